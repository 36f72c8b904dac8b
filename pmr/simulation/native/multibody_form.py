"""A system of bodies with each in its own modes, all of them one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pmr.reduced.carriers import CarriedRows
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native.simd import LANES
from pmr.system.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class MultibodyForm:
    """A system whose bodies are in modal form."""

    system: System
    forms: tuple[ModalForm, ...]
    carried: tuple[CarriedRows, ...]  # the bodies' rows, of their modes
    # (bodies + 1,): where each body's begin among all
    modes: Indices
    carriers: Indices
    inputs: Indices

    @property
    def columns(self) -> list[slice]:
        """Where the modes of each body stand, without what fills them up."""
        return [slice(int(at), int(at) + form.body.size) for at, form in zip(self.modes, self.forms, strict=False)]

    def along(self, part: str) -> Array:
        """Diagonal of ``K`` or ``D`` of all bodies, (r',)."""
        return np.concatenate([np.pad(np.diagonal(getattr(one.body, part)), _beside(one)) for one in self.forms])

    @property
    def damping(self) -> Array:
        """D of all bodies, (r', r')."""
        return np.asarray(block_diag(*(np.pad(form.body.D, _beside(form)) for form in self.forms)))

    @property
    def classically_damped(self) -> bool:
        return all(form.classically_damped for form in self.forms)

    @property
    def B(self) -> Array:
        """(r', i)."""
        return np.asarray(block_diag(*(np.pad(form.body.B, (_beside(form), (0, 0))) for form in self.forms)))


def _beside(form: ModalForm) -> tuple[int, int]:
    """Zeros before and behind the modes of a body."""
    return 0, -form.body.size % LANES


def multibody_form(system: System) -> MultibodyForm:
    """Diagonalise every body; errors as for `modal_form`."""
    forms = tuple(modal_form(body) for body in system.bodies.values())
    carried = []
    for body, form in zip(system.bodies.values(), forms, strict=True):
        assert body.carriers is not None  # as `System` checks
        carried.append(body.carriers.on(form.X))
    return MultibodyForm(
        system,
        forms,
        tuple(carried),
        modes=starts([form.body.size + _beside(form)[1] for form in forms]),
        carriers=starts([len(rows.values) for rows in carried]),
        inputs=starts([form.body.B.shape[1] for form in forms]),
    )


def starts(sizes: Sequence[int]) -> Indices:
    """Where parts of these sizes begin that stand one after the other, and where the last one ends."""
    return np.cumsum([0, *sizes], dtype=np.int64)
