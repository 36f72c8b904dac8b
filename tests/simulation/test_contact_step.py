"""Steps in parts, as many as the contact of pads that only push takes."""

import os
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import one_body
import pytest
from on_pads import beam_on_pads, driven, flexible_on_pads, modes_on_pads
from one_body import energy, respond
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel, Stepper, System
from pmr.files import npz
from pmr.scene.signals import Constant
from pmr.simulation import Excitation, InitialState, TimeStepping, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.modal import modal_form
from pmr.system.body import Trajectory, pushing_rows
from pmr.system.contacts import SLIDER

STIFFNESS = 3e8  # N/m, a scene's default
FALL = 5e-3  # m
BODIES = {"modes": modes_on_pads, "flexible": flexible_on_pads}
REST = (Constant(amount=0.0), Constant(amount=0.0))


def on_a_spring(mass: float, stiffness: float, clearance: float) -> ReducedModel:
    """One mass that meets one pad."""
    row, none = PPoly(np.ones((1, 1, 1, 1)), [0.0, 1.0]), np.zeros((1, 1))
    return ReducedModel(
        np.array([[mass]]), none, none, none, np.eye(1), row, ("F",), ("pad",), np.zeros(1),
        pads=np.array([1.0 / stiffness]), clearance=np.array([clearance]),
    )  # fmt: skip


def fall(body: ReducedModel, stepping: TimeStepping) -> Trajectory:
    """The beam falls by the clearance of its pads and bounces between those below and above."""
    return one_body.simulate(body, driven(Constant(amount=3.0), (Constant(amount=9.81), REST[1]), stepping))


@pytest.mark.parametrize("stiffness", [1e2, 1e8])
def test_the_frequency_of_a_contact_is_that_of_a_mass_on_its_pad(stiffness: float) -> None:
    body = on_a_spring(2.0, stiffness, 1e-3)
    x = np.array([[0.0], [0.0]])
    omega = contact_step.contact_frequency_at(System.of(body), x)
    assert omega == pytest.approx(np.sqrt(stiffness / 2.0), rel=1e-12)
    assert contact_step.contact_frequency_at(System.of(modal_form(body).body), x) == pytest.approx(omega, rel=1e-12)
    assert Stepper(body, step=1e-3, s=0.5).contact == pytest.approx(1e-3 * omega, rel=1e-12)
    both_ways = replace(body, clearance=None)
    assert not pushing_rows(both_ways) and contact_step.contact_frequency_at(System.of(both_ways), x) == 0.0


def test_as_many_parts_as_the_contact_takes() -> None:
    stepping = TimeStepping(1.0, 1e-3)
    assert [contact_step.count_parts(omega, stepping) for omega in (0.0, 50.0, 50.1, 1000.0)] == [1, 1, 2, 20]
    assert contact_step.count_parts(1e9, stepping) == contact_step.MOST_PARTS
    assert (
        contact_step.count_parts(1e9, TimeStepping(1.0, 1e-6)) == 5
        and contact_step.count_parts(1e9, TimeStepping(5.0, 1e-7)) == 1
    )
    assert contact_step.count_parts(1e9, TimeStepping(1.0, 1e-3, parts=3)) == 3
    with pytest.raises(InputError, match=r"time\.parts = -1: 0 or more"):
        TimeStepping(1.0, 1e-3, parts=-1)


def said(what: Callable[..., Any], body: ReducedModel, excitation: Excitation) -> Any:
    return what(contact_frequency(System.of(body), excitation.on_slider), excitation.stepping)


@pytest.mark.parametrize(("end", "step"), [(1.0, 0.1), (30.0, 0.05)])
def test_the_step_that_is_said_to_be_enough_is_enough(end: float, step: float) -> None:
    """Where all steps together would have too many parts, only a step that needs none is."""
    body, path = on_a_spring(2.0, 3e8, 1e-3), Constant(amount=0.5)
    (line,) = said(contact_step.warnings, body, driven(path, [], TimeStepping(end, step)))
    enough = float(re.search(r"time\.step = (\S+) s", line)[1])
    steps = int(np.ceil(end / enough))
    assert said(contact_step.warnings, body, driven(path, [], TimeStepping(end, end / steps))) == []


