"""State space on a grid of s as one block in Modelica.

The text needs no library: matrices are numbers, inputs and outputs have names and units of their own.  The parameter
`place` chooses one of the places.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.export.fmi.variables import Identifiers
from pmr.export.formats import Options
from pmr.export.places import load_places
from pmr.files.whole import replacement
from pmr.scene.frame import INERTIA, MINUS_THE_ACCELERATION
from pmr.simulation.state_space import state_space

Array = NDArray[np.float64]
#: Words of Modelica 3.6 (section 2.3.3), and what the block calls its own.
RESERVED = frozenset(
    """algorithm and annotation block break class connect connector constant constrainedby der discrete each
    else elseif elsewhen encapsulated end enumeration equation expandable extends external false final flow for
    function if import impure in initial inner input loop model not operator or outer output package parameter
    partial protected public pure record redeclare replaceable return stream then true type when while within
    Real Integer Boolean String time zeros place s x x_start A B C D f y""".split()
)

_BLOCK = """\
block {name} "Boom on pads, linear, with its extensions held at one of {S} places; written by pmr"
  parameter Integer place(min = 1, max = {S}) = 1 "which of the places" annotation(Evaluate = true);
  final parameter Real s[{S}, {P}](each unit = "m") = {s} "{paths}";
  parameter Real x_start[{n}] = zeros({n}) "modal coordinates and their rates at the start";
{variables}
  Real x[{n}](start = x_start, each fixed = true) "modal coordinates and their rates";
protected
  final parameter Real A[{S}, {n}, {n}] = {A};
  final parameter Real B[{S}, {n}, {i}] = {B};
  final parameter Real C[{S}, {q}, {n}] = {C};
  final parameter Real D[{S}, {q}, {i}] = {D};
  Real f[{i}] "inputs in their order";
  Real y[{q}] "outputs in their order";
equation
  der(x) = A[place, :, :] * x + B[place, :, :] * f;
  y = C[place, :, :] * x + D[place, :, :] * f;
{equations}
end {name};
"""


def write_modelica(npz_path: Path, target: Path, options: Options) -> Path:
    """Write a block of Modelica 3, named as the file, with A, B, C, D at all places; names are those of an FMU.

    Raises InputError as `pmr.export.places.held_at`, or if the file's name is none in Modelica.
    """
    name = target.stem
    if not (name.isascii() and name.isidentifier()) or name in RESERVED or target.suffix != ".mo":
        raise InputError("command line", "--out", str(target), "a name of letters, digits and _, with .mo, is allowed")
    system, s = load_places(npz_path, options)
    space, names = state_space(system, s, npz_path.name), Identifiers({name, *RESERVED})
    inputs = zip(space.inputs, system.input_units, strict=True)
    outputs = zip(space.outputs, space.units, strict=True)
    signs = [f", {MINUS_THE_ACCELERATION}" if INERTIA in title else "" for title in space.inputs]
    lines = [
        _variable("input", names(title), title + sign, unit) for (title, unit), sign in zip(inputs, signs, strict=True)
    ]
    lines += [_variable("output", names(title), title, unit) for title, unit in outputs]
    variables = [line.split("(")[0].split()[-1] for line in lines]
    i = len(space.inputs)
    equations = [f"  f[{k}] = {variable};" for k, variable in enumerate(variables[:i], 1)]
    equations += [f"  {variable} = y[{k}];" for k, variable in enumerate(variables[i:], 1)]
    S, n = space.A.shape[:2]
    text = _BLOCK.format(
        name=name,
        **{"S": S, "P": max(1, space.s.shape[1]), "n": n, "i": i, "q": len(space.outputs)},
        **{key: _braces(getattr(space, key)) for key in "ABCD"},
        s=_braces(space.s if space.paths else np.zeros((S, 1))),
        paths=_escape(", ".join(space.paths) or "nothing travels"),
        variables="\n".join(lines),
        equations="\n".join(equations),
    )
    with replacement(target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def _variable(kind: str, name: str, title: str, unit: str) -> str:
    """Declaration of a variable; units as Modelica writes them, N.m and m/s2."""
    return f'  {kind} Real {name}(unit = "{unit.replace(" ", ".").replace("^", "")}") "{_escape(title)}";'


def _escape(text: str) -> str:
    """Within a string."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _braces(values: Array) -> str:
    """An array with all digits, a row a line."""
    if values.size == 0:  # {} is no array in Modelica
        return f"zeros({', '.join(map(str, values.shape))})"
    if values.ndim == 1:
        return f"{{{', '.join(repr(float(value)) for value in values)}}}"
    return f"{{{(',' + chr(10) + '    ').join(map(_braces, values))}}}"
