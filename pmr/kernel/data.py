"""Arrays of a system in the form that kernel, file and FMU share (src/internal.h describes each array)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.kernel.blocks import LANES, Arrangement, Part, arrange, lines, round_up
from pmr.kernel.further import (
    NEGLIGIBLE,
    Arrays,
    Frame,
    Modal,
    frame_arrays,
    frame_output_arrays,
    further_names,
    ground_outputs,
    support_arrays,
)
from pmr.scene.built import reaction_name
from pmr.scene.mechanism import CYLINDER
from pmr.system.contacts import qualified_name
from pmr.system.from_scene import CombinedRings, combine_rings
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Row
from pmr.system.supports import SupportForces, with_support_forces
from pmr.system.system import System


@dataclass(frozen=True)
class SystemData:
    """Arrays of a system by name, as the kernel reads them, and the meaning of the numbers in them."""

    arrays: Arrays
    used_modes: NDArray[np.int64]  # (r,): numbers of the bodies' modes; modes with other numbers are padding
    modes: dict[str, slice]  # by body: slice of its modes among all modes, padding included
    rows: Arrangement
    further: tuple[tuple[str, str, bool], ...]  # name, unit, and whether it is a motion, of each further output


def system_data(
    system: System, forms: Mapping[str, Modal], frame: Frame | None = None, reduced: CombinedRings | None = None
) -> SystemData:
    """Arrays of a system for the kernel, from the modal forms of its bodies by name.

    `frame` is the system's moving frame, None for a system without one.  `reduced` is the system in modes in which
    contacts of a ring are combined.  If `reduced` is None, it is made here from `system`, and the reactions of rigid
    supports become further outputs.  Raises InputError if the frame has no motion for one of the system's paths.
    """
    supports = [
        SupportForces.from_body(body, system.on_one_path, reduced is None and isinstance(body, ReducedModel))
        for body in system.bodies.values()
    ]
    reduced = reduced or combine_rings(system_in_modes(system, forms, supports))
    modal, rows = reduced.system, arrange(reduced.system)
    used = np.concatenate([part.modes.start + np.arange(part.body.size) for part in rows.parts])
    motions = 0 if frame is None else len(frame.drivers)
    split = Outputs.of(rows, supports)
    arrays = _size_arrays(system, modal, rows, motions, len(split.outputs)) | _body_arrays(rows, split)
    arrays |= _contact_arrays(modal, rows, split) | _block_arrays(rows, split)
    arrays |= _term_arrays(modal, rows) | _friction_arrays(rows)
    arrays |= frame_arrays(frame, rows.paths) | _hoist_arrays(system, rows.paths)
    of_bodies = zip(system.bodies, supports, strict=True)
    reactions = [reaction_name(qualified_name(body, name)) for body, of in of_bodies for name in of.names]
    modes = [part.modes for part in rows.parts]
    arrays |= support_arrays(system, supports, [*forms.values()], modes, round_up(len(reactions)) + LANES)
    arrays |= frame_output_arrays(frame, system, rows.paths, reactions)
    further = further_names(reactions, arrays)
    ground = ground_outputs(frame.scene) if frame is not None and "ground_stand" in arrays else {}
    computed = None if frame is None else frame.computed
    behind = ground | dict(system.hoist.outputs) | ({} if computed is None else dict(computed.outputs))
    arrays |= {} if computed is None else dict(computed.arrays)
    shares = np.eye(len(system.contacts)) if reduced.shares is None else reduced.shares
    arrays |= {
        "shares": _fill_rows(shares, len(rows.F)),
        "names_drivers": lines([*rows.paths, *system.input_names, *system.term_names, *system.hoist.drivers]),
        "names_outputs": lines(system.output_names),
        "names_contacts": lines(modal.contact_names),
        "names_forces": lines(system.contact_names),
        "names_further": lines([*further, *behind]),
    }
    units = [unit for of in supports for unit in of.units]
    outputs_behind = [(name, unit, False) for name, unit in behind.items()]
    further_outputs = [(name, "N" if name == CYLINDER else "m", name != CYLINDER) for name in further[len(reactions) :]]
    modes_of = {name: part.modes for name, part in zip(forms, rows.parts, strict=True)}
    listed = (*((name, unit, False) for name, unit in zip(reactions, units, strict=True)), *further_outputs)
    return SystemData(arrays, used, modes_of, rows, (*listed, *outputs_behind))


@dataclass(frozen=True)
class Outputs:
    """Numbers of the bodies' outputs proper, and of reactions of rigid supports, among all outputs of the bodies."""

    outputs: NDArray[np.int64]
    reactions: NDArray[np.int64]
    counts: tuple[int, ...]  # number of outputs of each body that are no reactions

    @classmethod
    def of(cls, rows: Arrangement, supports: Sequence[SupportForces]) -> Outputs:
        """Split the outputs of the bodies in `rows`; the last outputs of each body are reactions of its `supports`."""
        outputs, reactions = list[NDArray[np.int64]](), list[NDArray[np.int64]]()
        for part, of in zip(rows.parts, supports, strict=True):
            numbers = np.arange(part.outputs.start, part.outputs.stop)
            first, second = np.split(numbers, [len(numbers) - len(of.names)])
            outputs.append(first)
            reactions.append(second)
        return cls(np.concatenate(outputs), np.concatenate(reactions), tuple(map(len, outputs)))

    def split(self, array: Array) -> list[Array]:
        """Split an `array` (k, all outputs) into two: the columns of outputs proper, and the columns of reactions.

        Both get columns of zeros at the end: up to whole registers, and then one more register.
        """
        parts = (array[:, numbers] for numbers in (self.outputs, self.reactions))
        return [np.pad(_fill_rows(columns, columns.shape[1]), ((0, 0), (0, LANES))) for columns in parts]

    def first_numbers(self, part: Part) -> list[int]:
        """Numbers of the first output and of the first reaction of the body in `part`, among all of each kind."""
        return [int(np.searchsorted(numbers, part.outputs.start)) for numbers in (self.outputs, self.reactions)]


