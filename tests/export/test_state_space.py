"""State space and frequency response with the sliders held, read back and against the equations as they are.

A state space in Modelica: its text read back, and simulated beside the compiled loop with its places held.
"""

import re
import runpy
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.io
import scipy.signal
from modelica_text import declared_array
from nested import Nested, reduced
from numpy.typing import NDArray
from on_pads import beam_on_pads, flexible_on_pads
from oracle import flexible, project, rich_body

from pmr import InputError, ReducedModel, System
from pmr.export.control import RESERVED, write_modelica
from pmr.export.formats import Options
from pmr.export.state_space import path_positions, state_space
from pmr.scene.signals import Constant, Sine
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.native import systems

S = np.array([1.7, 2.3, 2.9])


@pytest.fixture(scope="module")
def model() -> ReducedModel:
    """Two sliders, a force and a moment, damping."""
    return replace(flexible(rich_body(), 6), pads=np.array([2e-6, 3e-6]))


@pytest.fixture
def saved(model: ReducedModel, tmp_path: Path) -> Path:
    return model.save(tmp_path / "reduced.npz")


def response(model: ReducedModel, s: float, w: float) -> NDArray[np.complex128]:
    """Outputs and forces (q, i) from the equations with their multipliers, in the model's own coordinates."""
    tables, C, r = model.flexibility, model.C(s), model.size
    assert tables is not None
    F = tables.rows(s) + np.diag(model.row_compliance)
    dynamic = model.K + 1j * w * model.D - w**2 * model.M
    x = np.linalg.solve(np.block([[dynamic, C.T], [C, -F]]), np.vstack([model.B, -tables.inputs(s)]))
    y = model.outputs @ x[:r] + tables.direct - tables.outputs(s) @ x[r:]
    return np.vstack([y, x[r:]])


def test_matlab_and_python_control_read_the_same(saved: Path, model: ReducedModel, run_command) -> None:
    target = saved.with_name("boom.py")
    done = run_command("export", str(saved), "--to", "python-control", "--at", "2.3,1.7,2.9", "--out", str(target))
    assert done.returncode == 0, done.stderr
    space, data = state_space(System.of(model), {"slider": S}, "model"), scipy.io.loadmat(target.with_suffix(".mat"))
    np.testing.assert_array_equal(data["s"].ravel(), S)
    for name in "ABCD":
        np.testing.assert_array_equal(np.moveaxis(data[name], 2, 0), getattr(space, name))
    assert [str(cell[0]) for cell in data["outputs"].ravel()] == list(space.outputs)
    script = runpy.run_path(str(target))
    for k, s in enumerate(S):
        one = script["nearest"](s + 0.01)
        assert isinstance(one, control.StateSpace) and one.ninputs == 2 and one.noutputs == len(space.outputs)
        expected = response(model, s, 40.0)
        np.testing.assert_allclose(one(40.0j), expected, rtol=1e-9, atol=1e-10 * np.abs(expected).max())
        assert k == int(np.argmin(np.abs(script["S"] - s)))


def test_interpolated_matrices_are_as_far_off_as_the_file_says(
    saved: Path, model: ReducedModel, caplog, run_command
) -> None:
    """Static gains halfway between places, beside the equations; without --at within 1 %."""
    found = []
    for at in ("1.7,2.3,2.9", None):
        target = saved.with_name(f"boom{at is None}.mat")
        more = () if at is None else ("--at", at)
        done = run_command("export", str(saved), "--to", "matlab", *more, "--out", str(target))
        assert done.returncode == 0, done.stderr
        data, m = scipy.io.loadmat(target), len(model.outputs)
        s, off, size = data["s"].ravel(), [], []
        for k in range(len(s) - 1):
            A, B, C, D = ((data[name][:, :, k] + data[name][:, :, k + 1]) / 2.0 for name in "ABCD")
            exact = response(model, (s[k] + s[k + 1]) / 2.0, 0.0).real[:m]
            off.append(np.abs((D - C @ np.linalg.solve(A, B))[:m] - exact))
            size.append(np.abs(exact))
        units = [str(cell[0]) for cell in data["units"].ravel()][:m]
        largest = np.max(size, axis=0)
        largest[largest <= 1e-12 * largest.max()] = np.inf  # what does not move at all
        worst = (np.max(off, axis=0) / largest)[[unit == "m" for unit in units]].max()
        assert data["interpolation"]["static_gain"][0, 0].item() == pytest.approx(worst, rel=1e-6)
        found.append((worst, len(s), "halfway between two of the" in caplog.text))
        caplog.clear()
    (coarse, few, warned), (fine, many, silent) = found
    assert few == 3 and coarse > 0.01 and warned
    assert many >= 21 and fine <= 0.01 and not silent


@pytest.mark.slow
def test_a_table_and_a_picture(saved: Path, model: ReducedModel, run_command) -> None:
    done = run_command("export", str(saved), "--to", "frequency-response", "--at", "1.7,2.3")
    assert done.returncode == 0, done.stderr
    table = np.genfromtxt(saved.with_name("frequency_response.csv"), delimiter=",", skip_header=1)
    assert table.shape == (800, 6) and saved.with_name("frequency_response.png").read_bytes()[:4] == b"\x89PNG"
    for row in table[[0, 399, 650]]:
        expected = response(model, row[0], 2.0 * np.pi * row[1])[len(model.outputs) - 1]
        np.testing.assert_allclose(row[[2, 4]], np.abs(expected), rtol=1e-6)
        np.testing.assert_allclose(row[[3, 5]], np.degrees(np.angle(expected)), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("asked", ["1.7;2", "9", "nan", ""])
def test_places_off_the_path_are_refused(model: ReducedModel, asked: str) -> None:
    with pytest.raises(InputError, match=r"--at = .*: places from 0 to "):
        path_positions(System.of(model), asked)


def test_what_leaves_no_state_space_is_refused(tmp_path: Path, run_command) -> None:
    rich = rich_body()
    for model, says in (
        (project(rich, np.eye(rich.size)[:, 2:]), "slider.* are rigid"),
        (flexible_on_pads(beam_on_pads(1e-4), 6), "only push"),
    ):
        with pytest.raises(InputError, match=says):
            state_space(System.of(model), {"slider": np.array([2.0, 2.5])}, "model")
    done = run_command("export", "reduced.npz", "--to", "exudyn", "--at", "2")
    assert done.returncode == 2 and "it is allowed with --to matlab" in done.stderr
    done = run_command("export", "reduced.npz", "--to", "[/red]")  # no markup of what is shown meanwhile
    assert done.returncode == 2 and "--to = '[/red]': one of exudyn" in done.stderr


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


def test_a_name_that_is_none_is_refused(system: System, tmp_path: Path, run_command) -> None:
    saved = str(system.save(tmp_path / "system.npz"))
    for name in ("when.mo", "2.mo", "boom.txt"):
        out = str(tmp_path / name)
        done = run_command("export", saved, "--to", "modelica", "--at", "2", "--out", out)
        assert done.returncode == 2 and "with .mo, is allowed" in done.stderr
    done = run_command("export", saved, "--to", "modelica", "--at", "2")
    assert done.returncode == 0 and (tmp_path / "StateSpace.mo").exists(), done.stderr
