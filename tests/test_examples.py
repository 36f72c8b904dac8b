"""The examples of the manual run, and the figures on their pages are what they should be."""

import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
Found = dict[str, Any]
CHECKS: dict[str, Callable[[Found], None]] = {}


def figures_of(check: Callable[[Found], None]) -> Callable[[Found], None]:
    CHECKS[check.__name__] = check
    return check


@figures_of
def sliding_beam(found: Found) -> None:
    published, dropped, six = found["errors"].values()
    assert published["tip"] == pytest.approx(0.0113, rel=0.05) and published["beam"] == pytest.approx(0.0182, rel=0.05)
    assert dropped["beam"] < published["beam"] and six["beam"] < 0.003


@figures_of
def own_beam(found: Found) -> None:
    assert "0 to 3 m" in found["refused"] and found["error"] < found["estimate"] < 2.0 * found["error"] < 5e-4
    assert 0.7 < found["stiffest"] / 3.0 < 0.8


@figures_of
def residual_flexibility(found: Found) -> None:
    errors = found["errors"]
    for count in found["counts"]:
        assert errors["with residual flexibility", count] < 0.1 * errors["modes alone", count]


@figures_of
def pushing_pads(found: Found) -> None:
    (pulls, holds), (least, pushes) = found["largest"].values()
    assert least >= 0.0 > pulls and pushes > 1.5 * holds


@figures_of
def anti_sway(found: Found) -> None:
    one, two = found["residual"].values()
    assert one > 15.0 and two < 0.1 * one
    t, ramp = found["responses"]["one ramp"].t, found["scenes"]["one ramp"].frame.angles[1]
    swing = found["responses"]["one ramp"].other("swing of the hook across the boom")
    assert np.argmax(np.abs(swing) > 1e-3) * t[1] < 2.0 and float(ramp.value(np.array([t[-1]]))[0]) == np.deg2rad(20.0)


@figures_of
def crane(found: Found) -> None:
    lowest = [curve.models["full"][:, 0].min() for curve in found["curves"].values()]
    assert lowest == sorted(lowest, reverse=True) and max(found["sway"].values()) < 1e-3
    t = found["result"].responses["reduced"].t
    raised, out = (ramp(t, *times, *values) for times, values in (((1.0, 9.0), (20.0, 60.0)), ((1.0, 7.0), (0.8, 4.5))))
    boxes = ((0.36, 0.48, 0.012), (0.32, 0.44, 0.010), (0.28, 0.40, 0.008))
    steel = [7850.0 * 6.0 * 2.0 * (width + height) * wall for width, height, wall in boxes]  # kg
    for hook, force in found["luffing"].items():
        moment = sum(m * (k * out + 3.0) for k, m in enumerate(steel)) + hook * (2.0 * out + 6.0)
        hoisted = 1000.0 * (2.0 * out + 6.0)
        lug, foot = (2.0 - 0.25j) * np.exp(1j * np.deg2rad(raised)), 0.6 - 1.2j
        arm = (foot.conjugate() * lug).imag / np.abs(lug - foot)  # of the cylinder about the pivot
        held = 9.81 * np.cos(np.deg2rad(raised)) * (moment + hoisted) / arm  # statics about the pivot
        # at rest again it swings about what statics say, far out and raised; on the way it is accelerated too
        assert force[t > 12.0].mean() == pytest.approx(held[-1], rel=0.02) and force.max() > held.max()
    for curve in found["curves"].values():
        np.testing.assert_allclose(curve.models["reduced"][:, 0], curve.models["full"][:, 0], rtol=1e-4)
    assert "animation wide" in found["report"]  # its walls, by stress


def ramp(t: np.ndarray, start: float, end: float, low: float, high: float) -> np.ndarray:
    """Of fifth degree, smooth at both ends."""
    x = np.clip((t - start) / (end - start), 0.0, 1.0)
    return np.asarray(low + (high - low) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2))


@figures_of
def real_time(found: Found) -> None:
    assert 3.2 < found["s"][-1] <= 3.25 + 1e-9 and np.all(np.diff(found["s"]) >= 0.0)
    static = -30.0 * (5.0 - found["s"][-1]) ** 2 * 5.0 / (3.0 * 5e4)  # a beam on a pin and a roller, overhanging
    assert found["tip"][-500:].mean() == pytest.approx(static, rel=0.1)


@figures_of
def velocity_feedback(found: Found) -> None:
    assert max(found["before"]) < 1e-6 and min(found["after"]) > 0.01


