"""A boom on a base that moves freely: its equations beside those of a frame, and what they conserve."""

from dataclasses import replace

import free_boom
import momenta
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pmr import InputError, System
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.scene.rotation import FrameRotation
from pmr.simulation import Excitation
from pmr.simulation.frame_motion import Acceleration
from pmr.simulation.free_base import Extensions, FrameMotion, FreeBase, Moments, base_equations
from pmr.system.assembly import Assembly

pytestmark = pytest.mark.slow  # a boom is reduced


def extended(scene: Scene, t: float) -> Extensions:
    path = scene.extension(1)
    found = [float(one(t)) for one in (path.value, path.rate, path.second_rate)]
    return Extensions(*(np.array([0.0, one]) for one in found))


def test_sections_weigh_what_they_should() -> None:
    boom = FreeBase(free_boom.scene(), free_boom.system()).boom
    walls = [2.0 * 2.0 * (b + h) * t for b, h, t in ((0.24, 0.20, 0.005), (0.21, 0.17, 0.004))]
    assert boom.mass == pytest.approx(7850.0 * sum(walls) + 20.0, rel=1e-12)
    np.testing.assert_allclose(boom.first[1], [7850.0 * walls[1] + 40.0, 0.0, 0.0], rtol=0.0, atol=1e-9)
    (gust,) = [k for k, name in enumerate(free_boom.system().input_names) if name == "fly.gust"]
    np.testing.assert_allclose(boom.loads[1][:, gust], [0.0, 1.0, 0.0, 0.0, 0.0, 2.0], rtol=0.0, atol=1e-12)


def test_coordinates_feel_what_a_frame_makes_them_feel() -> None:
    """Loads and terms of a frame that luffs and slews, all of second order among them."""
    turns = ("frame.luffing={kind='sine', amplitude=0.4, frequency=0.7}",)
    turns += ("frame.slewing={kind='sine', amplitude=0.9, frequency=0.5}",)
    scene, system = free_boom.scene(*turns), free_boom.system()
    assembly, excitation, t = Assembly(system), Excitation.from_scene(scene), np.array([0.07])
    boom, turning = FreeBase(scene, system, assembly), FrameRotation.from_signals(*scene.frame.angles, t)
    second = float(Acceleration(paths=(scene.extension(1),), step=scene.time.step).value(0.07))
    out = replace(extended(scene, 0.07), second=np.array([0.0, second]))
    q, rate = np.random.default_rng(0).normal(size=(2, assembly.size))
    weight = scene.gravity.signal.value(t)[0] * turning.up[0]
    pressed = base_equations(boom.boom, FrameMotion(turning.velocity[0], weight), out, q, rate)
    known = np.concatenate([np.zeros(3), turning.acceleration[0], np.zeros(assembly.size), out.second])
    own = (pressed.forces + pressed.mass @ known)[6 : 6 + assembly.size]
    loads = [excitation.loads[one].value(t)[0] if INERTIA in one else 0.0 for one in system.input_names]
    c = excitation.amplitudes(system.term_names, t)
    expected = assembly.B @ np.array(loads) + assembly.term_forces(q[None], rate[None], c)[0]
    np.testing.assert_allclose(-own, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


class Adrift:
    """The boom on a turret in space, no weight, so soft that it bends by decimetres."""

    mass, inertia = 300.0, np.diag([40.0, 60.0, 50.0])  # of the turret, about the pivot

    def __init__(self, scene: Scene, system: System) -> None:
        assembly = Assembly(system)
        self.scene, self.boom, self.n = scene, FreeBase(scene, system, assembly), assembly.size
        self.M = assembly.M.toarray()
        self.K = 900.0 * self.M

    def start(self) -> Array:
        """Place of O, its axes, velocities v and omega, q and q', and the work of the cylinder."""
        q, rate = np.random.default_rng(1).normal(size=(2, self.n)) * [[0.02], [0.5]]
        return np.concatenate([[1.0, 2.0, 3.0], np.eye(3).ravel(), [0.4, -0.3, 0.2, 0.8, -0.5, 1.1], q, rate, [0.0]])

    def parts(self, y: Array) -> tuple[Array, ...]:
        return tuple(np.split(y, np.cumsum([3, 9, 3, 3, self.n, self.n])))

    def rates(self, t: float, y: Array) -> Array:
        _, R, v, omega, q, rate, _ = self.parts(y)
        R, out, n = R.reshape(3, 3), extended(self.scene, t), self.n
        pressed = base_equations(self.boom.boom, FrameMotion(omega, np.zeros(3)), out, q, rate)
        mass = pressed.mass.copy()
        mass[6 : 6 + n, 6 : 6 + n] += self.M
        mass[:3, :3] += self.mass * np.eye(3)
        mass[3:6, 3:6] += self.inertia
        given = pressed.forces + mass[:, 6 + n :] @ out.second
        given[6 : 6 + n] += self.K @ q
        given[3:6] += np.cross(omega, self.inertia @ omega)
        a = -np.linalg.solve(mass[: 6 + n, : 6 + n], given[: 6 + n])
        force = given[6 + n :] + mass[6 + n :, : 6 + n] @ a
        spin = np.cross(omega, np.eye(3), axisb=0, axisc=0)
        moved = (R @ v, (R @ spin).ravel(), a[:3] - np.cross(omega, v), a[3:6], rate, a[6:], [force @ out.rate])
        return np.concatenate(moved)

    def conserved(self, t: float, y: Array) -> tuple[Array, Array, float]:
        """Linear and angular momentum in space, and energy less the work of the cylinder."""
        O, R, v, omega, q, rate, work = self.parts(y)
        R, out, motion = R.reshape(3, 3), extended(self.scene, t), FrameMotion(omega, np.zeros(3))
        turret = np.append(self.mass * v, self.inertia @ omega)
        p = momenta.momentum(self.boom, motion, v, out, q, rate) + turret
        energy = (
            momenta.kinetic(self.boom, motion, v, out, q, rate)
            + (rate @ self.M @ rate + q @ self.K @ q) / 2.0
            - work[0]
        )
        energy += (v @ turret[:3] + omega @ turret[3:]) / 2.0
        return R @ p[:3], R @ p[3:] + np.cross(O, R @ p[:3]), energy


def test_momenta_and_energy_stay_while_it_telescopes() -> None:
    adrift = Adrift(free_boom.scene("sections.fly.joint.extension.times=[0.0, 0.8]"), free_boom.system())
    found = solve_ivp(adrift.rates, (0.0, 0.1), adrift.start(), method="DOP853", rtol=1e-10, atol=1e-10)
    before, after = (adrift.conserved(found.t[k], found.y[:, k]) for k in (0, -1))
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-10 * np.abs(one).max())
    moved = adrift.parts(found.y[:, -1])
    assert np.abs(moved[-1]) > 1e-4 * abs(before[2])  # the cylinder worked
    assert np.abs(moved[4]).max() > 0.02


