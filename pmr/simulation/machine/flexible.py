"""A boom's coordinates in a step of the compiled loop, with a given motion of the machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.simulation.excitation import Excitation
from pmr.simulation.floating import Extended
from pmr.simulation.moving import AXES, OF_BASE, MovingFrame
from pmr.simulation.native.arrays import ROW, V, Z
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import Handle, entry_of
from pmr.simulation.native.march import March
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.start import begin, places_of
from pmr.simulation.native.stepped import outputs_of, step_observed, step_of
from pmr.simulation.start import InitialState
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Moved:
    """Coordinates (n,) at the end of a step, as `pmr.system.assembly.Assembly` counts them, with their rates."""

    q: Array
    rate: Array
    loads: Array  # (i,) inputs
    second: Array | None = None  # where it is asked for


class Flexible:
    """A simulation whose steps are taken again and again until they fit the machine's motion (3, 6).

    That is value, rate and second rate of x, y, z, roll, pitch and yaw.
    """

    def __init__(self, scene: Scene, system: System) -> None:
        self.excitation, self.assembly = Excitation.of(scene), Assembly(system)
        self.frame, self.form = MovingFrame.in_scene(scene, system), SystemForm.of(system)
        self._scene, self._march = scene, March(self.form, self.excitation, {}, self.frame.examples)
        self.method = GeneralizedAlpha(self.excitation.stepping.step, self.excitation.stepping.rho_inf)
        self._drivers = self.frame.motions(self.excitation, self.excitation.times)
        self._angles, self._axes = ([self.frame.drivers.index(one) for one in some] for some in (OF_BASE, AXES))
        loop, outputs = self._march.loop, range(len(system.output_names))
        self._y, self._modes = np.zeros(len(outputs)), loop.state.modes
        c = self._march.mixed(np.zeros(len(system.term_names))) if system.terms else None
        sizes = self._march.s.shape[1], len(system.input_names), 0 if c is None else len(c)
        observed = outputs_of(self.form, outputs), self._y
        self._start, self._step = (step_of(loop, observed, parts, sizes) for parts in (0, 1))
        self._advance = entry_of(step_observed, self._step)
        blocks = [one.X[self.assembly.free[name]] for name, one in self.form.forms.items()]
        self._of_modes = np.zeros((self.assembly.size, self._modes.shape[1]))
        self._of_modes[:, self.form.used] = scipy.linalg.block_diag(*blocks)
        self._extended = self._lengths(scene)
        #: numbers of the inputs by which a frame accelerates a boom
        self.inertial = np.array([k for k, name in enumerate(system.input_names) if INERTIA in name])
        self._changing = list(_arrays((loop.state, loop.sides, loop.terms)))
        self._before = [one.copy() for one in self._changing]

    @property
    def times(self) -> Array:
        """(T,) s."""
        return self.excitation.times

    def extended(self, k: int) -> Extended:
        """How far sections are out at a step; at a kink with the mean of both rates, which leads to the right place."""
        return Extended(*self._extended[:, k])

    def angles(self, k: int) -> list[tuple[Array, Array, Array]]:
        """Luffing and slewing at a step, (1,) rad each, with rates and second rates."""
        drivers, found = self.frame.drivers, []
        for name in ("luffing", "slewing"):
            motion = self._drivers[:, drivers.index(name), k] if name in drivers else np.zeros(3)
            found.append((motion[:1], motion[1:2], motion[2:]))
        return found

    def inputs(self, k: int, base: Array) -> tuple[Array, Array]:
        """Amplitudes of inputs (i,) and terms (K,) at a step."""
        drivers = self._drivers[:, :, k].copy()
        drivers[:, self._angles] = base[:, 3:]
        drivers[0, self._axes] = base[2, :3]
        return self.frame.find(drivers)

    def at_rest(self, base: Array) -> Mapping[str, InitialState]:
        """Every body in equilibrium with the loads at t = 0; errors as for `equilibrium`."""
        found = equilibrium(self.assembly, self._march.x[0], *self.inputs(0, base)).q
        states = dict[str, InitialState]()
        for name, body in self.form.system.bodies.items():
            q = np.zeros(body.size)
            q[self.assembly.free[name]] = found[self.assembly.coordinates[name]]
            states[name] = InitialState(q, np.zeros(body.size))
        return states

    def coordinates(self, states: Mapping[str, InitialState]) -> Array:
        """Theirs (n,); zero of bodies that are missing."""
        found = np.zeros(self.assembly.size)
        for name, one in states.items():
            found[self.assembly.coordinates[name]] = one.q[self.assembly.free[name]]
        return found

    def begin(self, base: Array, states: Mapping[str, InitialState]) -> Moved:
        """At t = 0, with accelerations."""
        f, c = self.inputs(0, base)
        march = self._march
        mixed = march.mixed(c) if len(c) else np.zeros(0)
        onset = replace(march.onset, f=f, initial=states, c=mixed)
        begin(march.loop, self.form, self.method, onset)
        self._drive(self._start, 0, f, c)
        failed = self._advance(self._start)
        if failed:
            raise march.failed(failed, f"t = 0 s{places_of(march.onset.paths, march.s[0])}")
        self.keep()
        return self.accelerated(self._moved(f))

    def accelerated(self, moved: Moved) -> Moved:
        """The last one that was made, with accelerations."""
        loop, modes, m = self._march.loop, self._modes, len(self._march.loop.state.multipliers)
        D, v = loop.modes.damping, self._modes[V]
        a = loop.modes.B.T @ moved.loads - loop.modes.stiffness * modes[Z] - (D[0] * v if len(D) == 1 else D @ v)
        a -= modes[ROW : ROW + m].T @ loop.state.multipliers
        if loop.terms is not None and len(loop.terms.force):
            a += loop.terms.force
        return replace(moved, second=self._of_modes @ a)

    def keep(self) -> None:
        """Let the next steps begin where the last one ended."""
        for kept, one in zip(self._before, self._changing, strict=True):
            kept[...] = one

    def step(self, k: int, base: Array, inertia: Array) -> Moved:
        """To step k from where `keep` was said last, with inputs (i',) by which the frame accelerates the boom."""
        for kept, one in zip(self._before, self._changing, strict=True):
            one[...] = kept
        f, c = self.inputs(k, base)
        f[self.inertial] = inertia
        self._drive(self._step, k, f, c)
        failed = self._advance(self._step)
        if failed:
            raise self._march.failed(failed, f"step {k}, t = {self.times[k]:g} s")
        return self._moved(f)

    def _drive(self, stepped: Handle, k: int, f: Array, c: Array) -> None:
        """To step k, with inputs f (i,) and amplitudes c (K,) of terms there."""
        drive = stepped.kept[0].drive
        drive.s[-1], drive.f[-1] = self._march.s[k], f
        if drive.c is not None:
            drive.c[-1] = self._march.mixed(c)

    def _moved(self, f: Array) -> Moved:
        return Moved(self._of_modes @ self._modes[Z], self._of_modes @ self._modes[V], f)

    def _lengths(self, scene: Scene) -> Array:
        """(3, T, P): of the base, which stays, of all sections on it, then of what moves none."""
        t, count = self.times, len(scene.names)
        paths = list(scene.paths.items())
        found = np.zeros((3, len(t), count + sum(name not in scene.names for name, _ in paths)))
        column = count
        for name, path in paths:
            k = scene.names.index(name) if name in scene.names else column
            column += name not in scene.names
            found[0, :, k] = path.value(t)
            found[1, :, k] = (path.rate(t) + path.rate(np.maximum(np.nextafter(t, -np.inf), 0.0))) / 2.0
            found[2, :, k] = self._drivers[2, self.frame.drivers.index(name)]
        return found


def _arrays(of: Any) -> Iterator[Array]:
    """All arrays of named tuples within each other."""
    if isinstance(of, np.ndarray):
        if of.size and of.flags.writeable:
            yield of
    elif isinstance(of, tuple):
        for one in of:
            yield from _arrays(one)
