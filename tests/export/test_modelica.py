"""A state space in Modelica: its text read back, and simulated beside the compiled loop with its places held."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
from modelica_text import declared_array
from nested import Nested, reduced
from numpy.typing import NDArray
from processes import called

from pmr.export.control import RESERVED, write_modelica
from pmr.export.formats import Options
from pmr.export.state_space import state_space
from pmr.scene.signals import Constant, Sine
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System

Array = NDArray[np.float64]
PLACES = {"1": np.array([1.5, 2.0])}


@pytest.fixture(scope="module")
def system() -> System:
    return reduced(Nested(2, elements=6), 3)


@pytest.fixture(scope="module")
def text(system: System, tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("modelica")
    target = write_modelica(system.save(folder / "system.npz"), folder / "Boom.mo", Options(at="1.5,2"))
    return target.read_text()


def declared(text: str, kind: str) -> dict[str, str]:
    """Units of inputs or outputs by their names."""
    return dict(re.findall(rf'^  {kind} Real (\w+)\(unit = "(.*?)"\) ".*";$', text, re.MULTILINE))


def test_its_numbers_are_those_of_the_state_space(system: System, text: str) -> None:
    """To the last digit; each input and output is defined once, by a name that is no word of Modelica."""
    space = state_space(system, PLACES, "system")
    for name in "ABCD":
        np.testing.assert_array_equal(declared_array(text, name), getattr(space, name))
    np.testing.assert_array_equal(declared_array(text, "s"), space.s)
    inputs, outputs = (list(declared(text, kind)) for kind in ("input", "output"))
    assert not {*inputs, *outputs} & RESERVED and len({*inputs, *outputs}) == len(space.inputs) + len(space.outputs)
    equations = text.split("\nequation\n")[1].splitlines()
    assert equations[:2] == [
        "  der(x) = A[place, :, :] * x + B[place, :, :] * f;",
        "  y = C[place, :, :] * x + D[place, :, :] * f;",
    ]
    assigned = [f"  f[{k}] = {name};" for k, name in enumerate(inputs, 1)]
    assert equations[2:] == [*assigned, *(f"  {name} = y[{k}];" for k, name in enumerate(outputs, 1)), "end Boom;"]
    assert set(declared(text, "input").values()) == {"N", "m/s2"} and set(declared(text, "output").values()) >= {
        "m",
        "N",
    }


@pytest.mark.numerical
def test_simulated_it_is_the_compiled_loop_with_its_places_held(system: System, text: str) -> None:
    """From rest under 1 - cos: the loop's error is of second order in its step, so half of it leaves a quarter."""
    load, end = Sine(amplitude=1e3, frequency=200.0, offset=1e3, phase=-np.pi / 2.0), 5e-3
    loads = dict.fromkeys(system.input_names, load)
    A, B, C, D = (declared_array(text, name)[1] for name in "ABCD")
    off = []
    for step in (2e-5, 1e-5):
        stepping = TimeStepping(end, step, 1.0)
        found = systems.simulate(system, Excitation({"1": Constant(amount=2.0)}, loads, stepping))
        t = np.linspace(0.0, end, 2001)
        f = np.tile(load.value(t)[:, None], (1, B.shape[1]))
        _, y, _ = scipy.signal.lsim((A, B, C, D), f, t)
        moved = np.hstack([*systems.displacements(system, found).values(), found.forces])
        size = np.abs(moved).max(axis=0)
        every = round(step / t[1])
        off.append((np.abs(moved - y[::every])[:, size > 0.0] / size[size > 0.0]).max())
    assert off[0] < 1e-2
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.1)


def test_a_name_that_is_none_is_refused(system: System, tmp_path: Path, monkeypatch, capsys) -> None:
    saved = str(system.save(tmp_path / "system.npz"))
    for name in ("when.mo", "2.mo", "boom.txt"):
        out = str(tmp_path / name)
        done = called(monkeypatch, capsys, "export", saved, "--to", "modelica", "--at", "2", "--out", out)
        assert done.returncode == 2 and "with .mo, is allowed" in done.stderr
    done = called(monkeypatch, capsys, "export", saved, "--to", "modelica", "--at", "2")
    assert done.returncode == 0 and (tmp_path / "StateSpace.mo").exists(), done.stderr
