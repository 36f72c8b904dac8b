"""Cylinders and ropes that act beside the axis of sections: statics, moments in their place, and full models.

Pads hold both ways and the start is in equilibrium, so that every response is linear in the loads.
"""

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import Response, RunResult
from pmr import scene as scenes
from pmr.report.figures import space
from pmr.scene.choice import choose_model
from pmr.scene.members import NEXT_TAIL, TAIL, member_at

BOOMS = {"two": "boom_two.toml", "three": "boom_three.toml"}
WORKFLOWS = Path(__file__).parents[2] / "workflows"
LEVER = 6.0 - 2.0 * 0.15 - 2.0  # m between the pads of fly at its tail and those at the mouth
#: The base stands on a pin and a foot, so that its tail moves.
FEET = "[{name='pin',directions=['x','y','z','rx','rz'],on=1.5},{name='foot',directions=['z'],on=0.5,stiffness=5e7}]"
FACES = {
    "beam2d": "{bottom=[0.0],top=[0.0]}",
    "beam3d": "{bottom=[-0.05,0.05],top=[-0.05,0.05],left=[-0.05,0.05],right=[-0.05,0.05]}",
}


def settings(model: str, extension: str = "2.0") -> tuple[str, ...]:
    rings = f"at=0.15,unilateral=false,stiffness=1e8,faces={FACES.get(model, FACES['beam3d'])}"
    mesh = "{size=0.1,along=0.25}" if model == "shell" else "{elements=12}"
    return (
        f"section.body.model={model}", f"section.mesh={mesh}", f"section.joint.extension={extension}",
        f"section.joint.tail=[{{{rings}}}]", f"section.joint.mouth=[{{{rings}}}]", f"sections.base.supports={FEET}",
        "sections.fly.loads.0.signal=1000.0", "start=equilibrium", "gravity={inclination=60.0,rise=0.0}",
        "time={end=0.01,step=1e-3,rho_inf=0.9}", "compare.against=[]",
    )  # fmt: skip


def response(boom: str, *changes: str) -> Response:
    scene = scenes.load_any(WORKFLOWS / BOOMS[boom], changes)
    return pmr.simulate(scene, pmr.reduce(scene).system)


def moments(section: str, force: float, y: float, z: float) -> list[str]:
    """Loads that stand in for a force along x on the tail of `section` beside its axis."""
    return [
        f"{{name='{section} about {turn[1]}',on='tail',direction='{turn}',signal={moment!r}}}"
        for turn, moment in (("ry", force * z), ("rz", -force * y))
        if moment
    ]


