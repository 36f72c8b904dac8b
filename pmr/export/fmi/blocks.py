r"""The rows of a system as an FMU evaluates them: tables of what travels along one path on one body, and constants.

With the sides a of a contact, each of them :math:`b_a(x_a) U` on its body's carriers (`pmr.reduced.carriers`),

.. math::
    C = C_0 + \sum_k C_k(s_k), \qquad F = F_0 + \sum_k G_k(s_k) + \sum_{k < l} w_k(s_k)\, R\, w_l(s_l)^T

over the blocks k of sides that travel along one path on one body; what stays is in the constants.  The last sum is over
blocks of one body on different paths: no table in one variable holds it.  A body on one path is one block, with its own
tables.

Behind the m contacts stand the n pads that rub (`pmr.system.friction`), each with the row C' of its contact, on which
its moment acts: m + n rows in all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import columns, common_breaks, rebased, same_degree, select_rows, total, transposed
from pmr.constraints.rows import Row
from pmr.reduced.carriers import CarrierFlexibility
from pmr.reduced.model import ReducedModel
from pmr.scene.built import reaction_of
from pmr.simulation.modal import ModalForm, inertia_share, modal_form
from pmr.system.body import force_outputs, names_of, units_of
from pmr.system.contacts import ALONE, SLIDER, named
from pmr.system.friction import Friction
from pmr.system.system import Side, System

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Supports:
    """Reactions of a body's h rigid supports, in its modes (`pmr.simulation.modal.support_forces`); h may be 0."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    of_modes: Array  # (h, r)
    of_rates: Array  # (h, r)
    inputs: Array  # (h, i)
    inertia: Array  # P (h, n), on the body's coordinates
    carried: Array  # (K, h); of a body without carriers (0, h)
    rows: PPoly | None = None  # (h, m) of all rows of a body that knows them by its path alone

    @classmethod
    def of(cls, body: ReducedModel, form: ModalForm, on_tables: bool) -> Supports:
        """None where the body is one of several and does not know what its carriers press on them."""
        known, r, i = body.reactions, form.body.size, len(body.input_names)
        if known is None or not (on_tables or known.carried is not None):
            carriers = 0 if body.carriers is None else len(body.carriers.values)
            none, of_modes = np.zeros((carriers, 0)), np.zeros((0, r))
            return cls((), (), of_modes, of_modes, np.zeros((0, i)), np.zeros((0, body.size)), none)
        P, n = inertia_share(body, known), body.size
        carried, rows = np.zeros((0, len(known.names))), None
        if on_tables:
            rows = total(known.rows, transposed(body.rows_on(P.T)), -1.0)
        elif body.carriers is not None and known.carried is not None:
            carried = known.carried - body.carriers.values @ P.T
        return cls(
            names=known.names,
            units=known.units,
            of_modes=-(known.stiffness[:, :n] - P @ body.K) @ form.X,
            of_rates=-(known.damping[:, :n] - P @ body.D) @ form.X,
            inputs=known.inputs - P @ body.B,
            inertia=P,
            carried=carried,
            rows=rows,
        )


