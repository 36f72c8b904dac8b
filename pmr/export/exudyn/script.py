"""Export of a reduced system, with its scene, as a standalone Python script for Exudyn.

The script consists of functions copied from `script_parts`, `script_system` and `script_carriers` (or, of a body alone,
`script_tables`), and of what the scene says (`script_scene`): paths, loads and time stepping.
Whatever comes with the system (names, title, numbers) stands in it as a literal of Python: none of it is ever run.
"""

from __future__ import annotations

import inspect
import shutil
from pathlib import Path
from typing import Any

from pmr.errors import InputError
from pmr.errors.text import visible
from pmr.export.exudyn import script_carriers, script_parts, script_system, script_tables
from pmr.export.exudyn.script_scene import listed, scene_text
from pmr.files.whole import replaced
from pmr.scene.simulators import Asked, refuse
from pmr.simulation.exudyn.equations import Equations
from pmr.system.body import force_outputs
from pmr.system.contacts import ALONE
from pmr.system.system import System

_SCRIPT = '''\
"""A reduced system in Exudyn.

    M q'' + D q' + K q + C(s)^T lambda = B f(t),    C(s) q + H(s) f - F(s) lambda = 0,
    y = outputs q + W f - X(s) lambda

with {size} reduced coordinates q of {bodies}, path coordinates s(t) and outputs y; SI units throughout.

Written by pmr; needs numpy, scipy and exudyn, and the file MODEL in this folder.
"""

{imports}

TITLE = {title!r}
MODEL = {file_name!r}
CONTACTS = {contacts}  # the rows of C
OF = {where!r}

# --- What happens: change it here -------------------------------------------------------------------

{scene}

# --- Signals ----------------------------------------------------------------------------------------


{signals}


# --- The bodies in Exudyn ---------------------------------------------------------------------------


{system}


def main():
    model = read_model(Path(__file__).with_name(MODEL))
    t, y = simulate(model, PATHS, LOADS, END, STEP, RHO_INF, START, PARTS)
    tip = y[:, {tip}]
    print(f"Displacement{{OF}} at x = {{model.output_positions[{tip}]:g}} m over {{t[-1]:g}} s:")
    for name, value in (("smallest", tip.min()), ("largest", tip.max()), ("last", tip[-1])):
        print(f"  {{name}}: {{1e3 * value:.4f}} mm")


if __name__ == "__main__":
    main()
'''


def write_exudyn_script(npz_path: str | Path, target: str | Path) -> Path:
    """Write a script that simulates a saved system under its scene's paths and loads.

    It needs numpy, scipy and exudyn only, and the system in its own folder, into which it is copied if need be.
    Raises InputError as `exudyn_script`, if the file is no system, or if writing would replace one.
    """
    npz_path, target = Path(npz_path), Path(target)
    text = exudyn_script(
        System.load(npz_path).ensure_constant(npz_path.name).ensure_lengths_stay(npz_path.name), npz_path.name
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = target.with_name(npz_path.name)
    if target == beside:
        raise InputError("command line", "--out", str(target), "a name other than the model's is allowed")
    if not beside.exists():
        with replaced(beside) as part:
            shutil.copyfile(npz_path, part)
    elif beside.read_bytes() != npz_path.read_bytes():
        raise InputError("command line", "--out", str(target), f"{beside} is another model; another folder is allowed")
    with replaced(target) as part:
        part.write_text(text, encoding="utf-8")
    return target


def exudyn_script(system: System, file_name: str) -> str:
    """Text of a script that reads `system` from `file_name`.

    Raises InputError if the system's provenance has no usable scene, or its output is no displacement.
    """
    for body in system.bodies.values():
        if ALONE in system.bodies:
            body.ensure_whole(file_name)
    scene, equations = scene_text(system, file_name), Equations(system)
    first = {name: float(path.value(0.0)) for name, path in zip(system.paths, scene.paths.values(), strict=True)}
    x = equations.at(first or {"": 0.0})  # of a system in which nothing travels
    refuse("exudyn", equations.needs(x), Asked(file_name, "", None))
    units = [(name, force) for name, body in system.bodies.items() for force in force_outputs(body)]
    moved = [k for k, (_, force) in enumerate(units) if not force]
    if not moved:
        raise InputError(file_name, "outputs", None, "at least one displacement is allowed in a script")
    reader: Any = script_tables if ALONE in system.bodies else script_carriers
    signals = scene.kinds | ({"akima"} if "table" in scene.kinds else set())
    return _SCRIPT.format(
        title=scene.title,
        size=equations.size,
        bodies=f"{len(system.bodies)} bodies" if len(system.bodies) > 1 else "a body",
        contacts=listed(system.contact_names),
        file_name=file_name,
        imports=_imports(scene.kinds, reader),
        scene=scene.text(),
        signals=_sources(script_parts, signals),
        system=f"{_sources(reader)}\n\n\n{_sources(script_system)}",
        tip=moved[-1],
        where=visible(f" of {units[moved[-1]][0]}").rstrip() if ALONE not in system.bodies else "",
    )


def _sources(module: Any, names: set[str] | None = None) -> str:
    """Source text of some functions of a module, or of all, in the module's order."""
    functions = {name: f for name, f in vars(module).items() if getattr(f, "__module__", None) == module.__name__}
    return "\n\n\n".join(
        inspect.getsource(f).rstrip() for name, f in functions.items() if names is None or name in names
    )


def _imports(kinds: set[str], reader: Any) -> str:
    """What the copied functions need; the items as their module imports them."""
    items = "".join(
        f"    {name},\n"
        for name, value in vars(script_system).items()
        if getattr(value, "__module__", None) == "exudyn.itemInterface"
    )
    cache = "from functools import lru_cache\n" if "table" in kinds else ""
    scipy = ["from scipy.interpolate import Akima1DInterpolator"] if "table" in kinds else []
    if reader is script_tables:
        scipy = [f"from scipy.interpolate import {'Akima1DInterpolator, ' if scipy else ''}PPoly"]
    else:
        scipy.append("from scipy.linalg import block_diag")
    first = "" if reader is script_tables else "import json\n"
    return (
        f"{first}import warnings\n{cache}from pathlib import Path\nfrom types import SimpleNamespace\n\n"
        "import exudyn as exu\nimport numpy as np\n"
        f"from exudyn.itemInterface import (\n{items})\n" + "\n".join(scipy)
    )
