"""Multipliers that ring at the step's own frequency are the time integration's, and no error of a reduced model.

What is left of motions and forces that cancel or that nothing drives is nobody's error.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import one_body
import pytest
from driving import driven
from one_body import respond
from oracle import flexible, full_body
from scipy.interpolate import PPoly

from pmr import ReducedModel, reduce, run
from pmr import scene as scenes
from pmr.compare.errors import relative_error
from pmr.compare.estimate import chi
from pmr.compare.evaluation import evaluate_motion as of_sections
from pmr.compare.motion import force_round_off, round_off
from pmr.compare.outputs import run_from_start
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
from pmr.report import errors
from pmr.scene.signals import Chirp, Constant, Sine, SmoothRamp
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.simulation.stepping import NOTABLE
from pmr.system.body import Trajectory

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
        patch.setattr("pmr.simulation.stepping.GROWN", np.inf)
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
            if forces[rho_inf][1].surplus > NOTABLE:
                continue
            reduced, reference = (one.multipliers for one in forces[rho_inf])
            if is_ringing(reduced, reference):
                unjudged += 1
            else:
                damped = relative_error(*(one.multipliers for one in forces[0.8]))
                assert relative_error(reduced, reference) < max(RINGING_SHARE, 3.0 * damped), (path, rho_inf, step)
    assert unjudged > 0


WORKFLOWS = Path(__file__).parents[2] / "workflows"

ALONG = {
    "planar": ("evolved_residual.toml", "loads=[{name='X',on=5.0,direction='x',signal=1e3}]", "mesh.elements=20",
     "simulation.simulators=['march']", "time.end=6.0"),
    "space": ("boom.toml", "loads=[]", "gravity.direction=[-1.0,0.0,0.0]", "body.model=beam3d", "mesh.elements=12"),
}  # fmt: skip


def two_springs(turned: float) -> ReducedModel:
    """A load along one spring, an output and a slider along the other; coordinates turned by an angle in rad."""
    c, s = np.cos(turned), np.sin(turned)
    T = np.array([[c, -s], [s, c]])
    K, row = T.T @ np.diag([2e4, 3e4]) @ T, np.array([[0.0, 1.0]]) @ T
    pieces = PPoly(np.stack([0.1 * row, 0.95 * row])[:, None], [0.0, 1.0])  # the row at s = 0.5 m
    return ReducedModel(
        np.eye(2), np.zeros((2, 2)), K, T.T[:, :1], row, pieces, ("F",), ("slider",), np.zeros(1), pads=np.array([1e-5])
    )


def test_round_off_is_that_of_the_body_not_of_its_coordinates() -> None:
    loads = np.array([[3.0], [-7.0]])
    w2 = (2.0 * np.pi / 5.0) ** 2
    exact = 7e-11 / np.sqrt((2e4 + w2) * (3e4 + w2))
    for turned in (0.0, 1e-3, 0.7):
        assert round_off({"": two_springs(turned)}, loads, 5.0) == pytest.approx(exact, rel=1e-9, abs=0.0)
    assert round_off({"": two_springs(0.7)}, 1e-200 * loads, 5.0) == pytest.approx(1e-200 * exact, rel=1e-9, abs=0.0)


def test_a_mode_that_only_round_off_moves_has_no_share_of_its_own() -> None:
    """The first spring moves half as far again as its load holds it, the second one by a few units of round-off."""
    t, still = np.linspace(0.0, 1.0, 5), np.array([1.0, -2.0, 1.0, 3.0, 0.0])
    load = np.cos(t)[:, None]
    q = np.column_stack([1.5 * load[:, 0] / 2e4, np.spacing(1.5 / 2e4) * still])
    run = Trajectory(t, q, np.zeros_like(q), np.zeros((5, 1)), np.full(5, 0.5), 0.0)
    assert chi(two_springs(0.0), run, load, 0) == pytest.approx(0.5 / 1.5, rel=1e-9)
    assert chi(two_springs(0.0), run, load, 1) == 0.0


def test_of_several_bodies_all_loads_reach_every_output() -> None:
    """By the triangle inequality: the sum over the loads, and the largest output."""
    loads, w2 = np.array([[3.0, 2.0], [-7.0, 5.0]]), (2.0 * np.pi / 5.0) ** 2
    found = round_off({"base": two_springs(0.0), "fly": two_springs(0.7)}, loads, 5.0)
    assert found == pytest.approx(12e-11 / np.sqrt((2e4 + w2) * (3e4 + w2)), rel=1e-9, abs=0.0)


def test_a_response_of_sections_knows_its_round_off() -> None:
    boom = scenes.load_any(WORKFLOWS / "boom_two.toml", ("time.end=0.1", "section.mesh.elements=8"))
    system, excitation = reduce(boom).system, Excitation.from_scene(boom)
    run_ = run_from_start(system, excitation)
    found, loads = of_sections(system, run_), excitation.forces(system.input_names)
    assert found.round_off == pytest.approx(round_off(system.bodies, loads, boom.time.end), rel=1e-9)
    assert 0.0 < found.round_off < 1e-6 * np.abs(found.displacement).max()


def test_forces_have_a_round_off_too() -> None:
    model, stepping = two_springs(0.7), TimeStepping(1.0, 1e-3)
    motion = one_body.simulate(model, driven(Constant(amount=0.5), Constant(amount=7.0), stepping))
    f, w2 = np.full((1001, 1), 7.0), (2.0 * np.pi) ** 2
    least = 7e-11 / np.sqrt(2e4 + w2) / np.sqrt(1.0 / (3e4 + w2) + 1e-5)
    assert force_round_off(model, f, 1.0, 0.5) == pytest.approx(least, rel=1e-9, abs=0.0)
    response = respond(model, motion, np.zeros(1001), f)
    assert np.abs(response.slider_force).max() < response.force_round_off == pytest.approx(least, rel=1e-9, abs=0.0)
    assert np.abs(response.displacement).max() < response.round_off


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONG)
def test_a_load_along_the_axis_bends_nothing(name: str) -> None:
    """A mast under its weight: no error, no step too coarse, no pad that is pulled."""
    file, *changes = ALONG[name]
    outcome = run(scenes.load(WORKFLOWS / file, changes))
    assert outcome is not None
    summary = outcome.result.summary
    errors = summary["errors"]["reduced_vs_full"]
    assert [errors[name] for name in ("tip", "beam", "pad_force")] == [
        0.0,
        0.0,
        0.0,
    ]  # along the axis the support bears
    assert (summary["estimate"]["beam"], summary["step"]["beam"]) == (0.0, 0.0)
    beyond = {"planar": ["second order is left out: axial forces change the stiffness by some 14 %"], "space": []}
    assert [warning.partition(" at ")[0] for warning in summary["warnings"]] == beyond[name]
