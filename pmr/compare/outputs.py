r"""What models are judged by: displacements along the beam, the tip, forces of sliders and pads, velocities, probes.

Of a trajectory in the coordinates of a body, forces are its outputs in N and the multipliers of its sliders and pads;
velocities those of the displacements, with the part that follows at once (`pmr.compare.velocities`).  All outputs in
other units count as probes: stresses, strains and displacements of a place, rotations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import (
    RELATIVE_FLOOR,
    force_round_off,
    probe_round_off,
    refuse_infinite,
    relative_error,
    round_off,
    zero_round_off,
)
from pmr.reduced.model import ReducedModel
from pmr.simulation import Excitation
from pmr.system.contacts import ALONE
from pmr.system.system import System

Array = NDArray[np.float64]

#: Kinds of outputs by the names that scenes and summaries give them, and the one that only sections have.
KINDS = ("beam", "tip", "pad_force", "velocity", "probe")
CYLINDERS = "cylinder_force"
#: Those that are forces.
FORCES = ("pad_force", CYLINDERS)
#: Share of the largest probe in the same unit below which a probe's error is one of that share instead of its own.
LITTLE = 0.01
_HISTORIES = ("displacement", "velocity", "force", "probe")


@dataclass(frozen=True)
class Outputs:
    """Outputs of a simulation, by kind."""

    displacement: Array  # (T, o) m
    velocity: Array  # (T, o) m/s; no columns where they are not wanted
    force: Array  # (T, p) N
    probe: Array  # (T, k)
    units: tuple[str, ...]  # of the probes
    tips: tuple[int, ...]  # numbers of the displacements that are the tip's
    forces: tuple[str, ...] = ()  # kind of each force; none: all are those of sliders and pads

    def of(self, kind: str) -> Array:
        """One of `KINDS`, or `CYLINDERS`, (T, k)."""
        if kind == "tip":
            return self.displacement[:, list(self.tips)]
        if kind in FORCES:
            return self._forces(kind, self.force)
        return {"beam": self.displacement, "velocity": self.velocity, "probe": self.probe}[kind]

    def _forces(self, kind: str, force: Array) -> Array:
        """Columns of some forces (T, p) that are of one of the `FORCES`."""
        if not self.forces:
            return force if kind == "pad_force" else force[:, :0]
        return force[:, [k for k, kind_of_force in enumerate(self.forces) if kind_of_force == kind]]

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of which there are outputs; rates may be wanted of all displacements."""
        return tuple(kind for kind in (*KINDS, CYLINDERS) if kind == "velocity" or self.of(kind).shape[1])

    def moved_at(self, places: Sequence[int]) -> Outputs:
        """Return these outputs with some of the displacements alone, by their numbers."""
        which, rates = list(places), self.velocity.shape[1] > 0
        tips = tuple(which.index(tip) for tip in self.tips if tip in which)
        velocity = self.velocity[:, which] if rates else self.velocity
        return replace(self, displacement=self.displacement[:, which], velocity=velocity, tips=tips)

    def plus(self, difference: Outputs) -> Outputs:
        """The sum of both, kind by kind."""
        return replace(self, **{name: getattr(self, name) + getattr(difference, name) for name in _HISTORIES})

    def minus(self, other: Outputs) -> Outputs:
        """The difference of both, kind by kind."""
        return self.plus(other.times(-1.0))

    def times(self, factor: float) -> Outputs:
        """All of it, scaled."""
        return replace(self, **{name: factor * getattr(self, name) for name in _HISTORIES})


@dataclass(frozen=True)
class Floors:
    """Largest round-off of a displacement (m), of a force (N) and of each probe (k,)."""

    displacement: float
    force: float
    probe: Array

    @classmethod
    def of(cls, system: System, excitation: Excitation, forces: Array | None = None) -> Floors:
        """Bounds of round-off of a system under these loads (`pmr.compare.errors.round_off`).

        Of several bodies no force counts that is nothing beside the largest of its `forces` (T, m) in N.
        """
        f, end, least = excitation.forces(system.input_names), excitation.stepping.end, 0.0
        if ALONE in system.bodies:
            body: Any = system.bodies[ALONE]
            least = force_round_off(body, f, end, float(excitation.path.value(0.0)))
        elif forces is not None:
            least = RELATIVE_FLOOR * float(np.abs(forces).max(initial=0.0))
        return cls(round_off(system.bodies, f, end), least, probe_round_off(system.bodies, f, end))


def differences(outputs: Outputs, reference: Outputs, floors: Floors, kinds: Sequence[str] = KINDS) -> dict[str, float]:
    """Error by kind (`pmr.compare.errors.relative_error`), fractions; what is round-off in both counts as zero."""
    moves = zero_round_off(outputs.displacement, reference.displacement, floors.displacement)
    errors = dict[str, float]()
    for kind in kinds:
        match kind:
            case "tip":
                pair = moves[0][:, list(reference.tips)], moves[1][:, list(reference.tips)]
            case "beam":
                pair = moves
            case "pad_force" | "cylinder_force":
                forces = zero_round_off(outputs.force, reference.force, floors.force)
                pair = outputs._forces(kind, forces[0]), reference._forces(kind, forces[1])
            case "probe":
                errors[kind] = float(probe_differences(outputs, reference, floors).max(initial=0.0))
                continue
            case _:
                still = ~np.any(moves[0], axis=0) & ~np.any(moves[1], axis=0)
                pair = np.where(still, 0.0, outputs.of(kind)), np.where(still, 0.0, reference.of(kind))
        errors[kind] = relative_error(*pair)
    return errors


def probe_differences(outputs: Outputs, reference: Outputs, floors: Floors) -> Array:
    r"""Error of each probe, (k,) fractions; what is round-off in both counts as zero.

    .. math:: \mathrm{rms}(y_k - r_k) / \max(\mathrm{rms}(r_k),\ 0.01 \max_j \mathrm{rms}(r_j))

    over all probes j in the unit of k: of a wall that is bent, the stress across is worth no digits of its own.
    """
    y, r = zero_round_off(outputs.probe, reference.probe, floors.probe)
    refuse_infinite(y, r)
    units, error, size = np.array(reference.units), *(np.sqrt(np.mean(x**2, axis=0)) for x in (y - r, r))
    scale = np.array(
        [max(largest, LITTLE * size[units == unit].max()) for largest, unit in zip(size, units, strict=True)]
    )
    none = scale == 0.0
    return np.asarray(np.where(none, error > 0.0, error / np.where(none, 1.0, scale)))


def impulsive(model: ReducedModel, excitation: Excitation) -> bool:
    """Whether forces of sliders have no size: at a kink of the path a rigid slider strikes the body.

    The force of that blow is as high as the step is short, and no two models agree on it.
    """
    rigid = np.flatnonzero(model.row_compliance == 0.0)
    if not set(rigid.tolist()) & set(model.moving):
        return False
    end = excitation.stepping.end
    return any(t < end for t in excitation.path.kinks(end))
