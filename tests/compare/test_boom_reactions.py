"""Forces by which the ground holds a boom of sections: with loads, weight and inertia they sum to zero at all times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from pmr import ReducedModel, Response, System, pipeline
from pmr import scene as scenes
from pmr.compare.evaluation import evaluate_motion
from pmr.fem.compat import MPI
from pmr.files.arrays import Array
from pmr.fullmodel.build import AssembledBody, build_bodies
from pmr.reduction.bodies import reduce_bodies
from pmr.reduction.cache import ReducedBody
from pmr.reduction.recovery import Recovery
from pmr.scene import Scene
from pmr.scene.built import force_name, reaction_name
from pmr.scene.members import TAIL
from pmr.simulation import Excitation, SystemSimulator, exudyn
from pmr.simulation.native import systems
from pmr.system.body import force_outputs
from pmr.system.from_scene import system_of
from pmr.system.states import SystemTrajectory

AXES = ("x", "y", "z", "rx", "ry", "rz")
SHORT = (
    "section.mesh.elements=10", "compare.against=[]", "time.end=0.3", "section.reduction.estimate=false",
    "section.joint.extension={kind='smooth_ramp',times=[0.05,0.28],values=[0.6,0.8]}", "gravity.inclination=40.0",
)  # fmt: skip
SPACE = ("section.body.model=beam3d", "section.reduction.coordinates=9", "sections.base.reduction.coordinates=8")
ACROSS = "sections.fly.loads=[{name='side',on='tip',direction='y',signal={kind='sine',amplitude=300.0,frequency=4.0}}]"
TWO = "{at=0.15,stiffness=1e8,faces={bottom=[-0.08,0.08],top=[-0.08,0.08],left=[0.0],right=[0.0]}}"
JOINT = (f"section.joint.tail=[{TWO}]", f"section.joint.mouth=[{TWO}]")
PIN = "{name='pivot',directions=['x','y','z','rx','rz']}"
LUFFING = "{name='luffing',directions=['z'],on=1.5,stiffness=5e7}"
ON_PADS = (
    "sections.base.supports=[{name='stop',directions=['x']}]",
    "sections.base.pads=[{name='rear',at=0.4,stiffness=2e8,faces=FACES},"
    "{name='front',at=2.5,unilateral=true,stiffness=2e8,faces=FACES}]",
)


def on_pads(faces: str) -> tuple[str, ...]:
    return tuple(change.replace("FACES", faces) for change in ON_PADS)


CASES: Mapping[str, Sequence[str]] = {
    "clamp": (),
    "clamp on a spring": ("sections.base.supports=[{name='clamp',kind='clamped',stiffness=3e8}]",),
    "pivot": (f"sections.base.supports=[{{name='pivot'}},{LUFFING}]",),
    "pivot at 0.5 m": (f"sections.base.supports=[{{name='pivot',on=0.5}},{LUFFING}]",),
    "rigid cylinder": ("sections.base.supports=[{name='pivot'},{name='luffing',directions=['z'],on=1.5}]",
     "section.joint.cylinder.stiffness=2e7"),
    "held thrice": ("sections.base.supports=[{kind='clamped'},{name='prop',directions=['x','z'],on=3.0}]",),
    "pads": on_pads("{bottom=[0.0],top=[0.0]}"),
    "clamp in space": (*SPACE, *JOINT, ACROSS),
    "pivot in space": (*SPACE, *JOINT, ACROSS, f"sections.base.supports=[{PIN},{LUFFING}]"),
    "pads in space": (*SPACE, *JOINT, ACROSS, *on_pads("{bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],right=[0.0]}")),
}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A boom's sections, and how they move."""

    boom: Scene
    built: Mapping[str, AssembledBody]
    sections: Mapping[str, ReducedBody]
    system: System
    excitation: Excitation
    moved: SystemTrajectory

    @property
    def response(self) -> Response:
        return evaluate_motion(self.system, self.moved)


