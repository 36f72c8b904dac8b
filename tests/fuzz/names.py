"""Titles and file names of all kinds are shown unchanged, and so are all names of loads and pads that are allowed."""

import re
import runpy
import zlib
from pathlib import Path
from xml.etree import ElementTree

from fuzz import toml
from fuzz.bases import BEAM, BOOM
from fuzz.mutations import STRANGE, Random
from fuzz.scenes import coarse
from fuzz.scenes import prepare as warm
from fuzz.verdict import NonsenseError, strictly_read

from pmr import scene as scenes
from pmr.errors import LONGEST_NAME, escape_controls, is_name

RANGES = (
    (0, 32), (32, 127), (127, 256), (0x200, 0x700), (0x2000, 0x2100), (0x4E00, 0x9FFF), (0xFE00, 0x10000),
    (0x1F300, 0x1F700),
)  # fmt: skip


prepare = warm


def case(number: int, rng: Random, folder: Path) -> str:
    """Run a scene with hostile names, draw its report and export its model; return the outcome in a word."""
    from pmr import run
    from pmr.export.exudyn_script import write_exudyn_script
    from pmr.fem.compat import MPI
    from pmr.report.document import render_runs as render
    from pmr.report.sections import chapter as report_case

    title, name, other = f"{hostile(rng)}{hostile(rng)}", fit(hostile(rng)), fit(hostile(rng))
    base = BOOM if number % 4 == 0 else BEAM
    loads = [base["loads"][0] | {"name": name}, base["loads"][0] | {"name": other}]
    data = base | {"title": title, "loads": loads}
    if base is BOOM:
        data["pads"] = [
            pad | {"name": f"{part}{i}"} for i, (pad, part) in enumerate(zip(BOOM["pads"], (name, other), strict=True))
        ]
        data["supports"], data["masses"] = [BOOM["supports"][0] | {"name": other}], [BOOM["masses"][0] | {"name": name}]
    file = folder / f"{_file_name(title)}.toml"
    file.write_text(toml.written(data), encoding="utf-8")
    outcome = run(coarse(scenes.load(file)), MPI.COMM_SELF)
    assert outcome is not None
    page = render([report_case(outcome.result, "case-1")])
    if escape_controls(page.replace("\n", "")) != page.replace("\n", ""):
        raise NonsenseError("the page holds characters that steer")
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        ElementTree.fromstring(svg)
    outcome.result.save(folder / "results")
    strictly_read((folder / "results" / "summary.json").read_text())
    model = outcome.reduced.save(folder / f"{_file_name(other)}.npz")
    script = write_exudyn_script(model, folder / "script.py")
    names = runpy.run_path(str(script))
    if names["TITLE"] != escape_controls(title.replace("\ud800", "?")):
        raise NonsenseError(f"the script's title is {names['TITLE']!r}")
    return "shown"


def hostile(rng: Random) -> str:
    """Random text of letters of any script, control characters and pieces of code."""
    if rng.random() < 0.3:
        return STRANGE[int(rng.integers(len(STRANGE)))]
    parts = []
    for _ in range(int(rng.integers(1, 12))):
        low, high = RANGES[int(rng.integers(len(RANGES)))]
        parts.append(chr(int(rng.integers(low, high))))
        if rng.random() < 0.2:
            parts.append(STRANGE[int(rng.integers(len(STRANGE)))][:20])
    return "".join(parts)


def fit(name: str) -> str:
    """Remove from a name what no name may hold; the result is never empty, and differs for different names."""
    left = "".join(letter for letter in name if is_name(f"a{letter}a"))[: LONGEST_NAME // 2].strip()
    single = re.sub("[.]+", ".", left)
    return f"n{zlib.crc32(name.encode('utf-8', 'replace'))} {single}".strip()


def _file_name(name: str) -> str:
    """Name for a file, without what no file name may hold."""
    return "".join(letter for letter in name if letter not in "/\0")[:40] or "_"