@pytest.mark.parametrize("coordinates", [4, 10])
@pytest.mark.parametrize("kind", BODIES)
def test_stiff_pads_and_steps_of_a_millisecond_give_the_forces_of_a_fine_step(kind: str, coordinates: int) -> None:
    """Until the beam has rung through its first impacts: 0.2 s.  With one part a step 3 to 38 % are lost."""
    body = BODIES[kind](beam_on_pads(FALL, STIFFNESS, 20), coordinates)
    coarse, fine = fall(body, TimeStepping(0.2, 1e-3)), fall(body, TimeStepping(0.2, 2e-6, parts=1))
    assert coarse.peaks is not None and fine.parts is not None and fine.parts.max() == 1
    most = fine.multipliers.max(axis=0)
    assert np.abs(coarse.peaks.max(axis=0) - most).max() < 0.03 * most.max()
    assert np.all(coarse.peaks >= coarse.multipliers)
    assert np.array_equal(coarse.t, np.arange(201) * 1e-3) and coarse.s.shape == (201,)


@pytest.mark.slow
@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("stiffness", [1e6, 3e8, 1e10])
@pytest.mark.parametrize("kind", BODIES)
def test_energy_is_kept_where_it_is_resolved_and_never_grows(kind: str, stiffness: float, rho_inf: float) -> None:
    """Many impacts; at 1e10 N/m and steps of 10 ms even the parts are too long."""
    body = BODIES[kind](beam_on_pads(1e-3, stiffness), 6)
    v = np.zeros(6)
    v[:4] = np.random.default_rng(0).standard_normal(4) * [0.6, 0.6, 1.0, 0.6]
    for h in (1e-3, 1e-2):
        stepping = TimeStepping(2000 * h, h, rho_inf)
        found = one_body.simulate(body, driven(Constant(amount=3.5), REST, stepping), InitialState(np.zeros(6), v))
        total = energy(body, found, np.zeros((2001, 2))).total
        assert found.peaks is not None and np.count_nonzero(found.peaks.max(axis=1) > 0.0) > 20
        assert total.max() <= total[0] * (1.0 + 1e-12)


def test_five_seconds_of_rebounds_keep_their_energy() -> None:
    """The beam between pads of 3e8 N/m, steps of 1 ms; with one part a step all but some 1e-2 of it is gone."""
    body = modes_on_pads(beam_on_pads(1e-3, STIFFNESS), 4)
    start = InitialState(np.zeros(4), np.array([0.6, 0.4, 0.0, 0.0]))
    left = {}
    for parts in (0, 1):
        found = one_body.simulate(body, driven(Constant(amount=3.5), REST, TimeStepping(5.0, 1e-3, 0.9, parts)), start)
        total = energy(body, found, np.zeros((5001, 2))).total
        left[parts] = total[-1] / total[0]
    assert left[0] > 0.8 and left[1] < 0.05


def test_parts_are_smaller_steps_of_which_the_last_is_kept() -> None:
    body = modes_on_pads(beam_on_pads(1e-3, 1e8), 4)
    found = fall(body, TimeStepping(0.5, 1e-3, 0.9, parts=7))
    every = fall(body, TimeStepping(0.5, 1e-3 / 7, 0.9, parts=1))
    for name in ("q", "v", "multipliers", "s"):
        a, b = getattr(found, name), getattr(every, name)[::7]
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-9 * max(np.abs(b).max(), 1e-12))
    assert found.peaks is not None
    within = every.multipliers[1:].reshape(500, 7, 4).max(axis=1)
    np.testing.assert_allclose(found.peaks[1:], within, rtol=0.0, atol=1e-9 * within.max())
    loads, stepping = (Constant(amount=9.81), REST[1]), TimeStepping(0.5, 1e-3, 0.9, parts=7)
    seen = one_body.observe(modal_form(body), driven(Constant(amount=3.0), loads, stepping), outputs=[3], every=5)
    np.testing.assert_allclose(seen.multipliers, found.multipliers[::5], rtol=0.0, atol=1e-6 * within.max())