def run(changes: Sequence[str], simulator: SystemSimulator = systems.simulate) -> Run:
    boom = scenes.load_any("boom_two", [*SHORT, *changes])
    built = build_bodies(boom, MPI.COMM_SELF)
    sections = reduce_bodies(boom, built)
    system = system_of(boom, {name: one.model for name, one in sections.items()})
    excitation = Excitation.from_scene(boom)
    moved = simulator(system, excitation, systems.static_start(system, excitation))
    return Run(boom, built, sections, system, excitation, moved)


def shifted(directions: Sequence[str], X: Array) -> Array:
    """What forces (T, k) at a tail X (T,) m ahead of the origin are about the origin, (T, 6, k) along `AXES`."""
    A = np.zeros((len(X), 6, len(directions)))
    for k, direction in enumerate(directions):
        A[:, AXES.index(direction), k] = 1.0
        if direction == "z":
            A[:, AXES.index("ry"), k] = -X
        if direction == "y":
            A[:, AXES.index("rz"), k] = X
    return A


def balance(found: Run) -> dict[str, Array]:
    """Wrenches (T, 6) on the whole machine about the tail of its base: loads and weight, inertia, and of the ground.

    What Rayleigh damping takes, some of it to the ground, counts with the inertia.
    """
    moved, response, paths = found.moved, found.response, found.boom.paths
    ahead, first = np.zeros(len(moved.t)), 0
    parts = {name: np.zeros((len(moved.t), 6)) for name in ("loads", "inertia", "ground")}
    for name, body in found.system.bodies.items():
        ahead = ahead + paths[name].value(moved.t) if name in paths else ahead
        built, motion = found.built[name], moved.bodies[name]
        assert isinstance(body, ReducedModel) and built.model.rigid is not None
        full, V = built.model.gather(), Recovery(built.model, found.sections[name].V, body).V
        assert full is not None
        R, A = built.model.rigid.coordinates, shifted(built.structure.model.directions, ahead)
        f = moved.loads[:, first : first + len(body.input_names)]
        first += len(body.input_names)

        def add(part: str, work: Array, A: Array = A) -> None:
            parts[part] += np.einsum("tdk,tk->td", A, work)

        force = f @ body.B.T - motion.v @ body.D.T - motion.q @ body.K.T
        sides = [side for side in found.system.sides if side.place.body == name]
        for side, x, multiplier in zip(sides, motion.s.T, motion.multipliers.T, strict=True):
            row = built.model.carriers.row(full.row_names.index(side.place.row), side.place.row)
            measured = np.asarray(row.at(x) @ np.hstack([R, V]))
            force -= multiplier[:, None] * measured[:, R.shape[1] :]
            if found.system.contacts[side.contact].outer is None and side.place.row != TAIL:  # pads on the ground
                add("ground", -multiplier[:, None] * measured[:, : R.shape[1]])
        acceleration = np.linalg.solve(body.M, force.T).T
        add("loads", f @ (R.T @ full.B).T)
        add("inertia", -acceleration @ (R.T @ full.M @ V).T - motion.v @ (R.T @ full.D @ V).T)
        held = [(reaction_name(f"{name}: {row.name}"), row.at(row.breaks[0])) for row in full.rows.rows if row.is_fixed]
        for said, c in held:
            add("ground", -response.other(said)[:, None] * (c @ R))
        pads = built.structure.pads
        stiffness = {force_name(one.name): one.stiffness for one in (*pads.supports, *pads.fixed)}
        for k in np.flatnonzero(force_outputs(full)):
            said = full.output_names[k]
            add("ground", -response.force(f"{name}: {said}")[:, None] * (full.outputs[k] @ R) / stiffness[said])
    return parts


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_what_the_ground_holds_with_is_in_balance_with_all_else(case: str) -> None:
    """To 1e-9 of the largest of weight and inertia, forces and moments by themselves."""
    parts = balance(run(CASES[case]))
    left = np.sum(list(parts.values()), axis=0)
    for kind in (slice(0, 3), slice(3, 6)):
        assert np.abs(left[:, kind]).max() <= 1e-9 * np.abs(parts["loads"][:, kind]).max()


