"""A system as constants of the C source in `source/` (body.h and rows.h say what each of them is)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import same_degree
from pmr.constraints.rows import Row
from pmr.errors import BEYOND_ENDS
from pmr.export.fmi.blocks import Arrangement, Block, Part, arrangement
from pmr.export.fmi.drivers import Drivers
from pmr.export.fmi.luffing import luffing
from pmr.simulation import contact_step
from pmr.system.system import System

Array = NDArray[np.float64]
_NUMBERS_A_LINE = 8
#: Entries of a term's matrix below this share of its largest one are round-off of zero.
NOTHING = 1e-13
#: Tables of a block by their names in C.
_TABLES = {"C": "rows", "G": "between", "S": "staying", "H": "inputs", "X": "outputs"}


@dataclass(frozen=True)
class Constants:
    """A system in modal form, and what the C source needs of it."""

    rows: Arrangement
    drivers: Drivers
    macros: dict[str, object]  #: Of model.h
    arrays: dict[str, Array]  #: Of model.c by their declarations


def constants(system: System) -> Constants:
    """Modal form and tables of a system."""
    rows = arrangement(system)
    bodies, gives_way = [part.form.body for part in rows.parts], rows.gives_way
    stays = rows.constants
    (m, r), i, o = stays.C.shape, stays.H.shape[1], stays.X.shape[1]
    coupled = not all(part.form.classically_damped for part in rows.parts)
    drivers = Drivers.of(rows)
    of_terms, reacting = _terms(rows), [k for part in rows.parts for k in _reactions(part)]
    if drivers.frame is not None:
        o += 3  # the place of the tip
    raised = luffing(drivers)
    o += raised is not None
    clearance = np.pad(system.clearance, (0, m - len(system.contacts)), constant_values=np.nan)
    pushes = ~np.isnan(clearance)
    laid_out, arrays = _laid_out(rows)
    macros: dict[str, object] = {
        "MODES": r,
        "ROWS": max(m, 1),
        "CONTACTS": max(len(system.contacts), 1),
        "INPUTS": max(i, 1),
        "OUTPUTS": max(o, 1),
        "TIP": o - 3 - (raised is not None),
        "LUFFING": 0 if raised is None else len(raised.sources),
        "REACTIONS": len(reacting),
        "TERMS": len(rows.system.terms),
        "PATHS": max(len(rows.paths), 1),
        "DAMPING_COUPLES": int(coupled),
        "DAMPING_SIZE": r ** (2 if coupled else 1),
        "MODEL_EXCHANGE": int(rows.is_differential),
        "BEYOND_ENDS": BEYOND_ENDS,
    }
    of_bodies = {name: scipy.linalg.block_diag(*(getattr(body, name) for body in bodies)) for name in "DB"}
    shapes, direct, X, of_rates = (np.zeros((n, o)) for n in (r, i, m, r))
    X[:, : stays.X.shape[1]] = stays.X
    for part in rows.parts:
        shapes[part.modes, part.outputs], direct[part.inputs, part.outputs] = part.shapes.T, part.direct.T
        of_rates[part.modes, _reactions(part)] = part.supports.of_rates.T
    arrays |= {
        "const double constant_C[ROWS][MODES]": _present(stays.C, r),
        "const double constant_F[ROWS][ROWS]": stays.F if m else np.ones((1, 1)),  # a row that holds nothing
        "const double constant_H[ROWS][INPUTS]": _present(stays.H, max(i, 1)),
        "const double constant_X[ROWS][OUTPUTS]": _present(X, max(o, 1)),
        "const double path_ends[PATHS][2]": np.array(rows.ranges or [(0.0, 0.0)]),
        "const double omega2[MODES]": np.concatenate([part.form.omega2 for part in rows.parts]),
        "const double damping[DAMPING_SIZE]": of_bodies["D"].ravel() if coupled else np.diagonal(of_bodies["D"]),
        "const double inputs[INPUTS][MODES]": _present(of_bodies["B"].T, r),
        "const double shapes[MODES][OUTPUTS]": _present(shapes, max(o, 1)),
        "const double direct[INPUTS][OUTPUTS]": _present(direct, max(o, 1)),
        "const double clearance[ROWS]": _present(np.where(pushes, clearance, 0.0), 1),
        "const int pushes[ROWS]": _present(pushes.astype(int), 1),
        "const int gives_way[ROWS]": np.pad(gives_way, (0, m - len(gives_way))).astype(int) if m else np.ones(1, int),
        "const int quasi_static[MODES]": np.concatenate([_is_quasi_static(part) for part in rows.parts]).astype(int),
        "const int reaction_outputs[REACTIONS + 1]": np.array([*reacting, -1]),
        "const double reaction_rates[REACTIONS + 1][MODES]": np.vstack([of_rates[:, reacting].T, np.zeros(r)]),
    }
    of_friction, of_pads = _rubbing(rows)
    macros |= drivers.macros | laid_out | of_friction
    return Constants(
        rows, drivers, macros, arrays | drivers.arrays | of_terms | of_pads | ({} if raised is None else raised.arrays)
    )


def _rubbing(rows: Arrangement) -> tuple[dict[str, object], dict[str, Array]]:
    """Macros and arrays of the pads that rub and of their joints (friction.h)."""
    if (known := rows.friction) is None:
        return {"PADS": 0, "JOINTS": 0}, {}
    arrays = {
        "const int joint_paths[JOINTS]": np.array([rows.paths.index(name) for name in known.joints]),
        "const int joint_cylinders[JOINTS]": known.cylinders,
        "const double joint_gives[JOINTS]": known.gives,
        "const int first_pad[JOINTS + 1]": known.first,
        "const int pad_contacts[PADS]": known.pads,
        "const double pad_coefficients[PADS]": known.coefficients,
        "const double pad_stiffness[PADS]": known.stiffness,
        "const double pad_arms[PADS]": known.arms,
    }
    return {"PADS": len(known.pads), "JOINTS": len(known.joints)}, arrays


def _reactions(part: Part) -> list[int]:
    """Numbers of the outputs that are reactions of a body's supports: its last ones."""
    return list(range(part.outputs.stop - len(part.supports.names), part.outputs.stop))


