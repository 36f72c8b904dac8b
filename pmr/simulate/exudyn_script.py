"""Export of a reduced model, with its scene, as a standalone Python script for Exudyn.

The script consists of functions copied from `exudyn_script_signals`, `exudyn_script_solver` and `exudyn_script_body`
(or, where rows give way, `exudyn_script_yielding`), and of what the scene says: path, loads and time stepping.
"""

from __future__ import annotations

import inspect
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from pmr.body import force_outputs
from pmr.errors import InputError
from pmr.reduced import ReducedModel
from pmr.scene.space import Gravity
from pmr.signals import Constant, Signal, SignalBase, Sum
from pmr.simulate import exudyn_script_body, exudyn_script_signals, exudyn_script_solver, exudyn_script_yielding
from pmr.simulate.exudyn_items import refuse_what_march_alone_does
from pmr.simulate.stepping import TimeStepping, one_for_each
from pmr.yielding import yielding_rows

_WIDTH = 88
_SIGNAL: TypeAdapter[Any] = TypeAdapter(Signal)

_SCRIPT = '''\
"""{title}: a reduced model in Exudyn.

{equations}

with {size} reduced coordinates p, the slider at s(t) and the transverse displacements y; SI units throughout.
The rows of C:

{rows}

Written by pmr; needs numpy, scipy and exudyn, and {file_name} in this folder.
"""

{imports}

# --- What happens: change it here -------------------------------------------------------------------

{scene}

# --- Signals ----------------------------------------------------------------------------------------


{signals}


# --- The body in Exudyn -----------------------------------------------------------------------------


{body}


def main():
    model = read_model(Path(__file__).with_name("{file_name}"))
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
_YIELDING = """\
    M p'' + D p' + K p + C(s)^T lambda = B f(t),    C(s) p + H(s) f - (G(s) + pads) lambda = 0,
    y = outputs p + W f - X(s) lambda"""


def write_exudyn_script(npz_path: str | Path, target: str | Path) -> Path:
    """Write a script that simulates a saved reduced model under its scene's path and loads.

    The script needs numpy, scipy and exudyn only, and the model in its own folder: the file is copied there
    if it lies elsewhere.

    Parameters
    ----------
    npz_path : str or Path
        Written by `ReducedModel.save`, with the scene in its provenance.
    target : str or Path
        The script, e.g. ``sliding_beam.py``.

    Raises
    ------
    InputError
        If the file is no reduced model or has no scene, or writing would replace a model.
    """
    npz_path, target = Path(npz_path), Path(target)
    text = exudyn_script(ReducedModel.load(npz_path), npz_path.name)
    target.parent.mkdir(parents=True, exist_ok=True)
    beside = target.with_name(npz_path.name)
    if target == beside:
        raise InputError("command line", "--out", str(target), "a name other than the model's is allowed")
    if not beside.exists():
        shutil.copyfile(npz_path, beside)
    elif beside.read_bytes() != npz_path.read_bytes():
        raise InputError("command line", "--out", str(target), f"{beside} is another model; another folder is allowed")
    target.write_text(text, encoding="utf-8")
    return target


def exudyn_script(model: ReducedModel, file_name: str) -> str:
    """Text of a script that reads `model` from `file_name`.

    Raises
    ------
    InputError
        If the model's provenance has no usable scene, only some of its rows give way, it keeps residual inertia or has
        rows that only push.
    """
    refuse_what_march_alone_does(model, file_name)
    scene, yielding = _scene(model, file_name), yielding_rows(model)
    if 0 < len(yielding) < len(model.row_names):
        names = ", ".join(model.row_names[i] for i in yielding)
        raise InputError(file_name, "rows", None, f"only {names} give way; all rows or none are allowed in a script")
    module: Any = exudyn_script_yielding if yielding else exudyn_script_body
    signals = scene.kinds | ({"akima"} if "table" in scene.kinds else set())
    return _SCRIPT.format(
        title=scene.title,
        equations=_YIELDING if yielding else _FIRM,
        size=model.size,
        rows="\n".join(f"    {name}" for name in model.row_names),
        file_name=file_name,
        imports=_imports(scene.kinds, (module, exudyn_script_solver)),
        scene=scene.text(),
        signals=_sources(exudyn_script_signals, signals),
        body=f"{_sources(module, BODY)}\n\n\n{_sources(exudyn_script_solver, {'solve'})}",
        tip=int(np.flatnonzero(~force_outputs(model))[-1]),
    )


@dataclass(frozen=True)
class _Scene:
    """What a model's provenance says of path, loads (one an input, by the name of its function) and time."""

    title: str
    path: SignalBase
    loads: dict[str, SignalBase]
    stepping: TimeStepping

    @property
    def kinds(self) -> set[str]:
        """Kinds of all signals."""
        return {part.kind for signal in (self.path, *self.loads.values()) for part in _parts(signal)}

    def text(self) -> str:
        """Constants and functions of t."""
        times = (
            f"END = {self.stepping.end!r}  # s\n"
            f"STEP = {self.stepping.step!r}  # s\n"
            f"RHO_INF = {self.stepping.rho_inf!r}  # spectral radius at infinite frequency"
        )
        functions = [_function("slider_position", "s(t) in m.", self.path)]
        functions += [_function(name, "N (or N m).", signal) for name, signal in self.loads.items()]
        loads = f"LOADS = [{', '.join(self.loads)}]  # in the order of B's columns"
        return "\n\n\n".join([times, *functions, loads])


def _scene(model: ReducedModel, source: str) -> _Scene:
    try:
        scene = model.provenance["scene"]
        path = _SIGNAL.validate_python(scene["slider"]["path"])
        signals = [_SIGNAL.validate_python(load["signal"]) for load in scene["loads"]]
        if scene.get("gravity"):
            signals.append(Gravity.model_validate(scene["gravity"]).signal)
        stepping = TimeStepping(*(float(scene["time"][key]) for key in ("end", "step", "rho_inf")))
    except (KeyError, TypeError, ValueError) as error:
        allowed = f"a reduced model that holds its scene (slider.path, loads, time) is allowed: {error!r}"
        raise InputError(source, "provenance.scene", None, allowed) from None
    one_for_each(signals, model.input_names)
    names = [re.sub(r"\W", "_", f"load_{name}") for name in model.input_names]
    if len(set(names)) < len(names):
        names = [f"{name}_{i}" for i, name in enumerate(names)]
    title = re.sub(r'["\\]', "", str(scene.get("title", "Sliding body")))
    return _Scene(title, path, dict(zip(names, signals, strict=True)), stepping)


def _function(name: str, docstring: str, signal: SignalBase) -> str:
    return f'def {name}(t):\n    """{docstring}"""\n    return {_sum(signal)}'


def _sum(signal: SignalBase) -> str:
    """Calls of all terms; on a line each where they would make a long one."""
    calls = [_call(part) for part in _parts(signal)]
    line = " + ".join(calls)
    if len(calls) == 1 or (len(line) <= _WIDTH and "\n" not in line):
        return line
    lines = "\n+ ".join(calls).replace("\n", "\n        ")
    return f"(\n        {lines}\n    )"


def _call(signal: Any) -> str:
    """``kind(t, field=value, ...)``, an argument a line where it is long; a constant as a number."""
    if isinstance(signal, Constant):
        return repr(signal.amount)
    arguments = [f"{name}={value!r}" for name, value in signal.model_dump(exclude={"kind"}).items()]
    line = f"{signal.kind}(t, {', '.join(arguments)})"
    if len(line) <= _WIDTH:
        return line
    return "\n".join([f"{signal.kind}(", "        t,", *(f"        {a}," for a in arguments), "    )"])


def _parts(signal: Any) -> Iterator[Any]:
    """The signal, or what it sums up."""
    if isinstance(signal, Sum):
        for term in signal.terms:
            yield from _parts(term)
    else:
        yield signal


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
        f"{cache}from pathlib import Path\nfrom types import SimpleNamespace\n\n"
        "import exudyn as exu\nimport numpy as np\n"
        f"from exudyn.itemInterface import (\n{items})\n"
        f"from scipy.interpolate import {akima}PPoly"
    )
