"""The model's part of the budget: answers of a system, and what two of them are apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr.compare.model_part import KINDS, Answers, answers, compared, model_part, steps_of
from pmr.scene import load_any
from pmr.simulation import Excitation
from pmr.simulation.excitation import places
from pmr.system.assembly import Assembly
from pmr.system.statics import equilibrium

WORKFLOWS = Path(__file__).parents[2] / "workflows"
BEAM, TIP, PAD = (KINDS.index(kind) for kind in ("beam", "tip", "pad_force"))


def two() -> tuple[Answers, Answers]:
    """At two places, of two loads; the richer one has an output that the other one lacks."""
    rng = np.random.default_rng(5)
    keys = [(BEAM, "z at 1 m"), (BEAM, "z at 2 m"), (TIP, "tip z"), (PAD, "top")]
    own = Answers(np.array([[2.0, 3.0], [4.0, 5.0]]), {key: rng.uniform(-1.0, 1.0, (2, 2)) for key in keys})
    richer = {key: values * (1.25 if key[0] == BEAM else 2.0) for key, values in own.values.items()}
    return own, Answers(own.frequencies / [[1.0, 1.1], [1.6, 1.0]], {(PAD, "left"): np.ones((2, 2))} | richer)


def test_parts_are_differences_over_what_the_richer_model_answers() -> None:
    scene = load_any(WORKFLOWS / "boom_beam.toml", [])
    found = model_part(scene, compared(*two()), "shell", ["a", "b"], np.array([3.0, 1e-3]))
    assert found["beam"] == pytest.approx(0.2) and found["tip"] == pytest.approx(0.5) == found["pad_force"]
    assert found["frequency"] == pytest.approx(0.6)
    assert np.array(found["frequencies"]["own"]) == pytest.approx(two()[0].frequencies)
    assert "cylinder_force" not in found and any("stress" in one for one in found["not_covered"])


def test_loads_count_by_their_largest_amplitude() -> None:
    scene = load_any(WORKFLOWS / "boom_beam.toml", [])
    own, richer = two()
    for values in richer.values.values():
        values[:, 1] = 7.0
    found = model_part(scene, compared(own, richer), "shell", ["a", "b"], np.array([3.0, 0.0]))
    assert found["beam"] == pytest.approx(0.2)
    still = model_part(scene, compared(own, richer), "shell", ["a", "b"], np.zeros(2))
    assert still["beam"] is None and still["frequency"] == pytest.approx(0.6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["boom_beam", "boom_two"])
def test_answers_are_those_of_an_equilibrium(name: str) -> None:
    """One section and several by the same code; pads that only push are taken as closed."""
    scene = load_any(WORKFLOWS / f"{name}.toml", ["compare.against=[]"])
    system, excitation = pmr.reduce(scene).system, Excitation.of(scene)
    both_ways = tuple(replace(one, clearance=None) for one in system.contacts)
    system = replace(system, contacts=both_ways)
    steps, assembly = steps_of(excitation), Assembly(system)
    s = excitation.s.sum(axis=1)
    assert s[steps[0]] == s.min() and s[steps[-1]] == s.max() and len(steps) == 3
    found, x = answers(system, excitation), places(system, excitation)[steps]
    f = np.random.default_rng(1).uniform(-1.0, 1.0, len(system.input_names))
    for k in range(3):
        rest = equilibrium(assembly, x[k], f)
        forces = dict(zip(system.contact_names, rest.forces, strict=True))
        for (kind, called), values in found.values.items():
            if called in forces and kind == PAD:
                assert values[k] @ f == pytest.approx(forces[called], rel=1e-6, abs=1e-8 * abs(rest.forces).max())
        assert found.frequencies[k] == pytest.approx(assembly.frequencies(x[k], 2), rel=1e-9)