@pytest.mark.slow
def test_exudyn_tells_the_same_reactions() -> None:
    parts = balance(run(CASES["pivot"], exudyn.simulate_system))
    left, loads = np.sum(list(parts.values()), axis=0), parts["loads"]
    assert np.abs(left).max() <= 1e-9 * np.abs(loads).max()


@pytest.mark.slow
def test_a_summary_has_all_supports_whether_they_give_way_or_not() -> None:
    boom = scenes.load_any("boom_two", [*SHORT, *CASES["pivot"]])
    outcome = pipeline.run(boom)
    assert outcome is not None
    found = {one["name"]: one for one in outcome.result.summary["reactions"]}
    assert set(found) == {"base: pivot x", "base: pivot z", "base: luffing"}
    luffing = outcome.result.responses["reduced"].force("base: force of luffing")
    assert found["base: luffing"]["min"] == luffing.min() and found["base: luffing"]["unit"] == "N"
    resultants = {one["name"]: one for one in outcome.result.summary["supports"]}
    of_pivot = [outcome.result.responses["reduced"].other(f"reaction of base: pivot {axis}") for axis in "xz"]
    assert resultants["base: pivot"]["max"] == np.linalg.norm(of_pivot, axis=0).max()
    assert resultants["base: luffing"]["min"] == luffing.min() and len(resultants) == 2
    assert not any("along x" in line for line in outcome.result.summary["warnings"])


@pytest.mark.slow
def test_what_beams_without_axial_coordinates_do_not_know_is_said() -> None:
    """A boom of them has neither cylinders nor reactions along it."""
    ring = [{"at": 0.15, "unilateral": False}]
    profile = {"length": 6.0, "bending_stiffness": 1e7, "mass_per_length": 80.0}
    joint = {
        "extension": {"kind": "smooth_ramp", "times": [0.0, 0.1], "values": [0.6, 0.7]},
        "tail": ring,
        "mouth": ring,
    }
    boom = Scene.model_validate(
        {
            "title": "no axial coordinates",
            "section": {"body": {"profile": profile}, "mesh": {"elements": 10}, "reduction": {"coordinates": 4}},
            "sections": [
                {"name": "base", "supports": [{"name": "clamp", "kind": "clamped"}]},
                {"name": "fly", "joint": joint},
            ],
            "time": {"end": 0.1, "step": 2e-3},
            "compare": {"against": []},
        }
    )
    outcome = pipeline.run(boom)
    assert outcome is not None
    assert {one["name"] for one in outcome.result.summary["reactions"]} == {"base: clamp z", "base: clamp ry"}
    said = "base, fly: planar beams without coordinates along x"
    assert any(line.startswith(said) for line in outcome.result.summary["warnings"])


@pytest.mark.slow
def test_what_a_clamp_of_all_points_bears_is_said_to_be_missing() -> None:
    clamp = "sections.base.supports=[{kind='clamped',points='all'}]"
    outcome = pipeline.run(scenes.load_any("boom_two", [*SHORT, clamp]))
    assert outcome is not None and "reactions" not in outcome.result.summary
    said = "forces of supports with points = 'all' (base: tail) are not computed"
    assert any(line.startswith(said) for line in outcome.result.summary["warnings"])


@pytest.mark.slow
def test_a_clamp_of_the_full_model_is_no_contact() -> None:
    """Its moment, which holds all rotations of a face at once, is a reaction as the reduced model's is."""
    changes = [*SHORT, "time.end=0.05", "compare.against=['full']", "simulation.full=march"]
    result = pipeline.run(scenes.load_any("boom_two", changes)).result
    assert result.responses["full"].force_names == result.responses["reduced"].force_names
    assert result.summary["errors"]["reduced_vs_full"]["reaction of base: clamp ry"] < 1e-4
