"""Response of a run by one simulator: displacements, forces and energies over time, by name, and their extremes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr.errors import overview
from pmr.files.arrays import Array

#: Kinds of outputs, in this order: displacements of points along a body and of its tip; forces of pads (a slider counts
#: as a pad without faces), of cylinders and of elastic supports; measurements of probes; reactions of rigid supports;
#: friction of all pads of a joint along the boom; positions and rates of what moves by itself, a machine or a luffing
#: angle; forces of outriggers, margins against tipping, and the use of the support polygon; pressures, flows and power
#: of oil; height of the hook of a hoist, its place in space, its swing, the force of its rope, and
#: its pull on the winch.
KINDS = (
    "beam", "tip", "pad", "cylinder", "support", "probe", "reaction", "friction", "machine",
    "outrigger", "margin", "tipping", "pressure", "flow", "power",
    "hook_height", "hook_place", "swing", "hoist_force", "winch_pull",
)  # fmt: skip
#: Name of the column of a luffing angle that was computed.
LUFFING_ANGLE = "luffing angle"
#: Kinds of outputs that are columns of `Response.slider_force`.
FORCES = ("pad", "cylinder", "support")


@dataclass(frozen=True)
class Output:
    """Description of one column of a response: name, kind, body, place, direction and unit.

    For a displacement, `place` is the position in m along the body, and `direction` is x, y or z.  `body` is the name
    of the body, which is empty for a body alone.
    """

    name: str
    kind: str  # one of `KINDS`
    body: str  # empty for a body alone
    place: float | None = None  # m along the body; None unless the output is a displacement
    direction: str = ""  # x, y or z; empty unless the output is a displacement
    unit: str = "m"

    @property
    def is_force(self) -> bool:
        """Whether the column is the force of a contact or elastic support; reactions of rigid supports do not count."""
        return self.kind in FORCES

    @property
    def is_displacement(self) -> bool:
        """Whether the column is a displacement of the beam or of its tip."""
        return self.kind in ("beam", "tip")

    @property
    def text(self) -> str:
        """Kind and direction with a space between them, as `from_text` reads them.

        Without a direction the text is the kind alone.
        """
        return f"{self.kind} {self.direction}".rstrip()

    @classmethod
    def from_text(cls, name: str, kind: str, body: str, place: float | None, unit: str) -> Output:
        """Return an output called `name` of the body `body`, at `place` in m, with the unit `unit`.

        `place` is None for an output of no place along the body.  `kind` has the kind and the direction after a space,
        such as ``"tip z"``, or the kind alone.
        """
        what, _, direction = kind.partition(" ")
        return cls(name, what, body, place, direction, unit)


#: Share of the largest value in the same unit up to which a value is round-off.
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Energy:
    """Kinetic, strain and external energy in J over time, each (T,), relative to the axes that move with the boom.

    In a moving frame the kinetic energy is that of the motion relative to the boom's rigid motion, and the boom's
    weight and inertia are loads.  `pmr.compare.moving_frame.energy_in_space` returns energy and work in space, less
    those of the same boom if it were rigid.

    The external energy is minus the work of the loads.  With a hoist the strain energy includes the kinetic energy of
    the payload and the elastic energy of the rope, and the kinetic energy is that of the bodies.
    """

    kinetic: Array
    strain: Array
    external: Array

    @property
    def total(self) -> Array:
        """Sum of the three energies (T,) in J."""
        return self.kinetic + self.strain + self.external


@dataclass(frozen=True)
class Response:
    """Histories over T times that one simulator computed, in quantities that all simulators have in common.

    Attributes
    ----------
    t : (T,) array, s
    x : (o,) array, m
        Positions along the beam of the o displacements.
    displacement : (T, o) array, m
        Transverse displacements; the last column is the tip.  For a beam in space, the displacements of all positions
        along y come first, then those along z, then those of the tip.
    energy : Energy
    slider_force : (T, m) array, N
        Forces of m contacts: Lagrange multipliers of sliders, and forces of pads, cylinders and elastic supports.
        `force_names` has their names.
    residual_position : (T,) array, m
        Largest violation of a constraint: the largest absolute entry of C(s) q, with the coordinates q and the matrix C
        of the constraints at the path coordinate s.  The residual is NaN for simulators without constraints.
    residual_velocity : (T,) array, m/s
        Largest violation of the time derivative of a constraint: the largest absolute entry of C(s) q' + C'(s) s' q,
        where q' and s' are time derivatives and C'(s) is the derivative by s.  NaN for simulators without constraints.
    seconds : float
        Wall time of the solver alone.
    output_names, output_units : tuples of str
        Names and units (o,) of the columns of `displacement`; empty if outputs have no names.
    others : (T, k) array or None
        Outputs that are neither in m nor in N, then reactions of rigid supports; `other_names` and `other_units` have
        their names and units.
    force_names : tuple of str
        Names (m,) of the columns of `slider_force`; empty if contacts have no names.
    round_off : float, m
        Displacement up to which a displacement may be round-off (`pmr.compare.motion.round_off`); 0 if not known.
    force_round_off : float, N
        Force up to which a force may be round-off (`pmr.compare.motion.force_round_off`).
    force_peaks : (T, m) array, N, or None
        Forces as in `slider_force`, but for a pad that only pushes the largest force within the step that ends at t.
        None if steps are not divided into parts.
    kinds, bodies : tuples of str
        Kind and direction of each column, such as ``"tip z"`` (`KINDS`), and the body of each column.  Columns of
        displacements come first, then columns of forces, then `others`.
    surplus : float
        Energy that comes neither from loads nor from moving constraints, as a share of the largest energy
        (docs/time_integration.md).  NaN if a simulator has no energy balance.
    """

    t: Array
    x: Array
    displacement: Array
    energy: Energy
    slider_force: Array
    residual_position: Array
    residual_velocity: Array
    seconds: float
    output_names: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    force_names: tuple[str, ...] = ()
    round_off: float = 0.0
    force_round_off: float = 0.0
    force_peaks: Array | None = None
    surplus: float = np.nan
    others: Array | None = None
    other_names: tuple[str, ...] = ()
    other_units: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    bodies: tuple[str, ...] = ()

    def __repr__(self) -> str:
        head = f"Response at {len(self.t)} times from {self.t[0]:g} to {self.t[-1]:g} s"
        return overview(head, displacements=self.output_names, forces=self.force_names)

    @property
    def outputs(self) -> tuple[Output, ...]:
        """Description of each column: displacements, then forces, then `others`; empty if the results have no kinds."""
        names = (*self.output_names, *self.force_names, *self.other_names)
        if not len(names) == len(self.kinds) == len(self.bodies):
            return ()
        forces = len(self.force_names)
        units = ("m",) * len(self.output_names) + ("N",) * forces + self.other_units
        places = (*self.x.tolist(), *[None] * (forces + len(self.other_names)))
        return tuple(map(Output.from_text, names, self.kinds, self.bodies, places, units))

    @property
    def force_floor(self) -> float:
        """Force in N up to which a force may be round-off.

        This is the larger of two values: `force_round_off`, and `ROUND_OFF` times the largest force in N of all
        columns, those of `others` included.
        """
        in_newton = [k for k, unit in enumerate(self.other_units) if unit == "N"]
        other_forces = np.empty((0, 0)) if self.others is None else self.others[:, in_newton]
        largest = max(float(np.abs(forces).max(initial=0.0)) for forces in (self.slider_force, other_forces))
        return max(self.force_round_off, ROUND_OFF * largest)

    def clear_round_off(self, force: Array) -> Array:
        """Return the history `force` (T,) in N itself, or zeros (T,) if it is never above round-off (`force_floor`)."""
        return force if np.abs(force).max(initial=0.0) > self.force_floor else np.zeros_like(force)

    def of(self, kind: str, body: str | None = None, direction: str | None = None) -> Array:
        """Return the histories (T, k) of the k columns of one kind (`KINDS`), in the order of `outputs`; k may be 0.

        If `body` or `direction` is not None, only the columns of this body or along this direction are returned.  Each
        history is that of `column`.
        """
        chosen = [
            self.column(k)
            for k, output in enumerate(self.outputs)
            if output.kind == kind and body in (None, output.body) and direction in (None, output.direction)
        ]
        return np.stack(chosen, axis=1) if chosen else np.empty((len(self.t), 0))

    def with_forces(self, numbers: Sequence[int]) -> Response:
        """Return this response with only the columns of `slider_force` with these `numbers`, from 0, in this order.

        `force_peaks`, names, kinds and bodies follow; all other columns stay.
        """
        chosen, first, end = list(numbers), len(self.output_names), len(self.output_names) + len(self.force_names)
        columns = [*range(first), *(first + k for k in chosen), *range(end, len(self.kinds))] if self.kinds else []
        return replace(
            self,
            slider_force=self.slider_force[:, chosen],
            force_peaks=None if self.force_peaks is None else self.force_peaks[:, chosen],
            force_names=tuple(self.force_names[k] for k in chosen),
            kinds=tuple(self.kinds[k] for k in columns),
            bodies=tuple(self.bodies[k] for k in columns),
        )

    def with_others(self, values: Array, outputs: Iterable[Output]) -> Response:
        """Return this response with k further columns `values` (T, k) behind those of `others`.

        `outputs` describes the k new columns, which are neither displacements nor contact forces.
        """
        added = list(outputs)
        return replace(
            self,
            others=values if self.others is None else np.hstack([self.others, values]),
            other_names=(*self.other_names, *(output.name for output in added)),
            other_units=(*self.other_units, *(output.unit for output in added)),
            kinds=(*self.kinds, *(output.kind for output in added)),
            bodies=(*self.bodies, *(output.body for output in added)),
        )

    def column(self, number: int) -> Array:
        """Return the history (T,) of the column with this number, in the order of `outputs`.

        For a pad that only pushes, it is the largest force within each step, if such forces are stored.  Raises
        IndexError if there is no such column.
        """
        forces = self.slider_force if self.force_peaks is None else self.force_peaks
        for columns in (self.displacement, forces, self.others):
            if columns is not None and number < columns.shape[1]:
                return columns[:, number]
            number -= 0 if columns is None else columns.shape[1]
        raise IndexError(number)

    def other(self, name: str) -> Array:
        """Return the history (T,) of the output called `name` among `others`; raises ValueError if there is none."""
        number = self.other_names.index(name)
        assert self.others is not None  # as it has names
        return self.others[:, number]

    def force(self, name: str) -> Array:
        """Return the force (T,) in N called `name`, such as ``force of cylinder of fly``; NaN (T,) if there is none.

        For a pad that only pushes, it is the largest force within each step, if such forces are stored.
        """
        if name not in self.force_names:
            return np.full(len(self.t), np.nan)
        return self.column(self.displacement.shape[1] + self.force_names.index(name))

    @property
    def columns(self) -> dict[str, list[str]]:
        """Names of the columns, with their units in brackets, of each array (T, c), by the name of the array.

        The arrays are `displacement`, `slider_force` and, if there are any, `others`.
        """
        names = {
            "displacement": [f"{name} [m]" for name in self.output_names],
            "slider_force": [f"{name} [N]" for name in self.force_names],
            "others": [f"{name} [{unit}]" for name, unit in zip(self.other_names, self.other_units, strict=True)],
        }
        return {array: of_array for array, of_array in names.items() if array != "others" or of_array}

    @property
    def tip(self) -> Array:
        """Vertical displacement (T,) in m of the last body's free end; the last displacement if no column is a tip."""
        tip_columns = self.of("tip")
        return tip_columns[:, -1] if tip_columns.shape[1] else self.displacement[:, -1]