@dataclass(frozen=True)
class Part:
    """A body in modal form, and where its modes, inputs and outputs stand among all."""

    name: str
    body: ReducedModel
    form: ModalForm
    supports: Supports
    modes: slice
    inputs: slice
    outputs: slice  # those of the body, then reactions of its supports

    @property
    def output_names(self) -> list[tuple[str, str, bool]]:
        """Names and units of its outputs in their order, and whether each has a rate: forces have none."""
        names, units = names_of(self.body), units_of(self.body)
        found = [
            (named(self.name, name), unit, not is_force)
            for name, unit, is_force in zip(names, units, force_outputs(self.body).tolist(), strict=True)
        ]
        supports = zip(self.supports.names, self.supports.units, strict=True)
        return [*found, *((reaction_of(named(self.name, name)), unit, False) for name, unit in supports)]

    @property
    def shapes(self) -> Array:
        """What its outputs are of its modes, (o, r)."""
        return np.vstack([self.form.body.outputs, self.supports.of_modes])

    @property
    def direct(self) -> Array:
        """And of its loads at once, (o, i)."""
        known = self.form.body.flexibility if self.body.carriers is None else self.flexibility
        own = np.zeros((len(self.body.outputs), len(self.body.input_names))) if known is None else known.direct
        return np.vstack([own, self.supports.inputs])

    @cached_property
    def pressed(self) -> Array:
        """What unit forces on its carriers make of its outputs, with the sign of multipliers, (K, o)."""
        return np.hstack([self.flexibility.outputs.T, self.supports.carried])

    @cached_property
    def values(self) -> Array:
        """What its modes measure on its carriers, (K, r)."""
        assert self.body.carriers is not None  # as `System` checks
        return self.body.carriers.values @ self.form.X

    @cached_property
    def flexibility(self) -> CarrierFlexibility:
        """What its coordinates leave out between its carriers, or nothing."""
        assert self.body.carriers is not None
        K, i, o = len(self.body.carriers.values), len(self.body.input_names), len(self.form.body.outputs)
        none = {"rows": (K, K), "inputs": (K, i), "outputs": (o, K), "direct": (o, i), "energy": (i, i)}
        return self.body.carriers.flexibility or CarrierFlexibility(**{name: np.zeros(n) for name, n in none.items()})


@dataclass(frozen=True)
class Block:
    """What travels along one path on one body: tables on common breaks, with values of q sides."""

    part: Part
    path: int
    contacts: Indices  # (q,): to which the sides belong
    stays: Indices  # (w,): contacts of the sides that stay on this body
    rows: PPoly  # C (q, r)
    between: PPoly  # G (q, q) m/N
    staying: PPoly  # G (q, w) m/N, with what stays
    inputs: PPoly  # H (q, i) m/N
    outputs: PPoly  # X (q, o) m/N
    on_carriers: tuple[Row, ...] = ()  # the sides on these breaks, where another path travels on the body too


@dataclass(frozen=True)
class Constants:
    """What sides that stay contribute, and in F the contacts' compliance."""

    C: Array  # (m + n, r)
    F: Array  # (m + n, m + n) m/N
    H: Array  # (m + n, i) m/N
    X: Array  # (m + n, o) m/N


