"""A system with each of its bodies in its own modes, all of them one after the other, and what a step needs of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pmr.errors import InputError
from pmr.kernel.data import in_modes
from pmr.kernel.kernel import Kernel
from pmr.reduced.model import ReducedModel
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.moving import MovingFrame
from pmr.simulation.native.arrays import (
    DAMPING,
    INPUT,
    ROW,
    STIFFNESS,
    UNIT,
    Contact,
    Divided,
    Modes,
    Reach,
    Scheme,
    State,
    Tables,
)
from pmr.simulation.native.simd import LANES, aligned, padded
from pmr.system.contacts import ALONE
from pmr.system.friction import Friction
from pmr.system.rings import Combined
from pmr.system.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: So many bodies in a chain are no quicker by their own contacts alone: looking up which these are takes as long.
SHORT = 3


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
        return cls(
            System.of(form.body),
            {ALONE: replace(form, X=eye, inverse=eye, rows=rows)},
        )

    @cached_property
    def starts(self) -> Indices:
        """(bodies + 1,): where each body's modes begin among all, in whole vector registers."""
        return starts([form.body.size + sum(_beside(form)) for form in self.forms.values()])

    @cached_property
    def inputs(self) -> Indices:
        """(bodies + 1,): likewise."""
        return starts([form.body.B.shape[1] for form in self.forms.values()])

    @property
    def columns(self) -> dict[str, slice]:
        """Where the modes of each body stand, without what fills them up."""
        of_bodies = zip(self.forms.items(), self.starts, strict=False)
        return {name: slice(int(at), int(at) + form.body.size) for (name, form), at in of_bodies}

    @property
    def used(self) -> Indices:
        """(r,): where modes stand among all, and not what fills them up."""
        return np.concatenate([np.arange(own.start, own.stop) for own in self.columns.values()])

    @cached_property
    def quasi_static(self) -> Indices:
        """(q,): where modes without inertia stand."""
        of_bodies = zip(self.forms.values(), self.starts, strict=False)
        return np.concatenate([start + form.body.quasi_static for form, start in of_bodies])

    @cached_property
    def kernel(self) -> Kernel:
        """The system as the kernel has it, with a frame of its scene that moves."""
        return Kernel.of(self.system, self.forms, self.frame, self.combined)

    @cached_property
    def frame(self) -> MovingFrame | None:
        """What drives inputs and terms where the system's scene has a frame; None where that drives others."""
        try:
            return MovingFrame.of(self.system)
        except InputError:
            return None

    @cached_property
    def mobility(self) -> Array:
        """B^T B (i, i) in 1/kg: accelerations of the inputs' points by loads on free bodies."""
        return block_diag(*(form.body.B.T @ form.body.B for form in self.forms.values()))

    @property
    def modal(self) -> System:
        """The system in its modes, rings of pads as few contacts; a body whose tables say all is without carriers."""
        return self.combined.system

    @cached_property
    def combined(self) -> Combined:
        """The same, and what tells the forces of all contacts."""
        return in_modes(self.system, self.forms)

    def forces(self, multipliers: Array, friction: Array | None) -> Array:
        """Of all contacts, (..., m) N: what reaches the bodies, and in cylinders the friction of their joints' pads."""
        found, known = self.combined.forces(multipliers), Friction.of(self.system.contacts)
        return found if known is None or friction is None else found + known.along(friction)

    @cached_property
    def on_tables(self) -> ReducedModel | None:
        """A body in its modes, with a row for each contact in their order; None where tables do not say all."""
        if not self.system.on_one_path:
            return None
        (form,) = self.forms.values()
        rows = [form.body.row_names.index(contact.inner.row) for contact in self.system.contacts]
        return replace(
            form.body.with_rows(rows),
            pads=np.diagonal(self.system.compliance.constant),
            clearance=self.system.clearance,
        )

    @cached_property
    def tables(self) -> dict[Scheme, Tables]:
        """Those of `on_tables` that have been made, by the scheme that their couplings are of."""
        return {}

    @property
    def classically_damped(self) -> bool:
        """Whether damping couples no modes."""
        return all(form.classically_damped for form in self.forms.values())

    @cached_property
    def modes(self) -> Modes:
        """The modes' equations."""
        D = block_diag(*(np.pad(form.body.D, _beside(form)) for form in self.forms.values()))
        B = block_diag(*(np.pad(form.body.B, (_beside(form), (0, 0))) for form in self.forms.values()))
        return Modes(
            stiffness=aligned(np.concatenate([np.pad(form.omega2, _beside(form)) for form in self.forms.values()])),
            damping=aligned(np.diagonal(D)[None] if self.classically_damped else D),
            B=aligned(B.T),
        )

    def over_S(self, X: Array, scheme: Scheme) -> Array:
        """X S^-1, for X (..., r') and the symmetric S = 1 + D dv + Omega^2 dq; of modes without inertia another S.

        They have dq (D / h + Omega^2), see `pmr.simulation.native.quasi_static`.
        """
        stiffness, D, _ = self.modes
        still, gain = self.quasi_static, np.full(len(stiffness), scheme.v_gain)
        diagonal = 1.0 + stiffness * scheme.z_gain
        diagonal[still], gain[still] = stiffness[still] * scheme.z_gain, scheme.z_gain / scheme.z_from_v
        if len(D) == 1:
            return np.asarray(X / (diagonal + D[0] * gain))
        return np.asarray(X @ np.linalg.inv(np.diag(diagonal) + D * gain))

    def divided(self, scheme: Scheme) -> Divided:
        """Divided by S for one length of step."""
        stiffness, D, B = self.modes
        damped = np.zeros((0, 0, 0))
        if len(D) > 1:
            matrices = (np.diag(stiffness * self._inertia), D * self._inertia, np.eye(len(D)))
            damped = np.stack([self.over_S(A, scheme).T for A in matrices])
        return Divided(B=aligned(self.over_S(B, scheme)), damped=aligned(damped))

    def constant_modes(self, scheme: Scheme) -> Array:
        """The rows STIFFNESS, DAMPING, UNIT and INPUT of `State.modes`, (4, r')."""
        stiffness, D, B = self.modes
        modes = np.zeros((INPUT + 1, len(stiffness)))
        if len(B):
            modes[INPUT] = self.over_S(B[0], scheme)
        if len(D) == 1:
            modes[UNIT] = self.over_S(np.ones(len(stiffness)), scheme)
            weighted = modes[UNIT] * self._inertia
            modes[STIFFNESS], modes[DAMPING] = weighted * stiffness, weighted * D[0]
        return modes

    @property
    def _inertia(self) -> Array:
        """(r',): that of each mode, 1 or 0."""
        found = np.ones(len(self.modes.stiffness))
        found[self.quasi_static] = 0.0
        return found

    @cached_property
    def joined(self) -> list[list[int]]:
        """Numbers of the bodies, ascending, that each contact is on."""
        names, found = list(self.forms), [set[int]() for _ in self.modal.contacts]
        for side in self.modal.sides:
            found[side.contact].add(names.index(side.place.body))
        return [sorted(on) for on in found]

    @cached_property
    def reach(self) -> Reach:
        """Of bodies whose contacts have places of their own."""
        on = [[k for k, own in enumerate(self.joined) if body in own] for body in range(len(self.forms))]
        contacts = [(min(which), max(which) + 1) if which else (0, 0) for which in on]
        given = self.modal.compliance
        coupled = np.any([given.constant != 0.0, *(slope != 0.0 for slope in given.slopes)], axis=0)
        touched = [
            [*(on[body][end] for body in own for end in (0, -1)), *np.flatnonzero(row)]
            for own, row in zip(self.joined, coupled, strict=True)
        ]
        ends = [(int(min(which)), int(max(which)) + 1) for which in touched]
        bodies = [self.starts[:-1], self.starts[1:], self.inputs[:-1], self.inputs[1:], *np.transpose(contacts)]
        return Reach(
            bodies=np.stack(bodies, axis=1).astype(np.int64),
            moves=_pairs([(self.starts[own[0]], self.starts[own[-1] + 1]) for own in self.joined]),
            beside=_pairs([(first // LANES * LANES, last + -last % LANES) for first, last in ends]),
            of_mode=np.repeat(np.arange(len(self.forms)), np.diff(self.starts)),
            begins=np.zeros(len(self.joined), np.int64),
        )

    @property
    def _followed(self) -> Reach | None:
        """What a loop follows; None of few bodies, whose steps take a twentieth longer with it."""
        return self.reach if len(self.forms) > SHORT else None

    def state(self, scheme: Scheme, contact: Contact | None, shares: int) -> State:
        """At rest, before the rows are evaluated; `shares` as many as `State` says."""
        m, (i, r) = len(self.modal.contacts), self.modes.B.shape
        modes = np.zeros((ROW + max(m, 1), r))
        modes[: INPUT + 1] = self.constant_modes(scheme)
        reach = self._followed
        return State(
            modes=aligned(modes),
            multipliers=np.zeros(m),
            position=np.full(1, np.nan),
            interval=np.zeros(1, np.int64),
            couplings=padded(np.zeros((m, m + (0 if self.on_tables is None else i)))),
            factor=np.zeros((m, m)),
            weighted=aligned(np.zeros((m, r))),
            shares=np.zeros(shares),
            given=aligned(np.zeros(r if self.on_tables is None else 0)),
            pushed=None if self.on_tables is not None else aligned(np.zeros(m + -m % LANES)),
            contact=None if contact is None else contact._replace(reach=reach),
            reach=reach,
        )


def _beside(form: ModalForm) -> tuple[int, int]:
    """Zeros before and behind the modes of a body."""
    return 0, -form.body.size % LANES


def reach_of_all(m: int, i: int, r: int) -> Reach:
    """As if m contacts and i inputs were on one body with r modes."""
    return Reach(
        bodies=np.array([[0, r, 0, i, 0, m]], np.int64),
        moves=np.tile(np.array([0, r], np.int64), (m, 1)),
        beside=np.tile(np.array([0, m + -m % LANES], np.int64), (m, 1)),
        of_mode=np.zeros(r, np.int64),
        begins=np.zeros(m, np.int64),
    )


def _pairs(found: Sequence[tuple[int, int]]) -> Indices:
    return np.array(found, np.int64).reshape(-1, 2)


def starts(sizes: Sequence[int]) -> Indices:
    """Where parts of these sizes begin that stand one after the other, and where the last one ends."""
    return np.cumsum([0, *sizes], dtype=np.int64)
