"""A boom that luffs by itself with a payload on a rope, beside the equations of a rigid boom and a pendulum."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import free_boom
import numpy as np
import pytest
from oil_boom import (
    AREAS,
    BACK,
    RIGID,
    UP_AND_DOWN,
    G,
    K,
    chambers,
    flows,
    geometry,
    oil,
    opening_at,
    rigid,
    simulated,
    weight_moment,
)
from scipy.integrate import solve_ivp

from pmr.files.arrays import Array
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.free_motion import LuffingRun

pytestmark = pytest.mark.slow  # a boom is reduced

MASS, EA, FALLS, HANGING, SWING, SPEED, END = 60.0, 2e6, 2, 1.5, 0.4, 0.3, 0.5
HOIST = (
    "frame.second_order=false",
    f"hoist={{payload={MASS}, EA={EA}, falls={FALLS}, hanging={HANGING}, swing=[{SWING}, 0.0]}}",
    f"hoist.speed={{kind='smooth_ramp', times=[0.1, 0.3], values=[0.0, {SPEED}]}}",
)
#: Winch by the place it is at: from the pivot on the machine, or from the tail of the base section.
WINCHES = {"machine": "hoist.winch.at=[-0.4, 0.1, 0.5]", "boom": "hoist.winch={section='base', at=[0.4, 0.0, 0.1]}"}
STRETCHED = 6  # of the states: the length of the rope without force


def turned(angle: float, place: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]]) @ place


@cache
def places(winch: str) -> tuple[Array, Array]:
    """Head and winch, x and z from the pivot, on a boom that lies level."""
    tail = np.array(free_boom.scene().frame.tail_position)[[0, 2]]
    return tail + [2.6, 0.0], np.array([-0.4, 0.5]) if winch == "machine" else tail + [0.4, 0.1]


@cache
def run_of(winch: str, step: float) -> SimpleNamespace:
    keys = (*RIGID, oil(UP_AND_DOWN, "", True), *HOIST, WINCHES[winch])
    return simulated(*keys, f"time.end={END}", f"time.step={step}")


def rope_of(winch: str, angle: float, payload: Array) -> SimpleNamespace:
    """Length of the rope, and how it grows with the angle and with the payload's place."""
    head, at = places(winch)
    turn = turned(angle, head)
    carried = turned(angle, at) if winch == "boom" else at
    down, back = payload - turn, carried - turn
    hanging, along = np.hypot(*down), np.hypot(*back)
    quarter = np.array([-turn[1], turn[0]])  # d turn / d angle
    moved = np.array([-carried[1], carried[0]]) if winch == "boom" else np.zeros(2)
    by_angle = -FALLS * down @ quarter / hanging + back @ (moved - quarter) / along
    return SimpleNamespace(
        length=FALLS * hanging + along, along=along, by_angle=by_angle, by_payload=FALLS * down / hanging
    )


def wound(t: float) -> float:
    x = float(np.clip((t - 0.1) / 0.2, 0.0, 1.0))
    return SPEED * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


@cache
def reference(winch: str) -> Any:
    """Angle, its rate, payload and rope, its rates, and pressures by Radau's method, as functions of time."""
    boom = run_of(winch, 1e-3).boom
    head = turned(0.3, places(winch)[0])
    way, force = np.array([np.sin(SWING), -np.cos(SWING)]), MASS * G * np.cos(SWING) / FALLS
    along = rope_of(winch, 0.3, head + way).along
    unstretched = along + FALLS * HANGING
    payload = head + way * (unstretched * (1.0 + force / EA) - along) / FALLS
    moment = weight_moment(boom, 0.3) - force * rope_of(winch, 0.3, payload).by_angle
    push = -moment / geometry(0.3)[1]
    begun = [0.3, 0.0, *payload, 0.0, 0.0, unstretched, (push + BACK * AREAS[1]) / AREAS[0], BACK]

    def rates(t: float, y: Array) -> Array:
        angle, rate, place, velocity, unstretched, p = y[0], y[1], y[2:4], y[4:6], y[STRETCHED], y[7:]
        rope, (length, arm) = rope_of(winch, angle, place), geometry(angle)
        force = max(0.0, EA * (rope.length / unstretched - 1.0))
        q, swept = flows(opening_at(t), p, True), arm * rate * np.array([AREAS[0], -AREAS[1]])
        moment = weight_moment(boom, angle) + (p @ [AREAS[0], -AREAS[1]]) * arm - force * rope.by_angle
        falling = -force * rope.by_payload / MASS - [0.0, G]
        return np.array([rate, moment / boom.J, *velocity, *falling, -wound(t), *(K / chambers(length) * (q - swept))])

    scale = np.array([1e-12, 1e-11, *[1e-12] * 2, *[1e-11] * 2, 1e-12, 1e-3, 1e-3])
    return solve_ivp(
        rates, (0.0, END), begun, "Radau", rtol=1e-8, atol=1e3 * scale, dense_output=True, max_step=5e-3
    ).sol


def errors(winch: str, step: float) -> Array:
    """Largest errors of angle and of both pressures, as shares of the angle travelled and of the largest."""
    run = run_of(winch, step)
    y = reference(winch)(run.t)
    sizes = np.array([np.ptp(y[0]), *np.abs(y[7:]).max(axis=1)])
    computed = np.array([run.angle[0], run.pressure_bore, run.pressure_rod])
    return np.abs(computed - y[[0, 7, 8]]).max(axis=1) / sizes


@pytest.mark.parametrize("winch", WINCHES)
def test_payload_and_oil_move_a_rigid_boom_as_a_stiff_solver_has_it(winch: str) -> None:
    coarse, fine = errors(winch, 5e-4), errors(winch, 2.5e-4)
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.15)
    assert errors(winch, 6.25e-5).max() < 1e-5


def missing_energy(step: float) -> float:
    """Largest change of the energy of boom, payload and rope without a cylinder, over what the boom gains at most."""
    keys = (*RIGID, *HOIST[:-1], WINCHES["boom"], "frame.luffing_start=-1.0", "start='equilibrium'", "time.rho_inf=0.9")
    scene, system = free_boom.scene(*keys, "time.end=0.8", f"time.step={step}"), free_boom.system(*keys)
    moved, boom = LuffingRun(scene, system).with_luffing(), rigid(*keys)
    hoist = systems.simulate_form(SystemForm.of(system), Excitation.from_scene(moved), None).hoist
    assert hoist is not None and moved.frame is not None
    (angle, rate, _), place, force = moved.frame.luffing.samples.values, hoist[:, [1, 3]], hoist[:, 6]
    velocity = np.gradient(place, step, axis=0, edge_order=2)
    unstretched = rope_of("boom", 0.3, places("boom")[0] + [0.0, 1.0]).along + FALLS * HANGING
    height = boom.sx * np.sin(angle) + boom.sz * np.cos(angle)
    kinetic = boom.J * rate**2 / 2.0 + MASS * (velocity**2).sum(axis=1) / 2.0
    energy = kinetic + G * (height + MASS * place[:, 1]) + force**2 * unstretched / (2.0 * EA)
    return float(np.abs(energy[1:-1] - energy[1]).max() / (boom.J * rate**2 / 2.0).max())


def test_energy_of_boom_payload_and_rope_stays_but_for_the_step() -> None:
    coarse, fine = missing_energy(1e-3), missing_energy(5e-4)
    assert coarse / fine == pytest.approx(4.0, rel=0.1)
    assert fine < 2e-4
