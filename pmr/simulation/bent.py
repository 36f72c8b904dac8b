"""The shape of a boom at rest: how places along its sections are displaced across them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.postures import Postures, Stands, places_of
from pmr.system.assembly import Assembly
from pmr.system.body import kinds_of
from pmr.system.system import System

Array = NDArray[np.float64]
#: Places along a section, about.
PLACES = 9


@dataclass(frozen=True)
class Bent:
    """Displacements across the boom at some of the observed places of all sections."""

    outputs: Array  # (b, n)
    direct: Array  # (b, i)
    X: Array  # (P, b, m)
    x: Array  # (b,) m, from the section's tail
    section: NDArray[np.int64]  # (b,), the base is 0
    direction: tuple[str, ...]  # (b,): ``y`` or ``z`` of the boom
    names: tuple[str, ...]  # of the sections

    @classmethod
    def of(cls, system: System, at: Stands) -> Bent:
        """Choose outputs across the boom of a system at some places."""
        assembly = Assembly(system)
        number, x, section, direction, first = list[int](), list[float](), list[int](), list[str](), 0
        for k, body in enumerate(system.bodies.values()):
            kinds = kinds_of(body)
            for axis in dict.fromkeys(kind[-1] for kind in kinds if kind.split(" ")[0] in ("beam", "tip")):
                numbers = [i for i, kind in enumerate(kinds) if kind in (f"beam {axis}", f"tip {axis}")]
                some = np.unique(np.linspace(0, len(numbers) - 1, min(PLACES, len(numbers))).round().astype(int))
                for i in (numbers[place] for place in some):
                    number.append(first + i)
                    x.append(float(body.output_positions[i]))
                    section.append(k)
                    direction.append(axis)
            first += len(kinds)
        rows = assembly.along(places_of(system, at))
        outputs, direct = assembly.outputs.toarray()[number], assembly.direct[number]
        return cls(
            outputs, direct, rows.X[:, number], np.array(x), np.array(section), tuple(direction), tuple(system.bodies)
        )

    def measured(self, at: Postures) -> Postures:
        """Postures whose only outputs are the displacements across the boom."""
        none = {name: getattr(at, name)[..., :0, :] for name in ("machine_q", "machine_forces", "machine_loads")}
        return replace(
            at,
            outputs=self.outputs,
            direct=self.direct,
            X=self.X,
            machine_parts=at.machine_parts[..., :0, :],
            **none,
        )