@dataclass(frozen=True)
class Arrangement:
    """The rows of a system in modal form, of m contacts and n pads among them that rub."""

    system: System
    parts: tuple[Part, ...]
    paths: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]  # m, of the paths
    blocks: tuple[Block, ...]
    constants: Constants
    friction: Friction | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of all rows, (m + n,)."""
        names = self.system.contact_names
        return names if self.friction is None else (*names, *(f"moment of {names[k]}" for k in self.friction.pads))

    @property
    def whole(self) -> bool:
        """Whether there is nothing but one block, of all contacts and all inputs, and there are some of either."""
        order = np.arange(len(self.constants.F))
        alone = len(self.blocks) == len(self.parts) == 1 and np.array_equal(self.blocks[0].contacts, order)
        return alone and min(self.constants.H.shape) > 0

    @property
    def is_differential(self) -> bool:
        """Whether an ordinary differential equation is left: no contact is rigid, and nothing rubs."""
        return bool(self.gives_way.all()) and self.friction is None

    @property
    def gives_way(self) -> NDArray[np.bool_]:
        """Which of the contacts (m,) have residual flexibility or a compliance; the others are rigid."""
        gives = np.diagonal(self.constants.F) != 0.0
        for block in self.blocks:
            gives[block.contacts] |= np.any(block.between.c != 0.0, axis=(0, 1, 3))
        return gives[: len(self.system.contacts)]


def arrangement(system: System) -> Arrangement:
    """All rows of a system; an InputError is raised as for `modal_form`, or if a body is not reduced."""
    parts, friction = _parts(system.ensure_lengths_stay("system")), Friction.of(system.contacts)
    compliance = np.pad(system.compliance.constant, (0, 0 if friction is None else len(friction.pads)))
    m = len(compliance)
    r, i, o = (getattr(parts[-1], what).stop for what in ("modes", "inputs", "outputs"))
    constants = Constants(np.zeros((m, r)), compliance, np.zeros((m, i)), np.zeros((m, o)))
    if _has_tables(system):
        on, domain = system.paths or (SLIDER,), parts[0].form.body.domain
        return Arrangement(system, parts, on, (domain,), (_of_tables(system, parts[0]),), constants)
    paths, ranges, blocks = system.paths, tuple(system.ranges[path] for path in system.paths), list[Block]()
    of_all = [*system.sides, *_pressed(system, friction)]
    for part in parts:
        sides = [side for side in of_all if side.place.body == part.name]
        stays = [side for side in sides if side.place.path is None]
        weights = np.array([_stays(system, side) for side in stays]).reshape(len(stays), len(part.values))
        _add_constants(part, stays, weights, constants)
        travelled = [k for k, path in enumerate(paths) if any(side.place.path == path for side in sides)]
        for k in travelled:
            own = [side for side in sides if side.place.path == paths[k]]
            block = _of_sides(part, k, own, [_travels(system, side) for side in own], ranges[k], stays, weights)
            blocks.append(block if len(travelled) > 1 else replace(block, on_carriers=()))
    return Arrangement(system, parts, paths, ranges, tuple(blocks), constants, friction)


def _parts(system: System) -> tuple[Part, ...]:
    parts, r, i, o = list[Part](), 0, 0, 0
    for name, body in system.reduced.items():
        form = modal_form(body)
        supports = Supports.of(body, form, _has_tables(system))
        modes, inputs, outputs = form.body.size, len(body.input_names), len(body.outputs) + len(supports.names)
        parts.append(Part(name, body, form, supports, slice(r, r + modes), slice(i, i + inputs), slice(o, o + outputs)))
        r, i, o = r + modes, i + inputs, o + outputs
    return tuple(parts)


def _has_tables(system: System) -> bool:
    """Whether all contacts are rows of one body where the path leads, as its tables are."""
    if not (system.paths or ALONE in system.bodies):
        return False
    (body, *_) = system.bodies.values()
    moving = {body.row_names[k] for k in body.moving}
    return system.on_one_path and all(c.inner.path is not None or c.inner.row not in moving for c in system.contacts)


def _of_tables(system: System, part: Part) -> Block:
    """All contacts of a body on one path."""
    body, known, pressed = part.form.body, part.form.body.flexibility, part.supports.rows
    tables = [body.rows] if known is None else [body.rows, known.rows, known.inputs, known.outputs]
    tables += [] if pressed is None else [pressed]
    breaks = common_breaks(tables, body.domain)
    numbers = [body.row_names.index(contact.inner.row) for contact in system.contacts]
    m, i, o = len(numbers), len(body.input_names), len(body.outputs)
    G, H, X = (_none(breaks, shape) for shape in ((m, m), (m, i), (m, o)))
    if known is not None:
        G = rebased(columns(select_rows(known.rows, numbers), numbers), breaks)
        H = rebased(select_rows(known.inputs, numbers), breaks)
        X = rebased(columns(known.outputs, numbers), breaks)
        X = PPoly(X.c.swapaxes(2, 3), breaks)
    if pressed is not None:
        of_supports = rebased(columns(pressed, numbers), breaks)
        c = same_degree(X.c, of_supports.c.swapaxes(2, 3))
        X = PPoly(np.concatenate(c, axis=3), breaks)
    C, none = rebased(select_rows(body.rows, numbers), breaks), np.zeros(0, np.int64)
    return Block(part, 0, np.arange(m), none, C, G, PPoly(np.zeros((len(H.c), *H.c.shape[1:3], 0)), breaks), H, X)


def _of_sides(
    part: Part,
    path: int,
    sides: Sequence[Side],
    rows: Sequence[Row],
    domain: tuple[float, float],
    stays: Sequence[Side],
    weights: Array,
) -> Block:
    """The sides on one path as its rows (in s), beside those that stay and their weights (w, K)."""
    breaks = common_breaks([PPoly(row.coefficients, row.breaks) for row in rows], domain)
    rows, left = [row.refined(breaks) for row in rows], part.flexibility
    degree = same_degree(*(row.coefficients for row in rows))
    rows = [replace(row, coefficients=c) for row, c in zip(rows, degree, strict=True)]
    on = {"rows": part.values, "staying": left.rows @ weights.T, "inputs": left.inputs, "outputs": part.pressed}
    tables = {name: _times(rows, values, breaks) for name, values in on.items()}
    G = np.array([[_product(a, b, left.rows) for b in rows] for a in rows])
    between = PPoly(np.moveaxis(G, (0, 1), (2, 3)), breaks) if left.rows.any() else _none(breaks, (len(rows),) * 2)
    contacts, of_stays = (np.array([side.contact for side in some], np.int64) for some in (sides, stays))
    return Block(part, path, contacts, of_stays, between=between, on_carriers=tuple(rows), **tables)


def _pressed(system: System, friction: Friction | None) -> list[Side]:
    """The sides of pads that rub, on which their moments act, numbered behind the contacts."""
    pads = [] if friction is None else friction.pads.tolist()
    m, sides = len(system.contacts), system.sides
    return [Side(m + k, side.place, side.sign) for k, pad in enumerate(pads) for side in sides if side.contact == pad]


def _row(system: System, side: Side) -> Row:
    """The row of a side in x: of one that a moment acts on, C'."""
    row = system.row(side.place)
    return row if side.contact < len(system.contacts) else row.slope


