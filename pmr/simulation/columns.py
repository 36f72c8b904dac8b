"""What the columns of a response are called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pmr.scene.built import force_of, reaction_of
from pmr.system.body import Observed


@dataclass(frozen=True)
class Called:
    """What the columns of a response are called."""

    moved: tuple[str, ...]  # of the outputs in m
    forces: tuple[str, ...]  # of those in N, then of rows, each by `force_of` what pushes
    # of all other outputs, and their units
    others: tuple[str, ...]
    other_units: tuple[str, ...]

    def with_reactions(self, names: Sequence[str], units: Sequence[str]) -> Called:
        """With the reactions of rigid supports, given by the names of their rows, after all others."""
        others = (*self.others, *map(reaction_of, names))
        return replace(self, others=others, other_units=(*self.other_units, *units))


def called(body: Observed, rows: Sequence[str]) -> Called:
    """Names of a body's outputs, and of the forces of `rows`, given by their names."""
    count = len(body.output_positions)
    names = body.output_names or tuple(f"output {k}" for k in range(count))
    of = list(zip(names, body.output_units or ("m",) * count, strict=True))
    return Called(
        moved=tuple(name for name, unit in of if unit == "m"),
        forces=(*(name for name, unit in of if unit == "N"), *(force_of(row) for row in rows)),
        others=tuple(name for name, unit in of if unit not in ("m", "N")),
        other_units=tuple(unit for _, unit in of if unit not in ("m", "N")),
    )
