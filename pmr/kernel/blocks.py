r"""Blocks of named arrays from which the kernel reads a system, and the rows of contacts in them.

src/system.c describes the layout of the bytes.  Each side a of a contact has the row :math:`b_a(x_a) U` with weights
b_a on the carriers U of its body (`pmr.system.carriers`).  The rows C of all contacts and their flexibility F are

.. math::
    C = C_0 + \sum_k C_k(s_k), \qquad F = F_0 + \sum_k G_k(s_k) + \sum_{k < l} w_k(s_k)\, R\, w_l(s_l)^T

where a block k consists of the sides that travel along one path, with the coordinate s_k, on one body; w_k are the
weights of its sides, and R is the residual flexibility between the body's carriers.  Sides that don't travel contribute
to the constants C_0 and F_0.  The last sum is over pairs of blocks of one body on different paths.  A single body whose
contacts share one path is one block with the body's own tables.  The first m rows belong to the m contacts, the next n
rows to the n pads with friction (`pmr.system.contacts`): each of these is the derivative C' of the pad's row, on which
a moment acts.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.files.arrays import Array, Indices
from pmr.system.body import clear_rows, is_round_off
from pmr.system.carriers import CarrierFlexibility
from pmr.system.contacts import SLIDER, Friction
from pmr.system.polynomials import (
    common_breaks,
    power_contributions,
    refine_table,
    same_degree,
    shift_powers,
    transpose,
)
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row, RowPolynomials
from pmr.system.system import Side, System

#: Count of numbers in a register: the modes of each body are padded with zeros to a multiple of this count.
LANES = 4


def round_up(count: int) -> int:
    """Smallest multiple of `LANES`, the numbers in a register of the processor, that is at least `count`."""
    return count + -count % LANES


@dataclass(frozen=True)
class Part:
    """A body in its modes, and the slices of its modes, inputs and outputs among those of all bodies."""

    number: int  # of the body, from 0 on
    body: ReducedModel
    modes: slice  # padding included
    inputs: slice
    outputs: slice

    @property
    def flexibility(self) -> CarrierFlexibility:
        """Residual flexibility between the K carriers of the body; arrays of zeros if the body has none.

        The body has to have carriers.
        """
        carriers = self.body.carriers
        assert carriers is not None  # `System` checks this
        i, o = len(self.body.input_names), len(self.body.outputs)
        return carriers.flexibility or CarrierFlexibility.zero(len(carriers.values), i, o)

    @property
    def values(self) -> Array:
        """Values (K, n) of the modes on the body's K carriers, with columns of zeros for the padding in `modes`."""
        assert self.body.carriers is not None
        values = self.body.carriers.values
        return np.pad(values, ((0, 0), (0, round_up(values.shape[1]) - values.shape[1])))


@dataclass(frozen=True)
class Block:
    """Tables over one path: rows and flexibility of the q contact sides on one body that travel along this path.

    All tables have common breaks.  The tables also have the flexibility between these sides and the w sides on this
    body that do not travel.
    """

    part: Part  # the body
    path: int  # number of the path
    numbers: Indices  # (q,): numbers of the rows of the q sides
    stays: Indices  # (w,): numbers of the rows of the w sides
    rows: PPoly  # C (q, modes)
    between: PPoly  # G (q, q) m/N
    staying: PPoly  # G (q, w) m/N, between the q sides and the w sides
    inputs: PPoly  # H (q, i) m/N
    outputs: PPoly  # X (q, o) m/N
    on_carriers: tuple[Row, ...] = ()  # rows of the q sides on these breaks; empty unless the body has several paths


@dataclass(frozen=True)
class Arrangement:
    """Rows of m contacts and of n pads with friction: constant parts, and one block for each body and path."""

    parts: tuple[Part, ...]
    paths: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]  # m: lowest and highest s of each path
    blocks: tuple[Block, ...]
    C: Array  # (m + n, modes): constant part of the rows, as are F, H and X
    F: Array  # (m + n, m + n) m/N: flexibility with the contacts' compliance
    H: Array  # (m + n, i) m/N
    X: Array  # (m + n, o) m/N
    friction: Friction | None

    @property
    def flexibility_bounds(self) -> Array:
        """Upper bound (m + n,) in m/N of each row's own flexibility, the diagonal entry of F, over the whole path."""
        most = np.abs(np.diagonal(self.F))
        for block in self.blocks:
            most[block.numbers] += np.diagonal(np.abs(power_contributions(block.between)).sum(axis=0).max(axis=0))
        return most


def arrange(system: System) -> Arrangement:
    """Split the contact rows of a system, whose bodies are in their modes, into constants and a block for each path.

    A contact whose own flexibility is at most round-off of the largest one in the system becomes rigid: its flexibility
    is set to zero.
    """
    rows, m = _arrange_exactly(system), len(system.contacts)
    rigid = np.zeros(len(rows.F), bool)
    rigid[:m] = is_round_off(np.diag(rows.flexibility_bounds[:m]), system.largest_flexibility)
    clear_rows(rows.F, rigid)
    return replace(rows, blocks=tuple(_without_rigid_flexibility(block, rigid) for block in rows.blocks))


