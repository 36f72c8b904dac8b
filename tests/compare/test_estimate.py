from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from alone import estimate, outputs
from driving import Loads, driven, loads_at
from numpy.typing import NDArray
from oracle import flexible, full_body, inertial, nrms_error, paper_basis, project, rich_body, with_curvature

from pmr.compare import estimate as estimates
from pmr.compare import estimated
from pmr.compare.estimate import MARGIN, Estimate, by_other, no_estimate
from pmr.compare.estimated import envelope, warnings
from pmr.compare.indicators import kappa
from pmr.compare.outputs import Floors, Outputs, differences, probe_differences
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extended, with_kept_inertia
from pmr.scene.signals import Constant, Ramp, SignalBase, Sine, SmoothRamp
from pmr.simulation import TimeStepping
from pmr.simulation.native import simulator as march
from pmr.system.body import FullBody, displacement

Array = NDArray[np.float64]

PATH = SmoothRamp(times=(0.1, 0.8), values=(1.5, 3.0))
LOADS = (Sine(amplitude=200.0, frequency=3.0), Constant(amount=50.0))
STEPPING = TimeStepping(1.0, 1e-3)


def truth(full: FullBody, path: SignalBase, loads: Loads, stepping: TimeStepping) -> Array:
    run = march.simulate(full, driven(path, loads, stepping))
    f = loads_at(loads, run.t)
    return displacement(full, run.q, run.s, run.multipliers, f)


def errors(found: Estimate, model: ReducedModel, w: Array, path: SignalBase, loads: Loads) -> tuple[float, Array]:
    """e_NRMS of the model without kept inertia, and its error (T, o)."""
    run = march.simulate(model, driven(path, loads, STEPPING))
    f = loads_at(loads, run.t)
    y = displacement(model, run.q, run.s, run.multipliers, f)
    return nrms_error(y, w), w - y


@pytest.mark.parametrize("r", [5, 6, 9])
@pytest.mark.parametrize("body", ["paper", "rich"])
def test_it_is_the_error_and_a_margin(body: str, r: int) -> None:
    full, loads = (full_body(30), LOADS[0]) if body == "paper" else (rich_body(), LOADS)
    model = inertial(full, r, enrichment=4)
    w = truth(full, PATH, loads, STEPPING)
    found = estimate(model, driven(PATH, loads, STEPPING))
    beam, error = errors(found, model, w, PATH, loads)
    assert 1.0 < found.beam / beam < 1.6
    assert np.abs(found.error - error).max() < 0.35 * np.abs(error).max()
    assert found.largest == pytest.approx(MARGIN * np.abs(found.error).max())
    tip = np.sqrt(np.mean(error[:, -1] ** 2) / np.mean(w[:, -1] ** 2))
    assert 1.0 < found.tip / tip < 1.6
    assert found.seconds > 0.0


def moved(model: ReducedModel, path: SignalBase, loads: Loads) -> Array:
    run = march.simulate(model, driven(path, loads, STEPPING))
    f = loads_at(loads, run.t)
    return displacement(model, run.q, run.s, run.deforming, f)


@pytest.mark.parametrize("r", [6, 9])
def test_forces_and_velocities_have_estimates_of_their_own(r: int) -> None:
    full, excitation = rich_body(), driven(PATH, LOADS, STEPPING)
    model = inertial(full, r, enrichment=4)
    truth_, own = (outputs(one, excitation) for one in (full, model))
    found = estimate(model, excitation)
    for kind in ("pad_force", "velocity"):
        assert 1.0 < found.of(kind) / nrms_error(own.of(kind), truth_.of(kind)) < 2.0


