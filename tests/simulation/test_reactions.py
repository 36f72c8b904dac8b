"""Reactions of rigid supports: Newton's and Euler's equations of the full model, and the reduced one beside it."""

from pathlib import Path

import numpy as np
import pytest
from one_body import respond, simulate

from pmr import ReducedModel, run
from pmr import scene as scenes
from pmr.fullmodel.build import full_model
from pmr.pipeline import Outcome
from pmr.results.tables import reaction_extremes
from pmr.scene.built import GRAVITY
from pmr.simulation import Excitation
from pmr.system.body import FullBody

#: A beam that is clamped at one end and held at the other: statically indeterminate, whatever the slider does.
CLAMPED = (
    "mesh.elements=16",
    "time={end=1.0,step=2e-3}",
    "loads=[{on=3.0,direction='z',signal={kind='chirp',amplitude=50.0,times=[0.0,1.0],frequencies=[0.5,3.0]}}]",
    "slider.path={kind='smooth_ramp',times=[0.2,0.8],values=[1.0,2.0]}",
    "supports=[{on=0.0,kind='clamped'},{on=5.0,directions=['z'],name='end'}]",
    "damping={mass=0.1,stiffness=1e-4}",
    "simulation.simulators=['march']",
    "reduction={basis='free_modes',coordinates=6}",
    "compare.against=['full']",
)
NAMES = tuple(f"reaction of {name}" for name in ("support x at 0 m", "support z at 0 m", "support ry at 0 m", "end"))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    found = run(scenes.load("paper_evolved", CLAMPED))
    assert found is not None
    return found


