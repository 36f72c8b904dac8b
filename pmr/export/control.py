"""State space on a grid of path coordinates s, for MATLAB, python-control and Modelica, and its frequency response.

The frequency response is written as a table and a picture.  The Modelica block needs no library: matrices are numbers,
inputs and outputs have names and units, and the block's parameter ``place`` chooses one of the grid points.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.io
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.errors.environment import check_installed
from pmr.export.fmi.variables import Identifiers
from pmr.export.formats import Options
from pmr.export.state_space import PLACES, StateSpace, path_positions, saved_system, state_space
from pmr.files.arrays import Array
from pmr.files.whole import replacement_file, write_text
from pmr.scene.frame import INERTIA, MINUS_THE_ACCELERATION
from pmr.scene.keys import LUFFING, path_unit
from pmr.system.assembly import Assembly
from pmr.system.system import System

logger = logging.getLogger(__name__)
#: Files that are written with names and numbers of a model in them.
TEMPLATES = Path(__file__).with_name("templates")
#: Relative error allowed for interpolated gains and frequencies, and most grid points used to reach it.
CLOSE, MOST_PLACES = 0.01, 161
#: Number of frequencies of a response.
FREQUENCIES = 400
#: Share of the largest gain below which gains are round-off (zero by symmetry); all of them are drawn with this value.
FLOOR = 1e-12

#: Share of the largest natural frequency below which a frequency is that of a free motion.
FREE = 1e-6


def write_python_control(npz_path: Path, target: Path, options: Options) -> Path:
    """Write a script for python-control, and next to it the .mat file with its data; return the script's path.

    `npz_path` is the file of the model.  Raises InputError as `write_matlab`, if Python can't import the script's name,
    or if the data would replace the model.
    """
    data = target.with_suffix(".mat")
    if data == target or not target.stem.isidentifier():
        raise InputError("command line", "--out", str(target), "a name that Python can import, .py, is allowed")
    if data.exists() and data.samefile(npz_path):
        raise InputError(
            "command line", "--out", str(target), f"another name is allowed: {data.name} is input of the same run"
        )
    write_matlab(npz_path, data, options)
    write_text(target, (TEMPLATES / "state_space.py").read_text(encoding="utf-8").replace("state_space", target.stem))
    return target


def write_frequency_response(npz_path: Path, target: Path, options: Options) -> Path:
    """Write gain and phase of the system in `npz_path` as a table, and a picture of the gain.

    The gain has the unit of the output per unit of the input; the phase is in degrees.  The output is the last
    displacement, which is that of the tip.  The path `target` of the table is returned; the picture is written next to
    the table.  Raises InputError as `write_matlab`.
    """
    check_installed("matplotlib")
    system = saved_system(npz_path, options)
    s = path_positions(system, options.at)
    space, assembly = state_space(system, s, npz_path.name), Assembly(system)
    output = max(k for k, unit in enumerate(space.units) if unit == "m")
    natural = space.natural
    lowest = natural[natural > FREE * natural.max()].min()
    f = np.geomspace(0.1 * lowest, 1.2 * natural.max(), FREQUENCIES) / (2.0 * np.pi)
    rows = assembly.contact_rows_over_time(np.atleast_2d(system.side_coordinates(s)))
    answers = [assembly.frequency_responses(rows.at_time(k), 2.0 * np.pi * f)[:, output] for k in range(len(space.s))]
    response = np.array(answers)
    write_text(target, _response_table(space, f, response, space.outputs[output]))
    _draw(space, f, np.abs(response), space.outputs[output], target.with_suffix(".png"))
    return target


def write_matlab(npz_path: Path, target: Path, options: Options) -> Path:
    """Write A, B, C, D as arrays (rows, columns, S) over S grid points, as MATLAB's ``ss`` needs them; return `target`.

    `npz_path` is the file of the model.  The written file also has all names, and the two errors of interpolation
    (`interpolation_error`).  Unless the options give the grid, it is refined by factors of two, from `PLACES` points to
    `MOST_PLACES` at most, until the errors are at most `CLOSE`.  Larger errors of the interpolation are logged as a
    warning.  Raises errors as `pmr.export.state_space.state_space`.
    """
    system = saved_system(npz_path, options)
    s = path_positions(system, options.at)
    count = PLACES
    while True:
        space = state_space(system, s, npz_path.name)
        off = interpolation_error(system, space, npz_path.name)
        if max(off) <= CLOSE or options.at is not None or count >= MOST_PLACES:
            break
        count = 2 * count - 1
        s = {path: np.linspace(at[0], at[-1], count) for path, at in s.items()}
    if max(off) > CLOSE:
        logger.warning(
            "halfway between two of the %d places interpolated matrices have static gains off by up to %.2g %% and "
            "frequencies off by up to %.2g %%: places that are closer together are more accurate",
            len(space.s), *(100.0 * error for error in off),
        )  # fmt: skip
    matrices = {name: np.moveaxis(getattr(space, name), 0, 2) for name in "ABCD"}
    named = ("paths", "inputs", "outputs", "units", "states")
    names = {name: np.array(getattr(space, name), dtype=object) for name in named}
    with replacement_file(target) as part, part.open("wb") as stream:
        interpolation = dict(zip(("static_gain", "frequency"), off, strict=True))
        scipy.io.savemat(
            stream, {"s": space.grid, **matrices, **names, "interpolation": interpolation}, do_compression=True
        )
    return target


def interpolation_error(system: System, space: StateSpace, source: str) -> list[float]:
    """Return two errors of A, B, C and D interpolated linearly, halfway between neighbouring grid points.

    The first number is the largest error of a displacement's static gain, as a fraction of the largest gain from the
    same input to the same output.  Gains that are round-off are left out.  The second number is the largest error of a
    natural frequency, as a fraction of this frequency.  Free motions have neither a static gain nor a natural
    frequency, and are left out of both.

    Both numbers are zero for a grid of one point and for a system without paths.  `source` names the file in messages.
    """
    if len(space.s) < 2 or not space.paths:
        return [0.0, 0.0]
    halfway = state_space(system, dict(zip(space.paths, (space.s[1:] + space.s[:-1]).T / 2.0, strict=True)), source)
    A, B, C, D = ((values[1:] + values[:-1]) / 2.0 for values in (space.A, space.B, space.C, space.D))
    between = replace(halfway, A=A, B=B, C=C, D=D)
    displacements = [k for k, unit in enumerate(space.units) if unit == "m"]
    exact, other = (model.D - model.C @ np.linalg.pinv(model.A) @ model.B for model in (halfway, between))
    size = np.abs(exact).max(axis=0)
    size = np.where(size > FLOOR * size.max(initial=0.0), size, np.inf)
    of_gains = (np.abs(other - exact) / size)[:, displacements].max(initial=0.0)
    bound = halfway.natural > FREE * halfway.natural.max()
    of_frequencies = np.abs(between.natural[bound] / halfway.natural[bound] - 1.0).max(initial=0.0)
    return [float(of_gains), float(of_frequencies)]


def _response_table(space: StateSpace, f: Array, response: NDArray[np.complex128], output: str) -> str:
    """Comma-separated table of gain and phase of the complex `response` (S, W, i) from i inputs to one output.

    There are S grid points and W frequencies f (W,) in Hz.
    """
    of = [f"{output} / {name}" for name in space.inputs]
    places = ["s in m"] if len(space.paths) < 2 else [f'"{path} in {path_unit(path)}"' for path in space.paths]
    lines = [",".join([*places, "f in Hz", *(f'"{what} of {pair}"' for pair in of for what in ("gain", "phase"))])]
    gain, phase = np.abs(response), np.degrees(np.angle(response))
    for k, s in enumerate(space.grid.reshape(len(space.s), -1)):
        for w, hertz in enumerate(f):
            numbers = np.column_stack([gain[k, w], phase[k, w]]).ravel()
            lines.append(",".join(f"{x:.9g}" for x in (*s, hertz, *numbers)))
    return "\n".join([*lines, ""])


def _draw(space: StateSpace, f: Array, gain: Array, output: str, target: Path) -> None:
    """Draw the `gain` (S, W, i) over S grid points and W frequencies f (W,) in Hz, in decibels, as the .png `target`.

    `output` names the output in titles.  There is one panel for each input, a map over the path coordinate.  Several
    paths are drawn over the sum of their extensions, or over the luffing angle if this sum is the same everywhere.  If
    nothing varies, a panel has the curve of the first grid point alone.  Gains below the share `FLOOR` of the largest
    are drawn as this share.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    extends = [path != LUFFING for path in space.paths]
    together, axis = space.s[:, extends].sum(axis=1), "s in m" if len(space.paths) < 2 else "sum of extensions in m"
    if LUFFING in space.paths and np.ptp(together) == 0.0:
        together, axis = space.s[:, space.paths.index(LUFFING)], f"{LUFFING} in {path_unit(LUFFING)}"
    order = np.argsort(together, kind="stable")
    figure = Figure(figsize=(5.0 * len(space.inputs), 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    for k, name in enumerate(space.inputs):
        axes = figure.add_subplot(1, len(space.inputs), k + 1, yscale="log", xlabel=axis, ylabel="f in Hz")
        level = 20.0 * np.log10(np.maximum(gain[order, :, k], max(FLOOR * gain.max(), np.finfo(float).tiny))).T
        if np.ptp(together) > 0.0:
            mesh = axes.pcolormesh(together[order], f, level, shading="nearest", rasterized=True)
            figure.colorbar(mesh, label="gain in dB")
        else:
            axes.plot(level[:, 0], f)
            axes.set_xlabel("gain in dB")
        axes.set_title(f"{output} over {name}")
    with replacement_file(target) as part, part.open("wb") as stream:
        figure.savefig(stream, format="png", dpi=150)


#: Names that a variable can't have: keywords of Modelica 3.6 (section 2.3.3), and names that the block uses itself.
RESERVED = frozenset(
    """algorithm and annotation block break class connect connector constant constrainedby der discrete each
    else elseif elsewhen encapsulated end enumeration equation expandable extends external false final flow for
    function if import impure in initial inner input loop model not operator or outer output package parameter
    partial protected public pure record redeclare replaceable return stream then true type when while within
    Real Integer Boolean String time zeros place s x x_start A B C D f y""".split()
)


def write_modelica(npz_path: Path, target: Path, options: Options) -> Path:
    """Write a Modelica 3 block of a saved reduced system, with A, B, C, D at all grid points; return `target`.

    `npz_path` is the file of the system, from which the state space is computed.  The block is named like the file
    `target`, which has to end in .mo; its variables are named as an FMU names them.  Raises InputError as
    `pmr.export.state_space.state_space`, or if Modelica does not allow the file's name.
    """
    name = target.stem
    if not (name.isascii() and name.isidentifier()) or name in RESERVED or target.suffix != ".mo":
        raise InputError("command line", "--out", str(target), "a name of letters, digits and _, with .mo, is allowed")
    system = saved_system(npz_path, options)
    s = path_positions(system, options.at)
    space, names = state_space(system, s, npz_path.name), Identifiers({name, *RESERVED})
    inputs = zip(space.inputs, system.input_units, strict=True)
    outputs = zip(space.outputs, space.units, strict=True)
    signs = [f", {MINUS_THE_ACCELERATION}" if INERTIA in title else "" for title in space.inputs]
    lines = [
        _variable("input", names(title), title + sign, unit) for (title, unit), sign in zip(inputs, signs, strict=True)
    ]
    lines += [_variable("output", names(title), title, unit) for title, unit in outputs]
    variables = [line.split("(")[0].split()[-1] for line in lines]
    i, units = len(space.inputs), {path_unit(path) for path in space.paths}
    equations = [f"  f[{k}] = {variable};" for k, variable in enumerate(variables[:i], 1)]
    equations += [f"  {variable} = y[{k}];" for k, variable in enumerate(variables[i:], 1)]
    S, n = space.A.shape[:2]
    text = (
        (TEMPLATES / "state_space.mo")
        .read_text(encoding="utf-8")
        .format(
            name=name,
            **{"S": S, "P": max(1, space.s.shape[1]), "n": n, "i": i, "q": len(space.outputs)},
            **{key: _braces(getattr(space, key)) for key in "ABCD"},
            s=_braces(space.s if space.paths else np.zeros((S, 1))),
            unit=f'(each unit = "{units.pop()}")' if len(units) == 1 else "",
            paths=_escape(", ".join(f"{path} in {path_unit(path)}" for path in space.paths) or "nothing travels"),
            variables="\n".join(lines),
            equations="\n".join(equations),
        )
    )
    write_text(target, text)
    return target


def _variable(kind: str, name: str, title: str, unit: str) -> str:
    """Declaration of a Modelica variable `name` with its `title`; `kind` is ``input`` or ``output``.

    `unit` is in the notation of pmr, such as N m and m/s^2; the declaration has Modelica's, such as N.m and m/s2.
    """
    return f'  {kind} Real {name}(unit = "{unit.replace(" ", ".").replace("^", "")}") "{_escape(title)}";'


def _escape(text: str) -> str:
    """Text with backslashes and quotes escaped, as the content of a Modelica string."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _braces(values: Array) -> str:
    """The array `values` (any shape) as a Modelica expression with all digits, one row per line; zeros() if empty."""
    if values.size == 0:  # in Modelica {} is not an array
        return f"zeros({', '.join(map(str, values.shape))})"
    if values.ndim == 1:
        return f"{{{', '.join(repr(float(value)) for value in values)}}}"
    return f"{{{(',' + chr(10) + '    ').join(map(_braces, values))}}}"
