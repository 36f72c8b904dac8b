"""The file formats of `pmr export`, by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmr.errors import InputError, environment, similar_name_hint

if TYPE_CHECKING:
    from pmr.export.fmi import UnitObserver


@dataclass(frozen=True)
class Options:
    """Options of `pmr export` other than the files; None if an option is not given."""

    fmi: str | None = None  #: Version of the Functional Mock-up Interface
    at: str | None = None  #: Path coordinates, as `pmr.export.state_space.path_positions` reads them
    section: str | None = None  #: Name of the section of a boom that is written alone
    platforms: str | None = None  #: Whether there are binaries for all platforms, or for the host's alone
    sources: bool | None = None  #: Whether the C sources of the binaries are included
    observer: UnitObserver | None = None  #: Observer whose estimates the FMU has, too


@dataclass(frozen=True)
class Format:
    """A format: description, default file name, names of options, and function ``write(model, target, options)``."""

    description: str
    file_name: str
    options: frozenset[str]
    write: Callable[[Path, Path, Options], Path]


def _writer(module: str, name: str) -> Callable[..., Path]:
    """Function that calls the function `name` of a module of `pmr.export`, which it imports at the first call."""

    def write(*arguments: Any) -> Path:
        """Call the function and return the path that it has written."""
        written: Path = getattr(import_module(f"pmr.export.{module}"), name)(*arguments)
        return written

    return write


def _exudyn(model: Path, target: Path, options: Options) -> Path:
    """Write a model as a standalone Exudyn script, and return the file's path.

    Raises InputError if Exudyn is not installed.
    """
    environment.import_package("exudyn")  # parts of the script are modules that need Exudyn
    return _writer("exudyn_script", "write_exudyn_script")(model, target)


def _fmu(model: Path, target: Path, options: Options) -> Path:
    """Write a model as an FMU, with the `options` for FMUs, and return the file's path."""
    fmu, version = import_module("pmr.export.fmi"), options.fmi or "3"
    platforms = fmu.selected_platforms(options.platforms, version)
    written: Path = fmu.write_fmu(model, target, version, platforms, bool(options.sources), options.observer)
    return written


_AT = frozenset({"at", "section"})
FORMATS = {
    "exudyn": Format("a standalone Python script", "sliding_body.py", frozenset(), _exudyn),
    "fmu": Format(
        "a functional mock-up unit", "sliding_body.fmu", frozenset({"fmi", "platforms", "sources", "observer"}), _fmu
    ),
    "matlab": Format("state space on a grid of s", "state_space.mat", _AT, _writer("control", "write_matlab")),
    "python-control": Format(
        "the same, read by a script", "state_space.py", _AT, _writer("control", "write_python_control")
    ),
    "modelica": Format("a block of Modelica with it", "StateSpace.mo", _AT, _writer("control", "write_modelica")),
    "frequency-response": Format(
        "a table and a picture over s", "frequency_response.csv", _AT, _writer("control", "write_frequency_response")
    ),
    "dmig": Format("matrices of Nastran at places of s", "sliding_body.bdf", _AT, _writer("state_space", "write_dmig")),
    "op4": Format("the same matrices as OUTPUT4", "sliding_body.op4", _AT, _writer("state_space", "write_output4")),
}


def formats() -> dict[str, Format]:
    """All formats of saved models by name, including those of installed plug-ins (entry points ``pmr.exports``).

    Raises an InputError that names the plug-in if its object is no `Format`.
    """
    offered = environment.plugin_objects("pmr.exports", frozenset(FORMATS))
    for name, plugin in offered.items():
        if not isinstance(plugin, Format):
            raise environment.plugin_error("pmr.exports", name)
    return FORMATS | offered


@dataclass(frozen=True)
class BodyFormat:
    """A file format of flexible bodies: its description, default file name, reference of the data, and writer."""

    description: str
    file_name: str
    by: str  #: What the body's data refer to: ``node`` or ``frame``
    write: Callable[[Any, Path], Path]  #: Function (body, target)


#: Message that a boom of several sections can't be written in these formats.
ONE_BODY = (
    "one body is allowed: such a file holds nodes, modes and springs of a single body, and sections slide in each "
    "other; `pmr export` writes what a run leaves: an fmu or a script with the sliding in it, or a state space"
)
BODY_FORMATS = {
    "sid": BodyFormat("Standard Input Data, text", "body.SID_FEM", "node", _writer("bodies", "write_sid")),
    "ffrf": BodyFormat("ObjectFFRFreducedOrder of Exudyn", "body.npz", "node", _writer("bodies", "write_ffrf")),
    "simscape": BodyFormat(
        "Reduced Order Flexible Solid of Simscape", "body.mat", "frame", _writer("bodies", "write_simscape")
    ),
}


def write(to: str, model: Path, target: Path | None, options: Options) -> Path:
    """Write the saved reduced model `model` in the format `to`, and return the path of the written file.

    If `target` is None, the file has the format's default name, in the folder of the model.  Raises InputError if there
    is no such format, if the format does not accept an option that is set, or if its writer refuses the model.
    """
    writers = formats()
    if to not in writers:
        raise InputError(
            "command line", "--to", to, f"{similar_name_hint(to, writers)}one of {', '.join(writers)} is allowed"
        )
    chosen = writers[to]
    for name, value in vars(options).items():
        if value is not None and name not in chosen.options:
            takers = ", ".join(key for key, writer in writers.items() if name in writer.options)
            shown = value if isinstance(value, str | bool) else None
            raise InputError("command line", f"--{name}", shown, f"it is allowed with --to {takers}")
    return chosen.write(model, target or model.with_name(chosen.file_name), options)
