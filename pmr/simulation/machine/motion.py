"""The motion of a machine and its boom, step by step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.scene import Scene
from pmr.scene.frame import INERTIA, BaseMotion
from pmr.scene.machine import DIRECTIONS
from pmr.scene.signals import Constant
from pmr.simulation.found import MachineMotion, in_motion
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.machine.flexible import Flexible, Moved
from pmr.simulation.machine.rigid import Carrier, Rigid, Whole
from pmr.simulation.machine.weights import Weights
from pmr.system.system import System

Array = NDArray[np.float64]
#: Of the fastest motion so far, to which a step's rates are found.
ROUND_OFF = 1e-12
#: The same, where a further trial comes no nearer, which round-off of larger momenta keeps from it.
NEAR = 1e-9
#: Times that a step is tried with one derivative, which secants mend, then with another one, and in all.
PATIENCE, LIMIT = 6, 30
#: m/s and rad/s by which rates differ for a derivative, at least; and of the fastest motion.
DIFFERENCE = 1e-4
#: m/s and rad/s: the least of the fastest motion, whose square is a number.
SLOWEST = 1e-100
#: Cosine of pitch, where roll and yaw turn about almost the same axis.
UPRIGHT = 0.02


def with_machine_moved(scene: Scene, system: System) -> tuple[Scene, System]:
    """The scene with a frame that moves as its machine is found to, and the system with all inertia, as it is there.

    Both as they are where the scene has no machine.  Errors as for `machine_motion`.
    """
    if scene.frame is None or scene.frame.machine is None:
        return scene, system
    system = with_all_inertia(system)
    return in_motion(scene, machine_motion(scene, system)), system


def machine_motion(scene: Scene, system: System) -> MachineMotion:
    """Of the machine of a scene.

    Raises
    ------
    InputError
        If rows of the system are not on carriers, or supports of the base are not known.
    SimulationError
        If a step fails, or the machine pitches until it stands upright.
    """
    return _Stepping(scene, system).run()


@dataclass(frozen=True)
class _Inertial:
    """How a step accelerates the boom."""

    carrier: Carrier
    felt: Array  # (6,) by which the machine accelerates it on average, along its axes
    inputs: Array  # (i',) at the end of the step, whose average with those at its beginning does so
    smooth: Array  # (i',) as generalized-alpha has them


@dataclass(frozen=True)
class _Tried:
    """A motion that a step may end with."""

    b: Array  # (3, 6)
    inertial: _Inertial
    moved: Moved
    whole: Whole
    left: Array  # (6,): impulses that nothing bears, by the directions


class _Stepping:
    """Where machine and boom stand: motion b (3, 6), momenta, and smoothed accelerations and forces."""

    def __init__(self, scene: Scene, system: System) -> None:
        frame = scene.frame
        assert frame is not None and frame.machine is not None  # of those who ask
        still = BaseMotion(**dict.fromkeys(DIRECTIONS, Constant(amount=0.0)))
        resting = scene.model_copy(update={"frame": frame.model_copy(update={"base": still, "machine": None})})
        self.flexible = Flexible(resting, with_all_inertia(system))
        self.rigid = Rigid(scene, self.flexible.form.system, self.flexible)
        self._weights, self._in_balance = Weights(self.flexible.method), scene.start == "equilibrium"
        self._free = np.isin(DIRECTIONS, frame.machine.free)
        self._slope: Array | None = None
        self._rates = list[Array]()

    def run(self) -> MachineMotion:
        t = self.flexible.times
        values, forces, momenta = np.zeros((3, len(t), 6)), np.zeros((len(t), 6)), np.zeros((len(t), 6))
        self._begin()
        inputs = np.zeros((len(self._inertia), len(t)))
        for k in range(len(t)):
            if k:
                self._advance(k)
            values[:, k], momenta[k] = self._b, self._found
            inputs[:, k] = self._inertia
            forces[k] = -(self._held + self._whole.springs)
        names = self.flexible.form.system.input_names if self._free.any() else ()
        by_name = dict(zip([name for name in names if INERTIA in name], inputs, strict=False))
        return MachineMotion(self._weights.method.step, values, forces, by_name, momenta)

    # -- the start

    def _begin(self) -> None:
        """Where springs carry what stands on them if all begins in equilibrium; accelerations are of all together."""
        b = self.rigid.given[:, 0].copy()
        b[:2, self._free] += self.rigid.start[:, self._free]
        b = self._balanced(b) if self._in_balance else b
        states = self.flexible.at_rest(_still(b)) if self._in_balance else {}
        free = np.flatnonzero(self._free)

        def needed(second: Array) -> Array:
            b[2, free] = second
            return self.rigid.needed(0, b, self.flexible.begin(b, states))

        none = needed(np.zeros(len(free)))
        slope = np.array([needed(one) - none for one in np.eye(len(free))]).reshape(-1, 6).T
        self._held = needed(-np.linalg.solve(slope[free], none[free]))
        self._held[free] = 0.0
        self._b, self._smooth = b.copy(), b[2].copy()
        self._carrier = self.rigid.carrier(0, b)
        self._felt = self._carrier.felt(b[2])
        self._inertia = self.flexible.inputs(0, b)[0][self.flexible.inertial]
        self._inertia_smooth = self._inertia.copy()
        self._whole = self.rigid.at(0, b, self.flexible.begin(b, states))
        self._forces, self._found = self._whole.forces.copy(), self._whole.momenta
        balanced = self._weights.method.step * self.rigid.balanced(self._whole)
        self._fastest = np.full(2, max(balanced, SLOWEST))
        self._fastest = self._speed(b)

    def _balanced(self, b: Array) -> Array:
        """With directions that springs carry where these are in equilibrium with weight and loads."""
        sprung = np.flatnonzero(self._free & self.rigid.sprung)
        b = b.copy()

        def left(at: Array) -> Array:
            b[0, sprung] = at
            resting = _still(b)
            q = self.flexible.coordinates(self.flexible.at_rest(resting))
            moved = Moved(q, 0.0 * q, self.flexible.inputs(0, resting)[0], 0.0 * q)
            return self.rigid.needed(0, resting, moved)[sprung]

        at = b[0, sprung].copy()
        for _ in range(LIMIT):
            now = left(at)
            slope = np.array([(left(at + d) - now) / DIFFERENCE for d in DIFFERENCE * np.eye(len(at))]).T
            change = np.linalg.solve(slope, now) if len(at) else now
            at = at - change
            if np.abs(change).max(initial=0.0) <= 1e-12 * max(1.0, np.abs(at).max(initial=0.0)):
                break
        else:
            raise SimulationError("the machine finds no equilibrium on its springs")
        b[0, sprung] = at
        return b

    # -- a step

    def _advance(self, k: int) -> None:
        """To step k: rates of free directions by which no force or moment is left that nothing bears."""
        tried = self._tried(k, self._expected())
        since, smallest = 0, np.inf
        for _ in range(LIMIT if self._free.any() else 0):
            if self._slope is None or since == PATIENCE:
                self._slope, since = self._derivative(k, tried), 0
                tried = self._tried(k, tried.b[1, self._free])  # what is taken is what was tried last
            change = -np.linalg.solve(self._slope, tried.left[self._free])
            error = self._error(change, tried.b)
            if error <= ROUND_OFF or (error <= NEAR and error > smallest / 2.0):
                break
            smallest, since, last = min(smallest, error), since + 1, tried
            tried = self._tried(k, tried.b[1, self._free] + change)
            missed = (tried.left - last.left)[self._free] - self._slope @ change
            self._slope = self._slope + np.outer(missed, change) / (change @ change)  # as Broyden has it
        else:
            if self._free.any():
                at = f"step {k}, t = {self.flexible.times[k]:g} s"
                raise SimulationError(f"the machine's motion is not found at {at}")
        self._take(k, tried)

    def _expected(self) -> Array:
        """Rates of free directions at the end of a step, as the last ones lead on."""
        self._rates = [*self._rates, self._b[1, self._free]][-3:]
        if len(self._rates) < 3:
            return np.asarray(self._rates[-1] + self._weights.method.step * self._smooth[self._free])
        return np.asarray(3.0 * (self._rates[2] - self._rates[1]) + self._rates[0])

    def _tried(self, k: int, rates: Array) -> _Tried:
        """With such rates of free directions."""
        w, b = self._weights, self.rigid.given[:, k].copy()
        free, old = self._free, self._b
        smooth = w.by_impulse(rates - old[1, free], self._smooth[free])
        b[0, free] = w.moved(old[0, free], old[1, free], self._smooth[free], smooth)
        b[1, free] = rates
        carrier, which = self.rigid.carrier(k, b), self.flexible.inertial
        if free.any():
            felt = carrier.change(self._carrier) / w.method.step
            ends = (k - 1, old, self._carrier), (k, b, carrier)
            both = [self.flexible.inputs(at, np.vstack([of[:2], on.second(felt)[None]]))[0] for at, of, on in ends]
            mean = (both[0] + both[1])[which] / 2.0
            b[2] = carrier.second((3.0 * felt - self._felt) / 2.0 if k > 1 else felt)
            smooth_inertia = w.by_impulse(w.method.step * mean, self._inertia_smooth)
            inertia = w.of_smoothed(smooth_inertia, self._inertia_smooth, self._inertia)
        else:
            felt, inertia = self._felt, self.flexible.inputs(k, b)[0][which]
            smooth_inertia = inertia
        moved = self.flexible.step(k, b, inertia)
        whole = self.rigid.at(k, b, moved)
        given = w.impulse(w.smoothed(whole.forces, self._whole.forces, self._forces), self._forces)
        left = whole.momenta - self._whole.momenta - given
        turned = left[3:] - np.cross((b[0, :3] + old[0, :3]) / 2.0, left[:3])
        inertial = _Inertial(carrier, felt, inertia, smooth_inertia)
        return _Tried(b, inertial, moved, whole, np.append(left[:3], (whole.axes + self._whole.axes).T @ turned / 2.0))

    def _derivative(self, k: int, at: _Tried) -> Array:
        rates, free = at.b[1, self._free], self._free
        steps = DIFFERENCE * np.eye(len(rates))
        return np.array([(self._tried(k, rates + one).left - at.left)[free] for one in steps]).T / DIFFERENCE

    def _error(self, change: Array, b: Array) -> float:
        """A change of rates as a share of the fastest motion so far."""
        whole = np.zeros(6)
        whole[self._free] = np.abs(change)
        return float((whole.reshape(2, 3).max(axis=1) / self._speed(b)).max())

    def _speed(self, b: Array) -> Array:
        """The fastest so far, along and about axes (2,), with that of a motion, its acceleration within a step too."""
        size = np.abs(b[1:]).reshape(2, 2, 3).max(axis=2) * [[1.0], [self._weights.method.step]]
        return np.asarray(np.maximum(self._fastest, size.max(axis=0)))

    def _take(self, k: int, tried: _Tried) -> None:
        """End a step with it, which was tried last."""
        b, whole, left, at = tried.b, tried.whole, tried.left, f"t = {self.flexible.times[k]:g} s"
        if not np.all(np.isfinite(b)):
            raise SimulationError(f"the machine's motion is not finite at {at}")
        if np.cos(b[0, 4]) < UPRIGHT:
            raise SimulationError(f"the machine pitches by 90 degrees at {at}, where roll and yaw turn about one axis")
        w, free = self._weights, self._free
        self.flexible.keep()
        self._smooth[free] = w.by_impulse(b[1, free] - self._b[1, free], self._smooth[free])
        own = tried.inertial
        self._carrier, self._felt, self._inertia, self._inertia_smooth = own.carrier, own.felt, own.inputs, own.smooth
        self._forces = w.smoothed(whole.forces, self._whole.forces, self._forces)
        self._held = np.where(free, 0.0, self.rigid.needed(k, b, self.flexible.accelerated(tried.moved)))
        # what round-off has left of a step is not carried on into the next one
        exact = whole.momenta.copy()
        exact[:3] -= np.where(free[:3], left[:3], 0.0)
        if free[3:].all():
            axes = (whole.axes + self._whole.axes) / 2.0
            turned = np.linalg.solve(axes.T, left[3:])
            exact[3:] -= turned + np.cross((b[0, :3] + self._b[0, :3]) / 2.0, np.where(free[:3], left[:3], 0.0))
        self._b, self._whole, self._found = b, replace(whole, momenta=exact), whole.momenta
        self._fastest = self._speed(b)


def _still(b: Array) -> Array:
    """The same place, at rest."""
    found = np.zeros_like(b)
    found[0] = b[0]
    return found
