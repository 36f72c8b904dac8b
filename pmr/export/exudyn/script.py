"""Export of a reduced model, with its scene, as a standalone Python script for Exudyn.

The script consists of functions copied from `script_parts` and `script_body` (or, where rows give
way, `script_compliant_rows`), and of what the scene says (`script_scene`): path, loads and time stepping.
Whatever comes with the model (names, title, numbers) stands in it as a literal of Python: none of it is ever run.
"""

from __future__ import annotations

import inspect
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.export.exudyn import script_body as script_body
from pmr.export.exudyn import script_compliant_rows as script_compliant_rows
from pmr.export.exudyn import script_parts as script_parts
from pmr.export.exudyn.script_scene import WIDTH, scene_text
from pmr.files.whole import replaced
from pmr.reduced.model import ReducedModel
from pmr.scene.simulators import Asked, refuse
from pmr.simulation.needs import needs_of
from pmr.system.body import force_outputs
from pmr.system.compliant_rows import compliant_rows

_SCRIPT = '''\
"""A reduced model in Exudyn.

{equations}

with {size} reduced coordinates p, the slider at s(t) and the transverse displacements y; SI units throughout.

Written by pmr; needs numpy, scipy and exudyn, and the file MODEL in this folder.
"""

{imports}

TITLE = {title!r}
MODEL = {file_name!r}
ROWS = {rows}  # of C

# --- What happens: change it here -------------------------------------------------------------------

{scene}

# --- Signals ----------------------------------------------------------------------------------------


{signals}


# --- The body in Exudyn -----------------------------------------------------------------------------


{body}


def main():
    model = read_model(Path(__file__).with_name(MODEL))
    t, displacement = simulate(model, slider_position, LOADS, END, STEP, RHO_INF)
    tip = displacement[:, {tip}]
    print(f"Displacement at x = {{model.output_positions[{tip}]:g}} m over {{t[-1]:g}} s:")
    for name, value in (("smallest", tip.min()), ("largest", tip.max()), ("last", tip[-1])):
        print(f"  {{name}}: {{1e3 * value:.4f}} mm")


if __name__ == "__main__":
    main()
'''


#: Functions of a body's module that a script needs.
BODY = {"read_model", "multipliers", "system", "add_sliding_body", "simulate"}
_FIRM = "    M p'' + D p' + K p + C(s)^T lambda = B f(t),    C(s) p = 0,    y = outputs p"
_COMPLIANT_ROWS = """\
    M p'' + D p' + K p + C(s)^T lambda = B f(t),    C(s) p + H(s) f - (G(s) + pads) lambda = 0,
    y = outputs p + W f - X(s) lambda"""


def write_exudyn_script(npz_path: str | Path, target: str | Path) -> Path:
    """Write a script that simulates a saved reduced model under its scene's path and loads.

    It needs numpy, scipy and exudyn only, and the model in its own folder, into which it is copied if need be.
    Raises InputError as `exudyn_script`, if the file is no reduced model, or if writing would replace a model.
    """
    npz_path, target = Path(npz_path), Path(target)
    text = exudyn_script(ReducedModel.load(npz_path), npz_path.name)
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


def exudyn_script(model: ReducedModel, file_name: str) -> str:
    """Text of a script that reads `model` from `file_name`.

    Raises InputError if the model's provenance has no usable scene, only some of its rows give way, it keeps residual
    inertia or has rows that only push.
    """
    model.ensure_whole(file_name)
    refuse("exudyn-multiplier", needs_of(model, model.domain[0]), Asked(file_name, "", None))
    scene, compliant = scene_text(model, file_name), compliant_rows(model)
    moved = np.flatnonzero(~force_outputs(model))
    if not moved.size:
        raise InputError(file_name, "outputs", None, "at least one displacement is allowed in a script")
    if 0 < len(compliant) < len(model.row_names):
        names = ", ".join(model.row_names[i] for i in compliant)
        raise InputError(file_name, "rows", None, f"only {names} give way; all rows or none are allowed in a script")
    module: Any = script_compliant_rows if compliant else script_body
    signals = scene.kinds | ({"akima"} if "table" in scene.kinds else set())
    return _SCRIPT.format(
        title=scene.title,
        equations=_COMPLIANT_ROWS if compliant else _FIRM,
        size=model.size,
        rows=_listed(model.row_names),
        file_name=file_name,
        imports=_imports(scene.kinds, (module, script_parts)),
        scene=scene.text(),
        signals=_sources(script_parts, signals),
        body=f"{_sources(module, BODY)}\n\n\n{_sources(script_parts, {'add_body', 'solve'})}",
        tip=int(moved[-1]),
    )


def _listed(names: Sequence[str]) -> str:
    """A list of strings as Python writes it; a name a line where it is long."""
    line = repr(list(names))
    return line if len(line) <= WIDTH else "\n".join(["[", *(f"    {name!r}," for name in names), "]"])


def _sources(module: Any, names: set[str]) -> str:
    """Source text of some functions of a module, in the module's order."""
    return "\n\n\n".join(inspect.getsource(f).rstrip() for name, f in vars(module).items() if name in names)


def _imports(kinds: set[str], modules: Sequence[Any]) -> str:
    """What the copied functions need; the items as their modules import them."""
    items = "".join(
        f"    {name},\n"
        for module in modules
        for name, value in vars(module).items()
        if getattr(value, "__module__", None) == "exudyn.itemInterface"
    )
    cache = "from functools import lru_cache\n" if "table" in kinds else ""
    akima = "Akima1DInterpolator, " if "table" in kinds else ""
    return (
        f"import warnings\n{cache}from pathlib import Path\nfrom types import SimpleNamespace\n\n"
        "import exudyn as exu\nimport numpy as np\n"
        f"from exudyn.itemInterface import (\n{items})\n"
        f"from scipy.interpolate import {akima}PPoly"
    )
