"""A reduced model as constants of the C source in `source/` (body.h says what each of them is)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import rebased
from pmr.errors import BEYOND_ENDS, InputError
from pmr.reduced.model import ReducedModel
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native.system import table_breaks
from pmr.system.compliant_rows import compliant_rows

Array = NDArray[np.float64]
_NUMBERS_A_LINE = 8


@dataclass(frozen=True)
class Constants:
    """A body in modal form, and what the C source is told of it."""

    form: ModalForm
    gives_way: NDArray[np.bool_]  #: (m,) array: rows whose flexibility or pad gives way; the others are rigid
    sizes: dict[str, float]  #: Macros of model.h
    arrays: dict[str, Array]  #: Arrays of model.c by their declarations

    @property
    def model_exchange(self) -> bool:
        """Whether an ordinary differential equation is left: no row is rigid."""
        return bool(self.gives_way.all())


def constants(model: ReducedModel, source: str) -> Constants:
    """Modal form and tables of a model on common breaks; raises InputError of `source` if it keeps residual inertia."""
    if model.flexibility is not None and model.flexibility.keeps_inertia:
        raise InputError(source, "flexibility.inertia", None, "a model without residual inertia is allowed in an FMU")
    m, i, o = len(model.row_names), len(model.input_names), len(model.outputs)
    gives_way = np.isin(np.arange(m), compliant_rows(model))
    form = modal_form(model)
    body, breaks = form.body, table_breaks(form.body)
    none = {"rows": (m, m), "inputs": (m, i), "outputs": (o, m)}
    tables = {name: PPoly(np.zeros((1, len(breaks) - 1, *shape)), breaks) for name, shape in none.items()}
    if body.flexibility is not None:
        tables = {name: rebased(getattr(body.flexibility, name), breaks) for name in none}
    C = rebased(body.rows, breaks)
    coupled = not form.classically_damped
    pushes = ~np.isnan(body.row_clearance)
    sizes: dict[str, float] = {
        "MODES": body.size,
        "ROWS": max(m, 1),
        "INPUTS": max(i, 1),
        "OUTPUTS": max(o, 1),
        "INTERVALS": len(breaks) - 1,
        "POWERS_C": len(C.c),
        "POWERS_G": len(tables["rows"].c),
        "POWERS_H": len(tables["inputs"].c),
        "POWERS_X": len(tables["outputs"].c),
        "DAMPING_COUPLES": int(coupled),
        "DAMPING_SIZE": body.size ** (2 if coupled else 1),
        "MODEL_EXCHANGE": int(gives_way.all()),
        "BEYOND_ENDS": BEYOND_ENDS,
    }
    X = tables["outputs"].c.swapaxes(2, 3)
    arrays = {
        "const double breaks[INTERVALS + 1]": breaks,
        "const double table_C[INTERVALS][POWERS_C][ROWS * MODES]": _by_interval(C.c),
        "const double table_G[INTERVALS][POWERS_G][ROWS * ROWS]": _by_interval(tables["rows"].c),
        "const double table_H[INTERVALS][POWERS_H][ROWS * INPUTS]": _by_interval(tables["inputs"].c),
        "const double table_X[INTERVALS][POWERS_X][ROWS * OUTPUTS]": _by_interval(X),
        "const double omega2[MODES]": form.omega2,
        "const double damping[DAMPING_SIZE]": body.D.ravel() if coupled else np.diagonal(body.D),
        "const double inputs[INPUTS][MODES]": _present(body.B.T, body.size),
        "const double shapes[MODES][OUTPUTS]": _present(body.outputs.T, body.size),
        "const double direct[INPUTS][OUTPUTS]": _present(
            body.flexibility.direct.T if body.flexibility else np.zeros((i, o)), o
        ),
        "const double compliance[ROWS]": body.row_compliance if m else np.ones(1),  # a row that holds nothing
        "const double clearance[ROWS]": _present(np.where(pushes, body.row_clearance, 0.0), 1),
        "const int pushes[ROWS]": _present(pushes.astype(int), 1),
        "const int gives_way[ROWS]": gives_way.astype(int) if m else np.ones(1, int),
    }
    return Constants(form, gives_way, sizes, arrays)


@dataclass(frozen=True)
class Source:
    """The two files of C source that a model makes, and the token that tells it from others."""

    header: str
    text: str
    token: str


def source_text(constants: Constants, start_values: Array, nominal: Array) -> Source:
    """model.h and model.c.

    `start_values` (5 + 2 i,) are those of the variables from the time to the scheme's parameter: t, s, s', loads, their
    rates, step, rho_inf; `nominal` (2 r,) are sizes of the modal coordinates and of their rates.
    """
    arrays = constants.arrays | {
        "const double start_values[3 + 2 * INPUTS + 2]": start_values,
        "const double nominal[2 * MODES]": nominal,
    }
    macros = [f"#define {name} {value}" for name, value in constants.sizes.items()]
    names = constants.form.body.row_names or ("none",)
    parts = [f"{declaration} = {_listed(array)};" for declaration, array in arrays.items()]
    parts.append(f"const char *const row_names[ROWS] = {{{', '.join(map(c_string, names))}}};")
    digest = hashlib.sha256("\n".join([*macros, *parts]).encode()).hexdigest()
    token = "-".join(digest[a:b] for a, b in ((0, 8), (8, 12), (12, 16), (16, 20), (20, 32)))
    parts.append(f"const char *const model_token = {c_string('{' + token + '}')};")
    header = ["/* Sizes of the model. */", "#ifndef MODEL_H", "#define MODEL_H", "", *macros, "", "#endif", ""]
    text = ["/* Constants of the model. */", '#include "body.h"', "", *parts, ""]
    return Source("\n".join(header), "\n".join(text), "{" + token + "}")


def c_string(text: str) -> str:
    """A string literal of C in plain letters, without what a log would take for a format."""
    plain = "".join(letter if " " <= letter <= "~" and letter not in '"\\%#?' else "_" for letter in text)
    return f'"{plain}"'


def _by_interval(c: Array) -> Array:
    """Coefficients (powers, k, m, n) as (k, powers, m n)."""
    return _present(c.swapaxes(0, 1).reshape(c.shape[1], c.shape[0], -1), 1)


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
