r"""Pads of one ring as fewer contacts: six pads hold the stiff cross-section of a beam in three ways.

Pads that hold both ways, and stand at the same place of the same bodies, measure

.. math:: c_\rho(x) = \sum_\kappa S_{\rho\kappa}\, \hat c_\kappa(x), \qquad
    S^T \mathrm{diag}(k)\, S = \bar k\, 1, \quad \bar k \text{ the mean of } k

with fewer rows than they are where the section does not deform between them.  Gap and force of each are in proportion,
so contacts :math:`\hat c` of stiffness :math:`\bar k` do the same to both bodies, whatever these are, and from their
forces mu those of the pads are :math:`\lambda = \mathrm{diag}(k / \bar k)\, S \mu`, exactly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Row, dense_entries
from pmr.reduced.carriers import CarriedRows, CarrierFlexibility
from pmr.reduced.model import ReducedModel
from pmr.system.contacts import Contact, Place
from pmr.system.system import System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: What a pad adds to the others of its ring, over the largest, that is round-off in modes and flexibility.
DEPENDENT = 1e-10
#: Sums of columns in which dependent rows are looked for: several times as many as pads of a ring.
SUMS = 32


@dataclass(frozen=True)
class Combined:
    """A system with fewer contacts."""

    system: System
    # (m, m'): its contacts' forces (T, m') times the transposed are those of the m original ones; None: the same
    shares: Array | None = None

    def forces(self, reduced_forces: Array) -> Array:
        """Forces (..., m) N of all contacts from those (..., m') of the smaller system."""
        return reduced_forces if self.shares is None else reduced_forces @ self.shares.T


def combine_rings(system: System) -> Combined:
    """A system in its modes, with as few contacts as its rings of pads need."""
    if system.on_one_path:
        return Combined(system)
    numbers, contacts, shares = np.eye(len(system.contacts)), list[Contact](), list[Array]()
    bodies = {name: _Rows(body) for name, body in system.reduced.items()}
    for ring, S in _rings(system.contacts, bodies):
        pads = [system.contacts[k] for k in ring]
        scaled = np.sqrt(_relative_stiffness(pads))
        for n, share in enumerate(S.T):
            measured = share if len(ring) == 1 else share * scaled * [pad.direction for pad in pads]
            places = [
                replace(same[0], row=bodies[same[0].body].combine([place.row for place in same], measured))
                for same in zip(*map(_places, pads), strict=True)
            ]
            contact = replace(pads[n], inner=places[0], outer=(*places, None)[1])
            if len(ring) > 1:
                mean = float(np.mean([1.0 / pad.compliance for pad in pads]))
                contact = replace(contact, direction=1.0, compliance=1.0 / mean)
            contacts.append(contact)
            shares.append((share * scaled) @ numbers[ring])
    if len(contacts) == len(numbers):
        return Combined(system)
    models = {name: rows.model for name, rows in bodies.items()}
    return Combined(System(models, tuple(contacts), terms=system.terms), np.array(shares).T)


def _rings(contacts: Sequence[Contact], bodies: Mapping[str, _Rows]) -> list[tuple[list[int], Array]]:
    """Numbers of contacts that are combined, each with S (pads, fewer), or of one by itself."""
    groups = dict[object, list[int]]()
    for number, contact in enumerate(contacts):
        combines = contact.clearance is None and contact.compliance > 0.0 and not contact.friction
        where = tuple((place.body, place.at, place.path, place.rate) for place in _places(contact))
        groups.setdefault(where if combines else number, []).append(number)
    rings = list[tuple[list[int], Array]]()
    for ring in groups.values():
        S = _orthonormal(bodies, [contacts[k] for k in ring]) if len(ring) > 1 else None
        rings.extend([([k], np.ones((1, 1))) for k in ring] if S is None else [(ring, S)])
    return rings


def _places(contact: Contact) -> list[Place]:
    return [contact.inner] if contact.outer is None else [contact.inner, contact.outer]


def _relative_stiffness(pads: Sequence[Contact]) -> Array:
    """Stiffness of each pad over the mean of all, (pads,)."""
    if len(pads) == 1:
        return np.ones(1)
    stiffness = 1.0 / np.array([pad.compliance for pad in pads])
    return np.asarray(stiffness / np.mean(stiffness))


def _orthonormal(bodies: Mapping[str, _Rows], pads: Sequence[Contact]) -> Array | None:
    """(pads, fewer) of the pads' rows times the root of their relative stiffness; None where it takes them all."""
    measured = []
    for same in zip(*map(_places, pads), strict=True):
        measures = bodies[same[0].body].measured([place.row for place in same])
        if measures is None:
            return None
        measured.append(measures)
    signed = np.sqrt(_relative_stiffness(pads)) * [pad.direction for pad in pads]
    S, size, _ = np.linalg.svd(signed[:, None] * np.hstack(measured), full_matrices=False)
    fewer = S[:, size > DEPENDENT * size[0]]
    return None if len(fewer.T) == len(pads) else fewer


class _Rows:
    """Rows of a body, and combinations of them, on no more carriers than these take.

    Rows that differ in nothing but their carriers, as on a mesh whose section deforms, are combined by sums of these;
    others on the same breaks by sums of their coefficients.
    """

    def __init__(self, body: ReducedModel) -> None:
        assert body.carriers is not None  # as a system has it that is not on one path
        self._body, self._carriers = body, body.carriers
        self._size = len(body.carriers.values)  # carriers of the body, and behind them sums of these
        self._parts = list[tuple[Indices, Indices, Array]]()
        self._rows = dict[tuple[object, ...], Row]()

    def measured(self, names: Sequence[str]) -> Array | None:
        """Measures (rows, .) of modes, flexibility and inputs by rows that have their breaks in common.

        None of rows on others.
        """
        rows = [self._row(name) for name in names]
        if not all(np.array_equal(row.breaks, rows[0].breaks) for row in rows):
            return None
        if len({len(row.coefficients) for row in rows}) > 1:
            return None
        if (offsets := _offsets(rows)) is not None:
            used = np.unique(rows[0].touched)
            return np.array([self._carrier_measures[used + offset].ravel() for offset in offsets])
        powers = np.arange(len(rows[0].coefficients))[::-1, None]
        size = np.diff(rows[0].breaks) ** powers  # so that all coefficients have one unit
        sums = np.random.default_rng(12).standard_normal((SUMS, size.size)) * size.ravel()
        return np.array([((row.entries.T @ sums.T).T @ self._carrier_measures).ravel() for row in rows])

    @cached_property
    def _carrier_measures(self) -> Array:
        """Measures (K, .) of modes, flexibility and inputs by the carriers, each over its largest value.

        Of the many columns of the flexibility a few sums with random weights tell which rows depend on which.
        """
        parts, rng = [self._carriers.values], np.random.default_rng(11)
        if (flexibility := self._carriers.flexibility) is not None:
            parts += [flexibility.rows, flexibility.inputs, flexibility.outputs.T]
        for k, part in enumerate(parts):
            parts[k] = part / (np.abs(part).max(initial=0.0) or 1.0)
            if part.shape[1] > SUMS:
                parts[k] = parts[k] @ rng.standard_normal((part.shape[1], SUMS))
        return np.hstack(parts)

    def combine(self, names: Sequence[str], shares: Array) -> str:
        """Add the sum of rows times `shares` (rows,), unless it is there; its name."""
        key = (*names, shares.tobytes())
        if key not in self._rows:
            rows, name = [self._row(name) for name in names], f"{names[0]}, {len(self._rows) + 1}"
            offsets = _offsets(rows)
            if offsets is None or len(rows) == 1:
                entries = sum(share * row.entries for share, row in zip(shares, rows, strict=True))
                touched, coefficients = dense_entries(sp.csr_matrix(entries), len(rows[0].coefficients))
            else:
                used, coefficients = np.unique(rows[0].touched), rows[0].coefficients
                where = used + np.array(offsets)[:, None]
                numbers = np.broadcast_to(self._size + np.arange(len(used)), where.shape)
                self._parts.append((numbers.ravel(), where.ravel(), np.repeat(shares, len(used))))
                touched = self._size + np.searchsorted(used, rows[0].touched)
                self._size += len(used)
            self._rows[key] = replace(rows[0], name=name, touched=touched, coefficients=coefficients)
        return self._rows[key].name

    @property
    def model(self) -> ReducedModel:
        """The body with these rows and carriers."""
        old, rows = self._carriers, list(self._rows.values())
        each = np.arange(len(old.values))
        numbers, where, shares = map(np.concatenate, zip((each, each, np.ones(len(each))), *self._parts, strict=True))
        P = sp.csr_matrix((shares, (numbers, where)), (self._size, len(each)))
        used = np.unique(np.concatenate([row.touched.ravel() for row in rows]))
        P, old_flexibility = P[used], old.flexibility
        flexibility = old_flexibility and CarrierFlexibility(
            rows=np.asarray((P @ (P @ old_flexibility.rows).T).T),
            inputs=P @ old_flexibility.inputs,
            outputs=np.asarray((P @ old_flexibility.outputs.T).T),
            direct=old_flexibility.direct,
            energy=old_flexibility.energy,
        )
        rows = [replace(row, touched=np.searchsorted(used, row.touched)) for row in rows]
        names = tuple(row.name for row in rows)
        return replace(self._body, row_names=names, carriers=CarriedRows.of(rows, P @ old.values, flexibility))

    def _row(self, name: str) -> Row:
        return self._carriers.row(self._body.row_names.index(name), name)


def _offsets(rows: Sequence[Row]) -> list[int] | None:
    """How far the carriers of each row stand behind those of the first; None where rows differ in more than that."""
    first, offsets = rows[0], list[int]()
    for row in rows:
        offset = int(row.touched.min() - first.touched.min())
        same = np.array_equal(row.breaks, first.breaks) and np.array_equal(row.coefficients, first.coefficients)
        if not (same and np.array_equal(row.touched - offset, first.touched)):
            return None
        offsets.append(offset)
    return offsets