def system_in_modes(system: System, forms: Mapping[str, Modal], supports: Sequence[SupportForces] = ()) -> System:
    """System of the bodies in their modal `forms`; if the system is on one path, its bodies have no carriers.

    If `supports` has an entry for each body, the reactions of each body are additional outputs after its own.
    """
    bodies = {}
    for number, (name, form) in enumerate(forms.items()):
        carriers = None if system.on_one_path else system.bodies[name].carriers
        modal = replace(form.body, carriers=carriers and carriers.project(form.X).with_rows(form.rows))
        bodies[name] = with_support_forces(modal, form.X, form.rows, supports[number]) if supports else modal
    motions = {name: form.X for name, form in forms.items()}
    terms = tuple(term.project(motions) for term in system.terms)
    return System(bodies, system.contacts, terms=terms)


def _size_arrays(system: System, modal: System, rows: Arrangement, motions: int, outputs: int) -> Arrays:
    """Array ``sizes`` (k,) of counts of the system, in the order in which `read_arrays` in src/system.c reads them.

    `modal` is the system in modes, `rows` are its contact rows.  `motions` is the number of motions of its frame, and
    `outputs` the number of its outputs without reactions.
    """
    m, pads = len(modal.contacts), len(rows.F) - len(modal.contacts)
    inputs, order = rows.parts[-1].inputs.stop, np.arange(len(rows.F))
    single = len(rows.blocks) == len(rows.parts) == 1 and np.array_equal(rows.blocks[0].numbers, order) and m and inputs
    sizes = [
        rows.parts[-1].modes.stop,
        len(rows.F),
        m,
        len(system.contacts),
        inputs,
        outputs,
        len(rows.paths),
        len(modal.terms),
        pads,
        0 if rows.friction is None else len(rows.friction.joints),
        len(rows.paths) + inputs + len(modal.terms) + len(system.hoist.drivers),
        int(bool(single) and not modal.compliance.paths and rows.friction is None),
        int(not all(_is_diagonal(part.body.D) for part in rows.parts)),
        len(modal.compliance.paths),
        motions,
    ]
    return {"sizes": np.array(sizes)}