@pytest.mark.parametrize("r", [6, 9])
def test_what_probes_measure_has_estimates_by_name(r: int) -> None:
    full, excitation = with_curvature(full_body(30), 11), driven(PATH, LOADS[0], STEPPING)
    model = inertial(full, r, enrichment=4)
    truth_, own = (outputs(one, excitation) for one in (full, model))
    found = estimate(model, excitation)
    assert list(found.probes) == ["gauge"] and found.of("probe") == found.probes["gauge"]
    assert 1.0 < found.probes["gauge"] / nrms_error(own.probe, truth_.probe) < 2.0
    assert own.displacement.shape[1] == 31  # the gauge is no place along the beam
    other = by_other(model, inertial(full, r + 4, enrichment=4), excitation).probes["gauge"]
    assert nrms_error(own.probe, truth_.probe) < other < 2.0 * found.probes["gauge"]
    assert estimated.summary(found)["probes"] == found.probes


def test_a_probe_that_sees_little_is_measured_by_a_hundredth_of_the_largest() -> None:
    one, floors = np.array([[1.0, 1e-4, 3.0], [-1.0, 1e-4, -3.0]]), Floors(0.0, 0.0, np.array([0.0, 0.0, 0.0]))
    reference = Outputs(one[:, :0], one[:, :0], one[:, :0], one, ("Pa", "Pa", "mm"), ())
    off = replace(reference, probe=one * (1.1, 3.0, 1.2))
    assert probe_differences(off, reference, floors) == pytest.approx([0.1, 0.02, 0.2])
    assert differences(off, reference, floors, ["probe"])["probe"] == pytest.approx(0.2)
    still = replace(floors, probe=np.array([0.0, 1e-3, 0.0]))
    assert probe_differences(off, reference, still)[1] == 0.0


def test_forces_have_none_where_a_rigid_slider_strikes() -> None:
    """At a kink of the path; a slider that gives way has an estimate."""
    kinked, model = Ramp(times=(0.1, 0.6), values=(2.0, 3.0)), inertial(full_body(20), 5, enrichment=4)
    assert estimate(model, driven(kinked, LOADS[0], STEPPING)).of("pad_force") == 0.0
    assert estimate(model, driven(PATH, LOADS[0], STEPPING)).of("pad_force") > 0.0
    soft = replace(model, pads=np.array([1e-7]))
    assert estimate(soft, driven(kinked, LOADS[0], STEPPING)).of("pad_force") > 0.0
    late = Ramp(times=(1.0, 2.0), values=(2.0, 3.0))  # the first kink is at the end
    assert estimate(model, driven(late, LOADS[0], STEPPING)).of("pad_force") > 0.0


def test_what_the_enrichment_say_is_scaled_by_their_share_where_inertia_is_kept() -> None:
    model, larger = (with_kept_inertia(inertial(full_body(30), *size)) for size in ((12, 2), (14, 0)))
    found = estimate(model, driven(PATH, LOADS[0], STEPPING))
    y = [moved(one, PATH, LOADS[0]) for one in (model, larger)]
    assert found.kappa < 0.95 and found.by == "enrichment"
    assert found.beam == pytest.approx(MARGIN / found.kappa * nrms_error(y[1], y[0]), rel=1e-3)
    assert found.tip == pytest.approx(MARGIN / found.kappa * nrms_error(y[1][:, -1:], y[0][:, -1:]), rel=1e-3)
    assert np.abs(found.error - (y[1] - y[0]) / found.kappa).max() < 1e-3 * np.abs(found.error).max()


def test_otherwise_the_second_run_has_the_enrichment_and_the_inertia_of_the_rest() -> None:
    full = full_body(30)
    model, larger = inertial(full, 14, enrichment=2), with_kept_inertia(inertial(full, 16))
    found = estimate(model, driven(PATH, LOADS[0], STEPPING))
    y = [moved(one, PATH, LOADS[0]) for one in (model, larger)]
    assert found.by == "inertia"
    assert found.beam == pytest.approx(MARGIN * nrms_error(y[1], y[0]), rel=1e-3)
    assert np.abs(found.error - (y[1] - y[0])).max() < 1e-3 * np.abs(found.error).max()


