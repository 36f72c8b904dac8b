"""Runs of a boom that luffs by itself: what they state of its cylinder, and what their report shows."""

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import RunResult
from pmr.report.document import render_runs
from pmr.report.forces import driven_block
from pmr.report.sections import chapter
from pmr.results.quantities import QUANTITIES
from pmr.scene.built import force_name

pytestmark = pytest.mark.slow  # three sections are reduced

QUICK = (
    "section.mesh.elements=6", "section.reduction.estimate=false", "time.end=1.4", "compare.against=[]",
    "compare.richer='none'",
)  # fmt: skip


@pytest.fixture(scope="module")
def result() -> RunResult:
    return pmr.run(pmr.load_scene("luffing_oil", [*QUICK])).result


def test_cylinder_s_force_is_that_of_the_moment_at_the_pivot(result: RunResult) -> None:
    """One is by the pressures, the other by all that the supports of the boom bear in the motion that was computed."""
    response = result.responses["reduced"]
    force, of_moment = response.other("luffing cylinder force"), response.other("reaction of pivot cylinder")
    assert np.abs(force - of_moment).max() < 1e-3 * np.ptp(force)
    (bore, rod), oil = (14e-3 + 1.4e-3, 9e-3), QUANTITIES["driven_pressure"].histories(response)
    pushed = oil["luffing cylinder pressure bore"] * bore - oil["luffing cylinder pressure rod"] * rod
    np.testing.assert_allclose(pushed, force, rtol=1e-12)


def test_summary_has_the_range_of_angle_pressures_flows_and_power(result: RunResult) -> None:
    response, summary = result.responses["reduced"], result.summary
    angle = response.other("luffing angle")
    shown = dict(summary["frame"]["luffing"])
    assert shown.pop("unit") == "rad" and shown == pytest.approx({"min": angle.min(), "max": angle.max()}, rel=1e-15)
    cylinder = summary["luffing_cylinder"]
    for quantity in ("driven_pressure", "driven_flow", "driven_power"):
        for name, history in QUANTITIES[quantity].histories(response).items():
            extremes = cylinder[name.removeprefix("luffing cylinder ").replace(" ", "_")]
            assert (extremes["min"], extremes["max"]) == (history.min(), history.max())
    assert cylinder["flow_supply"]["max"] > 5e-4 and cylinder["pressure_rod"]["min"] > 0.0


def test_what_the_support_at_the_lug_lacks_of_the_cylinder_has_a_warning(result: RunResult) -> None:
    """The share is that of the vector from foot to lug in the axes of the boom, at the angle where it is largest."""
    angle, cylinder = result.responses["reduced"].other("luffing angle"), result.scene.frame.cylinder
    vector = complex(*cylinder.lug) - complex(*cylinder.foot) * np.exp(-1j * angle)
    (line,) = [line for line in result.summary["warnings"] if "along the boom" in line]
    share = np.abs(vector.real / vector.imag).max()
    assert f"the support 'lug' lacks the cylinder's force along the boom, up to {share:.2g} times" in line
    assert "a run at a given angle with frame.cylinder.stiffness" in line


def test_stored_result_and_report_have_the_angle_that_was_computed(result: RunResult, tmp_path: Path) -> None:
    result.save(tmp_path)
    stored = RunResult.load(tmp_path)
    t = result.responses["reduced"].t
    assert stored.frame is not None and stored.scene.frame is not None and stored.scene.frame.luffing == "free"
    angle = result.responses["reduced"].other("luffing angle")
    np.testing.assert_allclose(stored.frame.angles[0].value(t), angle, rtol=1e-14)
    block = driven_block(stored, "run")
    assert block is not None and len(block.drawings) == 3
    page = render_runs([chapter(stored, "run")])
    assert "pressure bore" in page and "raised 2" in page


def test_oil_that_boils_has_a_warning() -> None:
    """The boom falls on shut chambers of which one has to grow."""
    keys = ["frame.luffing_rate=-8.0", "frame.cylinder.oil.back_pressure=0.0", "frame.cylinder.oil.bulk_modulus=2e9"]
    scene = pmr.load_scene("luffing_oil", [*QUICK, *keys, "time.end=0.4"])
    lines = [line for line in pmr.run(scene).result.summary["warnings"] if "boils" in line]
    assert any(line.startswith("the oil on the rod side of the luffing cylinder boils at up to ") for line in lines)


