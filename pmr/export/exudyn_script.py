"""Export of a reduced system, with its scene, as a standalone Python script for Exudyn.

The script is an unchanged copy of ``templates/sliding_body.py``; the arrays that it reads are written next to it.
Names and numbers of the system are in that data file only, so that no text of a model is run as code.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PPoly

from pmr.errors import InputError, escape_controls
from pmr.files import npz
from pmr.files.arrays import Array
from pmr.files.whole import replacement_file
from pmr.scene.choice import SimulatorKey, refuse_unsupported
from pmr.scene.frame import INERTIA
from pmr.scene.signals import SignalBase
from pmr.simulation import contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.exudyn.equations import Equations
from pmr.simulation.moving import StoredScene, read_scene
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.body import length_outputs
from pmr.system.contacts import ALONE
from pmr.system.system import System

Arrays = dict[str, Any]


def write_exudyn_script(npz_path: str | Path, target: str | Path) -> Path:
    """Write a script that simulates the system saved in `npz_path` under its scene's paths and loads, to `target`.

    The script's data are written into the same folder.  The script needs numpy, scipy and exudyn only; its path is
    returned.

    Raises InputError in these cases, and as `script_data`:

    - the file holds no system;
    - the system's matrices or the lengths of its ropes change in time, or it has friction or a hoist;
    - the data would replace a file that does not hold data of a script.
    """
    npz_path, target = Path(npz_path), Path(target)
    system = System.load(npz_path).ensure_constant(npz_path.name)
    if system.compliance.paths:
        names = ", ".join(contact.name for contact in system.contacts if contact.lengthening)
        allowed = "0 is allowed here; `pmr simulate` follows ropes whose length changes"
        raise InputError(npz_path.name, "rope.lengthens", names, allowed)
    arrays, data_file = script_data(system, npz_path.name), target.with_suffix(".npz")
    if data_file.resolve() == npz_path.resolve() or not _is_free(data_file):
        raise InputError(
            "command line", "--out", str(target), f"a name is allowed whose data replaces no {data_file.name}"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    npz.write(data_file, arrays)
    with replacement_file(target) as part:
        shutil.copyfile(Path(__file__).with_name("templates") / "sliding_body.py", part)
    return target


def _is_free(file: Path) -> bool:
    """Whether a script's data may be written to a file, because it does not exist or holds data of a script."""
    if not file.exists():
        return True
    try:
        return {"paths", "inputs", "contacts", "time"} <= set(npz.read(file))
    except (OSError, npz.DamagedError):
        return False


def script_data(system: System, source: str) -> Arrays:
    """Arrays that the script reads, by name: matrices, contacts, signals, start.

    Raises InputError, which names the file `source`, for a system that the script can't simulate:

    - its provenance has no usable scene;
    - its scene has a frame that moves, or a signal that is no sum of polynomials and sines;
    - none of its outputs is a displacement.
    """
    for body in system.bodies.values():
        if ALONE in system.bodies:
            body.ensure_whole(source)
    scene, equations = read_scene(system, source), Equations(system)
    assembly = equations.assembly
    if any(name.startswith(INERTIA) for body in system.bodies.values() for name in body.input_names):
        allowed = "a scene without a frame is allowed in a script; `pmr run` and `pmr simulate` simulate one by Exudyn"
        raise InputError(source, "frame", None, allowed)
    excitation = scene.excitation
    first = dict(zip(excitation.paths, excitation.s[0].tolist(), strict=True))
    x = equations.side_positions_on(first or {"": 0.0})  # for a system without paths
    refuse_unsupported("exudyn", equations.needs(x), SimulatorKey(source, "", None))
    omega = contact_frequency(system, excitation)
    loads = excitation.forces(system.input_names)[0]  # at t = 0, when the weight may still rise
    start = equilibrium(assembly, x[0], loads).q if scene.static else np.zeros(assembly.size)
    return {
        "title": scene.title,
        "paths": np.array(system.paths, str),
        "inputs": np.array(system.input_names, str),
        "contacts": np.array(system.contact_names, str),
        "time": np.array([excitation.stepping.end, excitation.stepping.step, excitation.stepping.rho_inf]),
        "parts": contact_step.count_parts(omega, excitation.stepping) if omega else 1,
        "start": start,
        "ends": np.cumsum([len(free) for free in assembly.free_coordinates.values()]),
        **{name: getattr(assembly, name).toarray() for name in ("M", "D", "K", "B", "outputs")},
        "W": assembly.direct,
        "clearance": system.clearance,
        "rigid": assembly.contact_rows(x[0]).rigid,
        **(_path_tables(system, x[0]) if ALONE in system.bodies else _sides(system, assembly, x[0])),
        **_signal_arrays(scene, system, source),
        **_tip_values(system, source),
    }


def _tip_values(system: System, source: str) -> Arrays:
    """Values about the last displacement, which the script prints: ``tip``, ``tip_of`` and ``tip_position``.

    ``tip`` is the number of this displacement among the outputs, and ``tip_position`` its position in m.  ``tip_of``
    are words for its body, empty for a single body.  Displacements of probes do not count.  Raises InputError, which
    names the file `source`, if there is no displacement.
    """
    of = [
        (name, position, is_length)
        for name, body in system.bodies.items()
        for position, is_length in zip(body.output_positions, length_outputs(body), strict=True)
    ]
    displacements = [k for k, (_, _, is_length) in enumerate(of) if is_length]
    if not displacements:
        raise InputError(source, "outputs", None, "at least one displacement is allowed in a script")
    name, position, _ = of[displacements[-1]]
    where = "" if ALONE in system.bodies else escape_controls(f" of {name}").rstrip()
    return {"tip": displacements[-1], "tip_of": where, "tip_position": position}