def _is_quasi_static(part: Part) -> NDArray[np.bool_]:
    """Which of a body's modes (r,) have no inertia."""
    return np.isin(np.arange(part.form.body.size), part.form.body.quasi_static)


def _terms(rows: Arrangement) -> dict[str, Array]:
    """Entries of the terms on modes and supports, one term after the other (drive.h)."""
    if not rows.system.terms:
        return {}
    r, parts = rows.constants.C.shape[1], {part.name: part for part in rows.parts}
    at, values, counts = [np.empty((0, 2), int)], [np.empty(0)], list[int]()
    supports = np.cumsum([0, *(len(part.supports.names) for part in rows.parts)])
    first = {part.name: r + k for part, k in zip(rows.parts, supports.tolist(), strict=False)}
    for term in rows.system.terms:
        own = [parts[name] for name in term.bodies]
        modes = np.concatenate([np.arange(part.modes.start, part.modes.stop) for part in own])
        X, count = scipy.linalg.block_diag(*(part.form.X for part in own)), 0
        for key, A in term.arrays.items():
            tables, rows_of, before = [X.T @ A @ X], [modes], 0
            for part in own:
                work, held = term.supports.get(part.name), A[before : before + part.body.size]
                before += part.body.size
                if work is not None and len(part.supports.names):
                    tables.append((work - part.supports.inertia @ held) @ X)
                    rows_of.append(first[part.name] + np.arange(len(part.supports.names)))
            for table, to in zip(tables, rows_of, strict=True):
                some = np.argwhere(np.abs(table) > NOTHING * np.abs(table).max(initial=0.0))
                at.append(np.column_stack([to[some[:, 0]], modes[some[:, 1]] + r * (key == "damping")]))
                values.append(table[tuple(some.T)])
                count += len(some)
        counts.append(count)
    return {
        "const int first_entry[TERMS + 1]": np.cumsum([0, *counts]),
        "const int entries[][2]": _present(np.concatenate(at), 2),
        "const double entry_values[]": _present(np.concatenate(values), 1),
    }


