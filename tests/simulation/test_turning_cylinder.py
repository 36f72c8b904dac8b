"""A luffing cylinder that holds a boom along itself, beside a rigid boom by hand and beside other simulators."""

from typing import Any

import numpy as np
import pytest
from chart_beside_run import chart, run
from turning_cylinder import EXTENSION, LUG, Rigid, boom

import pmr
from pmr import InputError, SimulationError
from pmr.fullmodel.moving import direction_polynomial
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.mechanism import CYLINDER

SOFT = 2e6  # N/m: of the cylinder alone, beside which all else is rigid to 1e-6
RAISED = {"kind": "smooth_ramp", "times": [0.05, 0.25], "values": [10.0, 40.0]}


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "model"), [(10.0, "beam2d"), (40.0, "beam3d"), (70.0, "beam2d")])
def test_it_gives_way_along_its_own_line(degrees: float, model: str) -> None:
    """Deflection, forces and frequency of a rigid boom that turns about its pin; rods have no rotary inertia."""
    rigid = Rigid(np.deg2rad(degrees))
    result = pmr.run(boom(degrees, model, SOFT)).result
    response = result.responses["reduced"]
    assert response.of("tip", body="s1", direction="z")[0] == pytest.approx(-rigid.sag(SOFT), rel=1e-5)
    assert response.other(CYLINDER)[0] == pytest.approx(rigid.force, rel=1e-6)
    assert response.force("force of s0 luffing cylinder")[0] == pytest.approx(rigid.force, rel=1e-6)
    pin = [float(response.other(f"reaction of s0: pin {axis}")[0]) for axis in "xz"]
    assert pin == pytest.approx([rigid.pin.real, rigid.pin.imag], rel=1e-5)
    assert result.frequencies.models["reduced"][0, 0] == pytest.approx(rigid.frequency(SOFT), rel=1e-3)


@pytest.mark.slow
def test_all_simulators_agree_while_it_turns() -> None:
    """The reduced model in march and Exudyn, full order in march and PETSc, and a loop of one's own."""
    changed: dict[str, Any] = {"time": {"end": 0.3, "step": 1e-3}, "compare": {"against": ["full"]}}
    simulation = {"simulators": ["march", "exudyn"], "full": "petsc"}
    scene = boom(RAISED, "beam2d", 2e7, 2.1e11, **changed, simulation=simulation)
    outcome = pmr.run(scene)
    response, full = outcome.result.responses["reduced"], outcome.result.responses["full"]
    size = np.abs(full.displacement).max()
    assert 0.0 < max(outcome.result.summary["agreement"].values()) < 1e-6 * size
    assert np.abs(response.displacement - full.displacement).max() < 1e-4 * size
    at = scene.frame.angles[0]

    def motion(t: float) -> dict[str, tuple[float, float, float]]:
        return {"luffing": (float(at.value(t)), float(at.rate(t)), float(at.second_rate(t)))}

    stepper = pmr.Stepper(outcome.system, 1e-3, {"s1": 4.0}, frame=motion(0.0), outputs=["s1: tip z"])
    steps = [float(stepper.step({"s1": 4.0}, frame=motion(t))[0]) for t in response.t[1:].tolist()]
    tip = response.of("tip", body="s1", direction="z")[1:, 0]
    assert np.abs(np.array(steps) - tip).max() < 1e-9 * size


def test_a_step_that_fails_is_told_with_the_angle_in_rad() -> None:
    """By an Exudyn that may not iterate."""
    simulation = {"simulators": ["exudyn"], "newton": {"maxIterations": 1, "relativeTolerance": 0.0}}
    scene = boom(10.0, "beam2d", 2e7, simulation=simulation, start="rest")
    with pytest.raises(SimulationError, match=r"Exudyn failed at t = 0\.01 s, s1 at 4 m, luffing at 0\.1745\d* rad: "):
        pmr.run(scene)


def test_its_direction_is_followed_all_around() -> None:
    """A polynomial between breaks, beside the direction from foot to lug."""
    for foot, lug in (((0.5, -1.0), (LUG.real, LUG.imag)), ((0.6, -1.2), (2.0, -0.25)), ((-0.8, 0.4), (1.5, 0.2))):
        cylinder = LuffingCylinder(foot=foot, lug=lug, stiffness=SOFT)
        angle = np.linspace(-np.pi, np.pi, 4001)
        assert np.abs(direction_polynomial(cylinder)(angle) - cylinder.direction(angle)).max() < 1e-8


@pytest.mark.slow
def test_a_chart_says_what_a_run_says_with_it() -> None:
    """At an angle that the scene does not have; the support of a boom that a pin and the cylinder hold."""
    plain = boom(30.0, "beam2d", 6e7, 2.1e11, time={"end": 0.02, "step": 0.01}).model_dump(mode="json")
    plain["frame"]["second_order"] = True
    found = chart(plain, {"s1": EXTENSION}, 68.0, 0.0, 400.0)
    plain["frame"]["luffing"]["amount"] = 68.0
    kinds = list[str]()
    for limit, load, bar in zip(found.limits, found.load, found.bar, strict=True):
        if limit.of in ("luffing", "support", "deflection", "frequency"):
            value = run(plain, 0.0, float(load)).value(limit)
            assert abs(value / (limit.most or limit.least) - 1.0) <= bar + 1e-6
            kinds.append(limit.of)
    assert sorted(kinds) == ["deflection", "frequency", "luffing", "support"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"supports": [{"name": "luff", "on": 1.5, "directions": ["z"], "stiffness": 1e7}]}, "one of both"),
        ({"length": 1.2}, r"frame\.cylinder\.lug = 1\.5: with a stiffness, a place on the base"),
        ({"model": "shell"}, "whose base is a beam"),
    ],
)
def test_what_holds_the_base_twice_or_not_at_all_is_refused(change: dict[str, Any], message: str) -> None:
    scene = boom(20.0, "beam3d" if "model" in change else "beam2d", SOFT).model_dump(mode="json")
    base = scene["sections"][0]
    if "supports" in change:
        base["supports"] += change["supports"]
    elif "length" in change:
        base["body"]["box"]["length"] = change["length"]
        scene["sections"][1]["joint"]["extension"]["amount"] = 0.5
    else:
        base["body"]["model"] = change["model"]
        base["mesh"] |= {"size": 0.2}
        base["observe"] |= {"start": 0.0, "end": 6.0, "count": 3}
    with pytest.raises(InputError, match=message):
        boom(20.0, "beam2d", SOFT, sections=scene["sections"])