def _hoist_arrays(system: System, paths: Sequence[str]) -> Arrays:
    """Arrays of the hoist of a system with these `paths`, by their names in the kernel's block.

    The arrays have no entries if the system has no hoist.
    """
    hoist = system.hoist
    names = [*paths, *system.input_names, *system.term_names, *hoist.drivers]
    return {
        "hoist_inputs": np.array([system.input_names.index(name) for name in hoist.inputs], np.int64),
        "hoist_slots": np.array([names.index(slot.name) if slot.name else -1 for slot in hoist.slots], np.int64),
        "hoist_shares": np.array([[slot.constant, slot.factor] for slot in hoist.slots], float),
        "hoist_levers": hoist.levers,
        "hoist_numbers": hoist.numbers,
        "hoist_reach": np.array([[path in reach for path in paths] for reach in hoist.reach], float),
    }


def _is_diagonal(A: Array) -> bool:
    """Whether a matrix A (n, n) is exactly diagonal."""
    return bool(np.count_nonzero(A - np.diag(np.diagonal(A))) == 0)


def _fill_rows(array: Array, width: int) -> Array:
    """Return `array` (..., w0) with zeros appended along its last axis to the length w.

    w is `width` rounded up to whole registers.
    """
    missing = round_up(width) - array.shape[-1]
    return np.pad(np.asarray(array, float), [(0, 0)] * (array.ndim - 1) + [(0, missing)])


def _body_arrays(rows: Arrangement, split: Outputs) -> Arrays:
    """Arrays of the modes, inputs and outputs of all bodies, by their names in the kernel's block.

    `split` says which outputs are reactions of supports.
    """
    last = rows.parts[-1]
    r, i, o = last.modes.stop, last.inputs.stop, last.outputs.stop
    D, B, shapes, direct, energy = (np.zeros(shape) for shape in ((r, r), (i, r), (r, o), (i, o), (i, round_up(i))))
    omega2, inertia, still = np.zeros(r), np.zeros(r), list[int]()
    for part in rows.parts:
        body, place = part.body, slice(part.modes.start, part.modes.start + part.body.size)
        omega2[place], inertia[place] = np.diagonal(body.K), 1.0
        still += (place.start + np.asarray(body.quasi_static)).tolist()
        D[place, place], B[part.inputs, place], shapes[place, part.outputs] = body.D, body.B.T, body.outputs.T
        flexibility = body.flexibility if body.carriers is None else body.carriers.flexibility
        if flexibility is not None:
            direct[part.inputs, part.outputs] = flexibility.direct.T
            energy[part.inputs, part.inputs] = 0.0 if flexibility.energy is None else flexibility.energy
    inertia[still] = 0.0
    coupled = not all(_is_diagonal(part.body.D) for part in rows.parts)
    of_outputs, of_reactions = zip(split.split(shapes), split.split(direct), strict=True)
    return {
        "omega2": omega2,
        "damping": D if coupled else np.diagonal(D),
        "inertia": inertia,
        "of_modes": np.array(still, np.int64),
        "B": B,
        **dict(zip(("shapes", "direct"), of_outputs, strict=True)),
        **dict(zip(("reaction_shapes", "reaction_direct"), of_reactions, strict=True)),
        "load_energy": energy,
    }