def _travels(system: System, side: Side) -> Row:
    """The row of a side over its path coordinate s, x = at + rate s, with its sign."""
    row, place = _row(system, side), side.place
    c, breaks, touched = row.coefficients, row.breaks, row.touched
    if place.rate < 0.0:  # the intervals begin at their other end
        shifted = PPoly(c, breaks).c.copy()
        h = np.diff(breaks)[:, None]
        for last in range(len(c), 1, -1):
            for p in range(1, last):
                shifted[p] += shifted[p - 1] * h
        c, breaks, touched = shifted[:, ::-1], breaks[::-1], touched[::-1]
    powers = place.rate ** np.arange(len(c) - 1, -1, -1.0)
    return replace(
        row,
        breaks=(breaks - place.at) / place.rate,
        touched=touched,
        coefficients=np.ascontiguousarray(side.sign * c * powers[:, None, None]),
    )


def _stays(system: System, side: Side) -> Array:
    """Weights (K,) of a side that stays, with its sign."""
    return np.asarray(side.sign * _row(system, side).weights(side.place.at).toarray()[0])


def _add_constants(part: Part, stays: Sequence[Side], weights: Array, constants: Constants) -> None:
    """What the sides that stay on a body contribute by their weights (w, K)."""
    left, contacts = part.flexibility, [side.contact for side in stays]
    G = weights @ left.rows @ weights.T
    for k, b, row in zip(contacts, weights, G, strict=True):
        constants.C[k, part.modes] += b @ part.values
        constants.H[k, part.inputs] += b @ left.inputs
        constants.X[k, part.outputs] += b @ part.pressed
        np.add.at(constants.F[k], contacts, row)


def _times(rows: Sequence[Row], values: Array, breaks: Array) -> PPoly:
    """Rows b(s) (K,) on common breaks times values (K, n): a table (q, n)."""
    c = [np.einsum("pkd,kdn->pkn", row.coefficients, values[row.touched]) for row in rows]
    return PPoly(np.stack(c, axis=2), breaks)


def _product(a: Row, b: Row, R: Array) -> Array:
    """Coefficients (p, k) of a R b^T for rows on common breaks and of one degree."""
    moved = np.einsum("pkd,kde->pke", a.coefficients, R[a.touched[:, :, None], b.touched[:, None, :]])
    result = np.zeros((len(moved) + len(b.coefficients) - 1, len(a.touched)))
    for p, row in enumerate(moved):
        for q, c in enumerate(b.coefficients):
            result[p + q] += np.einsum("ke,ke->k", row, c)
    return result


def _none(breaks: Array, shape: tuple[int, ...]) -> PPoly:
    return PPoly(np.zeros((1, len(breaks) - 1, *shape)), breaks)