@figures_of
def fmu(found: Found) -> None:
    assert found["difference"] < 1e-12 < found["motion"].tip.max()


@figures_of
def matrices(found: Found) -> None:
    assert found["errors"]["tip"] < 0.01 and found["size"]["full"] == 25 * 27
    assert found["M"].sum() == pytest.approx(3.0 * found["RHO"] * found["SIZE"].prod())  # rigid translations


@figures_of
def own_mesh(found: Found) -> None:
    inertia = 0.006 * (0.16**3 / 12.0 + 2.0 * 0.1 * 0.08**2)
    lever, out = 0.6, 2.2  # m between the pads, and from the mouth to the tip, in the beginning
    beam = 1e3 * 500.0 * out**2 * (out + lever) / (3.0 * 210e9 * inertia)
    assert beam < -found["lowest"] < 4.0 * beam  # flanges give way under the pads


@figures_of
def shell_boom(found: Found) -> None:
    assert found["summary"]["coordinates"] == {"full": 6390, "reduced": 10}
    assert found["summary"]["estimate"]["tip"] < 1e-3 and 20e6 < found["peak"] < 80e6
    assert "<canvas" in found["report"]


@figures_of
def sections(found: Found) -> None:
    assert found["errors"]["tip"] < 1e-4 and found["heaviest"]["name"] == "middle mouth bottom"
    assert min(pad["min"] for pad in found["pads"]) >= 0.0


@figures_of
def weld(found: Found) -> None:
    stress, cycles = found["stress"], found["cycles"]
    assert stress.max() > 1.0 and stress.min() < -1.0 and len(stress) == 10001
    assert 1e-6 * cycles["range"].max() == pytest.approx(stress.max() - stress.min(), rel=1e-9)


@figures_of
def accuracy(found: Found) -> None:
    for tolerance, (reduction, step, _, holds) in found["found"].items():
        assert max(reduction, step) <= tolerance and holds
    steps = [one[2] for one in found["found"].values()]
    assert steps == sorted(steps, reverse=True)


@figures_of
def study(found: Found) -> None:
    for stiffness in found["stiffnesses"]:
        chosen = np.array([row for row in found["rows"] if row[1] == stiffness])
        assert np.all(np.diff(chosen[:, 2]) > 0.0) and np.all(np.diff(chosen[:, 3]) > 0.0)


@figures_of
def saved_model(found: Found) -> None:
    sideways = found["sideways"]
    reduced, stopped, stronger = (motion.displacement[:, sideways] for motion in found["motions"].values())
    np.testing.assert_allclose(stronger, 3.0 * reduced, atol=1e-9)  # linear in its loads
    assert abs(stopped - reduced).max() > 1e-4


@figures_of
def own_basis(found: Found) -> None:
    errors, counts = found["errors"], found["COUNTS"]
    for flexibility in ("false", "true"):
        assert errors[flexibility, counts[-1]] < 0.5 * errors[flexibility, counts[0]]
    assert errors["true", counts[-1]] < errors["false", counts[-1]] < 1.0


@figures_of
def crane_on_turret(found: Found) -> None:
    """The tip is the boom's length from the hinge, the rope as long as the winch has it, and the valve's oil lifts."""
    tip, payload = found["tip"], found["payload"]
    reach = 0.2 + found["scene"].extension(1).value(tip[:, 0]) + 2.0
    lengths, winch = np.linalg.norm((payload - tip)[:, 1:], axis=1), np.hypot(reach, found["WINCH"][2])
    paid = reach - reach[0] + winch[0] + 0.8
    assert np.abs(lengths + winch - paid).max() < 3e-3  # it stretches by a millimetre, the tip sags
    assert np.abs(np.linalg.norm(tip[:, 1:], axis=1) - reach).max() < 2e-3
    angle = np.arcsin(tip[:, 3] / reach)
    still = np.abs(np.gradient(angle, tip[:, 0]))
    assert still[tip[:, 0] < 0.28].max() < 0.05 < still[np.abs(tip[:, 0] - 0.75) < 0.15].min()


@figures_of
def leveled_basket(found: Found) -> None:
    """The cylinder bears the moment of the basket about its hinge, by an arm of 0.56 m, and swings about that."""
    boom, level, push = found["boom"], found["level"], found["push"]
    assert boom[-1] == pytest.approx(np.degrees(0.4), abs=0.2) and np.abs(level).max() < 2.0
    assert push.mean() == pytest.approx(1e-3 * 75.0 * found["WEIGHT"] / 0.56, rel=0.15) and push.min() > 0.0


