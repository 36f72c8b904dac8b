"""A load chart's limits beside runs at rest and beside statics: the weight on the deflected boom, slopes, ropes."""

import os
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
from chart_beside_run import MACHINE, Chart, beside, chart, run
from random_machines import GIVING, SHELLS, G, random_machine

from pmr import InputError
from pmr.results.quantities import LIMITED
from pmr.scene import Scene
from pmr.studies.chart_draft import check_at_rest
from pmr.studies.limits import KINDS, Limit

pytestmark = pytest.mark.slow

COUNT = 150
SAMPLED = [7]  # a machine with open pads; the third one, without, hangs its load beside the axis, below
FOOT, LUG, LENGTH, DENSITY = [0.7, -1.3], [1.6, -0.3], 8.0, 7850.0
BOXES = ((0.28, 0.38, 0.008), (0.235, 0.33, 0.0065))


def test_no_limit_has_a_formula_of_its_own() -> None:
    """All are quantities of runs, eigenvalues, what a user makes, or sums of moments of what a run says."""
    kinds = set(get_args(Limit.model_fields["of"].annotation))
    assert kinds == {*LIMITED, "buckling", "frequency", "overturning", "function", "expression"}


def test_a_kind_of_limit_that_no_run_is_asked_for_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, "slope", KINDS["deflection"])
    with pytest.raises(NotImplementedError, match="slope"):
        chart({}, {}, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("seed", range(COUNT) if os.environ.get("PMR_SWEEP") == "full" else SAMPLED)
def test_the_allowed_load_in_a_run_has_the_limits_value(seed: int) -> None:
    """Within the chart's bar, of every kind of limit; every ninth machine has walls that give, every fifth a shell."""
    assert all(seed % every < every - 1 for every in (GIVING, SHELLS)) or os.environ.get("PMR_SWEEP") == "full"
    rows = beside(seed)
    assert len(rows) >= 5
    assert [(kind, off, bar) for kind, _, off, bar in rows if not abs(off) <= bar + 1e-6] == []


def test_a_load_beside_the_axis_has_its_moments_in_a_chart_as_in_a_run() -> None:
    """Every kind of limit within its bar, beside a run with a mass at this place."""
    rows = beside(3, (0.2, 0.5, -0.3))
    assert len(rows) >= 5
    assert [(kind, off, bar) for kind, _, off, bar in rows if not abs(off) <= bar + 1e-6] == []


def test_the_bar_of_the_reduction_covers_a_run_whose_modes_move_the_load() -> None:
    """A run with the load as a mass has other modes, so an error of its own: more of it than the chart."""
    plain, extensions, angle = random_machine(11)
    for part in plain["sections"]:
        part["reduction"] = {"coordinates": 8}
    found = chart(plain, extensions, angle, 200.0, 900.0)
    number = next(k for k, one in enumerate(found.limits) if one.of == "stress")
    limit, load = found.limits[number], float(found.load[number])
    share, more = (run(plain, 200.0, mass).value(limit) / float(limit.most or 1.0) for mass in (load, 1.001 * load))
    off = (share - 1.0) / (more - share) * 0.001 * load
    assert 1e-3 < abs(off) <= found.reduction[number]
    assert found.reduction[number] < 5.0 * abs(off)


def planar(angle: float, base: float = 0.0) -> dict[str, Any]:
    """Two slender planar sections on a pin and a luffing cylinder, with many stations."""
    pads = [{"at": 0.2, "stiffness": 2e8, "unilateral": False}]
    sections = list[dict[str, Any]]()
    for k, (width, height, wall) in enumerate(BOXES):
        box = {"length": LENGTH, "width": width, "height": height, "wall": wall}
        part: dict[str, Any] = {"name": f"s{k}", "body": {"model": "beam2d", "shear": False, "box": box}}
        part |= {
            "mesh": {"elements": 20},
            "reduction": {"coordinates": 6},
            "observe": {"start": 0.0, "end": LENGTH, "count": 161},
        }
        sections.append(part)
    sections[0]["supports"] = [
        {"name": "pin", "on": "tail", "directions": ["x", "z"]},
        {"name": "luff", "on": LUG[0], "directions": ["z"], "stiffness": 6e7},
    ]
    extension = {"kind": "constant", "amount": 6.0}
    sections[1] |= {"joint": {"extension": extension, "tail": pads, "mouth": pads}}
    sections[1]["loads"] = [
        {"name": "wind", "on": "tip", "direction": "z", "signal": {"kind": "constant", "amount": 0.0}}
    ]
    frame: dict[str, Any] = {"pivot": [0.0, 0.0, 0.0], "unit": "degrees", "second_order": True}
    frame |= {"luffing": {"kind": "constant", "amount": angle}, "cylinder": {"foot": FOOT, "lug": LUG}}
    if base:
        frame["base"] = {"ry": {"kind": "constant", "amount": base}}
    scene = {"title": "planar", "frame": frame, "sections": sections, "gravity": {}, "start": "equilibrium"}
    return scene | {"time": {"end": 0.02, "step": 0.01}, "compare": {"against": []}}


@cache
def planar_chart(angle: float, base: float = 0.0) -> Chart:
    """Chart at one point of the planar boom, without error bars."""
    return chart(planar(angle, base), {"s1": 6.0}, angle, 0.0, 1000.0, error=False)


def moments(
    plain: dict[str, Any], mass: float, angle: float, base: float = 0.0
) -> tuple[float, np.ndarray, np.ndarray]:
    """Of weight and load about the pivot, N m, by stations where a run has them; the tip's place, and masses' sum.

    Angles from the horizontal are those on the ground: a pitch of the base lowers the boom.
    """
    found = run(plain, 0.0, mass)
    response, tail, about, weight = found.response, 0.0, 0.0, 0.0
    c, s = np.cos(np.deg2rad(angle - base)), np.sin(np.deg2rad(angle - base))
    for k, (width, height, wall) in enumerate(BOXES):
        tail += 6.0 * k
        columns = [i for i, one in enumerate(response.outputs) if one.kind in ("beam", "tip") and one.body == f"s{k}"]
        columns = [i for i in columns if response.outputs[i].direction == "z"]
        x, w = response.x[columns], response.displacement[0, columns]
        order = np.argsort(x)
        x, w = x[order], w[order]
        area = 2.0 * wall * (width + height)
        outwards = (tail + x) * c - w * s
        about += DENSITY * area * G * float(np.sum((outwards[1:] + outwards[:-1]) / 2.0 * np.diff(x)))
        weight += DENSITY * area * float(x[-1] - x[0])
    tip = np.array([(tail + LENGTH) * c - w[-1] * s, (tail + LENGTH) * s + w[-1] * c])
    return about + mass * G * tip[0], tip, np.array([weight])


@pytest.mark.parametrize("angle", [12.0, 68.0])
def test_the_luffing_cylinder_bears_the_weight_of_the_deflected_boom(angle: float) -> None:
    """Moments about the pivot of all stations' weight, over the arm: |L x F| / |L - F| of lug and foot."""
    plain = planar(angle)
    found = planar_chart(angle)
    limit = next(k for k, one in enumerate(found.limits) if one.of == "luffing")
    turned = complex(*LUG) * np.exp(1j * np.deg2rad(angle))
    arm = (complex(*FOOT).conjugate() * turned).imag / abs(turned - complex(*FOOT))
    moment, _, _ = moments(plain, float(found.load[limit]), angle)
    # the trapezoidal rule and what reduction and second order leave out
    assert moment / arm == pytest.approx(found.limits[limit].most, rel=2e-4)


def test_a_machine_on_a_slope_tips_sooner() -> None:
    """Moments about the front edge on a base that is inclined by 5 degrees, the carrier's among them."""
    base, angle = 5.0, 60.0
    plain = planar(angle, base)
    found = planar_chart(angle, base)
    number = next(k for k, one in enumerate(found.limits) if one.of == "overturning")
    limit, load = found.limits[number], float(found.load[number])
    pitch = np.deg2rad(base)
    moment, tip, (weight,) = moments(plain, load, angle, base)

    def on_ground(x: float, z: float) -> float:
        """How far a place on the machine is ahead of the pivot."""
        return float(x * np.cos(pitch) + z * np.sin(pitch))

    edge = on_ground(2.0, -limit.height)
    carrier = limit.machine[0].mass * G * (on_ground(MACHINE["at"][0], MACHINE["at"][2]) - edge)
    own = load * G * (tip[0] - edge)
    rest = moment - load * G * tip[0] - weight * G * edge + carrier
    assert limit.factor * own / -rest == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("angle", [12.0, 68.0])
def test_a_pin_bears_the_thrust_of_the_luffing_cylinder(angle: float) -> None:
    """All weight and the cylinder's force along itself, full size: W + F d, in the axes of the boom.

    The chart's load in a run makes the pin's resultant the limit.
    """
    plain = planar(angle)
    found = planar_chart(angle)
    number = next(k for k, one in enumerate(found.limits) if one.of == "support")
    mass = float(found.load[number])
    response = run(plain, 0.0, mass).response
    weight = G * (mass + sum(DENSITY * 2.0 * wall * (width + height) * LENGTH for width, height, wall in BOXES))
    turned = complex(*LUG) * np.exp(1j * np.deg2rad(angle)) - complex(*FOOT)
    pressed = (response.other("reaction of pivot cylinder")[0] * turned / abs(turned) - 1j * weight) * np.exp(
        -1j * np.deg2rad(angle)
    )
    pin = [float(response.other(f"reaction of s0: pin {axis}")[0]) for axis in "xz"]
    assert pin == pytest.approx([pressed.real, pressed.imag], rel=1e-6)
    assert np.hypot(*pin) == pytest.approx(found.limits[number].most, rel=1e-5)


def test_what_moves_below_a_boom_is_refused() -> None:
    plain = planar(30.0)
    plain["frame"]["base"] = {"ry": {"kind": "sine", "amplitude": 3.0, "frequency": 0.1}}
    with pytest.raises(InputError, match=r"frame\.base\.ry.*a base that is inclined by a constant rx, ry or rz"):
        check_at_rest(Scene.model_validate(plain))


def test_a_cylinder_bears_the_ropes_that_hang_on_it() -> None:
    """With sections that follow it the limit of a cylinder is that of the rope: T = F_1 + F_2."""
    plain, extensions, angle = random_machine(1)
    assert len(extensions) == 3 and plain["sections"][2]["joint"]["follows"] == "s1"
    found = chart(plain, extensions, angle, 0.0, 500.0, error=False)
    by_kind = {one.of: k for k, one in enumerate(found.limits)}
    cylinder, rope = by_kind["cylinder"], by_kind["rope"]
    assert found.limits[cylinder].most == pytest.approx(found.limits[rope].most)
    assert found.load[cylinder] == pytest.approx(found.load[rope])
