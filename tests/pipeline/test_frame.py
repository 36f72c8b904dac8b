"""Booms in a frame that moves, from the scene to forces and deflections."""

from pathlib import Path

import numpy as np
import plain_machines
import pytest
from newton_euler import needed, of_masses

import pmr
from pmr import Response
from pmr import scene as scenes
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.simulated import excitation_of_scene
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.pipeline.full_order import FullOrder
from pmr.simulation.native import systems
from pmr.simulation.reactions import with_pivot_force

pytestmark = pytest.mark.slow  # seconds each, the crane's full model half a minute
RAISED = f"frame.luffing={np.deg2rad(50.0)}"
PIVOT = "frame.pivot=[0.0, 0.0, 0.0]"
#: Three times as long as in the scene, with a third of the stations on their paths: few loads to answer.
LONG_PADS = tuple(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45"))
#: Three planar sections, their payload and a load, for a moment.
SHORT = ("time.end=0.2", "section.mesh.elements=8", "section.reduction.estimate=false", "compare.against=[]")


def moved(name: str | Path, *changes: str) -> Response:
    scene = scenes.load_any(name, changes)
    return pmr.simulate(scene, pmr.reduce(scene).reduced)


@pytest.mark.parametrize(
    ("name", "changes"),
    [("boom_three", SHORT), ("boom_beam", ("time.end=0.2", "mesh.elements=20", "compare.against=[]"))],
)
def test_gravity_that_a_frame_at_rest_has_turned_is_gravity_given_so(name: str, changes: tuple[str, ...]) -> None:
    given, turned = moved(name, *changes, "gravity.inclination=50.0"), moved(name, *changes, PIVOT, RAISED)
    # of the same equations: round-off of a step, 1e-13 of the largest, in some hundred of them
    assert turned.displacement == pytest.approx(given.displacement, abs=1e-10 * np.abs(given.displacement).max())
    assert turned.slider_force == pytest.approx(given.slider_force, abs=1e-9 * np.abs(given.slider_force).max())


def test_a_force_along_the_ground_is_its_parts_along_a_boom_at_rest() -> None:
    """Raised by 50 degrees, slewed by -30, in space; second order takes the part along the boom as it takes any."""
    quick = (
        *("section.mesh.elements=4", "time.end=0.1", "gravity.rise=0.05", "compare.against=[]", "frame.unit=rad"),
        *(
            f"frame.luffing={np.deg2rad(50.0)}",
            f"frame.slewing={np.deg2rad(-30.0)}",
            "section.reduction.estimate=false",
        ),
        "frame.second_order=true",
        *LONG_PADS,
    )
    frame = scenes.load_any(plain_machines.CRANE, quick).frame
    assert frame is not None
    towards = frame.rotation(0.0)[0, 0]

    def pushed(name: str, direction: str, force: float, axes: str = "body") -> str:
        signal = f"{{kind='smooth_ramp', times=[0.0, 0.05], values=[0.0, {force!r}]}}"
        return f"{{name='{name}', axes='{axes}', on='tip', direction='{direction}', signal={signal}}}"

    parts = [pushed(f"f {axis}", axis, 900.0 * float(part)) for axis, part in zip("xyz", towards, strict=True)]
    loads = [pushed("f", "x", 900.0, "ground")], parts
    one, three = (moved(plain_machines.CRANE, *quick, f"sections.fly.loads=[{','.join(some)}]") for some in loads)
    assert one.displacement == pytest.approx(three.displacement, abs=1e-10 * np.abs(three.displacement).max())
    assert one.slider_force == pytest.approx(three.slider_force, abs=1e-9 * np.abs(three.slider_force).max())


LUFFING = Path(__file__).parent / "luffing.toml"
#: So stiff that sections lag by (omega T)^-2 = 1e-7 of a load, on elements so few that round-off stays below that.
RIGID = (
    "section.body.material={young=2.1e15, poisson=0.3, density=7850.0}",
    "section.mesh.elements=2",
    "section.reduction.coordinates=4",
    "section.reduction.estimate=false",
    "section.joint.tail.0.stiffness=1e13",
    "section.joint.mouth.0.stiffness=1e13",
    "sections.fly.loads.0.signal=0.0",
    "frame.pivot=[0.4, 0.0, 0.7]",
    "time.end=12.0",
    "time.step=4e-3",
    "time.rho_inf=0.6",
)


def test_rigid_sections_press_and_push_as_newton_and_euler_say() -> None:
    scene = scenes.load_any(LUFFING, RIGID)
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    each = [needed(scene, number, found.t) for number in range(3)]
    beyond = [(sum(one.force for one in each[k:]), sum(one.moment for one in each[k:])) for k in range(3)]
    largest, turning = np.abs(beyond[0][0]).max(), np.abs(beyond[0][1]).max()
    for name, expected, size in (
        ("x", -beyond[0][0][:, 0], largest),
        ("z", -beyond[0][0][:, 2], largest),
        ("ry", -beyond[0][1][:, 1], turning),
    ):
        assert found.other(f"reaction of pivot {name}") == pytest.approx(expected, abs=1e-6 * size)
    for k, name in ((1, "middle"), (2, "fly")):
        cylinder = found.force(f"force of cylinder of {name}")
        tail, mouth = (found.force(f"force of {name} {end}") for end in ("tail", "mouth"))
        assert cylinder == pytest.approx(beyond[k][0][:, 0], abs=1e-6 * largest)
        assert tail + mouth == pytest.approx(-beyond[k][0][:, 2], abs=1e-6 * largest)
        # moment about y at the pivot, of forces across at their places and of the cylinder on the axis
        at_tail = 0.4 + 0.15 + sum(scene.extension(j).value(found.t) for j in range(1, k + 1))
        at_mouth = 0.4 + 6.0 - 0.15 + sum(scene.extension(j).value(found.t) for j in range(1, k))
        turned = at_tail * tail + at_mouth * mouth + 0.7 * cylinder
        assert turned == pytest.approx(beyond[k][1][:, 1], abs=1e-6 * turning)


SMOOTH = (
    *(f"{path}.degree=9" for path in ("section.joint.extension", "sections.fly.joint.extension")),
    *(f"frame.{angle}.degree=9" for angle in ("luffing", "slewing")),
)


def test_rigid_sections_in_space_press_and_push_as_newton_and_euler_say() -> None:
    stiff = [key for key in RIGID if not key.startswith(("time.end", "section.reduction.coo", "section.joint"))]
    pads = [f"section.joint.{end}.0.stiffness=1e12" for end in ("tail", "mouth")]
    changes = ["sections.base.supports.1.stiffness=1e13", "section.reduction.coordinates=8", "damping.ratio=0.0"]
    scene = scenes.load_any(plain_machines.CRANE, [*stiff, *pads, *changes, *SMOOTH, "time.end=16.0"])
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    each = [needed(scene, number, found.t) for number in range(3)]
    force, moment = sum(one.force for one in each), sum(one.moment for one in each)
    largest, turning = np.abs(force).max(), np.abs(moment).max()
    for k, axis in enumerate("xyz"):
        assert found.other(f"reaction of pivot {axis}") == pytest.approx(-force[:, k], abs=1e-6 * largest)
        assert found.other(f"reaction of pivot r{axis}") == pytest.approx(-moment[:, k], abs=1e-6 * turning)
    pushed = {"bottom": (2, 1.0), "top": (2, -1.0), "right": (1, 1.0), "left": (1, -1.0)}
    for k, name in ((1, "middle"), (2, "fly")):
        carried = np.zeros_like(force)
        carried[:, 0] = found.force(f"force of cylinder of {name}")
        for pad in found.force_names:
            if pad.startswith((f"force of {name} tail", f"force of {name} mouth")):
                axis, sign = next(way for face, way in pushed.items() if face in pad)
                carried[:, axis] += sign * found.force(pad)
        assert carried == pytest.approx(sum(one.force for one in each[k:]), abs=1e-6 * largest)


#: At 0, 5, 10, 15 and 20 s in mm, of a planar code of its own, without second order (0.5 % of the largest, 220.9 mm).
TIP = (-13.5003, -36.028, -136.04, -181.66, -146.68)


def test_a_boom_that_luffs_and_slides_out_moves_as_another_code_says() -> None:
    scene = scenes.load_any(LUFFING, ["section.reduction.estimate=false"])
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    tip = 1e3 * found.of("tip", body="fly")[[0, 2500, 5000, 7500, 10000], 0]
    assert tip[0] == pytest.approx(TIP[0], abs=1e-3)  # nothing has moved
    assert tip == pytest.approx(TIP, rel=5e-3)
    for name, largest in (("middle", 8190.0), ("fly", 4720.0)):
        force = found.force(f"force of cylinder of {name}")
        assert np.abs(force).max() == pytest.approx(largest, rel=5e-3)


def test_what_the_pivot_bears_is_what_the_frame_s_momentum_says() -> None:
    undamped = ["section.reduction.estimate=false", "damping.ratio=0.0", "time.end=4.0"]
    scene = scenes.load_any(LUFFING, undamped)
    reduced = pmr.reduce(scene)
    excitation = excitation_of_scene(scene, reduced.system)
    run = systems.simulate(reduced.system, excitation, systems.start_of(reduced.system, excitation))
    found, h = with_pivot_force(scene, evaluate_motion(reduced.system, run)), scene.time.step
    for j, given in (("x", 0.0), ("z", scene.sections[2].loads[0].signal.value(run.t))):
        momentum, force = np.zeros_like(run.t), np.zeros_like(run.t) + given
        for number, (name, body) in enumerate(reduced.system.bodies.items()):
            momentum += run.bodies[name].v @ np.asarray(body.B)[:, body.input_names.index(f"inertia {j}")]
            mass, moment = of_masses(scene, number)
            force += mass * excitation.loads[f"{name}.inertia {j}"].value(run.t)
            force += moment * excitation.loads[f"{name}.inertia {j}x"].value(run.t)
        reaction = found.other(f"reaction of pivot {j}")
        # the trapezoidal rule, without damping: a step's change of momentum is the mean force times the step
        impulse = h / 2.0 * ((force - reaction)[1:] + (force - reaction)[:-1])
        assert impulse == pytest.approx(np.diff(momentum), abs=1e-9 * h * np.abs(reaction).max())


def test_the_crane_moves_as_its_full_model_does() -> None:
    short = ["section.mesh.elements=6", "time.end=6.0", "time.step=8e-3", *LONG_PADS]
    summary = pmr.run(scenes.load_any(plain_machines.CRANE, short)).result.summary
    errors = summary["errors"]["reduced_vs_full"]
    assert errors["tip"] < 1e-3 and errors["support_force"] < 1e-3
    assert errors["tip"] <= summary["estimate"]["tip"] <= 5.0 * errors["tip"]
    assert [one["name"] for one in summary["reactions"]][5:11] == [
        f"pivot {axis}" for axis in ("x", "y", "z", "rx", "ry", "rz")
    ]


#: The same with second order; the largest deflection and force of a pad, in mm and N.
BENT, LARGEST, PAD = (-13.5051, -36.059, -138.86, -179.65, -113.12), 222.13, 83640.0


def test_axial_forces_bend_what_is_bent_as_another_code_says() -> None:
    scene = scenes.load_any(LUFFING, ["section.reduction.estimate=false", "frame.second_order=true"])
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    tip = 1e3 * found.of("tip", body="fly")[:, 0]
    assert tip[[0, 2500, 5000, 7500, 10000]] == pytest.approx(BENT, rel=5e-3)
    assert tip[0] == pytest.approx(BENT[0], abs=1e-3)
    assert np.abs(tip).max() == pytest.approx(LARGEST, rel=5e-3)
    pads = [name for name in found.force_names if "cylinder" not in name]
    assert max(np.abs(found.force(name)).max() for name in pads) == pytest.approx(PAD, rel=5e-3)


def test_second_order_of_a_reduced_boom_is_that_of_its_full_model() -> None:
    changes = ["frame.second_order=true", "section.mesh.elements=20", "time.end=12.0", "time.step=4e-3"]
    summary = pmr.run(scenes.load_any(LUFFING, [*changes, "compare.against=['full']"])).result.summary
    errors = summary["errors"]["reduced_vs_full"]
    assert errors["tip"] < 1e-3 and errors["pad_force"] < 1e-3
    assert errors["tip"] <= summary["estimate"]["tip"]
    assert summary["frame"]["second_order"] and summary["buckling"]["factor"] > 1.0


#: The crane raised, slewed and drawn out from the first moment on.
MOVED = (
    "frame.luffing.times=[0.0, 12.0]",
    "frame.slewing.times=[0.0, 12.0]",
    "section.joint.extension.times=[0.0, 8.0]",
    "sections.fly.joint.extension.times=[0.0, 8.0]",
)


@pytest.mark.mpi
@pytest.mark.parametrize(("file", "moved"), [(LUFFING, ()), (plain_machines.CRANE, MOVED)], ids=["planar", "crane"])
def test_full_order_of_second_order_is_the_same_by_both_simulators(file: Path, moved: tuple[str, ...]) -> None:
    """Terms of a frame and of axial forces in PETSc, beside the compiled loop: the same scheme, so to round-off."""
    changes = ["frame.second_order=true", "section.mesh.elements=6", "time.end=0.2", "time.step=4e-3", *moved]
    tips = []
    for simulator in ("march", "petsc"):
        scene = scenes.load_any(file, [*changes, *LONG_PADS, f"simulation.full={simulator}"])
        found = FullOrder.join(scene, {name: one.model for name, one in build_bodies(scene).items()}).reference("full")
        if MPI.COMM_WORLD.rank == 0:
            assert found is not None
            tips.append(found.of("tip", body="fly"))
    if tips:
        np.testing.assert_allclose(tips[1], tips[0], atol=1e-8 * np.abs(tips[0]).max())


def test_a_run_in_a_frame_moves_it_as_a_saved_system_does() -> None:
    """The kernel follows the frame itself in both: not a bit differs."""
    scene = scenes.load_any("boom_three", (*SHORT, PIVOT, RAISED, "frame.second_order=true"))
    outcome = pmr.run(scene)
    assert outcome is not None
    response = outcome.result.responses["reduced"]
    for saved in (outcome.system, outcome.reduced):
        again = pmr.simulate(scene, saved)
        assert np.array_equal(again.displacement, response.displacement)
        assert np.array_equal(again.slider_force, response.slider_force)