@pytest.mark.parametrize(
    ("model", "y", "z"),
    [("beam2d", 0.0, 0.12), ("beam3d", 0.05, 0.12), pytest.param("shell", 0.05, -0.12, marks=pytest.mark.slow)],
)
def test_a_cylinder_beside_the_axis_bends_both_sections_as_two_opposite_moments(model: str, y: float, z: float) -> None:
    """To round-off; pads bear the moment of the force, F z over their distance, by the balance of the rigid fly."""
    still = settings(model)
    beside = response("two", *still, f"section.joint.cylinder.offset=[{y},{z}]")
    force = float(beside.force("force of cylinder of fly")[0])
    tip = "{name='tip force',on='tip',direction='z',signal=1000.0}"
    on_fly, on_base = (
        ", ".join(loads) for loads in ([tip, *moments("fly", force, y, z)], moments("base", -force, y, z))
    )
    moved = response("two", *still, f"sections.fly.loads=[{on_fly}]", f"sections.base.loads=[{on_base}]")
    plain = response("two", *still)
    assert np.abs(beside.displacement - moved.displacement).max() <= 1e-10 * np.abs(moved.displacement).max()
    assert np.abs(beside.slider_force - moved.slider_force).max() <= 1e-10 * np.abs(moved.slider_force).max()
    assert np.abs(beside.displacement - plain.displacement).max() > 0.01 * np.abs(plain.displacement).max()
    more = dict(zip(beside.force_names, beside.slider_force[0] - plain.slider_force[0], strict=True))
    for (one, other), arm in ((("bottom", "top"), z), (("left", "right"), -y)):
        for end in ("tail", "mouth"):
            up, down = (sum(f for name, f in more.items() if f"fly {end} {face}" in name) for face in (one, other))
            assert abs(up - down) == pytest.approx(abs(force * arm) / LEVER, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("model", ["beam2d", "beam3d"])
def test_a_rope_and_a_cylinder_beside_it_act_on_the_section_between_them_each_on_its_own_line(model: str) -> None:
    """To round-off the response to moments; a rope of 60 MN as the only spring along the boom gives way."""
    y = 0.0 if model == "beam2d" else 0.04
    still = (*settings(model), "sections.middle.loads=[]")
    rope = "sections.fly.joint.rope={EA=6e7,length=6.0%s}"
    beside = response("three", *still, f"sections.middle.joint.cylinder.offset=[{y},0.1]", rope % ",offset=[0.0,-0.08]")
    drive, pull = (float(beside.force(f"force of cylinder of {name}")[0]) for name in ("middle", "fly"))
    loads = {
        "base": moments("base", -drive, y, 0.1),
        "middle": [*moments("middle", drive, y, 0.1), *moments("and", -pull, 0.0, -0.08)],
        "fly": ["{name='tip force',on='tip',direction='z',signal=1000.0}", *moments("fly", pull, 0.0, -0.08)],
    }
    moved = response("three", *still, rope % "", *(f"sections.{of}.loads=[{','.join(on)}]" for of, on in loads.items()))
    assert np.abs(beside.displacement - moved.displacement).max() <= 1e-10 * np.abs(moved.displacement).max()
    assert np.abs(beside.slider_force - moved.slider_force).max() <= 1e-10 * np.abs(moved.slider_force).max()


@pytest.mark.slow
def test_reduced_booms_move_as_full_ones_and_the_estimate_says_how_nearly() -> None:
    """Over a smooth extension of cylinders above and below the axis; with none beside it pads are off by 2e-5."""
    scene = scenes.load_any(
        WORKFLOWS / "boom_three.toml",
        [
            *settings("beam2d", "{kind='smooth_ramp',times=[0.1,0.45],values=[1.0,1.14]}"),
            "time={end=0.5,step=1e-3,rho_inf=1.0}", "compare.against=['full']", "section.reduction.coordinates=5",
            "sections.middle.joint.cylinder.offset=[0.0,0.1]", "sections.fly.joint.cylinder.offset=[0.0,-0.08]",
        ],
    )  # fmt: skip
    outcome = pmr.run(scene)
    assert outcome is not None
    result: RunResult = outcome.result
    true, estimated = result.summary["errors"]["reduced_vs_full"], result.summary["estimate"]
    assert true["beam"] < 1e-4 and true["pad_force"] < 5e-3 and true["cylinder_force"] < 5e-3
    for kind in ("beam", "pad_force", "cylinder_force"):
        assert 1.0 < estimated[kind] / true[kind] < 1.6
    axes = space.side_view(result).axes[0]
    drawn = {str(line.get_label()): np.asarray(line.get_xydata()) for line in axes.lines}
    lines = drawn["cylinder of middle"][0] - drawn["base"][0], drawn["cylinder of fly"][0] - drawn["middle"][0]
    assert [np.linalg.norm(line) for line in lines] == pytest.approx([0.1, 0.08], rel=1e-9)
    assert lines[0][0] < 0.0 < lines[0][1] and lines[1][1] < 0.0 < lines[1][0]


def test_lines_of_action_make_rows_where_they_differ() -> None:
    """A pinned base needs the row though its tail can't move along the boom: it turns under the moment."""
    boom = WORKFLOWS / "boom_three.toml"
    above, below = "sections.middle.joint.cylinder.offset=[0.0,0.1]", "sections.fly.joint.cylinder.offset=[0.0,-0.1]"
    scene = scenes.load_any(boom, [above, below])
    points = [dict(member_at(scene, k).tail_points) for k in range(3)]
    up, down = (0.0, 0.0, 0.1), (0.0, 0.0, -0.1)
    assert points == [{TAIL: up}, {TAIL: up, NEXT_TAIL: down}, {TAIL: down}]
    one = scenes.load_any(boom, ["section.joint.cylinder.offset=[0.0,0.1]"])
    assert [dict(member_at(one, k).tail_points) for k in range(3)] == [{TAIL: up}] * 3
    assert member_at(scene, 0).content != member_at(one, 1).content != member_at(scene, 1).content
    assert choose_model(member_at(scenes.load_any(boom, ["section.body.model=auto", above]))).model == "beam2d"
    aside = "sections.middle.joint.cylinder.offset=[0.1,0.0]"
    assert choose_model(member_at(scenes.load_any(boom, ["section.body.model=auto", aside]))).model == "beam3d"


def test_a_pinned_base_turns_under_a_cylinder_beside_its_axis() -> None:
    """However the pin is modelled; a support of all points removes the tail's own coordinate along the boom."""
    beside, foot = "section.joint.cylinder.offset=[0.0,0.3]", "{name='foot',directions=['z'],on=1.5,stiffness=5e7}"
    pinned, also, straight = (
        response("two", *settings("beam2d"), f"sections.base.supports=[{{name='pin',points='{points}'}},{foot}]", *more)
        for points, more in (("all", [beside]), ("mean", [beside]), ("mean", []))
    )
    assert np.abs(pinned.displacement - also.displacement).max() <= 1e-9 * np.abs(also.displacement).max()
    assert np.abs(pinned.displacement - straight.displacement).max() > 1e-3 * np.abs(straight.displacement).max()
