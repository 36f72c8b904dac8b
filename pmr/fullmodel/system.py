"""A system of full models: what is spread over ranks, and where the coordinates of each body stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Row
from pmr.fem.matrices import gather
from pmr.fullmodel.model import FullModel
from pmr.scene.names import ALONE, input_of
from pmr.system.body import FullBody
from pmr.system.contacts import Contact, Place
from pmr.system.system import Joined, System, ground_contacts
from pmr.system.terms import Term

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FullSystem(Joined[FullModel]):
    """Full models on one communicator, and what joins them.

    Vectors of a rank hold its coordinates of one body after the other; whole ones all of one body after the other.
    Supports that hold one coordinate are no contacts: they hold without being named.
    """

    @classmethod
    def of(cls, model: FullModel) -> FullSystem:
        """A body alone, as `System.of` has it."""
        return cls({ALONE: model}, ground_contacts(model))

    @property
    def models(self) -> tuple[FullModel, ...]:
        return tuple(self.bodies.values())

    @property
    def comm(self) -> Any:
        return self.models[0].comm

    @property
    def size(self) -> int:
        """Number of all coordinates n, those that supports hold included."""
        return sum(model.size for model in self.models)

    @cached_property
    def local(self) -> tuple[slice, ...]:
        """Slices of each body's coordinates in this rank's vectors."""
        return consecutive([model.M.getLocalSize()[0] for model in self.models])

    @cached_property
    def whole(self) -> tuple[slice, ...]:
        """Slices of each body's coordinates in whole vectors."""
        return consecutive([model.size for model in self.models])

    @cached_property
    def inputs(self) -> tuple[slice, ...]:
        """Slices of each body's inputs among `input_names`."""
        return consecutive([len(model.input_names) for model in self.models])

    @cached_property
    def observed(self) -> tuple[slice, ...]:
        """Slices of each body's outputs among all."""
        return consecutive([model.outputs.getSize()[1] for model in self.models])

    def mine(self, complete: Array) -> Array:
        """This rank's coordinates (..., n_local) out of all (..., n)."""
        parts = zip(self.whole, self.models, strict=True)
        return np.concatenate([complete[..., at][..., model.share] for at, model in parts], axis=-1)

    def gathered(self, local: Array) -> Any:
        """All coordinates (k, n) on rank 0 from the ranks' (k, n_local), which other ranks get back; collective."""
        parts = [self.comm.gather(local[:, at]) for at in self.local]
        return np.concatenate([np.concatenate(part, 1) for part in parts], 1) if self.comm.rank == 0 else local

    def with_supports(self) -> FullSystem:
        """Return the system with supports that hold one coordinate as contacts with the ground, after all others."""
        used = {(side.place.body, side.place.row) for side in self.sides}
        held = [
            Contact(input_of(name, row), Place(name, row, model.rows.rows[number].breaks[0]))
            for name, model in self.bodies.items()
            for number, row in ((number, model.row_names[number]) for number in model.rows.held)
            if (name, row) not in used
        ]
        return replace(self, contacts=(*self.contacts, *held))

    def gather(self) -> System | None:
        """The system with SciPy matrices on rank 0; None elsewhere.  Collective."""
        gathered: dict[int, FullBody | None] = {}
        for model in self.models:
            if id(model) not in gathered:
                gathered[id(model)] = model.gather()
        bodies = {name: body for name, model in self.bodies.items() if (body := gathered[id(model)]) is not None}
        terms = tuple(self._gathered_term(term) for term in self.terms)
        return System(bodies, self.contacts, terms=terms) if bodies else None

    def _gathered_term(self, term: Term) -> Term:
        """Return a term with SciPy's matrices on rank 0."""
        on_first_rank: dict[str, Any] = {
            key: A if sp.issparse(A) or isinstance(A, np.ndarray) else gather(A) for key, A in term.matrices.items()
        }
        return replace(term, **on_first_rank) if self.comm.rank == 0 else term

    @cached_property
    def side_rows(self) -> tuple[Row, ...]:
        """The row of each of the `sides`, on its body's carriers."""
        return tuple(self.row(side.place) for side in self.sides)


def consecutive(sizes: Sequence[int]) -> tuple[slice, ...]:
    """Slices of parts of these sizes, one after the other."""
    ends = np.cumsum([0, *sizes]).tolist()
    return tuple(slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True))