@figures_of
def set_down(found: Found) -> None:
    """The ground takes over the weight; the faster the winch, the harder the load meets it."""
    weight = found["PAYLOAD"] * found["GRAVITY"]
    slow, fast = found["SPEEDS"]
    for run in found["runs"].values():
        rope, ground = run["force of the hoist rope"], run["force of the ground"]
        assert 2.0 * rope[0] == pytest.approx(weight, rel=0.01) and ground[0] == 0.0
        last = slice(-250, None)
        assert (ground + 2.0 * rope)[last].mean() == pytest.approx(weight, rel=0.01)
        assert ground[last].mean() > 0.95 * weight
    assert found["hardest"][fast] > found["hardest"][slow] > 0.98
    assert min(found["rebound"].values()) > 0.01


@figures_of
def emergency_stop(found: Found) -> None:
    gentle, hard = (result.summary["ground"] for result in found["results"].values())
    margins = [min(of["min"] for of in stand["margins"]) for stand in (gentle, hard)]
    assert margins[0] > margins[1] > 0.0 and hard["tips"] is None
    assert not any("lifted" in of for of in gentle["outriggers"])
    assert any("lifted" in of for of in hard["outriggers"])
    assert "Outriggers and tipping" in found["report"]


@figures_of
def load_chart(found: Found) -> None:
    (governs, load), (other, more) = found["charts"].values()
    assert set(governs.tolist()) == {0, 1, 2} and np.isfinite(load).all()  # luffing cylinder, tip and tipping
    np.testing.assert_array_equal(load, [float(row["load [kg]"]) for row in found["chart"]])
    tips = governs == 2
    assert (more[tips] > load[tips]).all()
    np.testing.assert_array_equal(more[~tips], load[~tips])
    np.testing.assert_array_equal(other[~tips], governs[~tips])
    assert {row["governed by"] for row in found["lift"]} == {"stress", "tip", "pads"}
    assert "What the crane carries" in found["report"] and "<svg" in found["report"]


@figures_of
def tip_damping(found: Found) -> None:
    alone, controlled = found["swings"].values()
    assert controlled < 0.5 * alone > 1.0


@figures_of
def luffing_oil(found: Found) -> None:
    """Shut oil holds the boom; a larger ratio takes less pressure, and sways more."""
    low, high = found["RATIOS"]
    assert 2.0 * low == high and found["pressure"][high] < 0.7 * found["pressure"][low]
    assert found["sway"][high] > 1.2 * found["sway"][low] > 0.0
    for run in found["runs"].values():
        angle, bore = run.other("luffing angle"), run.other("luffing cylinder pressure bore")
        np.testing.assert_allclose(angle[run.t < 0.5], np.deg2rad(20.0), rtol=0.0, atol=1e-9)
        assert np.rad2deg(angle.max() - angle[0]) > 10.0 > np.rad2deg(angle[-1] - angle[0]) > 0.0 < bore.min()


@figures_of
def driven_extension(found: Found) -> None:
    mass = 7850.0 * 2.0 * 2.0 * (0.21 + 0.17) * 0.004 + 100.0  # kg
    t, push = found["t"], found["push"](found["t"])
    given = ((push[1:] + push[:-1]) / 2.0 * np.diff(t)).sum() - 2e3 * found["out"][-1]  # momentum, N s
    taken = (mass + 40.0) * found["speed"][-1] + mass * 9.81 * np.sin(0.3) * t[-1]
    assert given == pytest.approx(taken, rel=0.01)
    assert found["speed"].max() == pytest.approx((1000.0 - mass * 9.81 * np.sin(0.3)) / 2e3, rel=0.02)


def test_every_example_is_checked_and_short() -> None:
    scripts = {file.stem: file.read_text().splitlines() for file in EXAMPLES.glob("*.py")}
    assert set(scripts) == set(CHECKS) and len(scripts) >= 12
    assert max(map(len, scripts.values())) < 120


def test_every_example_has_its_place_in_the_gallery() -> None:
    places = runpy.run_path(str(EXAMPLES.parent / "_ext" / "gallery.py"))["EXAMPLES"]
    assert sorted(places) == sorted(file.stem for file in EXAMPLES.glob("*.py"))


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("name", CHECKS)
def test_figures(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name == "own_basis":
        pytest.importorskip("pymor", reason="pyMOR is not installed: make docs does it")
    monkeypatch.setattr(plt, "show", lambda: None)
    plt.switch_backend("agg")
    found = runpy.run_path(str(EXAMPLES / f"{name}.py"))
    CHECKS[name](found)
    assert plt.get_fignums()
    plt.close("all")
