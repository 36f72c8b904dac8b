from __future__ import annotations

import re
from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError

WORKFLOWS = Path(__file__).parents[2] / "workflows"
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
        scenes.load(WORKFLOWS / f"{file}.toml", changes)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert abs(float(size)) < 1e-100 and any(word in change for word in NOUGHT)


@pytest.mark.parametrize(
    ("file", "change", "says"),
    [
        ("boom_beam", "body.box.length=1e7", "body.box.length = 10000000.0: a number from 1e-06 to 1e+06 is allowed"),
        ("boom_beam", "body.box.wall=1e-5", "body.box.wall: a ratio of the smaller side over the wall from 0 to 10000"),
        ("boom_beam", "body.box.height=1e3", "body.box.width: a ratio of width over height from 0.001 to 1000"),
        ("boom_beam", "body.material.poisson=-0.999", "body.material.poisson = -0.999: a number from -0.99 to 0.4999"),
        ("boom_beam", "mesh.elements=100000", "mesh.elements = 100000: at most 5000 are allowed for beam3d"),
        ("boom_beam", "loads=[{name='F',signal=1e130}]", "loads[0].signal: at most 1e+120 N or N m are allowed"),
        ("boom_beam", "supports=[{name='c',stiffness=1e16}]",
         "supports[0].stiffness = 1e+16: a number from 1e-06 to 1e+15"),
        ("boom_beam", "observe.end=6.1", "observe.end = 6.1: on the body, 0 to 6 m, is allowed"),
        ("boom_beam", "body.section={area=0.01,second_moment_y=1e-4,second_moment_z=1e-4,torsion_constant=1e-4}",
         "body.section: shear_area_y and shear_area_z in m^2 are needed, or body.shear = false"),
        ("paper_simple", "body.profile.axial_stiffness=1e20",
         "body.profile.axial_stiffness: a ratio of length over radius of"),
    ],
)  # fmt: skip
def test_what_is_beyond_is_said_with_its_range(file: str, change: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        scenes.load(WORKFLOWS / f"{file}.toml", [change])
    assert says in str(refused.value)


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
    assert scenes.load(WORKFLOWS / "boom_beam.toml", changes).title