@dataclass(frozen=True)
class Source:
    """The two files of C source that a model makes, and the token that tells it from others."""

    header: str
    text: str
    token: str


def source_text(
    constants: Constants, path_names: Sequence[str], start_values: Array, nominal: Array, omega: float
) -> Source:
    """model.h and model.c.

    `omega` in rad/s is that of contacts that only push (`pmr.simulation.contact_step`), 0 without any.

    `start_values` (4 + 4 n,) are those of the variables up to the kind of start: t, the drivers, their rates of order
    one to three, step, rho_inf, start; `nominal` (2 r,) are sizes of the modal coordinates and of their rates.
    """
    arrays = constants.arrays | {
        "const double start_values[1 + 4 * DRIVERS + 3]": start_values,
        "const double nominal[2 * MODES]": nominal,
    }
    of_contacts: dict[str, object] = {
        "CONTACT_OMEGA": repr(float(omega)),
        "RESOLVED": contact_step.RESOLVED,
        "MOST_PARTS": contact_step.MOST_PARTS,
        "FORCE_TOLERANCE": contact_step.TOLERANCE,
    }
    macros = [f"#define {name} {value}" for name, value in (constants.macros | of_contacts).items()]
    parts = [f"{declaration} = {_listed(array)};" for declaration, array in arrays.items()]
    texts = {"row_names[ROWS]": constants.rows.names, "path_names[PATHS]": path_names}
    for name, words in texts.items():
        parts.append(f"const char *const {name} = {{{', '.join(map(c_string, words or ('none',)))}}};")
    digest = hashlib.sha256("\n".join([*macros, *parts]).encode()).hexdigest()
    token = "-".join(digest[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32)))
    parts.append(f"const char *const model_token = {c_string('{' + token + '}')};")
    header = ["/* Sizes of the model. */", "#ifndef MODEL_H", "#define MODEL_H", "", *macros, "", "#endif", ""]
    text = [
        "/* Constants of the model. */",
        '#include "drive.h"',
        '#include "friction.h"',
        '#include "rows.h"',
        "",
        *parts,
        "",
    ]
    return Source("\n".join(header), "\n".join(text), "{" + token + "}")


def c_string(text: str) -> str:
    """A string literal of C in plain letters, without what a log would take for a format."""
    plain = "".join(letter if " " <= letter <= "~" and letter not in '"\\%#?' else "_" for letter in text)
    return f'"{plain}"'


