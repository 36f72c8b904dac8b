"""Numbers in another unit are hinted at by their key, with what is usual and the likely unit; usual ones are not."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from plain_machines import CRANE, OUTRIGGERS
from pydantic import BaseModel

from pmr import InputError
from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.hints import OTHER_UNITS, hints
from pmr.scene.keys import quantity_of, usual_ranges
from pmr.scene.signals import SignalBase
from pmr.studies import call

ROOT = Path(__file__).parents[2]
COMPLETE = [
    file
    for file in sorted((*(ROOT / "workflows").glob("**/*.toml"), *(ROOT / "pmr" / "cli" / "templates").glob("*.toml")))
    if "kind" not in (keys := scenes.tomlfiles.read_tables(file, "file"))
    and file.name not in ("paper_base.toml", "base.toml")
]
CYLINDER = "frame.cylinder={foot=[0.9,-1.1],lug=[2.6,-0.3]}"
SPRING = "supports=[{on=1.0,directions=[DIRECTIONS],stiffness=1e5}]"
STILL = "frame.second_order=false"
MACHINE = "frame.machine={mass=24e3,center=[0.0,0.0,-1.0],inertia=[3e4,6e4,6e4],free=['z'],stiffness={z=1e7}}"

#: Scene, keys in another unit than theirs, the key that is named, and the unit that is suggested.
WRONG = [
    ("boom_two", ["sections.fly.masses.payload.mass=0.25"], "sections[1].masses[0].mass", "t"),
    ("boom_two", ["sections.fly.masses.payload.mass=1.2"], "sections[1].masses[0].mass", "t"),
    ("boom_beam", ["masses.payload.at=[6000.0,0.0,0.0]"], "masses[0].at[0]", "mm"),
    ("boom_beam", ["masses.payload.at=[9.4,0.0,-0.4]"], "masses[0].at[0]", "mm"),  # a place in axes of a longer boom
    ("boom_beam", ["masses.payload.at=[6.0,0.0,-400.0]"], "masses[0].at[2]", "mm"),
    ("boom_beam", ["masses.payload.inertia=[5e6,5e6,5e6]"], "masses[0].inertia[0]", "kg mm^2"),
    ("boom_beam", ["pads.tail.stiffness=3e5"], "pads[0].stiffness", "N/mm"),
    ("boom_beam", ["pads.tail.stiffness=300.0"], "pads[0].stiffness", "kN/mm"),
    ("boom_beam", ["body.material.yield_stress=355.0"], "body.material.yield_stress", "MPa"),
    ("boom_beam", ["body.material.young=210e3"], "body.material.young", "MPa"),
    ("boom_beam", ["body.material.young=210.0"], "body.material.young", "GPa"),
    ("boom_beam", ["body.material.density=7.85"], "body.material.density", "t/m^3"),
    ("boom_beam", ["body.material.density=7.85e-9"], "body.material.density", "t/mm^3"),
    ("boom_shell", ["mesh.size=100.0"], "mesh.size", "mm"),
    ("boom_beam", ["loads.gust.signal=1.0"], "loads[1].signal", "kN"),
    ("boom_beam", ["damping.ratio=0.5"], "damping.ratio", "%"),
    ("boom_beam", ["gravity.inclination=0.8"], "gravity.inclination", "rad"),
    ("boom_beam", ["gravity.acceleration=9810.0"], "gravity.acceleration", "mm/s^2"),
    ("boom_beam", ["gravity.acceleration=1.0"], "gravity.acceleration", "g"),
    ("boom_beam", ["gravity.rise=1000.0"], "gravity.rise", "ms"),
    ("paper_simple", ["time.end=4.0", "time.step=2.0"], "time.step", "ms"),
    ("boom_beam", ["loads.gust.signal={kind='sine',amplitude=1e3,frequency=1.0,phase=90.0}"], "phase", "degrees"),
    ("boom_beam", ["loads.gust.signal={kind='step',time=5000.0,after=1e3}"], "loads[1].signal.time", "ms"),
    ("steel_boom", ["body.profile.bending_stiffness=6.09e13"], "body.profile.bending_stiffness", "N mm^2"),
    ("steel_boom", ["body.profile.axial_stiffness=2.35e6"], "body.profile.axial_stiffness", "kN"),
    ("platform", ["sections.fly.joint.rope.EA=2.8e4"], "sections[3].joint.rope.EA", "kN"),
    ("platform", ["sections.fly.joint.rope.length=9000.0"], "sections[3].joint.rope.length", "mm"),
    ("platform", ["sections.first.joint.cylinder.stiffness=5e4"], "sections[1].joint.cylinder.stiffness", "N/mm"),
    (CRANE, ["frame.luffing={kind='smooth_ramp',times=[1.0,7.0],values=[0.1,1.0]}"], "frame.luffing", "rad"),
    (CRANE, ["frame.slewing={kind='smooth_ramp',times=[1.0,7.0],values=[0.0,1.57]}"], "frame.slewing", "rad"),
    (CRANE, ["frame.unit=rad", "frame.slewing=0.0", "frame.luffing=40.0"], "frame.luffing", "degrees"),
    (CRANE, [CYLINDER.replace("0.9,-1.1", "900.0,-1100.0")], "frame.cylinder.foot", "mm"),
    (CRANE, [STILL, MACHINE.replace("24e3", "24.0").replace("e4", "e1")], "frame.machine.mass", "t"),
    (CRANE, [STILL, MACHINE.replace("-1.0]", "-1000.0]")], "frame.machine.center", "mm"),
    (CRANE, [STILL, MACHINE.replace("z=1e7", "z=100.0")], "frame.machine.stiffness.z", "N/mm"),
    ("boom_beam", [SPRING.replace("DIRECTIONS", "'z','ry'")], "supports[0].stiffness", "N/mm"),
    ("boom_beam", [SPRING.replace("DIRECTIONS", "'ry'").replace("1e5", "100.0")], "supports[0].stiffness", "kN m/rad"),
    (CRANE, ["frame.base={acceleration={x=300.0}}"], "frame.base.acceleration.x", "cm/s^2"),
]  # fmt: skip


@pytest.mark.parametrize("file", COMPLETE, ids=lambda file: file.stem)
def test_no_scene_that_comes_with_the_package_has_one(file: Path) -> None:
    assert hints(scenes.load_any(file)) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("gravity.direction=[0.0,0.0,1.0]", "the weight lifts this boom"),
        ("gravity={rise=10.0}", "the run ends at 8 s, when it has reached 94 %"),  # 6 u^5 - 15 u^4 + 10 u^3 at u = 0.8
        ("start='equilibrium'; gravity={rise=10.0}", "when it has reached 94 %; gravity.rise = 0 has the whole weight"),
        ("fatigue={slope=0.3,reference=71e6}", "fatigue.slope = 0.3 is unusual: 2 to 30 is usual here"),
    ],
)
def test_a_weight_that_is_wrong_and_a_flat_line_of_fatigue_are_hinted_at_once(change: str, said: str) -> None:
    probes = "probes=[{name='weld',at=[3.0,0.15,0.2]}]"
    (hint,) = hints(scenes.load_any("boom_beam", [*change.split("; "), probes, "time.end=8.0"]))
    assert said in hint


@pytest.mark.parametrize(("scene", "changes", "key", "unit"), WRONG, ids=[f"{case[2]} in {case[3]}" for case in WRONG])
def test_a_number_in_another_unit_is_hinted_at_once(scene: str | Path, changes: list[str], key: str, unit: str) -> None:
    (hint,) = hints(scenes.load_any(scene, changes))
    named, _, rest = hint.partition(" = ")
    assert key in named and " is usual here; is " in rest and f" {unit} (" in rest and " meant?" in rest


@pytest.mark.parametrize(("last", "said"), [(90.0, 0), (1.57, 1)])
def test_a_motion_that_the_run_cuts_off_is_judged_by_its_whole(last: float, said: int) -> None:
    """After 0.2 s it has not slewed by a degree; 1.57 is rad for degrees in a long run and in a short one."""
    motion = f"frame.slewing={{kind='smooth_ramp',times=[0.0,7.0],values=[0.0,{last}]}}"
    assert len(hints(scenes.load_any(CRANE, [motion, "time.end=0.2"]))) == said


def test_what_is_alike_has_one_hint_that_counts_it() -> None:
    soft = [
        f"section.joint.{end}=[{{at=0.15,stiffness=1e5,faces={{bottom=[0.0],top=[0.0]}}}}]" for end in ("tail", "mouth")
    ]
    tail, mouth = hints(scenes.load_any("boom_three", soft))
    assert tail == (
        "sections[1].joint.tail[0].stiffness = 100000 N/m is unusual: 2e+06 to 1e+14 N/m is usual here; is 100000 "
        "N/mm (1e+08 N/m) or 100000 kN/mm (1e+11 N/m) meant? (1 more like it)"
    )
    assert mouth.startswith("sections[1].joint.mouth[0].stiffness = 100000 N/m") and mouth.endswith("(1 more like it)")


def test_a_support_that_holds_angles_alone_has_a_stiffness_in_N_m_per_rad() -> None:
    """100 kN m/rad is a usual spring about an axis, and a soft one along it."""
    assert hints(scenes.load_any("boom_beam", [SPRING.replace("DIRECTIONS", "'ry'")])) == []


@pytest.mark.parametrize(("unit", "steep", "gentle"), [("degrees", 30.0, 8.0), ("rad", 0.52, 0.14)])
def test_a_steep_ground_is_hinted_at_in_the_unit_of_the_frame(unit: str, steep: float, gentle: float) -> None:
    still = [f"frame.unit={unit}", "frame.luffing=0.5", "frame.slewing=0.1"] if unit == "rad" else []
    (hint,) = hints(scenes.load_any(OUTRIGGERS, [*still, f"frame.ground.slope=[{steep},{gentle}]"]))
    assert hint.startswith(f"frame.ground.slope[0] = {steep:g} {unit} is unusual: up to ")
    assert hints(scenes.load_any(OUTRIGGERS, [*still, f"frame.ground.slope=[{gentle},-{gentle}]"])) == []


def test_nothing_is_said_of_what_is_zero_or_of_a_scale_that_only_a_mesh_knows() -> None:
    assert hints(scenes.load_any("boom_beam", ["masses.payload.mass=0.0", "loads.gust.signal=0.0"])) == []


@pytest.mark.parametrize("inertia", [[0.0, 0.0, 1.0], [1.0, 5.0, 1.0], [-0.0, 2.0, 1.0]])
@pytest.mark.parametrize("key", ["sections.fly.masses=[{name='m',on='tip',mass=90.0,inertia=INERTIA}]",
                                 "frame.machine={mass=24e3,inertia=INERTIA,free=['z']}"])  # fmt: skip
def test_an_inertia_that_no_body_can_have_is_refused(key: str, inertia: list[float]) -> None:
    says = r"inertia = \[.*\]: three moments are allowed of which none is larger than the sum of the two others"
    with pytest.raises(InputError, match=says):
        scenes.load_any(CRANE, [key.replace("INERTIA", str(inertia))])


@pytest.mark.parametrize("inertia", [[0.0, 0.0, 0.0], [0.0, 3.0, 3.0], [1.0, 2.0, 3.0], [0.333, 0.667, 1.0]])
def test_rods_plates_and_rounded_figures_are_bodies(inertia: list[float]) -> None:
    assert scenes.load_any(CRANE, [f"sections.fly.masses=[{{name='m',on='tip',mass=90.0,inertia={inertia}}}]"])


def test_a_planar_body_turns_about_one_axis_alone() -> None:
    assert scenes.load_any("boom_two", ["sections.fly.masses.payload.inertia=[0.0,12.0,0.0]"])


CHART = """
kind = "chart"
title = "T"
scene = "CRANE"
change.sections.fly.masses = []
change.sections.fly.probes = [{name = "root", at = [1.0, 0.11, 0.16]}]
extensions = [1.0]
luffing = [30.0]
up_to = 20000.0
cases = [{name = "wind", wind = {speed = 14.0, on = [{load = "LOAD", area = 2.0, shape = 1.2}]}}]
[[limits]]
name = "stress"
of = "stress"
most = 355e6
[[limits]]
name = "cylinder"
of = "cylinder"
most = 260e3
[[limits]]
name = "ground"
of = "overturning"
polygon = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]]
height = 1.5
machine = [{name = "truck", mass = 24e3, at = [0.0, 0.0, -1.0]}]
"""


@pytest.mark.parametrize(
    ("usual", "wrong", "key", "unit"),
    [
        ("20000.0", "2.0", "up_to", "t"),
        ("355e6", "355.0", "limits[0].most", "MPa"),
        ("260e3", "260.0", "limits[1].most", "kN"),
        ("height = 1.5", "height = 1500.0", "limits[2].height", "mm"),
        ("[-2.0, -2.0]", "[-2000.0, -2000.0]", "limits[2].polygon[0][0]", "mm"),
        ("mass = 24e3", "mass = 24.0", "limits[2].machine[0].mass", "t"),
        ("14.0", "300.0", "cases[0].wind.speed", "m/min"),
        # of the scene, as in a run
        (
            "extensions",
            "change.section.body.material.density = 7.85\nextensions",
            "sections[0].body.material.density",
            "t/m^3",
        ),
    ],
)
def test_so_it_is_in_a_chart(usual: str, wrong: str, key: str, unit: str, tmp_path: Path) -> None:
    load = scenes.load_any(CRANE).sections[-1].loads[0].name
    file = tmp_path / "chart.toml"
    for text, count in ((CHART, 0), (CHART.replace(usual, wrong, 1), 1)):
        file.write_text(text.replace("LOAD", load).replace("CRANE", str(CRANE)))
        (part,) = call.load(file).parts
        assert len(found := part.study.hints()) == count
    assert found[0].startswith(f"{key} = ") and f" {unit} (" in found[0]


def tables(model: type[BaseModel], seen: set[type[BaseModel]]) -> Iterator[type[BaseModel]]:
    """All tables that a file may have, from the whole one in."""
    if model in seen:
        return
    seen.add(model)
    yield model
    for field in model.model_fields.values():
        for inner in models_in(field.annotation):
            yield from tables(inner, seen)


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)


#: Numbers with a unit for which none is likely to be meant, or that a refusal bounds, and results of others.
WITHOUT = {
    "Damping.mass", "Damping.stiffness", "Damping.frequencies", "Recovery.every", "Budget.microseconds_per_step",
    "PublishedFrequency.first",
    *(f"{table}.{key}" for table in ("Dampers", "InitialDisplacements", "InitialRates")
      for key in ("x", "y", "z", "rx", "ry", "rz")),
}  # fmt: skip


def test_every_number_with_a_unit_declares_what_is_usual_and_what_can_be_computed_with() -> None:
    keys = [
        (table, key)
        for table in tables(Scene, set())
        if not issubclass(table, SignalBase)
        for key in table.model_fields
    ]
    quantities = {(table, key): quantity for table, key in keys if (quantity := quantity_of(table, key)) is not None}
    bare = {at for at, quantity in quantities.items() if quantity.unit != "1" and not usual_ranges(*at)}
    assert {f"{table.__name__}.{key}" for table, key in bare} == WITHOUT
    assert all(quantity.unit and quantity.low < quantity.high for quantity in quantities.values())


def test_every_unit_has_others_that_differ_from_it() -> None:
    assert all(
        factor > 0.0 and not math.isclose(factor, 1.0) for others in OTHER_UNITS.values() for factor in others.values()
    )


SECTION = (
    "area=0.01,second_moment_y=1e-4,second_moment_z=1e-4,torsion_constant=1e-4,shear_area_y=5e-3,shear_area_z=5e-3"
)
MOUTH = "{name='m',moving=true,faces={bottom=[0.0]}}"

#: What to write into a scene, with a size in place of the @.
PLANAR = [
    *(f"body.profile.{key}=@" for key in ("length", "bending_stiffness", "mass_per_length", "axial_stiffness")),
    "damping={mass=@}", "damping={stiffness=@}", "time.end=@", "time.step=@", "loads=[{on=5.0,signal=@}]",
    "slider.path=@", "slider.offsets=[@]", "supports=[{on=@}]",
]  # fmt: skip
SPACE = [
    "body.box.length=@", "body.box.width=@", "body.box.height=@", "body.box.wall=@", "body.box.radius=@",
    "body.material.young=@", "body.material.density=@", "body.material.poisson=@", "gravity.acceleration=@",
    "masses=[{name='m',on='tip',mass=@}]", "masses=[{name='m',on='tip',mass=1.0,inertia=[1.0,@,1.0]}]",
    "masses=[{name='m',on='tip',mass=1.0,at=[@,0.0,0.0]}]",
    *("body.section={" + re.sub(f"{key}=[^,]*", f"{key}=@", SECTION) + "}" for key in
      ("area", "second_moment_y", "torsion_constant", "shear_area_z")),
    *(f"pads=[{{name='t',at=0.15,faces={{bottom=[0.0]}},{key}=@}},{MOUTH}]" for key in
      ("length", "width", "stiffness", "unilateral=true,clearance")),
    f"pads=[{{name='t',at=@,faces={{bottom=[0.0]}}}},{MOUTH}]",
    f"pads=[{{name='t',at=0.15,faces={{bottom=[@]}}}},{MOUTH}]",
    "supports=[{name='c',stiffness=@}]", "observe.start=@", "observe.end=@", "recovery.every=@", "time.step=@",
    "loads=[{name='F',signal=@}]", "slider.path=@", "mesh.elements=@", "loads=[{name='F',on=@,signal=1.0}]",
]  # fmt: skip
EXTREMES = ["1e300", "1e-300", "-1e300", "-1e-300", "5e-324", "1.7976931348623157e308", "inf", "nan"]


NOUGHT = ("damping", "radius", "mass=@", "inertia", "at=[@", "observe.start", "signal=@", "path=@", "poisson",
          "supports", "offsets", "on=@", "bottom=[@", "clearance")  # fmt: skip


@pytest.mark.parametrize("size", EXTREMES)
@pytest.mark.parametrize(
    ("file", "change"), [*(("paper_simple", c) for c in PLANAR), *(("boom_beam", c) for c in SPACE)]
)
def test_sizes_beyond_all_that_is_built_are_refused(file: str, change: str, size: str) -> None:
    """Where nought is allowed, a number that is as good as nought is, too."""
    changes = [change.replace("@", size)]
    if "clearance" in change:
        changes.append("compare.against=[]")
    try:
        scenes.load(file, changes)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert abs(float(size)) < 1e-100 and any(word in change for word in NOUGHT)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_models_in_other_units_pass(scale: float) -> None:
    """A boom in mm, t and MPa, or in km: every size and place by the scale."""
    ring = "name='{}',length={},width={},faces={{bottom=[0.0]}},{}"
    pads = [ring.format(name, 0.3 * scale, 0.08 * scale, rest) for name, rest in
            (("t", f"at={0.15 * scale}"), ("m", "moving=true"))]  # fmt: skip
    box = {"length": 6.0, "width": 0.3, "height": 0.4, "wall": 0.008}
    changes = [f"body.box.{name}={size * scale}" for name, size in box.items()]
    changes += ["pads=[" + ",".join(f"{{{pad}}}" for pad in pads) + "]", f"slider.path={2.0 * scale}"]
    changes += [f"observe.start={0.2 * scale}", f"observe.end={5.8 * scale}"]
    assert scenes.load("boom_beam", changes).title


@pytest.mark.parametrize(("torsion_constant", "model", "is_open"), [
    (11.9e-8, "beam3d", True), (11.9e-8, "beam2d", False), (2.0e-6, "beam3d", False),
])  # fmt: skip
def test_a_beam_of_an_open_profile_is_said_to_warp_freely(torsion_constant: float, model: str, is_open: bool) -> None:
    """A channel of 200 mm, and a tube of the same second moments."""
    section = f"area=3.22e-3,second_moment_y=1.91e-5,second_moment_z=1.48e-6,torsion_constant={torsion_constant}"
    scene = scenes.load_any("boom_beam", ["body.shear=false", f"body.section={{{section}}}"])
    body = scene.sections[0].body.model_copy(update={"model": model})
    remarks = [hint for hint in hints(scene.vary_sections(lambda _: {"body": body})) if "warps freely" in hint]
    assert len(remarks) == is_open
    assert all(hint.startswith("body.section.torsion_constant = 1.19e-07 m^4") for hint in remarks)


@pytest.mark.parametrize("x, acting", [(2.0, "the luffing cylinder"), (2.02, "")])
def test_a_probe_where_section_forces_jump_is_named(x: float, acting: str) -> None:
    template = scenes.load_any(
        ROOT / "pmr" / "cli" / "templates" / "crane.toml", [f"sections.base.probes.lug.at=[{x}, -0.18, -0.24]"]
    )
    assert isinstance(template, Scene)
    remarks = [hint for hint in hints(template) if "section forces jump" in hint]
    assert len(remarks) == bool(acting)
    assert all(f"probe lug of base is where {acting} acts, at 2 m" in remark for remark in remarks)


def test_a_probe_beside_a_support_or_a_mass_of_a_body_is_named() -> None:
    probe = "probes=[{name='gauge', at=[6.0, 0.15, 0.2], measures=['stress', 'displacement']}]"
    (remark,) = hints(scenes.load_any("boom_beam", [probe, "masses.payload.at=[6.0,0.0,-0.4]"]))
    assert "probe gauge of the body is where the mass payload acts, at 6 m" in remark


def test_a_probe_at_a_load_along_a_body_is_named() -> None:
    probe = "probes=[{name='gauge', at=[4.0, 0.15, 0.2], measures=['stress']}]"
    load = "loads=[{name='push', on=4.0, direction='z', signal={kind='constant', amount=1e3}}]"
    (remark,) = hints(scenes.load_any("boom_beam", [probe, load]))
    assert "probe gauge of the body is where the load push acts, at 4 m" in remark


@pytest.mark.parametrize(
    ("probe", "is_between"),
    [
        ("at=[3.0,0.0,0.2]", True), ("at=[3.0,0.15,0.0]", True), ("at=[3.0,0.14,0.2]", False),
        ("at=[3.0,0.067,-0.2]", False), ("at=[3.0,0.0,0.2],face='top left'", False),
    ],
)  # fmt: skip
def test_a_probe_of_stress_between_corners_of_a_beam_is_named(probe: str, is_between: bool) -> None:
    """With a force to the side one of both corners has far more stress, and the probe has that of one of them."""
    lines = hints(scenes.load("boom_beam", [f"probes=[{{name='p',{probe}}}]"]))
    assert [line.partition(" of the box")[0] for line in lines] == [
        "probe p of the body is between corners"
    ] * is_between