def _without_rigid_flexibility(block: Block, rigid: NDArray[np.bool_]) -> Block:
    """Return the block with zeros in place of the flexibility of rigid contacts.

    `rigid` (m + n,) is the mask of these contacts among all rows.
    """
    on, staying = rigid[block.numbers], block.staying.c.copy()
    if not on.any() and not rigid[block.stays].any():
        return block
    between = block.between.c.copy()
    clear_rows(between, on)
    staying[:, :, on], staying[:, :, :, rigid[block.stays]] = 0.0, 0.0
    carried = (
        replace(row, coefficients=np.zeros_like(row.coefficients)) if is_rigid else row
        for row, is_rigid in zip(block.on_carriers, on, strict=False)
    )
    breaks = block.between.x
    return replace(block, between=PPoly(between, breaks), staying=PPoly(staying, breaks), on_carriers=tuple(carried))


def _arrange_exactly(system: System) -> Arrangement:
    """Split the contact rows of a system into constants and a block for each body and path.

    Unlike `arrange`, this function leaves the flexibility of contacts as it is, however small.
    """
    parts, friction = _body_parts(system), Friction.from_contacts(system.contacts)
    F = np.pad(system.compliance.constant, (0, 0 if friction is None else len(friction.pads)))
    size = {what: getattr(parts[-1], what).stop for what in ("modes", "inputs", "outputs")}
    C, H, X = (np.zeros((len(F), size[what])) for what in ("modes", "inputs", "outputs"))
    if system.on_one_path:
        domain = parts[0].body.domain
        paths = system.paths or (SLIDER,)
        blocks_of_tables = (_block_of_tables(system, parts[0]),) if system.contacts else ()
        return Arrangement(parts, paths, (domain,), blocks_of_tables, C, F, H, X, friction)
    paths, blocks = system.paths, list[Block]()
    ranges = tuple(system.ranges[path] for path in paths)
    pads, m = [] if friction is None else friction.pads.tolist(), len(system.contacts)
    rubbing = [Side(m + k, s.place, s.sign) for k, pad in enumerate(pads) for s in system.sides if s.contact == pad]
    of_all = [*system.sides, *rubbing]  # moments by friction act on the sides of its pads, as on further sides
    for part, name in zip(parts, system.bodies, strict=True):
        sides = [side for side in of_all if side.place.body == name]
        stays = [side for side in sides if side.place.path is None]
        weights = np.array([_fixed_side_weights(system, side) for side in stays]).reshape(len(stays), len(part.values))
        numbers = [side.contact for side in stays]
        for number, b, G in zip(numbers, weights, weights @ part.flexibility.rows @ weights.T, strict=True):
            C[number, part.modes] += b @ part.values
            H[number, part.inputs] += b @ part.flexibility.inputs
            X[number, part.outputs] += b @ part.flexibility.outputs.T
            np.add.at(F[number], numbers, G)
        travelled = [k for k, path in enumerate(paths) if any(side.place.path == path for side in sides)]
        for k in travelled:
            moving = [side for side in sides if side.place.path == paths[k]]
            block = _block_on_path(system, part, k, moving, ranges[k], np.array(numbers, np.int64), weights)
            blocks.append(block if len(travelled) > 1 else replace(block, on_carriers=()))
    return Arrangement(parts, paths, ranges, tuple(blocks), C, F, H, X, friction)


def _body_parts(system: System) -> tuple[Part, ...]:
    """Bodies of a system, with the slices of their modes, inputs and outputs among those of all bodies."""
    parts, r, i, o = list[Part](), 0, 0, 0
    for number, body in enumerate(system.reduced.values()):
        modes, inputs, outputs = round_up(body.size), len(body.input_names), len(body.outputs)
        parts.append(Part(number, body, slice(r, r + modes), slice(i, i + inputs), slice(o, o + outputs)))
        r, i, o = r + modes, i + inputs, o + outputs
    return tuple(parts)


def _block_of_tables(system: System, part: Part) -> Block:
    """Block of a system that has a single body, `part`, and one path: the body's own tables describe all contacts."""
    m, missing = len(system.contacts), round_up(part.body.size) - part.body.size
    body = part.body.with_rows([part.body.row_names.index(contact.inner.row) for contact in system.contacts])
    tables = [body.rows, body.residual.rows, body.residual.inputs, transpose(body.residual.outputs)]
    breaks = common_breaks(tables, body.domain)
    C, G, H, X = (refine_table(table, breaks) for table in tables)
    C = PPoly(np.pad(C.c, ((0, 0), (0, 0), (0, 0), (0, missing))), breaks)
    staying = PPoly(np.zeros((1, len(breaks) - 1, m, 0)), breaks)
    return Block(part, 0, np.arange(m), np.zeros(0, np.int64), C, G, staying, H, X)


