"""A system of bodies with each in its own modes, all of them one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.reduced.carriers import CarriedRows
from pmr.simulate.modal import ModalForm, modal_form
from pmr.simulate.native.simd import LANES
from pmr.system.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class MultibodyForm:
    """A system whose bodies are in modal form.

    Attributes
    ----------
    system : System
    forms : tuple of ModalForm
    carried : tuple of CarriedRows
        The bodies' rows, of their modes.
    modes, carriers, inputs : (bodies + 1,) integer arrays
        Where each body's begin among all.
    """

    system: System
    forms: tuple[ModalForm, ...]
    carried: tuple[CarriedRows, ...]
    modes: Indices
    carriers: Indices
    inputs: Indices

    @property
    def columns(self) -> list[slice]:
        """Where the modes of each body stand, without what fills them up."""
        return [slice(int(at), int(at) + form.body.size) for at, form in zip(self.modes, self.forms, strict=False)]

    def along(self, part: str) -> Array:
        """Diagonal of ``K`` or ``D`` of all bodies, (r',)."""
        found = np.zeros(self.modes[-1])
        for columns, form in zip(self.columns, self.forms, strict=True):
            found[columns] = np.diagonal(getattr(form.body, part))
        return found

    @property
    def damping(self) -> Array:
        """D of all bodies, (r', r')."""
        found = np.zeros((self.modes[-1],) * 2)
        for columns, form in zip(self.columns, self.forms, strict=True):
            found[columns, columns] = form.body.D
        return found

    @property
    def classically_damped(self) -> bool:
        return all(form.classically_damped for form in self.forms)

    @property
    def B(self) -> Array:
        """(r', i)."""
        found = np.zeros((self.modes[-1], self.inputs[-1]))
        for columns, at, form in zip(self.columns, self.inputs, self.forms, strict=False):
            found[columns, at : at + form.body.B.shape[1]] = form.body.B
        return found


def multibody_form(system: System) -> MultibodyForm:
    """Diagonalise every body.

    Raises
    ------
    InputError
        If one is too large, or has no mass.
    """
    forms = tuple(modal_form(body) for body in system.bodies.values())
    carried = []
    for body, form in zip(system.bodies.values(), forms, strict=True):
        assert body.carriers is not None  # as `System` checks
        carried.append(body.carriers.on(form.X))
    return MultibodyForm(
        system,
        forms,
        tuple(carried),
        modes=starts([form.body.size + -form.body.size % LANES for form in forms]),
        carriers=starts([len(rows.values) for rows in carried]),
        inputs=starts([form.body.B.shape[1] for form in forms]),
    )


def starts(sizes: Sequence[int]) -> Indices:
    """Where parts of these sizes begin that stand one after the other, and where the last one ends."""
    return np.cumsum([0, *sizes], dtype=np.int64)