def test_full_reactions_hold_the_supports_and_fulfil_newton() -> None:
    scene = scenes.load("paper_evolved", CLAMPED)
    body, excitation = full_model(scene).gather(), Excitation.from_scene(scene)
    assert isinstance(body, FullBody)
    f = excitation.forces(body.input_names)
    moved = simulate(body, excitation)
    response = respond(body, moved, excitation.path_rate, f)
    assert response.others is not None and response.other_names == NAMES
    assert response.other_units == ("N", "N", "N m", "N")
    # C^T lambda with the slider's multiplier and the reactions as they are reported
    slider = body.row_names.index("slider")
    C = np.array([body.C(s).toarray() for s in moved.s])
    pressed = moved.multipliers[:, [slider], None] * C[:, [slider]]
    pressed = pressed[:, 0] + response.others @ C[0][body.rows.fixed]
    force = f @ body.B.T - moved.v @ body.D.T - moved.q @ body.K.T - pressed
    acceleration = np.linalg.solve(body.M.toarray(), force.T).T
    held = acceleration @ C[0][body.rows.fixed].T
    assert np.abs(held).max() <= 1e-7 * np.abs(acceleration).max()  # eps |M^-1| |K| |q|; 1 if a reaction is wrong
    # Newton and Euler: load less slider and supports is the inertia of all, across and about the clamp
    x = np.linspace(0.0, 5.0, body.size // 3)
    motions = np.zeros((body.size, 2))
    motions[1::3, 0], motions[1::3, 1], motions[2::3, 1] = 1.0, x, 1.0
    inertia = (acceleration + 0.1 * moved.v) @ body.M.T @ motions
    _, z, ry, end = response.others.T
    push = moved.multipliers[:, slider]
    sums = np.column_stack([f[:, 0] - push - z - end, 3.0 * f[:, 0] - moved.s * push + ry * sign(body) - 5.0 * end])
    assert np.abs(sums - inertia).max() <= 1e-9 * np.abs(inertia).max()


def sign(body: FullBody) -> float:
    """Of the rotation that the support about y measures, beside the slope of the axis."""
    row = body.C(1.0)[body.row_names.index("support ry at 0 m")].toarray()[0]
    return -float(row[2])


@pytest.mark.slow
@pytest.mark.numerical
def test_reduced_reactions_are_as_good_as_the_forces_of_the_slider(outcome: Outcome) -> None:
    errors = outcome.result.summary["errors"]["reduced_vs_full"]
    largest = max(errors[name] for name in NAMES)
    assert 0.0 < largest <= 2.0 * errors["pad_force"] < 0.02
    assert errors[NAMES[0]] == 0.0  # nothing acts along the axis
    listed = {one["name"]: one for one in outcome.result.summary["reactions"]}
    reduced = outcome.result.responses["reduced"]
    assert listed["end"]["max"] == reduced.other("reaction of end").max()
    assert listed["support ry at 0 m"]["unit"] == "N m"


@pytest.mark.slow
def test_a_saved_model_tells_them_too(outcome: Outcome, tmp_path: Path) -> None:
    scene, model = outcome.result.scene, ReducedModel.load(outcome.reduced.save(tmp_path / "reduced.npz"))
    excitation = Excitation.from_scene(scene)
    f = excitation.forces(model.input_names)
    again = respond(model, simulate(model, excitation), excitation.path_rate, f)
    found, first = (reaction_extremes(one, excitation.s[:, 0]) for one in (again, outcome.result.responses["reduced"]))
    assert [(of.support, of.unit) for of in found] == [(of.support, of.unit) for of in first]
    for of, one in found.items():
        assert one.highest.value == pytest.approx(first[of].highest.value, rel=1e-9, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("full", ["petsc", "exudyn"])
def test_every_simulator_of_full_models_tells_the_same(outcome: Outcome, full: str) -> None:
    scene = scenes.load("paper_evolved", (*CLAMPED, f"simulation.full={full}"))
    found = run(scene)
    assert found is not None
    for name in NAMES[1:]:
        one, other = (of.result.responses["full"].other(name) for of in (found, outcome))
        assert np.abs(one - other).max() <= 1e-7 * np.abs(other).max()


@pytest.mark.slow
def test_a_rigid_support_bears_what_a_stiff_one_does() -> None:
    asked = [*CLAMPED, "supports=[{on=0.0,kind='pinned'},{on=5.0,directions=['z'],name='end'}]", "compare.against=[]"]
    stiff = [*asked, "supports=[{on=0.0,kind='pinned'},{on=5.0,directions=['z'],name='end',stiffness=1e9}]"]
    outcomes = [run(scenes.load("paper_evolved", each)) for each in (asked, stiff)]
    rigid, spring = (one.result.responses["reduced"] for one in outcomes if one is not None)
    force = spring.force("force of end")
    assert np.abs(rigid.other("reaction of end") - force).max() <= 0.01 * np.abs(force).max()


@pytest.mark.slow
def test_the_clamp_of_a_boom_of_sections_bears_all_of_them() -> None:
    still = ("section.joint.extension=2.0", "damping={mass=40.0}", "sections.fly.loads=[]", "time.end=2.5")
    both_ways = ("section.joint.tail.0.unilateral=false", "section.joint.mouth.0.unilateral=false")
    few = ("section.mesh.elements=12", "compare.against=[]", "gravity.rise=0.5")
    boom = scenes.load_any("boom_two", [*still, *both_ways, *few])
    outcome = run(boom)
    assert outcome is not None
    response, weight, moment = outcome.result.responses["reduced"], 0.0, 0.0
    for part, tail in zip(boom.sections, (0.0, 2.0), strict=True):
        box = part.body.box
        mass = part.body.material.density * box.length * 2.0 * box.wall * (box.width + box.height)
        weight, moment = weight + GRAVITY * mass, moment + GRAVITY * mass * (tail + box.length / 2.0)
        for one in part.masses:
            weight, moment = weight + GRAVITY * one.mass, moment + GRAVITY * one.mass * (tail + box.length)
    assert response.other("reaction of base: clamp z")[-1] == pytest.approx(-weight, rel=1e-6)
    assert response.other("reaction of base: clamp ry")[-1] == pytest.approx(moment, rel=1e-6)
    listed = {one["name"]: one["unit"] for one in outcome.result.summary["reactions"]}
    assert listed == {"base: clamp x": "N", "base: clamp z": "N", "base: clamp ry": "N m"}