def _block_on_path(
    system: System,
    part: Part,
    path: int,
    sides: Sequence[Side],
    domain: tuple[float, float],
    stays: Indices,
    weights: Array,
) -> Block:
    """Block of the `sides` of contacts that travel along the path number `path`, on the body in `part`.

    The block's tables reach over `domain`, the lowest and the highest path coordinate in m.  The w sides on this body
    that don't travel have the row numbers `stays` (w,); `weights` (w, K) are their weights on the body's K carriers,
    with the sides' signs.
    """
    rows = [_row_on_path(system, side) for side in sides]
    breaks = common_breaks([PPoly(row.coefficients, row.breaks) for row in rows], domain)
    rows = [row.refine(breaks) for row in rows]
    degree = same_degree(*(row.coefficients for row in rows))
    rows = [replace(row, coefficients=c) for row, c in zip(rows, degree, strict=True)]
    R, C = part.flexibility.rows, RowPolynomials.from_rows(rows, breaks)
    return Block(
        part,
        path,
        np.array([side.contact for side in sides], np.int64),
        stays,
        rows=C.times(part.values),
        between=C.quadratic_form(R),
        staying=C.times(R @ weights.T),
        inputs=C.times(part.flexibility.inputs),
        outputs=C.times(part.flexibility.outputs.T),
        on_carriers=tuple(rows),
    )


def _modal_row(system: System, side: Side) -> Row:
    """Row of a side of a contact as a function of the coordinate x in m along its body.

    A side with a row number of m or more is one on which a moment acts; its row is the derivative with respect to x.
    """
    row = system.row(side.place)
    return row if side.contact < len(system.contacts) else row.slope


def _fixed_side_weights(system: System, side: Side) -> Array:
    """Weights (K,) of a side that does not travel on the K carriers of its body, times the side's sign, 1 or -1."""
    return np.asarray(side.sign * _modal_row(system, side).weights(side.place.at).toarray()[0])


def _row_on_path(system: System, side: Side) -> Row:
    """Row of a side as a function of its path's coordinate s, times the side's sign, 1 or -1.

    The place on the body is x = at + rate s.
    """
    row, place = _modal_row(system, side), side.place
    c, breaks, touched = row.coefficients, row.breaks, row.touched
    if place.rate < 0.0:  # intervals are reversed: each begins at its former end
        shifted = shift_powers(c, np.diff(breaks)[:, None])
        c, breaks, touched = shifted[:, ::-1], breaks[::-1], touched[::-1]
    powers = place.rate ** np.arange(len(c) - 1, -1, -1.0)
    return replace(
        row,
        breaks=(breaks - place.at) / place.rate,
        touched=touched,
        coefficients=np.ascontiguousarray(side.sign * c * powers[:, None, None]),
    )


MAGIC = b"PMRSYS3\n"
#: Alignment of arrays in bytes, and size of the block's header and of each array's header.
LINE = 64
_KINDS = {"i": 0, "f": 1, "u": 2}  # numbers of the kinds of arrays
_HEAD, _ARRAY = struct.Struct("=8siiqQ32x"), struct.Struct("=40siiqq")


def pack(arrays: Mapping[str, NDArray[Any] | str]) -> bytearray:
    """Pack arrays (any shape) of integers or real numbers, and texts, by name into a block of bytes for the kernel.

    The block's checksum is zero until `seal` sets it.
    """
    at, heads, parts = LINE * (1 + len(arrays)), bytearray(), list[tuple[int, bytes]]()
    for name, array in arrays.items():
        encoded = _encode(array)
        content = encoded.tobytes()
        at += -at % LINE
        heads += _ARRAY.pack(name.encode(), _KINDS[encoded.dtype.kind], 0, encoded.size, at)
        parts.append((at, content))
        at += len(content)
    block = bytearray(at)
    block[:LINE] = _HEAD.pack(MAGIC, 1, len(arrays), at, 0)
    block[LINE : LINE + len(heads)] = heads
    for first, content in parts:
        block[first : first + len(content)] = content
    return block


def lines(names: Iterable[str]) -> str:
    """Text with one of `names` per line; letters beyond ASCII are escaped as in Python."""
    return "\n".join(name.encode("unicode_escape").decode("ascii") for name in names)


def seal(block: bytearray, checksum: int) -> None:
    """Write the `checksum` of the bytes after the first `LINE` bytes into the head of a block, in place."""
    block[24:32] = struct.pack("=Q", checksum)


def _encode(array: NDArray[Any] | str) -> NDArray[Any]:
    """Array in the kernel's types: integers and booleans as int32, other numbers as float64, text as uint8 bytes.

    The shape of an array stays; a text of k bytes in UTF-8 becomes an array (k,).
    """
    if isinstance(array, str):
        return np.frombuffer(array.encode(), np.uint8)
    return np.asarray(array, np.int32 if array.dtype.kind in "iub" else np.float64)
