"""A system with each of its bodies in its own modes, all of them one after the other, and its kernel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pmr.errors import InputError
from pmr.kernel.data import in_modes
from pmr.kernel.kernel import Kernel
from pmr.kernel.rows import round_up
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.moving import MovingFrame
from pmr.system.contacts import ALONE, Friction
from pmr.system.from_scene import Combined
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SystemForm:
    """A system whose bodies are in modal form."""

    system: System
    forms: Mapping[str, ModalForm]  # by the bodies' names, in their order

    @classmethod
    def of(cls, system: System) -> SystemForm:
        """Diagonalise every body; errors as for `modal_form`."""
        return cls(system, {name: modal_form(body) for name, body in system.bodies.items()})

    @classmethod
    def alone(cls, form: ModalForm) -> SystemForm:
        """A body alone, whose coordinates are its modes already."""
        eye, rows = np.eye(form.body.size), tuple(range(len(form.body.row_names)))
        return cls(System.of(form.body), {ALONE: replace(form, X=eye, inverse=eye, rows=rows)})

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Columns of each body's modes among all of the kernel's, which pad bodies to whole registers."""
        sizes = {name: form.body.size for name, form in self.forms.items()}
        starts = np.cumsum([0, *map(round_up, sizes.values())]).tolist()
        return {name: slice(at, at + size) for at, (name, size) in zip(starts, sizes.items(), strict=False)}

    @property
    def used(self) -> NDArray[np.int64]:
        """Columns (r,) of modes among all of the kernel's."""
        return np.concatenate([np.arange(part.start, part.stop) for part in self.columns.values()])

    @cached_property
    def kernel(self) -> Kernel:
        """The system as the kernel has it, with a frame of its scene that moves."""
        return Kernel.of(self.system, self.forms, self.frame, self.combined)

    @cached_property
    def frame(self) -> MovingFrame | None:
        """Frame that drives inputs and terms, of the system's scene; None where that drives others."""
        try:
            return MovingFrame.of(self.system)
        except InputError:
            return None

    @cached_property
    def mobility(self) -> Array:
        """B^T B (i, i) in 1/kg: accelerations of the inputs' points by loads on free bodies."""
        return np.asarray(block_diag(*(form.body.B.T @ form.body.B for form in self.forms.values())))

    @property
    def modal(self) -> System:
        """The system in its modes, rings of pads as few contacts; a body whose tables say all is without carriers."""
        return self.combined.system

    @cached_property
    def combined(self) -> Combined:
        """The system in its modes, and what tells the forces of all contacts."""
        return in_modes(self.system, self.forms)

    def forces(self, multipliers: Array, friction: Array | None) -> Array:
        """Forces (..., m) in N of all contacts: what reaches the bodies, and in cylinders friction of their pads."""
        forces, pads = self.combined.forces(multipliers), Friction.of(self.system.contacts)
        return forces if pads is None or friction is None else forces + pads.along(friction)