def test_the_reduction_has_an_estimate_beside_a_free_angle_in_second_order() -> None:
    """Modes that would have no inertia have it here, and the richer model of the estimate has further ones."""
    keys = ["section.reduction.estimate=true", "compare.against=['full']", "frame.second_order=true"]
    summary = pmr.run(pmr.load_scene("luffing_oil", [*QUICK, *keys])).result.summary
    errors = summary["errors"]["reduced_vs_full"]
    for kind in ("tip", "beam", "pad_force", "cylinder_force"):
        assert 1.0 <= summary["estimate"][kind] / errors[kind] < 1.5


def test_pads_that_pull_have_a_remedy_that_a_free_angle_takes(result: RunResult) -> None:
    """A full ring shares a force between the pad that bears and the one opposite; bearing faces alone carry it all."""
    assert not [line for line in result.summary["warnings"] if "pull" in line]
    ends = [f"section.joint.{end}.0.faces.{face}=[-0.06, 0.06]" for end, face in (("tail", "bottom"), ("mouth", "top"))]
    full = pmr.run(pmr.load_scene("luffing_oil", [*QUICK, *ends])).result
    (line,) = [line for line in full.summary["warnings"] if "holds both ways and pulls" in line]
    assert "set unilateral" not in line and "unilateral = true is refused beside frame.luffing = 'free'" in line
    assert "leave only the faces that bear in faces of joint.tail of middle and joint.mouth of middle" in line
    slewing = "frame.slewing={kind='smooth_ramp', times=[0.0, 1.0], values=[0.0, 20.0]}"
    aside = pmr.run(pmr.load_scene("luffing_oil", [*QUICK, slewing])).result.summary["warnings"]
    (line,) = [line for line in aside if "holds both ways and pulls" in line]
    assert "the one on the other side would bear all" in line and "leave only" not in line
    mouth = force_name("middle mouth bottom right")
    of_faces, of_rings = (run.responses["reduced"].force(mouth)[0] for run in (result, full))
    assert of_faces == pytest.approx(2.0 * of_rings, rel=0.02)


def test_a_supply_that_is_too_weak_has_a_warning(result: RunResult) -> None:
    """The valve opens to raise the boom: the oil in the bore has more than the supply's pressure, and flows back."""
    assert not [line for line in result.summary["warnings"] if "supply" in line]
    weak = ["frame.cylinder.oil.supply=5e6", "frame.cylinder.oil.counterbalance.setting=1e6", "time.end=1.2"]
    run = pmr.run(pmr.load_scene("luffing_oil", [*QUICK, *weak])).result
    response = run.responses["reduced"]
    assert response.other("luffing angle")[-1] < response.other("luffing angle")[0]
    assert response.other("luffing cylinder flow bore").min() < 0.0
    (line,) = [line for line in run.summary["warnings"] if "too weak" in line]
    assert line.startswith("the supply of 5 MPa is too weak for the luffing cylinder: at 0.61")
    (shut,) = [line for line in run.summary["warnings"] if "relief valve" in line]
    assert shut.startswith("the oil on the bore side of the luffing cylinder has up to ")


def test_a_cylinder_at_the_end_of_its_stroke_has_a_warning_and_no_weak_supply(result: RunResult) -> None:
    """The valve stays open against the stop, which takes what the supply presses and the load does not need."""
    assert result.summary["luffing_cylinder"]["stops"] == []
    start = float(result.responses["reduced"].other("luffing cylinder length")[0])
    oil = "frame.cylinder.oil.valve.opening={kind='smooth_ramp',times=[0.1,0.2],values=[0.0,0.6]}"
    scene = pmr.load_scene("luffing_oil", [*QUICK, oil, f"frame.cylinder.stroke=[{start - 0.1}, {start + 0.01}]"])
    run = pmr.run(scene).result
    length, t = run.responses["reduced"].other("luffing cylinder length"), run.responses["reduced"].t
    beyond = np.flatnonzero(length > start + 0.01)
    first, *_ = run.summary["luffing_cylinder"]["stops"]
    assert first["start"] == t[beyond[0]] and first["speed"] > 0.0
    deepest = max(span["give"] for span in run.summary["luffing_cylinder"]["stops"])
    assert deepest == pytest.approx(length.max() - start - 0.01, rel=1e-9)
    (line,) = [line for line in run.summary["warnings"] if "meets the stop" in line]
    assert line.startswith("the luffing cylinder meets the stop at its greatest length at ")
    assert run.responses["reduced"].other("luffing cylinder pressure bore")[-1] > 0.95 * 21e6  # beside the supply
    assert not [line for line in run.summary["warnings"] if "supply" in line]