def _laid_out(rows: Arrangement) -> tuple[dict[str, object], dict[str, Array]]:
    """Macros and arrays of blocks and pairs, all tables one after the other (rows.h, rows.c)."""
    found: dict[str, list[NDArray[Any]]] = {
        name: [] for name in ("breaks", "contacts", "touched", "weights", "between")
    }
    found |= {f"table_{name}": [] for name in _TABLES}
    listed, carriers = [], [_carriers(block.on_carriers) for block in rows.blocks]
    for block, touched in zip(rows.blocks, carriers, strict=True):
        at = {name: sum(part.size for part in parts) for name, parts in found.items()}
        tables = {name: getattr(block, attribute) for name, attribute in _TABLES.items()}
        tables["S"], tables["H"] = (PPoly(c, block.rows.x) for c in same_degree(tables["S"].c, tables["H"].c))
        found["breaks"].append(block.rows.x)
        found["contacts"] += [block.contacts, block.stays]
        for name, table in tables.items():
            found[f"table_{name}"].append(table.c.swapaxes(0, 1))
        width = max((row.touched.shape[1] for row in block.on_carriers), default=0)
        for wide in (_widened(row, width, touched) for row in block.on_carriers):
            found["touched"].append(wide[0])
            found["weights"].append(wide[1])
        if block.on_carriers:  # interval by interval, with all rows of each
            q = len(block.on_carriers)
            for name in ("touched", "weights"):
                found[name][-q:] = [np.stack(found[name][-q:], axis=1)]
        p = block.part
        sizes = [block.path, len(block.rows.x) - 1, len(block.contacts), len(block.stays)]
        sizes += [n for of in (p.modes, p.inputs, p.outputs) for n in (of.start, of.stop - of.start)]
        sizes += [len(tables[name].c) for name in "CGHX"]
        sizes += [at[name] for name in ("breaks", "contacts", *(f"table_{name}" for name in _TABLES))]
        listed.append([*sizes, len(touched), width, at["touched"], at["weights"]])
    pairs = []
    for k, first in enumerate(rows.blocks):
        for l, second in enumerate(rows.blocks[k + 1 :], k + 1):
            if first.part is second.part and (R := first.part.flexibility.rows).any():
                pairs.append([k, l, sum(part.size for part in found["between"])])
                found["between"].append(R[np.ix_(carriers[k], carriers[l])])
    nothing = [[0, 1, 0, 0, *(0,) * 6, *(1,) * 4, *(0,) * 11]]  # one that adds nothing: C has no arrays of nothing
    macros: dict[str, object] = {
        "WHOLE": int(rows.whole),
        "BLOCKS": max(len(listed), 1),
        "PAIRS": len(pairs),
        "BLOCK_LIST": _initialisers(listed or nothing),
        "PAIR_LIST": _initialisers(pairs or [[0, 0, 0]]),
        "WIDTH": max([1, *(sizes[-3] for sizes in listed)]),
        "LARGEST": max([1, *(max(table.c[0, 0].size for table in _tables(block)) for block in rows.blocks)]),
    }
    if not listed:
        found["breaks"].append(np.array([0.0, 1.0]))
    kinds = {"contacts": "int", "touched": "int"}
    arrays = {
        f"const {kinds.get(name, 'double')} {name}[]": _flat(parts, name in kinds) for name, parts in found.items()
    }
    return macros, arrays


def _tables(block: Block) -> Iterable[PPoly]:
    return (getattr(block, attribute) for attribute in _TABLES.values())


def _carriers(rows: Sequence[Row]) -> NDArray[np.int64]:
    """Numbers of the carriers that rows touch, ascending."""
    return np.unique(np.concatenate([np.empty(0, np.int64), *(row.touched.ravel() for row in rows)]))


def _widened(row: Row, width: int, carriers: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Which of the carriers (., width) a row touches in each interval, and with what (., powers, width)."""
    missing = width - row.touched.shape[1]
    touched = np.searchsorted(carriers, np.pad(row.touched, ((0, 0), (0, missing)), "edge"))
    return touched, np.pad(row.coefficients, ((0, 0), (0, 0), (0, missing))).swapaxes(0, 1)


def _initialisers(lists: Sequence[Sequence[int]]) -> str:
    return ", ".join(f"{{{', '.join(map(str, numbers))}}}" for numbers in lists)


def _flat(parts: Sequence[Array], integer: bool) -> Array:
    found = np.concatenate([np.empty(0), *(part.ravel() for part in parts)])
    return _present(found.astype(int) if integer else found, 1)


def _present(array: Array, least: int) -> Array:
    """The array, or zeros along the last axis in place of nothing, which C has no arrays of."""
    return array if array.size else np.zeros((*(max(n, 1) for n in array.shape[:-1]), least), array.dtype)


def _listed(array: Array) -> str:
    """An initialiser of C, in braces for every axis."""
    if array.ndim > 1:
        return "{\n" + ",\n".join(map(_listed, array)) + "}"
    numbers: Sequence[float] = array.tolist()
    lines = (numbers[n : n + _NUMBERS_A_LINE] for n in range(0, len(numbers), _NUMBERS_A_LINE))
    return "{" + ",\n".join(", ".join(map(repr, line)) for line in lines) + "}"