def _signal_arrays(scene: StoredScene, system: System, source: str) -> Arrays:
    """Arrays, by name, of the strands of paths and loads: polynomials and sines (`pmr.scene.signals.base.Strand`).

    Paths and loads are in the order of the system's names.  Raises InputError, which names the file `source`, if a
    signal has no strands.
    """
    excitation = scene.excitation
    names = [*system.paths, *system.input_names]
    chosen = [excitation.paths[name] for name in system.paths]
    chosen += [excitation.loads[name] for name in system.input_names]
    strands = [(k, strand) for k, signal in enumerate(chosen) for strand in _strands(signal, names[k], source)]
    arrays: Arrays = {
        "strands.signal": np.array([k for k, _ in strands]),
        "strands.amplitude": np.array([strand.amplitude for _, strand in strands]),
        "strands.spread": np.array([strand.spread for _, strand in strands]),
    }
    for k, (_, strand) in enumerate(strands):
        angles = np.broadcast_to(strand.angles, (len(strand.breaks), 3))
        arrays |= {f"strands.{k}": strand.polynomials.T, f"strands.{k}.angle": angles.T}
        arrays |= {f"strands.{k}.breaks": strand.breaks, f"strands.{k}.angle.breaks": strand.breaks}
    return arrays


def _strands(signal: SignalBase, name: str, source: str) -> Any:
    """Polynomials and sines of the signal called `name` (`pmr.scene.signals.base.Strand`).

    Raises InputError about the file `source` for a signal without them.
    """
    try:
        return signal.strands
    except NotImplementedError as error:
        raise InputError(source, f"signal of {name}", None, f"{error}; one is allowed in a script") from None


def _path_tables(system: System, x: Array) -> Arrays:
    """Tables of the contact matrices C, F, H and X of a single body over its path, as arrays by name.

    The matrices are those of the script's equations.  Without residual flexibility H and X are zero, and F is only the
    compliance of the contacts themselves.  This compliance is that with the sides of contacts at x (sides,) in m.
    """
    (body,) = system.reduced.values()
    numbers = [body.row_names.index(side.place.row) for side in system.sides]
    m, i, o = len(numbers), len(body.input_names), len(body.output_positions)
    residual = body.flexibility
    arrays: Arrays = {"C": body.rows.c[:, :, numbers], "C.breaks": body.rows.x}
    for name, part, shape, chosen in (
        ("F", "rows", (m, m), np.ix_(numbers, numbers)),
        ("H", "inputs", (m, i), np.ix_(numbers)),
        ("X", "outputs", (o, m), np.ix_(range(o), numbers)),
    ):
        arrays |= {name: np.zeros((1, 1, *shape)), f"{name}.breaks": np.array(body.domain)}
        if residual is not None:
            table: PPoly = getattr(residual, part)
            arrays |= {name: table.c[(slice(None), slice(None), *chosen)], f"{name}.breaks": table.x}
    arrays["F"][-1] += system.contact_compliance(x)
    return arrays


def _sides(system: System, assembly: Assembly, x: Array) -> Arrays:
    """Arrays, by name, with which the script computes the contacts of a boom.

    For each side of a contact they have its place, its path and its rows.  For each body they have the displacements of
    its carriers, and its responses to forces on its carriers.  The compliance of the contacts is that with their sides
    at x (sides,) in m.
    """
    paths, names = list(system.paths), list(system.bodies)
    arrays: Arrays = {
        "compliance": system.contact_compliance(x),
        "sides.contact": np.array([side.contact for side in system.sides]),
        "sides.body": np.array([names.index(side.place.body) for side in system.sides]),
        "sides.path": np.array([-1 if (p := side.place.path) is None else paths.index(p) for side in system.sides]),
        "sides.at": np.array([side.place.at for side in system.sides], float),
        "sides.rate": np.array([side.place.rate for side in system.sides], float),
    }
    for k, side in enumerate(system.sides):
        row = system.row(side.place)
        arrays |= {f"sides.{k}": side.sign * row.coefficients, f"sides.{k}.touched": row.touched[None]}
        arrays |= {f"sides.{k}.breaks": row.breaks, f"sides.{k}.touched.breaks": row.breaks}
    n, i, o = assembly.size, assembly.B.shape[1], assembly.outputs.shape[0]
    for k, (name, body) in enumerate(system.bodies.items()):
        assert body.carriers is not None
        values, flex = body.carriers.values, body.carriers.flexibility
        K = len(values)
        V, R, H, X = np.zeros((K, n)), np.zeros((K, K)), np.zeros((K, i)), np.zeros((o, K))
        V[:, assembly.coordinate_slices[name]] = values[:, assembly.free_coordinates[name]]
        if flex is not None:
            R, H[:, assembly.input_slices[name]], X[assembly.output_slices[name]] = flex.rows, flex.inputs, flex.outputs
        arrays |= {f"bodies.{k}.V": V, f"bodies.{k}.R": R, f"bodies.{k}.H": H, f"bodies.{k}.X": X}
    return arrays
