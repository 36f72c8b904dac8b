"""What is no reference: the run says so, and why, instead of an error that would blame the reduced model.
A motion that no linear model describes is said, a small one is not.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.compare.trust import ALTERNATING, distrust_warnings, missing_reference_warnings, reason_for_distrust
from pmr.errors import InputError, SimulationError
from pmr.fem.compat import MPI
from pmr.files import npz
from pmr.fullmodel.build import full_model
from pmr.pipeline import run
from pmr.pipeline.full_order import FullOrder
from pmr.report import errors
from pmr.report.sections import chapter
from pmr.results import Energy, Response
from pmr.scene.keys import ALONE
from pmr.studies import shared

T = np.arange(200) * 1e-3
#: 3.7 m/s on a coarse beam: with rho_inf = 0.9 all is well, with 0.999 the full model grows by tens of decades.
FAST = (
    "time.end=2.0",
    "mesh.elements=16",
    "slider.path={kind='ramp',times=[0.05,1.0,1.95],values=[0.7,4.2,0.7]}",
    "reduction.coordinates=8",
)
GROWN = (*FAST, "time.rho_inf=0.999")


def response(displacement: np.ndarray, surplus: float = np.nan) -> Response:
    nothing = np.zeros(len(displacement))
    energy = Energy(nothing, nothing, nothing)
    return Response(
        T, np.zeros(1), displacement[:, None], energy, nothing[:, None], nothing, nothing, 0.0, surplus=surplus
    )


def test_what_can_be_trusted() -> None:
    smooth = np.sin(20.0 * T)
    assert reason_for_distrust(response(smooth)) is reason_for_distrust(response(smooth, 0.05)) is None
    assert "12 % of its largest energy" in str(reason_for_distrust(response(smooth, 0.12)))
    assert "overflows" in str(reason_for_distrust(response(smooth, np.inf)))
    assert "not finite" in str(reason_for_distrust(response(np.full(200, np.nan), 0.0)))
    shaken = smooth + 3.0 * ALTERNATING * (-1.0) ** np.arange(200)
    assert "changes its sign with every step" in str(reason_for_distrust(response(shaken)))


def test_warnings() -> None:
    smooth = np.sin(20.0 * T)
    assert missing_reference_warnings({}) == distrust_warnings(response(smooth, 0.01)) == []
    [reference], [reduced] = missing_reference_warnings({"ancf": "it broke"}), distrust_warnings(response(smooth, 0.3))
    assert reference == "no reference by the ANCF cable: it broke"
    assert reduced.startswith("the reduced model's motion is not to be trusted: 30 % of its largest energy")


@pytest.mark.slow
def test_a_run_without_reference_says_so(load_scene) -> None:
    outcome = run(load_scene("evolved_residual", GROWN), MPI.COMM_SELF)
    assert outcome is not None
    result, summary = outcome.result, outcome.result.summary
    assert "grows without bound" in summary["no_reference"]["full"]
    assert summary["errors"] == {}
    assert summary["max_error"] is None
    assert summary["max_displacement"] < 0.1
    assert list(result.responses) == ["reduced"]
    [warning] = [warning for warning in summary["warnings"] if warning.startswith("no reference by the full model")]
    assert "rho_inf" in warning
    table = errors.rows(result)
    assert [row.comparison for row in table if row.value == "no reference"] == ["reduced against full"]
    shown = chapter(result, "case-1")
    assert [warning[:1].upper() + warning[1:]] == [line for line in shown.warnings if "no reference" in line.lower()]
    assert "times the true error" not in " ".join(point.text for point in shown.points)


@pytest.mark.slow
def test_the_same_run_with_a_reference_has_one(load_scene) -> None:
    outcome = run(load_scene("evolved_residual", FAST), MPI.COMM_SELF)
    assert outcome is not None
    summary = outcome.result.summary
    assert summary["no_reference"] == {}
    assert summary["errors"]["reduced_vs_full"]["beam"] < 0.01
    assert outcome.result.responses["full"].surplus < 0.01


@pytest.mark.mpi
@pytest.mark.parametrize("simulator", ["march", "petsc"])
def test_every_rank_knows_that_there_is_none(load_scene, simulator: str) -> None:
    fast = "slider.path={kind='ramp',times=[0.02,0.22,0.42],values=[0.7,4.2,0.7]}"
    few = ["time.end=0.3", "mesh.elements=8", fast, "reduction.coordinates=8", "time.rho_inf=0.999"]
    scene = load_scene("evolved_residual", [*few, f"simulation.full={simulator}"])
    full = FullOrder.join(scene, {ALONE: full_model(scene)})
    found = full.references(steps=[0, 20])
    assert found.responses == found.states == {}
    assert "grows without bound" in found.missing["full"]
    with pytest.raises(SimulationError, match="grows without bound"):
        full.reference("full")


def test_a_cable_that_fails_is_no_reference_either(load_scene) -> None:
    case = [
        *GROWN,
        "body.profile.axial=true",
        "compare.against=['ancf']",
        "compare.ancf_elements=8",
        "time.rho_inf=1.0",
    ]
    scene = load_scene("evolved_residual", case)
    found = FullOrder.join(scene, {ALONE: full_model(scene)}).references()
    assert found.responses == {}
    assert "ANCF" not in found.missing["ancf"]
    assert "rho_inf" in found.missing["ancf"]


@pytest.mark.slow
def test_a_reduced_motion_that_grows_is_no_result(load_scene) -> None:
    """The paper's basis keeps its slider rigid: index 3 here too."""
    scene = load_scene("paper_evolved", [*GROWN[:3], "compare.against=[]", "time.rho_inf=0.9999"])
    with pytest.raises(InputError, match=r"time\.rho_inf = 0\.9999: a smaller one is allowed: .*grows without bound"):
        run(scene, MPI.COMM_SELF)


def test_a_study_takes_no_such_reference(load_scene) -> None:
    scene = load_scene("evolved_residual", GROWN)
    task = shared.reference_task(scene, "full")
    with pytest.raises(SimulationError, match="grows without bound"):
        task.function(task.arguments, {})


def test_responses_keep_their_surplus() -> None:
    found = response(np.sin(T), 0.25)
    assert npz.record_from_arrays(Response, npz.record_arrays(found)).surplus == 0.25
    older = {name: array for name, array in npz.record_arrays(found).items() if name != "surplus"}
    assert np.isnan(npz.record_from_arrays(Response, older).surplus)
    assert replace(found, surplus=np.inf).surplus == np.inf


SHORT = ["mesh.elements=8", "reduction.snapshots=3", "reduction.modes=3", "reduction.coordinates=6", "time.end=0.4"]
SHORT += ["time.step=4e-3", "slider.path=2.5", "compare.against=[]", "simulation.simulators=['march']"]


@pytest.mark.slow
@pytest.mark.parametrize(("force", "times"), [(-50.0, None), (-5e7, True), (-5e4, True)])
def test_a_motion_as_large_as_the_body_is_said(force: float, times: bool | None) -> None:
    scene = scenes.load(Path("workflows/paper_simple.toml"), [*SHORT, f"loads=[{{on=5.0,signal={force!r}}}]"])
    outcome = run(scene)
    assert outcome is not None
    said = [line for line in outcome.result.summary["warnings"] if "theory of small motions" in line]
    assert len(said) == (1 if times else 0)
    if times:
        assert outcome.result.summary["max_displacement"] > 0.5
