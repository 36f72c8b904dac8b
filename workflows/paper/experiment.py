"""What the experiments of this folder share: their command line, rows that are computed in processes, and the report.

An experiment is a script with `SETTINGS`, a function that computes a row, and ``main(settings, out, jobs)``, which
returns its chapter of the report. ``python combinations.py --out DIR --jobs 2 --set "fewest=5"`` runs one of them, and
so does ``pmr study combinations``. Stored rows are read and not computed again.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import json
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import pmr
from pmr.compare.summary import parts_of_forces, sampling_part, theory_part
from pmr.report.blocks import Block, Chapter
from pmr.report.document import render, with_date, write_page
from pmr.report.studies import comparison
from pmr.results.run import SummaryPart, combine_parts
from pmr.scene import Scene
from pmr.scene.hints import hints
from pmr.simulation import Excitation, contact_step
from pmr.studies.study import Statement
from pmr.system.body import FullBody

Row = dict[str, Any]  # figures and arrays by name
Settings = Mapping[str, Any]


@dataclass(frozen=True)
class Findings:
    """Results of an experiment as numbers by name, and what is published of them, for a table in its report."""

    figures: Mapping[str, Any]
    published: Sequence[Statement] = ()
    source: str = ""
    remarks: Sequence[str] = ()
    summary: Mapping[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "summary", {"source": self.source, "remarks": list(self.remarks)})

    def blocks(self) -> list[Block]:
        """Return the table that compares the numbers with published ones, as a list; empty if nothing is published."""
        table = comparison(self)
        return [Block("Beside the publication", errors=table)] if table.rows else []


def warnings_of_response(scene: pmr.scene.Scene, system: pmr.System, response: pmr.Response) -> list[str]:
    """Return the warnings of a system's response that need no other model, the gravest first."""
    excitation = Excitation.from_scene(scene)
    omega = contact_step.contact_frequency(system, excitation)
    parts = [
        SummaryPart(grave=hints(scene)),
        *parts_of_forces(scene, system, response),
        SummaryPart(warnings=contact_step.warnings(omega, excitation.stepping)),
        sampling_part(scene, excitation),
        theory_part(scene, {"motion": response}),
    ]
    return list(combine_parts(parts)["warnings"])


def run(
    main: Callable[[Settings, Path, int], Chapter | list[Chapter]], defaults: Settings, document: str, title: str = ""
) -> None:
    """Run an experiment with the options of the command line, and write its report; exit with code 2 for bad input.

    `main` computes the chapters, `defaults` are its settings, the first line of `document` describes it in ``--help``.
    """
    parser = argparse.ArgumentParser(description=document.partition("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("reports", Path(inspect.getfile(main)).stem))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="changes")
    options = parser.parse_args()
    try:
        settings = changed(defaults, options.changes)
        options.out.mkdir(parents=True, exist_ok=True)
        chapters = main(settings, options.out, options.jobs)
        chapters = chapters if isinstance(chapters, list) else [chapters]
        print(f"report {report(options.out, chapters, title)}")
    except pmr.InputError as error:
        parser.exit(2, f"{error}\n")


def changed(defaults: Settings, changes: Sequence[str]) -> Settings:
    """Return the settings with changes such as ``"fewest=5"``; InputError for a key that is not among them."""
    settings = dict(defaults)
    for text in changes:
        key, _, value = text.partition("=")
        if key not in settings:
            raise pmr.InputError("command line", f"--set {key}", value, f"one of {', '.join(settings)} is allowed")
        try:
            settings[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            settings[key] = value
    return settings


def report(out: Path, chapters: Sequence[Chapter], title: str = "") -> Path:
    """Write report.html and report.pdf of chapters into the folder `out`, and return the path of report.html."""
    text = render(
        "study_report.html", title or chapters[0].title, chapters, kind=with_date("Study report", []), introduction=()
    )
    return write_page(text, out).html


def save(out: Path, **content: Any) -> None:
    """Write `content` to summary.json in the folder `out`; arrays become lists, NaN and infinite numbers null."""
    (out / "summary.json").write_text(json.dumps(_plain(content), indent=1, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    """Return a value as JSON holds it: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(part) for part in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not np.isfinite(value) else value


def rows(compute: Callable[..., Row], parameters: Sequence[Mapping[str, Any]], out: Path, jobs: int) -> list[Row]:
    """Return the rows ``compute(**p)`` for each p of `parameters`, in this order; stored rows are read.

    Each is computed in one of `jobs` processes with one thread, or in this process if `jobs` is 0, and stored in the
    folder `out`.
    """
    folder = out / "rows"
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / f"{_digest(compute, one)}.npz" for one in parameters]
    missing = [(one, file) for one, file in zip(parameters, files, strict=True) if not file.exists()]
    if jobs == 0:
        for one, file in missing:
            _store(compute, one, file)
    elif missing:
        os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        with ProcessPoolExecutor(min(jobs, len(missing)), mp_context=get_context("spawn")) as pool:
            for done in as_completed([pool.submit(_store, compute, one, file) for one, file in missing]):
                done.result()
    return [_read(file) for file in files]


def _store(compute: Callable[..., Row], parameters: Mapping[str, Any], file: Path) -> None:
    """Compute a row and write it to a file, whole or not at all."""
    part = file.with_suffix(f".{os.getpid()}.part.npz")
    np.savez(part, **compute(**parameters))
    part.replace(file)


def _read(file: Path) -> Row:
    """Read a row from its file."""
    with np.load(file, allow_pickle=False) as data:
        return {name: array if array.ndim else array.item() for name, array in data.items()}


def full_body(scene: Scene) -> FullBody:
    """Return the full model of a scene with a single body."""
    body = pmr.full_model(scene)
    assert isinstance(body, FullBody)
    return body


def _digest(compute: Callable[..., Row], parameters: Mapping[str, Any]) -> str:
    """Return the digest of what decides a row: sources of its module, this one and the package, and parameters.

    The text of files that parameters name is covered, too.
    """
    files = {name: Path(value).read_text() for name, value in parameters.items() if _names_file(value)}
    source = "".join(Path(inspect.getfile(function)).read_text() for function in (compute, rows))
    content = [compute.__name__, source, _package(), dict(parameters), files]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:24]


def _names_file(value: Any) -> bool:
    """Return whether a parameter is the path of a TOML file."""
    return isinstance(value, str) and value.endswith(".toml") and Path(value).is_file()


@lru_cache
def _package() -> str:
    """Return the digest of the sources of `pmr` without its reports."""
    folder, digest = Path(pmr.__file__).parent, hashlib.sha256()
    for file in sorted((*folder.rglob("*.py"), *folder.rglob("*.c"))):
        if "report" not in file.relative_to(folder).parts:
            digest.update(file.read_bytes())
    return digest.hexdigest()
