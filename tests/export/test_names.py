"""No reader sees more than a name: every file that is written of a model is read again, and its names counted."""

import csv
import io
import os
import re
import runpy
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import scipy.io
from fuzz.names import fit, hostile
from oracle import flexible, rich_body

from pmr import ReducedModel, System
from pmr.export.exudyn_script import script_data
from pmr.export.fmi import fmu_contents
from pmr.export.formats import Options, write
from pmr.kernel.kernel import Kernel
from pmr.scene.signals import Sine, SmoothRamp
from pmr.simulation.moving import read_scene

MODELS = 200 if os.environ.get("PMR_SWEEP") == "full" else 4
CARDS = r"\$ .*|SPOINT  .{8}THRU    .{8}|DMIG[ *]   ?.*|\*       [ \d.DE+-]*|"


def named(model: ReducedModel, names: Sequence[str], title: str) -> ReducedModel:
    """The model with these names and the scene that a run would leave in it; the title may be anything."""
    each = iter(names)
    called: dict[str, Any] = {
        field: tuple(next(each) for _ in getattr(model, field)) for field in ("input_names", "row_names")
    }
    loads = [
        {"name": name, "signal": Sine(amplitude=3.0, frequency=1.3).model_dump()} for name in called["input_names"]
    ]
    path = SmoothRamp(times=(0.0, 0.01), values=(2.0, 2.6)).model_dump()
    time = {"end": 0.01, "step": 1e-3, "rho_inf": 0.8}
    scene = {"title": title, "slider": {"path": path}, "loads": loads, "time": time}
    outputs = tuple(next(each) for _ in model.output_positions)
    return replace(model, **called, output_names=outputs, provenance={"scene": scene})


@pytest.fixture(scope="module")
def plain() -> ReducedModel:
    return flexible(rich_body(), 6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("number", range(MODELS))
def test_names_are_names_to_whoever_reads_a_file(plain: ReducedModel, number: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(number)
    model = named(plain, [fit(hostile(rng)) for _ in range(40)], hostile(rng))
    inputs, outputs = list(model.input_names), list(model.output_names)
    saved = model.save(tmp_path / "model.npz")
    found = ReducedModel.load(saved)
    assert (found.input_names, found.row_names) == (model.input_names, model.row_names)

    def written(to: str, name: str) -> Path:
        return write(to, saved, tmp_path / name, Options(at="1.7,2.9"))

    deck = written("dmig", "deck.bdf").read_text(encoding="ascii").splitlines()
    assert all(re.fullmatch(CARDS, line) for line in deck)
    assert sum(line.startswith("$ Load") for line in deck) == len(inputs)
    matlab = scipy.io.loadmat(written("matlab", "space.mat"))
    assert [str(cell[0]) for cell in matlab["inputs"].ravel()] == inputs
    table = written("frequency-response", "response.csv").read_text(encoding="utf-8")
    rows = list(csv.reader(io.StringIO(table)))
    assert len({len(row) for row in rows}) == 1 and not any(cell[:1] in "=+@\t\r" for cell in rows[0])
    assert [name in rows[0][2 + 2 * k] for k, name in enumerate(inputs)] == [True] * len(inputs)
    control = runpy.run_path(str(written("python-control", "space.py")))
    assert control["system"](0).input_labels == [name.replace(".", "_") for name in inputs]

    assert script_data(System.of(found), "model.npz")["inputs"].tolist() == inputs
    for version in "23":
        fmu = fmu_contents(System.of(found), read_scene(System.of(found), "model.npz"), "model", version)
        root = ElementTree.fromstring(fmu.texts["modelDescription.xml"])
        shown = {element.get("name") for element in root.iter()} | {
            element.get("description") for element in root.iter()
        }
        assert all(any(name in (text or "") for text in shown) for name in (*inputs, *outputs))
        for name in ("resources/reference_in.csv", "resources/reference_out.csv"):
            assert len({len(row) for row in csv.reader(io.StringIO(fmu.texts[name]))}) == 1
        assert set(inputs) <= set(Kernel(fmu.system).names("drivers"))
