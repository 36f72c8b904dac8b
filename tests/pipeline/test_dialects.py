"""A body alone as `[body]` and as `[[sections]]` with one entry: the same figures, and the same report."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmr import InputError, run
from pmr import scene as scenes
from pmr.report.document import write_report
from tests.scene.test_dialects import WHOLE, written

QUICK = WHOLE + "gravity = {rise = 0.1}\nsimulation = {repeats = 1}\n"


@pytest.mark.slow
def test_figures_and_report_do_not_depend_on_the_dialect(tmp_path: Path, undrawn: None) -> None:
    """Seconds aside, which the two reports differ in."""
    files = [written(tmp_path, listed, QUICK) for listed in (True, False)]
    outcomes = [run(scenes.load(file, [f"title={file.stem}"])) for file in files]
    listed, top = (one.result for one in outcomes if one is not None)
    assert set(listed.responses) == set(top.responses) == {"reduced", "full"}
    for model, one in listed.responses.items():
        other = top.responses[model]
        largest = np.abs(other.displacement).max()
        assert largest > 1e-4 and np.abs(one.displacement - other.displacement).max() <= 1e-12 * largest
        assert one.columns == other.columns
    apart = {"title", "seconds", "estimate", "step", "date"}  # estimates have seconds in them, too
    assert set(listed.summary) == set(top.summary)
    for key in set(listed.summary) - apart:
        assert listed.summary[key] == top.summary[key], key
    pages = []
    for result, title in ((listed, "sections"), (top, "body")):
        shown = replace(result, summary=top.summary | {"title": title}, responses=top.responses)
        pages.append(write_report([shown], tmp_path / title).html.read_text(encoding="utf-8"))
    assert pages[0] != pages[1] and pages[0].replace("sections", "") == pages[1].replace("sections", "").replace(
        ">body<", "><"
    )


PROBE = """probes=[{name="p",at=[3.0,0.0,0.2],face="inner"}]"""
MANY = "reduction={coordinates=400}"


@pytest.mark.parametrize(("more", "key"), [(PROBE, "probes[0].face"), (MANY, "reduction.coordinates")])
def test_what_is_refused_on_the_way_is_called_as_the_file_calls_it(tmp_path: Path, more: str, key: str) -> None:
    for listed, called in ((False, key), (True, f"sections[0].{key}")):
        file = written(tmp_path, listed, QUICK)
        file.write_text(f"{file.read_text()}{more}\n")
        with pytest.raises(InputError) as refused:
            run(scenes.load(file))
        assert refused.value.key == called