class Drawn(Adrift):
    """The same, its extension a coordinate: a rod of so many kg on a spring; moments change as it is drawn out."""

    def __init__(self, scene: Scene, system: System, rod: float) -> None:
        super().__init__(scene, system)
        self.rod, self.spring, self.relaxed = rod, 2e4, 0.55
        own = self.boom.boom.moments.value
        self.changed = np.random.default_rng(2).normal(size=(2, *own.shape)) * np.abs(own).max()

    def start(self) -> Array:
        return np.append(super().start()[:-1], [0.6, 0.5])

    def moments(self, s: float, v: float) -> Moments:
        """Beta + s beta_1 + s^2 beta_2."""
        own, (one, two) = self.boom.boom.moments.value, self.changed
        slope = np.zeros((*own.shape, 2))
        slope[..., 1] = one + 2.0 * s * two
        return Moments(own + s * one + s**2 * two, slope, 2.0 * two * v**2)

    def rates(self, t: float, y: Array) -> Array:
        _, R, v, omega, q, rate, (s, s_t) = self.parts(y)
        R, n, out = R.reshape(3, 3), self.n, Extensions(*np.array([[0.0, s], [0.0, s_t], [0.0, 0.0]]))
        pressed = base_equations(self.boom.boom, FrameMotion(omega, np.zeros(3)), out, q, rate, self.moments(s, s_t))
        free = np.delete(np.arange(8 + n), 6 + n)
        mass, forces = pressed.mass[np.ix_(free, free)], pressed.forces[free]
        mass[6 : 6 + n, 6 : 6 + n] += self.M
        mass[:3, :3] += self.mass * np.eye(3)
        mass[3:6, 3:6] += self.inertia
        mass[-1, -1] += self.rod
        forces[6 : 6 + n] += self.K @ q
        forces[3:6] += np.cross(omega, self.inertia @ omega)
        forces[-1] += self.spring * (s - self.relaxed)
        a, spin = -np.linalg.solve(mass, forces), np.cross(omega, np.eye(3), axisb=0, axisc=0)
        moved = (R @ v, (R @ spin).ravel(), a[:3] - np.cross(omega, v), a[3:6], rate, a[6:-1], [s_t, a[-1]])
        return np.concatenate(moved)

    def conserved(self, t: float, y: Array) -> tuple[Array, Array, float]:
        O, R, v, omega, q, rate, (s, s_t) = self.parts(y)
        R, motion, moments = R.reshape(3, 3), FrameMotion(omega, np.zeros(3)), self.moments(s, s_t)
        out, turret = Extensions(*np.array([[0.0, s], [0.0, s_t], [0.0, 0.0]])), self.inertia @ omega
        p = momenta.momentum(self.boom, motion, v, out, q, rate, moments) + np.append(self.mass * v, turret)
        energy = (
            momenta.kinetic(self.boom, motion, v, out, q, rate, moments) + (rate @ self.M @ rate + q @ self.K @ q) / 2.0
        )
        energy += (self.mass * v @ v + omega @ turret + self.rod * s_t**2 + self.spring * (s - self.relaxed) ** 2) / 2.0
        return R @ p[:3], R @ p[3:] + np.cross(O, R @ p[:3]), energy


def test_momenta_and_energy_stay_while_a_spring_draws_it_out() -> None:
    drawn = Drawn(free_boom.scene(), free_boom.system(), rod=30.0)
    found = solve_ivp(drawn.rates, (0.0, 0.1), drawn.start(), method="DOP853", rtol=1e-10, atol=1e-10)
    before, after = (drawn.conserved(found.t[k], found.y[:, k]) for k in (0, -1))
    for one, other in zip(before, after, strict=True):
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-9 * np.abs(one).max())
    moved = drawn.parts(found.y[:, -1])
    assert np.abs(moved[-1] - [0.6, 0.5]).max() > 0.05
    assert np.abs(moved[4]).max() > 0.01


def test_what_is_refused() -> None:
    scene = free_boom.scene()
    planar = scene.model_copy(update={"frame": scene.frame.model_copy(update={"slewing": None})})
    with pytest.raises(InputError, match="luffs and slews"):
        FreeBase(planar, free_boom.system())