def test_a_response_has_the_peaks_of_pads_that_only_push() -> None:
    body = modes_on_pads(beam_on_pads(FALL, STIFFNESS, 20), 4)
    found = fall(body, TimeStepping(0.2, 1e-3))
    response = respond(body, found, np.zeros(201), np.tile([9.81, 0.0], (201, 1)))
    assert found.peaks is not None and response.force_peaks is not None
    name = response.force_names[0]
    assert np.array_equal(response.force(name), found.peaks[:, 0])
    again = npz.record_from_arrays(type(response), npz.record_arrays(response))
    assert np.array_equal(again.force(name), found.peaks[:, 0])


def test_a_contact_that_no_part_resolves_is_told_with_a_step_that_does() -> None:
    path = Constant(amount=0.5)
    body = on_a_spring(1.0, 1e10, 1e-3)  # omega = 1e5 / s
    coarse = driven(path, [], TimeStepping(1.0, 1e-3))
    (line,) = said(contact_step.warnings, body, coarse)
    assert "h omega = 0.5 in each of the 200 parts of a step, 0.05 resolves" in line and "time.step = 0.0001 s" in line
    assert said(contact_step.warnings, body, driven(path, [], TimeStepping(0.1, 1e-4))) == []
    assert said(contact_step.summary, body, coarse) == {
        "contact": {"omega": pytest.approx(1e5), "parts": 200, "h_omega": pytest.approx(0.5)}
    }
    one_part = driven(path, [], TimeStepping(1.0, 1e-3, parts=1))
    (line,) = said(contact_step.warnings, on_a_spring(1.0, 1e6, 1e-3), one_part)
    assert "h omega = 1 in each of the 1 parts" in line and "time.step = 5e-05 s" in line
    both_ways = replace(body, clearance=None)
    assert said(contact_step.warnings, both_ways, coarse) == [] and said(contact_step.summary, both_ways, coarse) == {}


#: Falls of the sweep: a sample in CI, all of them with PMR_SWEEP=full.
FALLS = 200 if os.environ.get("PMR_SWEEP") == "full" else 30


@pytest.mark.slow
def test_first_impacts_of_random_falls_are_those_of_a_fine_step() -> None:
    """Stiffness over three decades, any step, place and number of modes; with one part a step a fifth are 10 % off."""
    rng, off, whole = np.random.default_rng(7), [], []
    for number in range(FALLS):
        stiffness, r, clearance = (
            10.0 ** rng.uniform(6.0, 9.0),
            int(rng.integers(3, 11)),
            10.0 ** rng.uniform(-3.3, -2.0),
        )
        h, s, rho_inf = float(rng.choice([2e-4, 5e-4, 1e-3, 2e-3])), rng.uniform(2.0, 4.5), rng.choice([0.5, 0.9, 1.0])
        body = list(BODIES.values())[number % 2](beam_on_pads(clearance, stiffness, 20), r)
        steps = int(np.ceil((1.6 * np.sqrt(2.0 * clearance / 9.81) + 0.01) / h))
        system = System.of(body)
        omega = contact_step.contact_frequency_at(system, system.side_coordinates({SLIDER: np.array([s])}))
        found = []
        for parts in (0, 1, max(2, int(np.ceil(h * omega / 0.004)))):
            stepping = TimeStepping(steps * h, h, float(rho_inf), parts)
            run = one_body.simulate(body, driven(Constant(amount=s), (Constant(amount=9.81), REST[1]), stepping))
            found.append(float((run.multipliers if run.peaks is None else run.peaks).max()))
        off.append(abs(found[0] / found[2] - 1.0))
        whole.append(abs(found[1] / found[2] - 1.0))
    assert max(off) < 0.05
    assert np.count_nonzero(np.array(whole) > 0.1) > 0.1 * FALLS


def test_parts_that_another_run_has_chosen_are_no_reason_for_a_warning() -> None:
    """Steps that are divided as those of a free extension were: they may have had shorter parts, and needed none."""
    stepping, omega = TimeStepping(1.0, 2e-3), 2000.0
    assert contact_step.warnings(omega, stepping) == []
    assert contact_step.warnings(omega, replace(stepping, schedule=(16,) * stepping.steps)) == []
    assert contact_step.warnings(omega, replace(stepping, parts=16)) != []
