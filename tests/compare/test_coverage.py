"""What the estimate of a scene does not cover is named: loads beyond the enrichment modes, if there are any.

What damping makes of the residual part's own deformation, against full models.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import on_pads
import pytest
from alone import estimate, outputs
from driving import driven
from fuzz import toml
from fuzz.bases import MOVED
from on_pads import beam_on_pads
from oracle import enriched, full_body, with_curvature

from pmr import InputError, SimulationError, run
from pmr.compare.outputs import RoundOffBounds, differences
from pmr.compare.trust import (
    AWAY_FROM_PROBES,
    LOAD_JUMPS,
    MACHINE_MOTION,
    RIGID_REACTIONS,
    SLIDER_IMPACTS,
    STRESSES,
    coverage_warnings,
    effects_not_covered,
    highest_mode_frequency,
    stress_clauses,
)
from pmr.report import trust
from pmr.scene import load as read
from pmr.scene.signals import Chirp, Constant, Ramp, Signal, Sine, SmoothRamp, Step, Sum, Table
from pmr.simulation import TimeStepping
from pmr.system.body import FullBody
from pmr.system.body_matrices import Rayleigh

MODEL = enriched(full_body(20), 9, enrichment=6)  # the highest enrichment mode is at 179 Hz, at the steps at 163 Hz

STEPPING = TimeStepping(2.0, 1e-3)


def test_the_highest_frequency_known_is_that_of_the_steps() -> None:
    assert MODEL.enrichment is not None
    true = float(np.sqrt(MODEL.enrichment.stiffness[-1])) / (2.0 * np.pi)
    assert highest_mode_frequency(MODEL, TimeStepping(1.0, 1e-5)) == pytest.approx(true, rel=1e-4)
    omega, h = 2.0 * np.pi * true, 1e-3
    # the trapezoidal rule keeps all energy and turns a mode by 2 atan(omega h / 2) in a step
    step = np.linalg.solve([[1.0, -h / 2], [omega**2 * h / 2, 1.0]], [[1.0, h / 2], [-(omega**2) * h / 2, 1.0]])
    turned = abs(float(np.angle(np.linalg.eigvals(step)[0])))
    assert highest_mode_frequency(MODEL, STEPPING) == pytest.approx(turned / (2.0 * np.pi * h), rel=1e-9)


@pytest.mark.parametrize(
    "signal",
    [
        Constant(amount=3.0),
        Sine(amplitude=1.0, frequency=100.0),
        Sine(amplitude=1.0, frequency=1010.0),  # 10 Hz at the steps, which another warning says
        Chirp(amplitude=1.0, times=(0.0, 2.0), frequencies=(0.5, 120.0)),
        Step(time=0.3, after=1.0),
        Ramp(times=(0.1, 0.5, 0.6), values=(0.0, 1.0, 0.5)),
        SmoothRamp(times=(0.1, 0.11, 0.12), values=(0.0, 1.0, 0.0)),
    ],
    ids=lambda signal: signal.kind,
)
def test_what_the_enrichment_know_is_covered(signal: Signal) -> None:
    assert effects_not_covered(MODEL, [("load F", signal)], STEPPING) == []
    assert coverage_warnings([STRESSES, AWAY_FROM_PROBES]) == []


NOISE = Table(times=tuple(np.linspace(0.0, 2.0, 2001)), values=tuple(np.random.default_rng(1).normal(size=2001)))


@pytest.mark.parametrize(
    ("signal", "said"),
    [
        (Sine(amplitude=1.0, frequency=197.0), "load F, 197 Hz, excites beyond the highest enrichment mode, 163"),
        (Sum(terms=(Constant(amount=1e6), Sine(amplitude=1.0, frequency=197.0))), "load F, 197 Hz"),
        (Chirp(amplitude=1.0, times=(0.0, 2.0), frequencies=(1.0, 300.0)), "load F, 300 Hz"),
        (Sine(amplitude=1.0, frequency=803.0), "load F, 803 Hz"),  # 197 Hz at the steps
        (SmoothRamp(times=(0.1, 0.1025, 0.105), values=(0.0, 1.0, 0.0)), "% of it above the highest enrichment mode"),
        (NOISE, "% of it above the highest enrichment mode"),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_a_load_beyond_the_enrichment_is_named(signal: Signal, said: str) -> None:
    quiet = ("the slider's path", Constant(amount=2.0))
    (clause,) = effects_not_covered(MODEL, [quiet, ("load F", signal)], STEPPING)
    assert said in clause and coverage_warnings([clause, STRESSES]) == [
        f"the error may be larger than its estimate: {clause}"
    ]


def test_more_enrichment_cover_more() -> None:
    tone = [("load F", Sine(amplitude=1.0, frequency=197.0))]
    assert len(effects_not_covered(MODEL, tone, STEPPING)) == 1
    assert effects_not_covered(enriched(full_body(20), 9, enrichment=12), tone, STEPPING) == []


@pytest.mark.slow
def test_damping_that_couples_modes_is_not_covered_but_estimated_without() -> None:
    slightly = np.zeros((9, 9))
    slightly[4, 5] = slightly[5, 4] = 1e-7
    model = replace(MODEL, D=0.1 * np.eye(9) + slightly)
    assert effects_not_covered(model, [], STEPPING) == [
        "the damping of modes beyond the enrichment modes, which is not Rayleigh's"
    ]
    found = estimate(model, driven(Constant(amount=2.0), Sine(amplitude=1.0, frequency=3.0), TimeStepping(0.2, 1e-3)))
    assert found.by == "attachment" and found.error_of("beam") > 0.0


SHORT = ["time.end=0.4", "mesh.elements=20", "slider.path={kind='ramp',times=[0.1,0.3],values=[1.25,1.6]}"]

HELD = "supports=[{name='cylinder',on='tail',directions=['x'],stiffness=%s}]"

TONE = "loads=[{name='F',on=5.0,signal={kind='sum',terms=[10.0,{kind='sine',amplitude=50.0,frequency=197.0}]}}]"


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", ["'rigid'", "1e9"])
def test_reactions_of_rigid_supports_have_an_estimate(load_scene, stiffness: str) -> None:
    short = ["time.end=0.1", "compare.against=[]", "simulation.simulators=['march']", "recovery.frames=2"]
    outcome = run(load_scene("boom_beam", [*short, HELD % stiffness, "recovery.every=0.05"]))
    assert outcome is not None
    found = outcome.result.summary["estimate"]
    assert ("reaction" in found) == (stiffness == "'rigid'") and found["not_covered"] == [STRESSES]
    probe = "probes=[{name='web',at=[2.0,0.0,0.2],measures=['stress']}]"
    for change, said in (([probe], [AWAY_FROM_PROBES]), (["recovery.stress=false"], [])):
        assert stress_clauses(load_scene("boom_beam", change)) == said


@pytest.mark.slow
@pytest.mark.parametrize("free", [["z", "ry"], []])
def test_the_motion_of_a_machine_that_is_found_is_named(tmp_path: Path, free: list[str]) -> None:
    """The full model follows it, so that no error has it."""
    held = {"mass": 3000.0, "free": free, "stiffness": dict.fromkeys(free, 2e6)}
    scene = MOVED | {"frame": MOVED["frame"] | {"machine": held}, "time": {"end": 0.02, "step": 2e-3}, "recovery": None}
    (tmp_path / "scene.toml").write_text(toml.written({key: one for key, one in scene.items() if one is not None}))
    outcome = run(read(tmp_path / "scene.toml"))
    assert outcome is not None
    assert (MACHINE_MOTION in outcome.result.summary["estimate"]["not_covered"]) == bool(free)


@pytest.mark.slow
@pytest.mark.parametrize("load", [[], [TONE]])
def test_a_run_says_it_in_report_and_summary(load_scene, load: list[str]) -> None:
    outcome = run(load_scene("evolved_residual", [*SHORT, *load, "simulation.simulators=['march']"]))
    assert outcome is not None
    summary, text = (
        outcome.result.summary,
        dict(trust.trust_table(outcome.result).rows)[trust.NOT_IN_ERROR.format("reduction")],
    )
    left_out = summary["estimate"]["not_covered"]
    assert left_out[-2:] == [RIGID_REACTIONS, SLIDER_IMPACTS]  # without stresses, which this beam does not have
    assert (len(left_out) == 3) == bool(load) == any("larger than its estimate" in line for line in summary["warnings"])
    assert all(clause in text for clause in left_out)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "function", "error"),
    [
        ("evolved_residual", "estimate_error", SimulationError("stopped at step 7")),
        ("paper_evolved", "estimate_by_other_model", InputError("scene", "time", None, "march refuses")),
        ("paper_evolved", "estimate_by_other_model", SimulationError("stopped at step 7")),
    ],
)
def test_an_estimate_that_fails_leaves_the_run_standing(load_scene, monkeypatch, name, function, error) -> None:
    reason = str(error)

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(f"pmr.compare.error_parts.{function}", fails)
    outcome = run(load_scene(name, [*SHORT, "simulation.simulators=['march']", "compare.against=[]"]))
    assert outcome is not None
    found = outcome.result.summary["estimate"]
    assert found["beam"] is None and found["reason"] == reason and outcome.result.tip_error is None
    assert reason in dict(trust.trust_table(outcome.result).rows)["reduction"]


def test_without_tones_and_steps_there_is_no_share() -> None:
    still = replace(STEPPING, end=1e-3)
    assert effects_not_covered(MODEL, [("load F", NOISE)], still) == []


def test_forces_of_a_load_that_sets_in_at_once_have_no_estimate_where_damping_is_strong() -> None:
    """What was said was down to a hundredth of the truth, whatever the model."""
    full, end = full_body(20), TimeStepping(1.0, 1e-3)
    step, smooth = Step(time=0.3, after=20.0), SmoothRamp(times=(0.2, 0.4), values=(0.0, 20.0))
    path = SmoothRamp(times=(0.1, 0.8), values=(1.5, 3.0))
    for share, load, known in ((1e-3, step, False), (1e-3, smooth, True), (1e-7, step, True)):
        model = enriched(replace(full, D=share * full.K, rayleigh=Rayleigh(0.0, share)), 4, enrichment=4)
        found = estimate(model, driven(path, load, end))
        assert ("pad_force" in found.errors) == known and (found.unknown.get("pad_force") == LOAD_JUMPS) != known


EXTENSION = on_pads.driven(
    SmoothRamp(times=(0.1, 0.4), values=(2.1, 2.4)),
    (Constant(amount=0.0), Sine(amplitude=200.0, frequency=3.0)),
    TimeStepping(0.5, 2.5e-4),
)


def damped(beta: float, stiffness: float) -> FullBody:
    """In proportion to stiffness, with a gauge beside the pads' path."""
    full = with_curvature(beam_on_pads(None, stiffness), 4)
    return replace(full, D=beta * full.K, rayleigh=Rayleigh(0.0, beta))


def test_estimates_know_of_it() -> None:
    full = damped(1e-3, 2e4)
    model = replace(enriched(full, 12, enrichment=4), rayleigh=full.rayleigh)
    truth, own = (outputs(one, EXTENSION) for one in (full, model))
    found, floors = estimate(model, EXTENSION), RoundOffBounds(0.0, 0.0, np.zeros(1))
    true = differences(own, truth, floors, ["beam", "probe"])
    assert 1.0 < found.error_of("probe") / true["probe"] < 2.0 and 1.0 < found.error_of("beam") / true["beam"] < 2.0
