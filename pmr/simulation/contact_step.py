r"""Length of steps that contacts that only push need, and the number of equal parts into which each step is divided.

A body that lands on closed pads swings on them, for half a period of

.. math:: \omega^2 = \max_s \lambda_{max}\big( (G + 1/k)^{-1}\, C M^{-1} C^T \big)

Here :math:`\omega` is the largest circular frequency over all path positions s, C the rows of contacts that only push,
M the mass matrix, G the residual flexibility and k the pads' stiffness.  A step of length h with h omega of 1 or more
removes the energy of an impact and most of its force; the loss falls with the square of h omega (docs/pads_theory.md).
So a step is divided into equal parts.  Their largest number follows from h omega; the actual number follows from an
estimate of the error (src/substeps.c of `pmr.kernel`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse.linalg as spla

from pmr.errors import two_digits, two_digits_below
from pmr.files.arrays import Array, Indices
from pmr.kernel.laws import SchemeFactors
from pmr.simulation.excitation import Excitation, side_positions
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.system import System

#: h omega of a part at which a peak force is right to some per cent, and an impact keeps 99.9 % of its energy (mean).
RESOLVED = 0.05
#: Allowed error of closed contacts' forces in a part, over the largest force so far, per radian of h omega up to one.
TOLERANCE = 1e-5
#: Most parts of one step, and most parts of all steps together.
MOST_PARTS, MOST_IN_ALL = 200, 5_000_000
#: Number of positions on the path at which omega is computed.
PLACES = 65


def contact_frequency(system: System, excitation: Excitation) -> float:
    """Largest omega in rad/s of contacts that only push, along the paths; 0 without such contacts or if they are rigid.

    For a single path, omega is computed at `PLACES` positions, from the smallest to the largest coordinate of the run.
    For several paths, it is computed at up to `PLACES` steps of the run.  Raises the errors of
    `pmr.simulation.excitation.side_positions`.
    """
    x = side_positions(system, excitation, np.unique(np.linspace(0, len(excitation.s) - 1, PLACES).astype(int)))
    if not (system.on_one_path and system.paths):
        return contact_frequency_at(system, x)
    (path,) = system.paths
    s = np.clip(excitation.s[:, list(excitation.paths).index(path)], *system.ranges[path])
    return contact_frequency_at(
        system, system.side_coordinates({path: np.unique(np.linspace(s.min(), s.max(), PLACES))})
    )


def contact_frequency_within(system: System, ranges: Mapping[str, tuple[float, float]]) -> float:
    """Largest omega in rad/s of contacts that only push while all paths go from one end of their range to the other.

    All paths move at the same time; omega is computed at `PLACES` positions.  `ranges` are the ends in m, by the paths'
    names.  Raises InputError if a path is missing.
    """
    x = system.side_coordinates({path: np.linspace(*ends, PLACES) for path, ends in ranges.items()})
    return contact_frequency_at(system, np.broadcast_to(x, (PLACES, len(system.sides))))


def contact_frequency_at(system: System, x: Array) -> float:
    """Largest omega in rad/s of contacts that only push, with the sides of all contacts at x (T, sides) m.

    The result is 0 if no contact only pushes, or if all contacts that only push are rigid.
    """
    pushing = np.flatnonzero(~np.isnan(system.clearance))
    if not len(pushing):
        return 0.0
    assembly = Assembly(system)
    factor, rows = spla.splu(assembly.M.tocsc()), assembly.contact_rows_over_time(x, effects=False)
    C = rows.C[:, pushing]
    mobilities = factor.solve(C.reshape(-1, assembly.size).T).T.reshape(C.shape)  # M^-1 C^T of all positions at once
    return row_frequency(rows.F[:, pushing][:, :, pushing], C @ mobilities.transpose(0, 2, 1))


def row_frequency(F: Array, mobility: Array) -> float:
    """Largest natural frequency in rad/s of m contact rows: the root of the largest eigenvalue of F^-1 C M^-1 C^T.

    The flexibility F in m/N and the mobility C M^-1 C^T in 1/kg are (S, m, m), at S positions.  Positions with a
    singular F are left out; the result is 0 if F is singular at all positions.
    """
    gives, shapes = np.linalg.eigh(F)  # simulators refuse a rigid row that only pushes
    regular = gives[:, 0] > gives[:, -1] * F.shape[-1] * np.finfo(float).eps
    scaled = shapes[regular] / np.sqrt(gives[regular])[:, None]  # F^-1 is the product of this with its transpose
    squares = np.linalg.eigvalsh(scaled.transpose(0, 2, 1) @ mobility[regular] @ scaled)
    return float(np.sqrt(squares.max(initial=0.0)))


def count_parts(omega: float, stepping: TimeStepping) -> int:
    """Number of equal parts of a step that resolve contacts of circular frequency `omega` in rad/s.

    If `stepping` states a number of parts, the result is this number; if it has a schedule, the largest number there.
    Otherwise the result is at most `MOST_PARTS`, and all steps together have at most `MOST_IN_ALL` parts.  With these
    bounds the parts may be too long for the contacts (`warnings`).
    """
    if stepping.parts or stepping.schedule:
        return stepping.parts or max(stepping.schedule)
    needed = int(np.ceil(stepping.step * omega / RESOLVED - 1e-9))
    return max(1, min(needed, MOST_PARTS, MOST_IN_ALL // stepping.steps))


def part_counts(omega: float, stepping: TimeStepping) -> tuple[int, ...]:
    """Ascending numbers of equal parts, among which a step chooses by its error: 1, 2, 4 and so on.

    The largest number is at least `count_parts` of `omega` in rad/s, the circular frequency of the contacts.  If
    `stepping` has a schedule, only the numbers in the schedule are returned.  If it states a number of parts, only this
    number is.
    """
    if stepping.schedule:
        return tuple(sorted(set(stepping.schedule)))
    if stepping.parts:
        return (stepping.parts,)
    return tuple(2**k for k in range((count_parts(omega, stepping) - 1).bit_length() + 1))


def with_schedule(stepping: TimeStepping, parts_of_steps: Indices | None, omega: float) -> TimeStepping:
    """Time grid `stepping` whose T steps have the numbers of parts that another simulation chose.

    `parts_of_steps` (T + 1,) are these numbers; the first one, of t = 0, is ignored.  If they are None, every step has
    the number of parts that `omega` in rad/s needs.  The grid is returned unchanged if `omega` is 0, or if the grid
    states a number of parts.
    """
    if omega == 0.0 or stepping.parts:
        return stepping
    if parts_of_steps is None:
        return replace(stepping, parts=count_parts(omega, stepping))
    return replace(stepping, schedule=tuple(parts_of_steps[1:].tolist()))


def summary(omega: float, stepping: TimeStepping) -> dict[str, object]:
    """Entry ``contact`` of summary.json, for contacts of circular frequency `omega` in rad/s; empty if `omega` is 0.

    The keys are ``omega`` in rad/s; ``parts``, the largest number of parts of a step; ``h_omega``, the length of such a
    part times omega; and, if `stepping` has a schedule, ``mean_parts``, the mean number of parts of a step.
    """
    if omega == 0.0:
        return {}
    count = count_parts(omega, stepping)
    entries = {"omega": omega, "parts": count, "h_omega": stepping.step * omega / count}
    if stepping.schedule:
        entries["mean_parts"] = float(np.mean(stepping.schedule))
    return {"contact": entries}


def warnings(omega: float, stepping: TimeStepping) -> list[str]:
    """Warning, in a list, if the shortest parts of steps are too long for contacts of frequency `omega` in rad/s.

    The shortest parts are those that `count_parts` allows without the schedule of `stepping`.  The list is empty if
    they are short enough.
    """
    stepping = replace(stepping, schedule=())
    count = count_parts(omega, stepping)
    reached = stepping.step * omega / count
    if reached <= RESOLVED * (1.0 + 1e-9):
        return []
    in_all = stepping.end * omega / RESOLVED  # number of parts of all steps together, which does not depend on the step
    enough = RESOLVED / omega * (MOST_PARTS if in_all <= MOST_IN_ALL and not stepping.parts else 1)
    return [
        f"pads that only push: their contact has h omega = {two_digits(reached)} in each of the {count} parts of a "
        "step, "
        f"{RESOLVED:g} resolves an impact: peak forces are too small and rebounds lose energy; "
        f"time.step = {two_digits_below(enough)} s, or less stiffness, is enough"
    ]


@dataclass(frozen=True)
class StepParts:
    """Numbers of equal parts into which T steps are divided; all steps together have N - 1 parts."""

    stepping: TimeStepping
    parts: Indices  # (T,): of each step; the largest number is a multiple of all others

    @classmethod
    def for_contacts(cls, stepping: TimeStepping, omega: float) -> StepParts:
        """Numbers of parts in the schedule of `stepping`; without a schedule, the number that `omega` in rad/s needs.

        `omega` is the circular frequency of contacts that only push.  If it is 0, each step has one part.
        """
        if omega == 0.0:
            return cls(stepping, np.ones(stepping.steps, np.int64))
        return cls(stepping, np.array(stepping.schedule or [count_parts(omega, stepping)] * stepping.steps))

    @property
    def finest(self) -> int:
        """Largest number of parts of a step."""
        return int(self.parts.max())

    def factors(self, parts: int) -> SchemeFactors:
        """Factors of the time integration for one of the `parts` equal parts of a step."""
        return SchemeFactors.of(self.stepping.divide(parts).step, self.stepping.rho_inf)

    @cached_property
    def numbers(self) -> Indices:
        """Numbers (N,) of the ends of all parts on a uniform time grid; the first is 0, for t = 0.

        The uniform grid divides each step into `finest` parts, so every end of a part is a point of this grid.
        """
        return np.concatenate([[0], np.cumsum(np.repeat(self.finest // self.parts, self.parts))])

    @cached_property
    def times(self) -> Array:
        """Times (N,) in s of the ends of all parts, t = 0 included."""
        return np.asarray(self.stepping.divide(self.finest).times[self.numbers])

    @cached_property
    def ends(self) -> Indices:
        """Indices (T + 1,) in `times` at which whole steps end; the first is 0, for t = 0."""
        return np.concatenate([[0], np.cumsum(self.parts)])

    @property
    def steps(self) -> int:
        """Number of parts of all steps together, N - 1."""
        return len(self.numbers) - 1
