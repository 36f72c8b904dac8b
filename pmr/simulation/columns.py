"""What the columns of a response are called."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr.scene.built import force_of, reaction_of
from pmr.system.body import Observed, force_outputs, kinds_of, length_outputs, other_outputs


@dataclass(frozen=True)
class Called:
    """What the columns of a response are called."""

    moved: tuple[str, ...]  # of the outputs in m
    forces: tuple[str, ...]  # of those in N, then of rows, each by `force_of` what pushes
    # of all other outputs, and their units
    others: tuple[str, ...]
    other_units: tuple[str, ...]
    # kind and direction of each, as `Response.kinds` has them: those of moved, of forces, of others
    kinds: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]

    @property
    def all_kinds(self) -> tuple[str, ...]:
        """One after the other."""
        return tuple(kind for kinds in self.kinds for kind in kinds)

    def with_reactions(self, names: Sequence[str], units: Sequence[str]) -> Called:
        """With the reactions of rigid supports, given by the names of their rows, after all others."""
        others, (moved, forces, other_kinds) = (*self.others, *map(reaction_of, names)), self.kinds
        kinds = moved, forces, (*other_kinds, *("reaction" for _ in names))
        return replace(self, others=others, other_units=(*self.other_units, *units), kinds=kinds)


def called(body: Observed, rows: Sequence[str]) -> Called:
    """Names of a body's outputs, and of the forces of `rows`, given by their names: those of pads and sliders."""
    count, kinds = len(body.output_positions), np.array(kinds_of(body), dtype=object)
    names = np.array(body.output_names or [f"output {k}" for k in range(count)], dtype=object)
    units = np.array(body.output_units or ("m",) * count, dtype=object)
    moved, forces, others = length_outputs(body), force_outputs(body), other_outputs(body)
    return Called(
        moved=tuple(names[moved]),
        forces=(*names[forces], *(force_of(row) for row in rows)),
        others=tuple(names[others]),
        other_units=tuple(units[others]),
        kinds=(tuple(kinds[moved]), (*kinds[forces], *("pad" for _ in rows)), tuple(kinds[others])),
    )
