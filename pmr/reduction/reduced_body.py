"""What one body is reduced to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.attachment import as_simulated
from pmr.reduced.model import ReducedModel
from pmr.reduction.basis import Basis
from pmr.reduction.snapshots import Snapshots


@dataclass(frozen=True)
class ReducedBody:
    """A body's model on a basis, and the snapshots that this is made from; the same on every rank."""

    snapshots: Snapshots
    basis: Basis
    modal: ReducedModel  # with tables over one path, or of free modes on carriers
    stressed: bool = False  # whether terms that vary in time act on it

    @property
    def V(self) -> NDArray[np.float64]:
        """This rank's rows (n_local, k) of the basis."""
        return np.array(self.basis.V.getDenseArray())

    @property
    def tells_errors(self) -> bool:
        """Whether the model on the basis alone tells errors: it knows the inertia of what it leaves out."""
        return self.modal.carriers is not None and self.modal.carriers.inertia is not None

    @cached_property
    def model(self) -> ReducedModel:
        """Model that is simulated: with modes of a section's cylinder and, under terms, modes without inertia."""
        return as_simulated(self.modal, self.stressed)
