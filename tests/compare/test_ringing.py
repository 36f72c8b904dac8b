"""Multipliers that ring at the step's own frequency are the time integration's, and no error of a reduced model."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import one_body
import pytest
from driving import driven
from oracle import flexible, full_body

from pmr.compare.errors import nrms
from pmr.compare.summary import simulate_saved
from pmr.compare.trust import (
    RINGING_SHARE,
    RingingReference,
    alternating_share,
    alternation_cause,
    alternation_remedy,
    is_ringing,
    rigid_contacts,
    ringing_share,
    ringing_warnings,
)
from pmr.pipeline import run
from pmr.report import errors
from pmr.scene.signals import Chirp, Sine, SmoothRamp
from pmr.simulation import TimeStepping, balance
from pmr.simulation.modal import modal_form

#: 3 m/s on a smooth path.  With rho_inf = 0.97 the energy's surplus is below 1e-3 and displacements agree to 2e-5, and
#: 98 % of the full model's slider force alternate.
FAST = (
    "time.end=1.0",
    "mesh.elements=16",
    "slider.path={kind='smooth_ramp',times=[0.05,0.5,0.95],values=[0.9,2.1,0.9]}",
    "reduction.coordinates=8",
    "compare.against=['full']",
)
SIGNS = (-1.0) ** np.arange(200)[:, None]
SMOOTH = np.sin(0.1 * np.arange(200))[:, None]


@pytest.mark.parametrize("per_period", [2, 4, 10, 40])
def test_the_alternating_share_of_a_tone(per_period: int) -> None:
    tone = np.cos(2.0 * np.pi * np.arange(40 * per_period) / per_period)
    assert alternating_share(tone) == pytest.approx(np.sin(np.pi / per_period) ** 8, rel=0.02)


def test_what_is_too_short_or_still_does_not_alternate() -> None:
    assert (
        alternating_share(np.ones(8)) == alternating_share(np.zeros((20, 3))) == ringing_share(np.zeros((20, 3))) == 0.0
    )
    assert ringing_share(np.arange(8.0)[:, None]) == 0.0


def test_only_the_reference_is_said_to_ring_where_it_does() -> None:
    shaken = SMOOTH + 0.1 * SIGNS
    assert is_ringing(SMOOTH, shaken)
    assert not is_ringing(shaken, SMOOTH)  # the reduced model's own ringing is its error
    assert not is_ringing(shaken, shaken)
    assert not is_ringing(SMOOTH, SMOOTH + 0.5 * RINGING_SHARE * SIGNS)
    assert not is_ringing(0.5 * SMOOTH, shaken)  # off by more than what rings


def test_a_rigid_row_is_blamed_only_where_there_is_one() -> None:
    """Behind kinks "a rigid row that moves" was said to ring where all pads give way."""
    row = SimpleNamespace(compliance=0.0, kind="pad", name="mouth")
    pad, cylinder = (
        SimpleNamespace(compliance=1e-8, kind="pad", name="tail"),
        SimpleNamespace(compliance=0.0, kind="cylinder", name="cylinder of fly"),
    )
    stiff, flexible = SimpleNamespace(flexibility=None), SimpleNamespace(flexibility=object())

    def named(body: object, *contacts: object) -> list[str]:
        return rigid_contacts(SimpleNamespace(bodies={"": body}, contacts=contacts))  # type: ignore[arg-type]

    assert named(stiff, pad) == [] and "rigid" not in alternation_cause([]) + alternation_remedy([])
    assert named(stiff, row, pad, cylinder) == ["mouth", "cylinder of fly"] and named(flexible, row, pad) == []
    said = ringing_warnings({"pad_force": RingingReference(0.1, 3.0, 0.01)}, named(stiff, pad, cylinder))
    assert "cylinder of fly is rigid" in said[0] and "pads that give way" not in said[0]


@pytest.mark.slow
def test_a_reference_that_rings_is_not_booked_on_the_reduced_model(load_scene) -> None:
    found = {}
    for rho_inf in (0.8, 0.97):
        outcome = run(load_scene("evolved_residual", [*FAST, f"time.rho_inf={rho_inf}"]))
        assert outcome is not None
        found[rho_inf] = outcome.result
    calm, rung = (one.summary for one in found.values())
    assert calm["not_judged"] == {} and calm["errors"]["reduced_vs_full"]["pad_force"] < RINGING_SHARE
    assert rung["no_reference"] == {} and rung["errors"]["reduced_vs_full"]["beam"] < 1e-3
    assert all("pad_force" not in rung[kind]["reduced_vs_full"] for kind in ("errors", "absolute_errors"))
    assert rung["not_judged"]["pad_force"]["alternating"] > 0.5 > 10.0 * rung["not_judged"]["pad_force"]["below"]
    [warning] = [line for line in rung["warnings"] if line.startswith("the full model is no reference of pad forces")]
    assert "rho_inf = 0.8 or less" in warning
    assert ("slider force", "not judged") in [(row.place, row.value) for row in errors.rows(found[0.97])]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "rung"), [("smooth_ramp", False), ("ramp", True)])
def test_a_reduced_model_that_rings_is_said_to(load_scene, path: str, rung: bool) -> None:
    """The paper's basis keeps its slider rigid."""
    changes = [*FAST[:2], FAST[2].replace("smooth_ramp", path), "compare.against=[]"]
    outcome = run(load_scene("paper_evolved", changes))
    assert outcome is not None
    for result in (outcome.result, simulate_saved(outcome.system, outcome.result.scene)):
        said = [line for line in result.summary["warnings"] if line.startswith("of the forces of sliders and pads")]
        assert len(said) == rung


@pytest.mark.slow
def test_no_force_is_blamed_that_agrees_with_more_damping() -> None:
    """Random smooth paths: an error that is judged is at most three times that with rho_inf = 0.8, beside `RINGING`."""
    rng, beam = np.random.default_rng(12), full_body(elements=50)
    full, rich = modal_form(beam), modal_form(flexible(beam, 24))
    unjudged = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(balance, "GROWN", np.inf)
        for _ in range(60):
            step, rho_inf = float(rng.choice([1e-3, 5e-4])), float(rng.choice([0.9, 0.95, 0.97, 0.98, 0.99, 0.995]))
            half, speed = rng.uniform(0.3, 2.2), 10.0 ** rng.uniform(-0.5, 1.0)
            knots = (0.05, 0.05 + 2.0 * half / speed, 0.05 + 4.0 * half / speed)
            path = SmoothRamp(times=knots, values=(2.6 - half, 2.6 + half, 2.6 - half))
            if rng.random() < 0.5:
                path = Sine(amplitude=half, frequency=speed / half / 2.0 / np.pi, offset=2.6)
            load = Chirp(amplitude=50.0, times=(0.0, 1.0), frequencies=(1.0, float(rng.uniform(2.0, 15.0))))
            forces = {}
            for rho in (0.8, rho_inf):
                drive = driven(path, load, TimeStepping(1.0, step, rho))
                forces[rho] = [one_body.simulate_modal(form, drive) for form in (rich, full)]
            if forces[rho_inf][1].surplus > balance.NOTABLE:
                continue
            reduced, reference = (one.multipliers for one in forces[rho_inf])
            if is_ringing(reduced, reference):
                unjudged += 1
            else:
                damped = nrms(*(one.multipliers for one in forces[0.8]))
                assert nrms(reduced, reference) < max(RINGING_SHARE, 3.0 * damped), (path, rho_inf, step)
    assert unjudged > 0