def _contact_arrays(system: System, rows: Arrangement, split: Outputs) -> Arrays:
    """Constant arrays of the contacts by their names in the kernel's block.

    They are the constant parts C, F, H, X of the rows; the clearances, 0 for contacts that hold both ways; the mask of
    contacts that only push; the range of modes that each row touches; the ends of each path's range; and the
    derivatives of the compliance by the paths that lengthen ropes.  `split` says which outputs are reactions of
    supports.
    """
    m, moments = len(system.contacts), len(rows.F) - len(system.contacts)
    clearance = np.pad(system.clearance, (0, moments), constant_values=np.nan)
    slopes = np.pad(system.compliance.slopes, ((0, 0), (0, moments), (0, moments)))
    touched = [set(np.flatnonzero(row).tolist()) for row in rows.C]
    for block in rows.blocks:
        for number in block.numbers.tolist():
            touched[number] |= {block.part.modes.start, block.part.modes.stop - 1}
    ends = [(min(modes) // LANES * LANES, round_up(max(modes) + 1)) if modes else (0, 0) for modes in touched]
    return {
        "C0": rows.C,
        "F0": _fill_rows(rows.F, len(rows.F)),
        "H0": _fill_rows(rows.H, rows.H.shape[1]),
        **dict(zip(("X0", "reaction_X0"), split.split(rows.X), strict=True)),
        "clearance": np.where(np.isnan(clearance), 0.0, clearance),
        "pushes": ~np.isnan(clearance),
        "row_modes": np.array(ends, np.int64).reshape(m + moments, 2),
        "path_ends": np.array(rows.ranges, float).reshape(-1, 2),
        "rope_paths": np.array([rows.paths.index(path) for path in system.compliance.paths], np.int64),
        "rope_slopes": _fill_rows(slopes, len(rows.F)),
    }


def _block_arrays(rows: Arrangement, split: Outputs) -> Arrays:
    """Arrays of the blocks of rows, and of pairs of blocks, by their names in the kernel's block.

    The tables of all blocks are stored one after the other.  `split` says which outputs are reactions of supports.
    """
    parts: dict[str, list[NDArray[Any]]] = {
        name: [np.zeros(0, np.int64 if name in ("block_rows", "touched") else np.float64)]
        for name in ("breaks", "block_rows", "touched", "weights", "between", *(f"table_{what}" for what in "CGSHXR"))
    }

    def store(name: str, array: NDArray[Any]) -> int:
        """Append the entries of `array` to the part `name`; return the number of entries before them."""
        at = sum(part.size for part in parts[name])
        parts[name].append(array.ravel())
        return at

    numbers, pairs, reactions = list[list[int]](), list[list[int]](), list[list[int]]()
    carriers = [_touched_carriers(block.on_carriers) for block in rows.blocks]
    for block, on in zip(rows.blocks, carriers, strict=True):
        q, part, C, X = len(block.numbers), block.part, block.rows.c, block.outputs.c
        count, (first_output, first_reaction) = split.counts[part.number], split.first_numbers(part)
        tables = {
            "C": C,
            "G": _pad_powers(block.between.c, 2 * len(C) - 1),
            "S": _pad_powers(block.staying.c, len(C)),
            "H": block.inputs.c,
            "X": X[..., :count],
        }
        head = [block.path, part.number, C.shape[1], q, len(block.stays), part.modes.start, C.shape[3]]
        head += [part.inputs.start, part.inputs.stop - part.inputs.start, first_output, count]
        head += [len(table) for table in tables.values()]
        head += [store("breaks", block.rows.x), store("block_rows", np.concatenate([block.numbers, block.stays]))]
        for what, table in tables.items():
            head.append(store(f"table_{what}", _fill_rows(table.swapaxes(0, 1), table.shape[3])))
        at = store("table_R", _fill_rows(X[..., count:].swapaxes(0, 1), X.shape[3] - count))
        reactions.append([first_reaction, X.shape[3] - count, len(X), at])
        width = max((row.touched.shape[1] for row in block.on_carriers), default=0)
        wide = [_carrier_weights(row, width, on) for row in block.on_carriers]
        head += [len(on), width]
        for what in ("touched", "weights"):  # interval by interval, each with all rows
            head.append(store(what, np.stack([arrays[what] for arrays in wide], axis=1) if wide else parts[what][0]))
        numbers.append(head)
    for k, first in enumerate(rows.blocks):
        for l, second in enumerate(rows.blocks[k + 1 :], k + 1):
            if first.part is second.part:
                R = first.part.flexibility.rows[np.ix_(carriers[k], carriers[l])]
                pairs.append([k, l, store("between", R)])
    lists = {"blocks": np.array(numbers, np.int64), "pairs": np.array(pairs, np.int64)}
    lists["reaction_blocks"] = np.array(reactions, np.int64)
    return {**lists, **{name: np.concatenate(some) for name, some in parts.items()}}


def _pad_powers(c: Array, powers: int) -> Array:
    """Coefficients c (p, ...), highest power first, with zeros put before them: (max(p, `powers`), ...)."""
    return np.concatenate([np.zeros((max(powers - len(c), 0), *c.shape[1:])), c])


def _touched_carriers(rows: tuple[Row, ...]) -> NDArray[np.int64]:
    """Ascending numbers (k,) of the carriers that the `rows` touch, each once."""
    return np.unique(np.concatenate([np.zeros(0, np.int64), *(row.touched.ravel() for row in rows)]))


def _carrier_weights(row: Row, width: int, carriers: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """Arrays ``touched`` and ``weights``: which carriers a row touches in each interval, and by which polynomials.

    ``touched`` (intervals, width) has positions in `carriers` (k,), and ``weights`` (intervals, powers, width)
    coefficients.  If a row touches fewer than `width` carriers, the last one is repeated with zero coefficients.
    """
    missing = width - row.touched.shape[1]
    touched = np.searchsorted(carriers, np.pad(row.touched, ((0, 0), (0, missing)), "edge"))
    weights = np.pad(row.coefficients, ((0, 0), (0, 0), (0, missing))).swapaxes(0, 1)
    return {"touched": touched, "weights": weights}


def _term_arrays(system: System, rows: Arrangement) -> Arrays:
    """Matrices of the system's terms, by their names in the kernel's block.

    The matrices are stored in registers of `LANES` rows by one column; registers without entries are left out.  Entries
    up to `NEGLIGIBLE` of the largest one of a matrix count as zero.
    """
    r = rows.parts[-1].modes.stop
    where = {
        name: np.arange(part.modes.start, part.modes.start + part.body.size)
        for name, part in zip(system.bodies, rows.parts, strict=True)
    }
    keys, values, counts = list[NDArray[np.int64]](), [np.zeros((0, LANES))], [0]
    for term in system.terms:
        at = np.concatenate([where[name] for name in term.bodies])
        blocks, of_row = np.unique(at // LANES, return_inverse=True)
        count = 0
        for name, A in term.arrays.items():
            tall = np.zeros((len(blocks), LANES, len(at)))
            tall[of_row, at % LANES] = np.where(np.abs(A) > NEGLIGIBLE * np.abs(A).max(initial=0.0), A, 0.0)
            block, column = np.nonzero(tall.any(axis=1))
            keys.append((2 * blocks[block] + (name == "damping")) * r + at[column])
            values.append(tall[block, :, column])
            count += len(block)
        counts.append(count)
    registers, at = np.unique(np.concatenate([np.zeros(0, np.int64), *keys]), return_inverse=True)
    first = np.searchsorted(registers, r * np.arange(2 * (r // LANES) + 1))
    of_rows = np.stack([first[:-2:2], first[1::2], first[2::2]], axis=1)
    return {
        "of_rows": of_rows if len(registers) else np.zeros(0, np.int64),
        "columns": (registers % r).astype(np.int64),
        "first_entry": np.cumsum(counts),
        "registers_of": at.astype(np.int64),
        "entry_values": np.concatenate(values),
    }


def _friction_arrays(rows: Arrangement) -> Arrays:
    """Arrays of the pads with friction in `rows`, grouped by joint, by their names in the kernel's block.

    Without friction the only key is ``first_pad``.
    """
    friction = rows.friction
    if friction is None:
        return {"first_pad": np.zeros(1, np.int64)}
    return {
        "joint_paths": np.array([rows.paths.index(name) for name in friction.joints], np.int64),
        "joint_cylinders": friction.cylinders,
        "joint_gives": friction.cylinder_compliance,
        "first_pad": friction.first_pads,
        "pad_contacts": friction.pads,
        "pad_laws": friction.laws,
        "pad_stiffness": friction.stiffness,
        "pad_arms": friction.arms,
    }