@pytest.mark.parametrize("r", [9, 12, 16])
def test_damping_of_what_is_left_out_is_in_it(r: int) -> None:
    """5 % at 5 and 40 Hz: most of the error is the damping of modes far beyond the enrichment modes."""
    plain = full_body(30)
    full = replace(plain, D=(2.79 * plain.M + 3.54e-4 * plain.K).tocsr())
    model, w = inertial(full, r, enrichment=2), truth(full, PATH, LOADS[0], STEPPING)
    found, true = estimate(model, driven(PATH, LOADS[0], STEPPING)), nrms_error(moved(model, PATH, LOADS[0]), w)
    assert 1.1 < found.beam / true < 1.4
    enrichment_alone = nrms_error(moved(extended(model), PATH, LOADS[0]), moved(model, PATH, LOADS[0]))
    assert enrichment_alone / found.kappa < 0.85 * true  # which is why they are not enough


def test_the_larger_one_of_both_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Inertia that sees nothing of the error leaves it to the enrichment modes."""
    model = inertial(full_body(30), 6, enrichment=4)
    both = estimate(model, driven(PATH, LOADS[0], STEPPING))
    monkeypatch.setattr(estimates, "with_kept_inertia", lambda _: model)
    alone = estimate(model, driven(PATH, LOADS[0], STEPPING))
    assert (both.by, alone.by) == ("inertia", "enrichment")
    assert alone.beam == pytest.approx(both.beam, rel=0.1) and np.abs(alone.error).max() > 0.0


def test_the_error_of_a_model_with_its_inertia_kept() -> None:
    full = full_body(30)
    w, model = truth(full, PATH, LOADS[0], STEPPING), inertial(full, 6, enrichment=4)
    plain, kept = (estimate(one, driven(PATH, LOADS[0], STEPPING)) for one in (model, with_kept_inertia(model)))
    run = march.simulate(with_kept_inertia(model), driven(PATH, LOADS[0], STEPPING))
    y = displacement(model, run.q, run.s, run.deforming, loads_at([LOADS[0]], run.t))
    assert 1.0 < kept.beam / nrms_error(y, w) < 1.6
    assert kept.beam < 0.7 * plain.beam and plain.kappa < kept.kappa < 1.0


def test_kappa_is_the_share_of_the_next_modes_in_the_inertia() -> None:
    full, s = full_body(20), np.linspace(0.5, 4.5, 23)
    model, every = inertial(full, 5, enrichment=3), inertial(full, 5, enrichment=25)
    assert model.enrichment and every.enrichment
    assert kappa(every, s) == pytest.approx(1.0, abs=1e-5)
    squares = every.enrichment.rows(s)[:, 0] ** 2
    whole, part = (squares[:, :c] @ every.enrichment.stiffness[:c] ** -2.0 for c in (25, 3))
    rms = np.sqrt(np.mean(part**2)), np.sqrt(np.mean(whole**2))
    assert kappa(model, s) == pytest.approx(rms[0] / rms[1], rel=1e-4)
    whole, part = (squares[:, :c] @ every.enrichment.stiffness[:c] ** -3.0 for c in (25, 3))
    exact = np.sqrt(np.mean(part**2)) / np.sqrt(np.mean(whole**2))
    assert 0.99 * exact < kappa(with_kept_inertia(model), s) < exact < 1.0


def test_chi_says_whether_the_first_truncated_mode_is_reached() -> None:
    model = inertial(full_body(20), 4, enrichment=4)  # the first mode left out is at 16.8 Hz
    slow, blow = SmoothRamp(times=(0.0, 0.9), values=(0.0, 50.0)), Sine(amplitude=50.0, frequency=17.0)
    rest = Constant(amount=2.0)
    assert estimate(model, driven(rest, slow, STEPPING)).chi < 0.05
    found = estimate(model, driven(rest, blow, STEPPING))
    assert found.chi > 0.5
    assert "first truncated mode (chi = " in warnings({"": model}, STEPPING, found)[0]


def test_nothing_moves_and_nothing_is_wrong() -> None:
    found = estimate(inertial(full_body(20), 5, enrichment=4), driven(PATH, Constant(amount=0.0), STEPPING))
    assert (found.beam, found.tip, found.chi, found.largest) == (0.0, 0.0, 0.0, 0.0)


def test_an_error_larger_than_the_motion_is_not_capped() -> None:
    model = inertial(full_body(20), 1, enrichment=1)
    found = estimate(model, driven(Constant(amount=2.0), Sine(amplitude=50.0, frequency=2.5), TimeStepping(3.0, 1e-3)))
    assert found.beam > 1.2 and found.tip > 1.2
    assert "times the motion: too few coordinates" in warnings({"": model}, STEPPING, found)[0]


@pytest.mark.slow
@pytest.mark.parametrize("r", [12, 18])
def test_of_any_basis_a_model_of_free_modes_tells_the_error(r: int) -> None:
    """At least the true one, and more by what that model is off by itself."""
    full, excitation = full_body(30), driven(PATH, LOADS[0], STEPPING)
    pod, w = project(full, paper_basis(full, 5, 6, r)), truth(full, PATH, LOADS[0], STEPPING)
    beam, error = errors(by_other(pod, inertial(full, 6, enrichment=4), excitation), pod, w, PATH, LOADS[0])
    for free in (6, 10):
        better = inertial(full, free, enrichment=4)
        found, own = by_other(pod, better, excitation), estimate(better, excitation)
        assert beam <= found.beam <= 1.01 * beam + 2.0 * own.beam
        assert np.abs(found.error - error).max() < 0.5 * own.largest
        assert found.by == "other model" and found.kappa is None and estimated.summary(found)["chi"] is None


def test_an_envelope_holds_an_oscillation_without_its_zeros() -> None:
    t = np.linspace(0.0, 10.0, 2001)
    error = np.stack([t * np.sin(2.0 * np.pi * 3.0 * t), np.zeros_like(t)], axis=1)
    found = envelope(error)
    assert np.all(found >= np.abs(error)) and np.all(found[:, 1] == 0.0)
    assert np.all(found[:, 0] <= t + 0.5) and np.all(found[200:, 0] >= t[200:] - 0.5)


def test_where_there_is_no_estimate_it_says_why() -> None:
    full = full_body(20)
    model = inertial(full, 5, enrichment=2)
    pod = project(full, paper_basis(full, 3, 3, 5))
    assert no_estimate({"": model}) is None
    assert "without residual flexibility" in str(no_estimate({"": pod}))
    assert "no eigenmodes" in str(no_estimate({"": replace(pod, flexibility=model.flexibility)}))
    for without in (
        flexible(full, 5),
        replace(model, enrichment=None),
        replace(flexible(full, 5), enrichment=model.enrichment),
        replace(model, clearance=np.zeros(1)),  # without carriers
    ):
        assert "keeps no enrichment modes" in str(no_estimate({"": without}))
    with pytest.raises(ValueError, match="no estimate: without residual flexibility"):
        estimate(pod, driven(PATH, LOADS[0], STEPPING))


def test_a_step_too_long_for_an_undamped_scheme_is_said() -> None:
    model = inertial(full_body(20), 8, enrichment=2)
    fastest = np.sqrt(model.K[-1, -1])
    for step, rho_inf, expected in ((2.2 / fastest, 1.0, 1), (1.8 / fastest, 1.0, 0), (2.2 / fastest, 0.9, 0)):
        assert len(warnings({"": model}, TimeStepping(100 * step, step, rho_inf), None)) == expected
    assert "h omega = 2.2" in warnings({"": model}, TimeStepping(220 / fastest, 2.2 / fastest, 1.0), None)[0]


def test_a_file_is_enough(tmp_path: Path) -> None:
    model = inertial(full_body(20), 5, enrichment=4)
    path = Ramp(times=(0.0, 1.0), values=(2.0, 3.0))
    expected = estimate(model, driven(path, LOADS[0], STEPPING))
    found = estimate(ReducedModel.load(model.save(tmp_path / "m.npz")), driven(path, LOADS[0], STEPPING))
    assert (found.beam, found.kappa, found.chi) == (expected.beam, expected.kappa, expected.chi)
