"""What one body is reduced to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.attachment import with_cylinder_modes
from pmr.reduced.model import ReducedModel
from pmr.reduction.basis import Basis
from pmr.reduction.snapshots import Snapshots


@dataclass(frozen=True)
class ReducedBody:
    """A body's model on a basis, and the snapshots that this is made from; the same on every rank."""

    snapshots: Snapshots
    basis: Basis
    modal: ReducedModel  # with tables over one path, or of free modes on carriers

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
        """What is simulated: a section of a boom has the modes of its cylinder as well."""
        return with_cylinder_modes(self.modal)