@dataclass(frozen=True)
class Extreme:
    """An extreme value of a history, with the time in s and the path coordinate in m at which it occurs."""

    value: float
    t: float
    s: float


@dataclass(frozen=True)
class Extremes:
    """Smallest and largest value of a history, each with its time and path coordinate."""

    lowest: Extreme
    highest: Extreme

    @classmethod
    def from_history(cls, values: Array, t: Array, s: Array) -> Extremes:
        """Return the extremes of `values` (T,) at times t (T,) in s, with the path coordinates s (T,) in m.

        Of several equal values, the first one counts.  Raises ValueError if there are no values.
        """
        ends = int(np.argmin(values)), int(np.argmax(values))
        return cls(*(Extreme(float(values[k]), float(t[k]), float(s[k])) for k in ends))

    @property
    def largest(self) -> Extreme:
        """The extreme with the larger absolute value; its value has its sign."""
        return self.highest if self.highest.value >= -self.lowest.value else self.lowest

    @property
    def size(self) -> float:
        """The largest absolute value of the history."""
        return abs(self.largest.value)

    @classmethod
    def from_summary(cls, summary: Mapping[str, float], place: str = "s_") -> Extremes:
        """Return the extremes from a mapping as `Extremes.summary` returns it.

        `place` is the beginning of the keys of places: ``s_`` for path coordinates, ``x_`` for positions along a beam,
        which then stand in the field `s`.
        """
        keys = [[f"{what}{end}" for what in ("", "t_", place)] for end in ("min", "max")]
        return cls(*(Extreme(*(float(summary[key]) for key in of_end)) for of_end in keys))

    def summary(self) -> dict[str, float]:
        """Return the extremes with the keys ``min``, ``t_min``, ``s_min``, ``max``, ``t_max`` and ``s_max``."""
        low, high = self.lowest, self.highest
        return {
            "min": low.value, "t_min": low.t, "s_min": low.s, "max": high.value, "t_max": high.t, "s_max": high.s,
        }  # fmt: skip
