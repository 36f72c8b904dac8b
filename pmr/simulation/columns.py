"""What the columns of a response are called."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmr.system.body import Observed, force_outputs, kinds_of, length_outputs, names_of, other_outputs, units_of


@dataclass(frozen=True)
class Called:
    """Names, units and kinds of the columns of a response."""

    moved: tuple[str, ...]  # of the outputs in m
    forces: tuple[str, ...]  # of those in N
    # of all other outputs, and their units
    others: tuple[str, ...]
    other_units: tuple[str, ...]
    # kind and direction of each, as `Response.kinds` has them: those of moved, of forces, of others
    kinds: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]


def column_names(body: Observed) -> Called:
    """Names of a body's outputs."""
    kinds, names, units = (np.array(of(body), dtype=object) for of in (kinds_of, names_of, units_of))
    lengths, forces, other = length_outputs(body), force_outputs(body), other_outputs(body)
    return Called(
        moved=tuple(names[lengths]),
        forces=tuple(names[forces]),
        others=tuple(names[other]),
        other_units=tuple(units[other]),
        kinds=(tuple(kinds[lengths]), tuple(kinds[forces]), tuple(kinds[other])),
    )
