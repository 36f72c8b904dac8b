r"""How fine a step has to be for rows that only push.

A body that lands on closed pads swings on them, for half a period of

.. math:: \omega^2 = \max_s \lambda_{max}\big( (G + 1/k)^{-1}\, C M^{-1} C^T \big)

taken over the rows that only push.  A step with h omega of 1 or more takes the energy of an impact and most of its
force; what is lost falls with the square (docs/pads.md).  So a step is made in equal parts, as many as h omega takes;
that is the most, and an estimate of the error decides (src/substeps.c of `pmr.kernel`).

Of how many parts each step is made: as a reduced model's contacts asked for, or as many as resolve them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from pmr.errors.text import rounded, rounded_down
from pmr.kernel.laws import SchemeFactors
from pmr.simulation import contact_step
from pmr.simulation.excitation import Excitation, places
from pmr.simulation.stepping import TimeStepping
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: h omega with which a peak force is right within some per cent, and an impact keeps 99.9 % of its energy in the mean.
RESOLVED = 0.05
#: What a part may err in the forces of closed contacts, over the largest so far, for each radian of h omega up to one.
TOLERANCE = 1e-5
#: Parts that a step is divided into at most, and parts of all steps together.
MOST_PARTS, MOST_IN_ALL = 200, 5_000_000
#: Places on the path at which omega is found.
PLACES = 65


def contact_frequency(system: System, excitation: Excitation) -> float:
    """Largest omega in rad/s of the contacts that only push, on the way; 0 without any, or if a rigid one does.

    Errors as for `pmr.simulation.excitation.places`.
    """
    x = places(system, excitation)
    if not (system.on_one_path and system.paths):
        return frequency_at(system, x[np.unique(np.linspace(0, len(x) - 1, PLACES).astype(int))])
    (path,) = system.paths
    s = np.clip(excitation.s[:, list(excitation.paths).index(path)], *system.ranges[path])
    return frequency_at(system, system.coordinates({path: np.unique(np.linspace(s.min(), s.max(), PLACES))}))


def frequency_at(system: System, x: Array) -> float:
    """Circular frequency in rad/s of contacts that only push, with their places at x (T, sides) m."""
    pushing = np.flatnonzero(~np.isnan(system.clearance))
    if not len(pushing):
        return 0.0
    assembly = Assembly(system)
    factor, rows = spla.splu(assembly.M.tocsc()), assembly.along(x)
    mobility = [C @ factor.solve(np.ascontiguousarray(C.T)) for C in rows.C[:, pushing]]
    return frequency(rows.F[:, pushing][:, :, pushing], np.array(mobility))


def frequency(F: Array, mobility: Array) -> float:
    """The largest omega in rad/s of rows with F = G + 1/k (S, m, m) in m/N and C M^-1 C^T (S, m, m) in 1/kg."""
    gives = np.linalg.matrix_rank(F, hermitian=True) == F.shape[-1]  # a rigid row that only pushes is refused elsewhere
    squares = np.linalg.eigvals(np.linalg.solve(F[gives], mobility[gives])).real
    return float(np.sqrt(squares.max(initial=0.0)))


def parts(omega: float, stepping: TimeStepping) -> int:
    """Equal parts of a step in which a contact of circular frequency `omega` in rad/s is followed."""
    if stepping.parts or stepping.schedule:
        return stepping.parts or max(stepping.schedule)
    needed = int(np.ceil(stepping.step * omega / RESOLVED - 1e-9))
    return max(1, min(needed, MOST_PARTS, MOST_IN_ALL // stepping.steps))


def levels(omega: float, stepping: TimeStepping) -> tuple[int, ...]:
    """Numbers of parts of a step that the tolerance may choose: powers of two, up to what resolves `omega`.

    Or those that are asked for.
    """
    if stepping.schedule:
        return tuple(sorted(set(stepping.schedule)))
    if stepping.parts:
        return (stepping.parts,)
    return tuple(2**k for k in range((parts(omega, stepping) - 1).bit_length() + 1))


def as_made(stepping: TimeStepping, parts_of_steps: NDArray[np.int64] | None, omega: float) -> TimeStepping:
    """Time grid whose steps have the parts (T,) of another simulation; None: the parts that `omega` takes."""
    if omega == 0.0 or stepping.parts:
        return stepping
    if parts_of_steps is None:
        return replace(stepping, parts=parts(omega, stepping))
    return replace(stepping, schedule=tuple(parts_of_steps[1:].tolist()))


def summary(omega: float, stepping: TimeStepping) -> dict[str, object]:
    """``contact`` of summary.json, where a contact of circular frequency `omega` in rad/s only pushes; empty for 0.

    ``omega``, ``parts`` of a step at most, ``h_omega`` of one of these, and ``mean_parts`` of the steps as made.
    """
    if omega == 0.0:
        return {}
    count = parts(omega, stepping)
    entries = {"omega": omega, "parts": count, "h_omega": stepping.step * omega / count}
    if stepping.schedule:
        entries["mean_parts"] = float(np.mean(stepping.schedule))
    return {"contact": entries}


def warnings(omega: float, stepping: TimeStepping) -> list[str]:
    """A line where even the parts of a step are too long for contacts of circular frequency `omega` in rad/s."""
    count = parts(omega, stepping)
    reached = stepping.step * omega / count
    if reached <= RESOLVED * (1.0 + 1e-9):
        return []
    in_all = stepping.end * omega / RESOLVED  # parts of all steps, whatever the step
    enough = RESOLVED / omega * (MOST_PARTS if in_all <= MOST_IN_ALL and not stepping.parts else 1)
    return [
        f"pads that only push: their contact has h omega = {rounded(reached)} in each of the {count} parts of a step, "
        f"{RESOLVED:g} resolves an impact: peak forces are too small and rebounds lose energy; "
        f"time.step = {rounded_down(enough)} s, or less stiffness, is enough"
    ]


Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Lengths:
    """Numbers of parts (T,) of T steps, the largest a multiple of all; N parts in all."""

    stepping: TimeStepping
    parts: Indices

    @classmethod
    def of(cls, stepping: TimeStepping, omega: float) -> Lengths:
        """Scheduled parts, or those that contacts of circular frequency `omega` in rad/s need; 0: none only pushes."""
        if omega == 0.0:
            return cls(stepping, np.ones(stepping.steps, np.int64))
        return cls(stepping, np.array(stepping.schedule or [contact_step.parts(omega, stepping)] * stepping.steps))

    @property
    def finest(self) -> int:
        return int(self.parts.max())

    def factors(self, parts: int) -> SchemeFactors:
        """Factors of the scheme for one of so many parts of a step."""
        return SchemeFactors.of(self.stepping.divide(parts).step, self.stepping.rho_inf)

    @cached_property
    def numbers(self) -> Indices:
        """(N,): which of the ends of steps in the most parts the times are, t = 0 among them."""
        return np.concatenate([[0], np.cumsum(np.repeat(self.finest // self.parts, self.parts))])

    @cached_property
    def times(self) -> Array:
        """(N,) s."""
        return np.asarray(self.stepping.divide(self.finest).times[self.numbers])

    @cached_property
    def ends(self) -> Indices:
        """Numbers of the times that end a step, (T + 1,), t = 0 among them."""
        return np.concatenate([[0], np.cumsum(self.parts)])

    @property
    def steps(self) -> int:
        """All parts of all steps, N - 1."""
        return len(self.numbers) - 1
