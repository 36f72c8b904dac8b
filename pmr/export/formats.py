"""The formats of `pmr export`, by their names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmr import environment
from pmr.errors import InputError
from pmr.errors.text import hint
from pmr.fields.framed import FramedBody
from pmr.fields.nodal import NodalBody


@dataclass(frozen=True)
class Options:
    """What a format may be told besides the files; None: nothing was said.

    Attributes
    ----------
    fmi : str or None
        Version of the Functional Mock-up Interface.
    at : str or None
        Places of the sliders in m, separated by commas.
    """

    fmi: str | None = None
    at: str | None = None


@dataclass(frozen=True)
class Format:
    """A format: what it is, the name of its file, which options it takes, and its writer (model, target, options)."""

    says: str
    file_name: str
    options: frozenset[str]
    write: Callable[[Path, Path, Options], Path]


def _exudyn(model: Path, target: Path, options: Options) -> Path:
    environment.needed("exudyn")  # the script's parts are tested code, which is loaded to be written
    from pmr.export.exudyn.script import write_exudyn_script

    return write_exudyn_script(model, target)


def _fmu(model: Path, target: Path, options: Options) -> Path:
    from pmr.export.fmi.fmu import write_fmu

    return write_fmu(model, target, options.fmi or "3")


def _matlab(model: Path, target: Path, options: Options) -> Path:
    from pmr.export.control import write_matlab

    return write_matlab(model, target, options.at)


def _python_control(model: Path, target: Path, options: Options) -> Path:
    from pmr.export.control import write_python_control

    return write_python_control(model, target, options.at)


def _frequency_response(model: Path, target: Path, options: Options) -> Path:
    from pmr.export.control import write_frequency_response

    return write_frequency_response(model, target, options.at)


def _dmig(model: Path, target: Path, options: Options) -> Path:
    from pmr.export.nastran import write_dmig

    return write_dmig(model, target, options.at)


def _op4(model: Path, target: Path, options: Options) -> Path:
    from pmr.export.nastran import write_output4

    return write_output4(model, target, options.at)


_AT = frozenset({"at"})
FORMATS = {
    "exudyn": Format("a standalone Python script", "sliding_body.py", frozenset(), _exudyn),
    "fmu": Format("a functional mock-up unit", "sliding_body.fmu", frozenset({"fmi"}), _fmu),
    "matlab": Format("state space on a grid of s", "state_space.mat", _AT, _matlab),
    "python-control": Format("the same, read by a script", "state_space.py", _AT, _python_control),
    "frequency-response": Format("a table and a picture over s", "frequency_response.csv", _AT, _frequency_response),
    "dmig": Format("matrices of Nastran at places of s", "sliding_body.bdf", _AT, _dmig),
    "op4": Format("the same matrices as OUTPUT4", "sliding_body.op4", _AT, _op4),
}


@dataclass(frozen=True)
class BodyFormat:
    """A format of flexible bodies: what it is, the name of its file, what it describes a body by (node, frame), and its
    writer (body, target).
    """

    says: str
    file_name: str
    by: str
    write: Callable[[Any, Path], Path]


def _sid(body: NodalBody, target: Path) -> Path:
    from pmr.export.sid import write_sid

    return write_sid(body, target)


def _ffrf(body: NodalBody, target: Path) -> Path:
    from pmr.export.ffrf import write_ffrf

    return write_ffrf(body, target)


def _simscape(body: FramedBody, target: Path) -> Path:
    from pmr.export.simscape import write_simscape

    return write_simscape(body, target)


BODY_FORMATS = {
    "sid": BodyFormat("Standard Input Data, text", "body.SID_FEM", "node", _sid),
    "ffrf": BodyFormat("ObjectFFRFreducedOrder of Exudyn", "body.npz", "node", _ffrf),
    "simscape": BodyFormat("Reduced Order Flexible Solid of Simscape", "body.mat", "frame", _simscape),
}


def write(to: str, model: Path, target: Path | None, options: Options) -> Path:
    """Write a saved reduced model in a format; beside the model where there is no target.

    Raises
    ------
    InputError
        If there is no such format, it does not take an option that was given, or its writer refuses.
    """
    if to not in FORMATS:
        raise InputError("command line", "--to", to, f"{hint(to, FORMATS)}one of {', '.join(FORMATS)} is allowed")
    chosen = FORMATS[to]
    for name, value in vars(options).items():
        if value is not None and name not in chosen.options:
            takers = ", ".join(key for key, one in FORMATS.items() if name in one.options)
            raise InputError("command line", f"--{name}", value, f"it is allowed with --to {takers}")
    return chosen.write(model, target or model.with_name(chosen.file_name), options)
