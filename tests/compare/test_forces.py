"""How far forces of two runs are apart, and which figures of a run a part of its budget covers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from driving import driven

import pmr
from pmr.compare.errors import force_errors, force_histories
from pmr.compare.forces import support_rows
from pmr.compare.model_part import Motion, model_budget
from pmr.compare.outputs import away_from_kinks
from pmr.compare.second_order import _second_order_steps
from pmr.compare.step_error import step_error
from pmr.compare.trust import budget_warnings, quantities_not_covered, reduction_warnings
from pmr.scene import Scene, load_any
from pmr.scene.signals import Constant, Table
from pmr.simulation import Excitation, TimeStepping

QUICK = ["compare.against=[]", "time.end=0.4", "time.step=4e-3", "mesh.elements=8"]
T = np.linspace(0.0, 1.0, 101)
PADS = {"left": 3e3 * np.sin(T), "right": 4e3 * np.sin(T)}


@pytest.fixture(scope="module")
def boom():
    """A beam on pads and its motion."""
    scene = load_any("boom_beam", QUICK)
    return scene, Motion.compute(scene, pmr.reduce(scene).system)


@pytest.mark.parametrize("size", [1.0, 1e-200, 1e200])
def test_a_kind_is_off_by_the_norm_of_all_of_its_forces(size: float) -> None:
    """3-4-5: only the left pad is off, by a tenth: 0.1 * 3 / 5."""
    own = {("pad_force", "N"): {"left": 1.1 * size * PADS["left"], "right": size * PADS["right"]}}
    reference = {("pad_force", "N"): {name: size * one for name, one in PADS.items()}}
    assert force_errors(own, reference) == pytest.approx({"pad_force": 0.06})


def test_forces_of_round_off_are_not_off() -> None:
    """A cylinder that bears 1e-13 N made the mesh "off by 130 %"; one that bears 1 N of 5 kN counts by a thousandth."""
    noise = np.random.default_rng(1).normal(size=(2, len(T)))
    for size, least, most in ((1e-13, 0.0, 1e-12), (1.0, 0.1, 1.0), (100.0, 1.0, 2.0)):
        one, other = ({("pad_force", "N"): PADS, ("cylinder_force", "N"): {"drive": size * of}} for of in noise)
        assert least <= force_errors(one, other)["cylinder_force"] <= most


def test_moments_are_beside_moments_and_the_larger_error_counts() -> None:
    reference = {("reaction", "N"): {"x": 1e3 * T}, ("reaction", "N m"): {"ry": 0.2 * T}}
    own = {("reaction", "N"): {"x": 1.01e3 * T}, ("reaction", "N m"): {"ry": 0.3 * T}}
    assert force_errors(own, reference) == pytest.approx({"reaction": 0.5})
    assert force_errors({("reaction", "N"): {"z": T}}, reference) == {}
    for forces, moment in ((own, 1e-12), (reference, -1e-12)):  # round-off beside the forces
        forces["reaction", "N m"] = {"rx": moment * T}
    assert force_errors(own, reference) == pytest.approx({"reaction": 0.01})
    nothing = {("reaction", "N"): {"x": 0.0 * T}}
    assert force_errors(nothing, nothing) == {}


def test_a_mesh_is_measured_by_frequencies_and_reactions_too(boom) -> None:
    scene, motion = boom
    response = motion.response
    others = 1.1 * np.asarray(response.others)
    other = replace(motion, frequencies=1.2 * motion.frequencies, response=replace(response, others=others))
    part = model_budget(scene, other, motion, "coarser mesh")
    assert part["frequency"] == pytest.approx(0.2) and part["reaction"] <= 0.1 * (1.0 + 1e-9)
    still = replace(motion, frequencies=np.zeros_like(motion.frequencies))
    assert model_budget(scene, still, still, "coarser mesh")["frequency"] is None  # rigid-body motions


def test_what_a_part_has_no_figure_for_is_named(boom) -> None:
    scene, motion = boom
    lacking = quantities_not_covered(scene, motion.response, {"beam": 0.1, "frequency": 0.2})
    assert lacking == ["pad forces", "stresses"]  # its cylinder bears nothing
    response = replace(motion.response, others=np.full_like(np.asarray(motion.response.others), 1e4))
    assert "reactions of rigid supports" in quantities_not_covered(scene, response, {})
    plain = scene.model_copy(update={"recovery": None})
    assert quantities_not_covered(plain, motion.response, {"pad_force": 0.0}, exact=("frequency",)) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["boom_beam", "boom_three"])
def test_the_steps_error_of_forces_is_that_beside_far_smaller_steps(name: str) -> None:
    elements = "mesh.elements=6" if name == "boom_beam" else "section.mesh.elements=3"
    changes = ["compare.against=[]", "time.end=1.0", elements]
    scene = load_any(name, [*changes, "time.step=0.01"])
    system = pmr.reduce(scene).system
    error = step_error(system, Excitation.from_scene(scene), complete=lambda response: response)
    fine = load_any(name, [*changes, "time.step=0.000625", "time.rho_inf=0.95"])
    own, reference = (pmr.simulate(one, system) for one in (scene, fine))
    sampled = {key: {n: f[::16] for n, f in of.items()} for key, of in force_histories(reference).items()}
    true = force_errors(force_histories(own), sampled)
    assert set(true) == set(error.errors) - {"beam", "tip"} and "pad_force" in true
    for kind, size in true.items():
        if kind not in error.unsettled and size > 1e-6:
            assert size < error.errors[kind] < 2.5 * size


def test_a_reduction_that_is_far_off_is_a_warning_by_itself() -> None:
    far = {"errors": {"reduced_vs_full": {"beam": 0.633, "tip": 0.05, "pad_force": 1.7}}}
    (said,) = reduction_warnings(far)
    assert "63 % in displacements, 170 % in pad forces (compared with the full model)" in said
    (said,) = reduction_warnings({"estimate": {"beam": 0.02, "tip": 0.01, "frequency": 0.2}})
    assert "20 % in natural frequencies (estimated)" in said
    assert reduction_warnings({"errors": {"reduced_vs_full": {"beam": 0.01, "tip": 0.02}}}) == []
    assert reduction_warnings(far | {"errors": {"reduced_vs_full": {"beam": 0.01, "pad_force": 0.9}},
                                                "impacts": {"pad_force": 0.001}}) == []  # fmt: skip


def test_walls_that_yield_at_pads_warn() -> None:
    scene = SimpleNamespace(compare=SimpleNamespace(model_tolerance=0.05), goal=None)
    walls = {"value": 284e6, "yield": 355e6, "section": "fly"}
    coarse, short = ({"model": {"beside": None, "wall_stress": walls | {"value": value}}} for value in (284e6, 426e6))
    assert not list(budget_warnings(scene, coarse))  # type: ignore[arg-type]
    assert list(budget_warnings(scene, short)) == [  # type: ignore[arg-type]
        "the stress in walls of fly at pads is about 1.2 times the yield stress, but the model stays elastic"
    ]


@pytest.mark.parametrize(("beside", "gives"), [("shell", True), ("plates_of_mine", True), ("beam3d", False)])
def test_walls_that_give_are_advised_beside_any_model_with_walls(beside: str, gives: bool) -> None:
    """A boom of boxes with pads and rigid walls; a model of an installed package is a shell or solid."""
    scene = load_any("boom_three", ["section.body.model='beam3d'", "compare.model_tolerance=0.05"])
    (line,) = budget_warnings(scene, {"model": {"beside": beside, "tip": 0.2}})
    assert ('set body.walls = "give"' in line) is gives and f"compared with a {beside}" in line


def test_the_kind_that_the_mesh_is_off_most_in_is_named() -> None:
    compare = SimpleNamespace(model_tolerance=0.05)
    scene = SimpleNamespace(compare=compare, goal=None)
    budget = {"mesh": {"beam": 1e-3, "frequency": 0.0712}}
    assert list(budget_warnings(scene, budget)) == [  # type: ignore[arg-type]
        "the mesh is off by up to 7.1 % in natural frequencies, more than compare.model_tolerance = 0.05; a finer one "
        "is closer"
    ]


@pytest.mark.parametrize(("every", "away"), [(5, 42), (1, 101)])
def test_where_a_kink_is_near_at_all_times_none_is_left_out(every: int, away: int) -> None:
    """As with an extension by a table: kinks at each fifth step leave two steps between them, at each step no step."""
    at = T[::every]
    path = Table(times=tuple(at), values=tuple(np.arange(len(at)) % 2.0), interpolation="linear")
    excitation = driven(path, Constant(amount=1.0), TimeStepping(1.0, 0.01))
    assert away_from_kinks(excitation, T, 0.0099).sum() == away
    assert len(_second_order_steps(excitation)) > 0


@pytest.mark.slow
def test_a_machine_bears_on_the_ground_and_is_no_support_of_the_boom() -> None:
    """A body alone on it, with forces on its supports as outputs: the clamp bears 6 m of steel box, not 12 t."""
    machine = {"mass": 12e3, "inertia": [8e3, 2e4, 2e4], "free": ["z"], "stiffness": {"z": 4e6}}
    body = {"model": "beam3d", "box": {"length": 6.0, "width": 0.3, "height": 0.4, "wall": 0.008}}
    clamped = {
        "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": 0.3, "machine": machine}, "body": body, "mesh": {"elements": 4},
        "supports": [{"name": "clamp", "on": "tail", "kind": "clamped"}], "gravity": {},
        "reduction": {"coordinates": 4}, "time": {"end": 0.05, "step": 1e-2}, "compare": {"against": []},
        "start": "equilibrium",
    }  # fmt: skip
    scene = Scene.model_validate({"title": "on a machine"} | clamped)
    response = pmr.simulate(scene, pmr.reduce(scene).system)
    (row,) = support_rows(scene, response)
    weight = 9.80665 * 7850.0 * 6.0 * (0.308 * 0.408 - 0.292 * 0.392)
    assert row["name"] == "clamp" and row["max"] == pytest.approx(weight, rel=0.2)
    assert np.abs(response.other("reaction of machine z")).max() > 12e3 * 9.0
