"""Excitation of a simulation: signals of paths, loads, terms and a hoist on the time grid, and simulator options."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np
from pydantic import BaseModel

from pmr.errors import BEYOND_ENDS, InputError
from pmr.files.arrays import Array, Indices
from pmr.scene import Scene
from pmr.scene.choice import inertia_fields, is_accelerated
from pmr.scene.frame import INERTIA
from pmr.scene.hoist import ROPE
from pmr.scene.keys import SLIDER as SLIDER
from pmr.scene.keys import input_name
from pmr.scene.mechanism import FrameTerm, frame_terms
from pmr.scene.members import EXTENSION, member_at, members
from pmr.scene.run_settings import Simulation
from pmr.scene.signals import SignalBase
from pmr.simulation.frame import (
    FrameAmplitude,
    accelerating_signals,
    extensions_up_to,
    frame_amplitude,
    load_signals,
    products_of,
    section_acceleration,
)
from pmr.simulation.frame_motion import (
    Acceleration,
    ComputedMotion,
    Product,
    computed_inputs,
    hold_computed_motions,
    rotation_products,
)
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import Body, BodySystem, System
from pmr.system.terms import frame_quantities

Load = TypeVar("Load")


@dataclass(frozen=True)
class Excitation:
    """Signals of P paths s(t), i loads f(t) and k terms c(t), and a time grid of T times."""

    paths: Mapping[str, SignalBase]  # signals of P paths by their names, in m; of a luffing angle in rad
    loads: Mapping[str, SignalBase]  # signals of loads in N or N m, by input name
    stepping: TimeStepping
    # options of a scene's section `simulation`; each simulator reads its own
    options: Simulation = field(default_factory=Simulation)
    start: Literal["rest", "equilibrium"] = "rest"  # how motions begin if no initial state is given
    # c_k(t) by the names of the terms that they scale (`pmr.system.terms`)
    terms: Mapping[str, SignalBase] = field(default_factory=dict)
    hoist: Mapping[str, SignalBase] = field(default_factory=dict)  # what drives a hoist, by name (`pmr.system.terms`)
    # with motions that were computed at rest, for the equilibrium at t = 0: before that time they are held
    resting: Excitation | None = None

    @classmethod
    def from_scene(cls, scene: Scene) -> Excitation:
        r"""Paths, loads, amplitudes of terms and time grid of a scene.

        The i-th section that slides along the boom has its tail at :math:`X_i = s_1 + \dots + s_i` on the boom's axis,
        the sum of the extensions.  With its mass :math:`M_i` and the axis :math:`e_x`, the load :math:`-M_i e_x X_i''`
        acts on the section, as the input `EXTENSION`.  In a scene with a frame, this load is one of the loads that
        `pmr.simulation.frame` derives from the frame's motion.

        Raises InputError for a scene with a motion that is not known in advance: of a machine, a free luffing angle or
        a free extension.
        """
        if (key := scene.computed_key) is not None:
            value = "free" if key != "frame.machine" else None
            moves = {"frame.luffing": "how a boom luffs freely", "frame.machine": "how a machine moves"}.get(
                key, "how a section slides freely"
            )
            allowed = f"none is allowed here: only pmr run and pmr.simulate, with march, find {moves}"
            raise InputError("scene", key, value, allowed)
        # numbers of parts into which steps were divided when a free extension was computed
        samples = (path.samples for path in scene.paths.values() if isinstance(path, ComputedMotion))
        parts = next((of.parts for of in samples if len(of.parts) == scene.time.steps), ())
        stepping = TimeStepping(scene.time.end, scene.time.step, scene.time.rho_inf, schedule=parts)
        loads, paths = dict[str, SignalBase](), scene.paths
        for name, member in zip(scene.names, members(scene), strict=True):
            signals = load_signals(scene, member) | member.weight
            for axis in inertia_fields(member):
                signals[INERTIA + axis] = section_acceleration(scene, member.number, axis, -1.0)
            if is_accelerated(member):
                signals[EXTENSION] = Acceleration(paths=tuple(paths.values())[: member.number], step=stepping.step)
            loads |= {input_name(name, load): signal for load, signal in signals.items()}
        loads |= computed_inputs(scene)
        terms = term_signals(scene)
        driven = scene.driven_paths, loads, stepping, scene.simulation, scene.start
        held = hold_computed_motions(scene)
        resting = None if held is scene else cls.from_scene(held)
        return cls(*driven, terms=terms, hoist=hoist_signals(scene), resting=resting)

    @property
    def path(self) -> SignalBase:
        """Signal of the only path; raises InputError if there are several paths or none."""
        if len(self.paths) != 1:
            allowed = f"{len(self.paths)} given ({', '.join(self.paths)}), one path for all sliders is allowed"
            raise InputError("scene", "slider.path", None, allowed)
        return next(iter(self.paths.values()))

    @property
    def on_slider(self) -> Excitation:
        """Excitation with its only path renamed to `SLIDER`, as in a system of one body; errors as `path`."""
        return self if tuple(self.paths) == (SLIDER,) else replace(self, paths={SLIDER: self.path})

    @cached_property
    def times(self) -> Array:
        """Times (T,) in s of the steps, t = 0 included."""
        return self.stepping.times

    @cached_property
    def s(self) -> Array:
        """Path coordinates (T, P) in m at the steps, one column for each path in the order of `paths`."""
        return self._columns(self.paths.values())

    @cached_property
    def rates(self) -> Array:
        """Path velocities (T, P) in m/s at the steps; at a kink the velocity right after the kink."""
        rates = [path.rate(self.times) for path in self.paths.values()]
        return np.column_stack([np.empty((len(self.times), 0)), *rates])

    @cached_property
    def path_rate(self) -> Array:
        """Velocity (T,) in m/s of the only path at the steps; errors as `path`."""
        return np.asarray(self.path.rate(self.times))

    def path_within(self, domain: tuple[float, float]) -> Array:
        """Coordinates (T,) in m of the only path at the steps, clipped to `domain`, the range (low, high) in m.

        Errors as `clip_path` and `path`.
        """
        return clip_path(self.path, self.s[:, 0], domain, self.times)

    @cached_property
    def f(self) -> Array:
        """Loads (T, i) in N or N m at the steps, one column for each load in the order of `loads`."""
        return self._columns(self.loads.values())

    def forces(self, names: Sequence[str], t: Array | None = None) -> Array:
        """Loads (T, i) in N or N m, one column for each of the inputs `names`, in this order.

        The loads are sampled at the steps if t is None, else at times t (T,) in s.  The result may be the array `f`
        itself.  Raises the errors of `signals_in_order`.
        """
        signals = signals_in_order(self.loads, names)
        return self.f if t is None and tuple(names) == tuple(self.loads) else self._columns(signals, t)

    def first_loads(self, system: System) -> Array:
        """Values (l,) at t = 0 of the loads that a user gives to a system, in the order of `System.load_names`."""
        signals = dict(self.loads) | dict(self.hoist)
        return np.array([float(signals[name].value(0.0)) for name in system.load_names])

    def amplitudes(self, names: Sequence[str], t: Array | None = None) -> Array:
        """Amplitudes c (T, k), one column for each of the terms `names`, in this order.

        The amplitudes are sampled at the steps if t is None, else at times t (T,) in s.  Raises the errors of
        `signals_in_order`.
        """
        return self._columns(signals_in_order(self.terms, names, "term"), t)

    @property
    def signals(self) -> list[tuple[str, SignalBase]]:
        """Pairs (name, signal) of paths, loads, terms and what drives a hoist, with the names that messages use."""
        paths = [("the slider's path" if len(self.paths) == 1 else f"path {n}", path) for n, path in self.paths.items()]
        loads = ((f"load {name}", load) for name, load in self.loads.items())
        return [*paths, *loads, *((f"term {name}", term) for name, term in self.terms.items()), *self.hoist.items()]

    def with_stepping(self, stepping: TimeStepping) -> Excitation:
        """Excitation with the same signals on another time grid, `stepping`."""
        return self if stepping == self.stepping else replace(self, stepping=stepping)

    def on_grid(self, stepping: TimeStepping) -> Excitation:
        """Excitation on another time grid, `stepping`.

        Loads, terms and what drives a hoist contain accelerations, which are averaged over the steps of the new grid.
        Paths, and the excitation `resting`, stay as they are.
        """
        loads, terms, hoist = (
            {name: signal.on_steps(stepping.step) for name, signal in signals.items()}
            for signals in (self.loads, self.terms, self.hoist)
        )
        return replace(self, loads=loads, terms=terms, hoist=hoist, stepping=stepping)

    def _columns(self, signals: Iterable[SignalBase], t: Array | None = None) -> Array:
        """Values (T, k) of k signals, one column each, at the steps if t is None, else at times t (T,) in s."""
        at = self.times if t is None else t
        return np.column_stack([np.empty((len(at), 0)), *(signal.value(at) for signal in signals)])


def signals_in_order(
    loads: Mapping[str, Load], names: Sequence[str], of: Literal["input", "term", "hoist"] = "input"
) -> tuple[Load, ...]:
    """Return the signals of `loads`, a mapping by name, in the order of `names`.

    `names` are those of a system's inputs, of its terms, or of what drives its hoist.  `of` says which, for a message:
    ``input``, ``term`` or ``hoist``.  Raises InputError unless `loads` has all `names` and no other.
    """
    if set(loads) != set(names):
        allowed = f"{', '.join(loads) or 'none'} given, one for each {of} is allowed: {', '.join(names) or 'none'}"
        raise InputError("scene", {"input": "loads", "term": "terms"}.get(of, of), None, allowed)
    return tuple(loads[name] for name in names)


def clip_path(path: SignalBase, s: Array, domain: tuple[float, float], t: Array) -> Array:
    """Path coordinates s (T,) in m clipped to `domain`, the range (low, high) in m.

    A path may go beyond an end by `BEYOND_ENDS` times the length of the domain.

    Parameters
    ----------
    path : SignalBase
        Signal with the values s at the times t.
    s : (T,) array, m
        Path coordinates at the times t.
    domain : tuple of float, m
        Smallest and largest path coordinate.
    t : (T,) array, s
        Times, ascending.

    Raises
    ------
    InputError
        If the path goes farther beyond an end, at one of the times t or between two of them.
    """
    low, high = domain
    slack = BEYOND_ENDS * (high - low)
    outside = ~((s >= low - slack) & (s <= high + slack))
    if outside.any():
        k = int(np.argmax(outside))
        allowed = f"{low:g} to {high:g} m is allowed; left at t = {t[k]:g} s"
        raise InputError("scene", "slider.path", float(s[k]), allowed)
    for at in path.bounds(float(t[0]), float(t[-1])):
        if not low - slack <= at <= high + slack:
            allowed = f"{low:g} to {high:g} m is allowed; left between two steps"
            raise InputError("scene", "slider.path", at, allowed)
    return np.clip(s, low, high)


def side_positions(
    system: BodySystem[Body], excitation: Excitation, steps: Indices | Sequence[int] | slice = slice(None)
) -> Array:
    """Positions x (T, sides) in m of the sides of all contacts, at all steps or at the `steps`.

    The positions follow from the paths by `System.side_coordinates`.  The array may be read-only.

    Raises
    ------
    InputError
        If a path of the system has no signal, or leaves the range in which its rows are defined.
    """
    s = excitation.s[steps]
    x = system.side_coordinates(dict(zip(excitation.paths, s.T, strict=True)))
    return np.broadcast_to(x, (len(s), len(system.sides)))


def first_moves(excitation: Excitation) -> Indices:
    """Numbers (1 + P,) of steps: 0, then for each of P paths the first step at whose end the path has moved.

    The number is 0 for a path that never moves.
    """
    return np.concatenate([[0], np.argmax(excitation.s != excitation.s[0], axis=0)])


def hoist_signals(scene: Scene) -> dict[str, SignalBase]:
    """Signals that drive the hoist of a scene, by the names of `pmr.system.terms`; empty without a hoist.

    The signals are the length of the rope or the speed of its winch, the wind on the payload, and in a frame the
    quantities of the frame's motion that accelerate the payload.
    """
    if scene.hoist is None:
        return {}
    signals = {ROPE: scene.hoist.rope_signal, **scene.hoist.wind_signals}
    if scene.frame is None:
        return signals
    return signals | {
        name: frame_amplitude(scene, (Product(1.0, (quantity,)),), **accelerating_signals(scene, 0))
        for name, quantity in frame_quantities(scene).items()
    }


def machine_signals(scene: Scene) -> list[tuple[str, SignalBase]]:
    """Pairs (key, signal) of all signals of frame, hoist and free extensions of a scene, as the scene states them."""
    tables: dict[str, BaseModel | None] = {"frame": scene.frame, "hoist": scene.hoist}
    tables |= dict(zip(scene.extension_keys, scene.free_extensions.values(), strict=True))
    return [pair for key, table in tables.items() if table is not None for pair in _signals_in(key, table)]


def _signals_in(key: str, table: BaseModel) -> Iterator[tuple[str, SignalBase]]:
    """Yield pairs (key, signal) of all signals in a table of a scene, and in tables within it.

    `key` is the key of the table in the scene.
    """
    for name, value in table:
        if isinstance(value, SignalBase):
            yield f"{key}.{name}", value
        elif isinstance(value, BaseModel):
            yield from _signals_in(f"{key}.{name}", value)


def term_signals(scene: Scene, which: Iterable[FrameTerm] | None = None) -> dict[str, SignalBase]:
    """Amplitudes of the terms `which` (`pmr.scene.mechanism`), or of all terms if `which` is None, by the term's name.

    The terms are those of the scene.
    """
    return {term.name: _term_signal(scene, term) for term in (frame_terms(scene) if which is None else which)}


def _term_signal(scene: Scene, term: FrameTerm) -> SignalBase:
    """Signal of the amplitude of one term of the scene.

    The amplitude is an acceleration, a load, an acceleration or load divided by the length of a cylinder, or a product
    of the frame's rotation (`rotation_products`).
    """
    if term.kind == "field":
        return section_acceleration(scene, term.number, term.component)
    if term.kind == "load":
        return load_signals(scene, member_at(scene, term.number))[term.component]
    if term.kind == "cylinder":
        carried = scene.names.index(term.carried_section)
        return _over_length(scene, section_acceleration(scene, carried, term.component, -1.0), term)
    if term.kind == "cylinder load":
        load = load_signals(scene, member_at(scene, scene.names.index(term.carried_section)))[term.component]
        return _over_length(scene, load, term)
    return frame_amplitude(scene, rotation_products(term.kind, term.component))


def _over_length(scene: Scene, of: SignalBase, term: FrameTerm) -> FrameAmplitude:
    """Amplitude of the force in the cylinder of `term`, divided by the cylinder's length.

    The force is caused by `of`: either a load on the sections that the cylinder carries, or their acceleration.
    """
    name, over = input_name(term.carried_section, term.component), ("over", term.number)
    products = tuple(product.times(1.0, over) for product in products_of(of, name))
    if not isinstance(of, FrameAmplitude):
        return frame_amplitude(scene, products, loads=((name, of),), paths=extensions_up_to(scene, term.number))
    return of.model_copy(update={"products": products, "paths": of.paths or extensions_up_to(scene, term.number)})
