"""Names that come with a model are data in the script that is written for it, never code."""

import json
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle import project

from pmr import InputError, ReducedModel, System
from pmr.errors import escape_controls, is_name
from pmr.export.exudyn_script import script_data, write_exudyn_script
from pmr.scene.signals import SignalBase, Sine, SmoothRamp, Step, Table
from pmr.system.body import FullBody

PATH = SmoothRamp(times=(0.0, 0.2), values=(2.0, 2.6))
SINE = Sine(amplitude=3.0, frequency=1.3, phase=0.4, offset=-2.0)
TABLE = Table(times=(0.2, 0.5, 0.6, 1.1, 1.3), values=(1.0, 2.0, 1.5, 1.8, -0.5))
STEP = Step(time=0.5, before=1.0, after=2.0)
CODE = "__import__('pathlib').Path('ran').write_text('code ran')"
NAMES = {
    "triple quotes": f'"""\n{CODE}\n"""', "single quotes": f"'''\n{CODE}\n'''", "quote": f'"); {CODE}; ("',
    "newline": f"F\n{CODE}\n", "carriage return": f"F\r{CODE}\r", "line separator": f"F\u2028{CODE}\u0085{CODE}",
    "backslash": f'\\"""\n{CODE}\n\\', "braces": "{" + CODE + "} {0} {title} {{", "percent": "%(" + CODE + ")s %s %d",
    "dollar": "$" + CODE + "${x}", "NUL": f"F\0{CODE}", "superscript": "F²", "ligature": "ﬁ", "surrogate": "F\udc80",
    "right to left": f"F\u202e{CODE}\u2066", "coding": "# -*- coding: utf-7 -*-\n+AAo-" + CODE, "keyword": "import",
    "nothing": "", "long": "x" * 5000,
}  # fmt: skip


def scene(*signals: SignalBase) -> dict[str, Any]:
    """What a run leaves in the provenance of its model."""
    return {
        "title": "A beam",
        "slider": {"path": PATH.model_dump(mode="json")},
        "loads": [{"name": "F", "signal": signal.model_dump(mode="json")} for signal in signals],
        "time": {"end": 0.2, "step": 1e-3, "rho_inf": 0.8},
    }


@pytest.fixture(scope="module")
def plain(rich: FullBody) -> ReducedModel:
    return project(rich, np.eye(rich.size)[:, 2:])


def named(model: ReducedModel, name: str) -> ReducedModel:
    """The model with `name` wherever a name may stand."""
    given = scene(SINE, TABLE)
    given["title"] = name
    for load in given["loads"]:
        load["name"] = load["direction"] = name
    return replace(
        model,
        input_names=(name, f"{name} 2"),
        row_names=(name, f"{name} 0.8"),
        left_out=(name,),
        output_names=tuple(name for _ in model.output_positions),
        provenance={"scene": given, "scene_hash": name, "basis": name},
    )


@pytest.mark.parametrize("compliant", [False, True], ids=["firm", "compliant"])
@pytest.mark.parametrize("kind", NAMES)
def test_a_name_is_never_run(plain: ReducedModel, kind: str, compliant: bool, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    model, rows = named(plain, NAMES[kind]), [NAMES[kind], f"{NAMES[kind]} 0.8"]
    if compliant:
        model = replace(model, pads=np.array([2e-6, 3e-6]))
    if not is_name(NAMES[kind]):  # a file with such names is refused; a title may be anything
        with pytest.raises(InputError, match="which is not a name"):
            write_exudyn_script(model.save(tmp_path / "refused.npz"), tmp_path / "script.py")
        model, rows = replace(plain, provenance=model.provenance, pads=model.pads), list(plain.row_names)
    script = write_exudyn_script(model.save(tmp_path / "beam.npz"), tmp_path / "script.py")
    names = runpy.run_path(str(script))
    assert names["TITLE"] == escape_controls(NAMES[kind]) and names["DATA"]["contacts"].tolist() == rows
    assert list(names["LOADS"]) == list(model.input_names)
    t = 0.123
    assert [load(t) for load in names["LOADS"].values()] == pytest.approx([float(SINE.value(t)), float(TABLE.value(t))])
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("kind", ["triple quotes", "quote", "backslash", "braces", "superscript", "right to left"])
def test_a_files_name_is_never_run(plain: ReducedModel, kind: str, tmp_path: Path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    name = NAMES[kind].replace("/", " ") + ".npz"
    model = replace(plain, provenance={"scene": scene(SINE, STEP)})
    script = write_exudyn_script(model.save(tmp_path / name), tmp_path / "script.py")
    runpy.run_path(str(script), run_name="__main__")
    said = capfd.readouterr().out
    assert said.startswith("Displacement at x = 5 m over 0.2 s:\n") and not (tmp_path / "ran").exists()


def test_a_crafted_model_is_refused(plain: ReducedModel, tmp_path: Path) -> None:
    """A file that no `save` wrote: its header says what it likes."""
    model = replace(plain, provenance={"scene": scene(SINE, STEP)})
    with np.load(model.save(tmp_path / "beam.npz")) as data:
        arrays = dict(data)
    names = [f'"""\n{CODE}\n"""', f"\\\n{CODE}"]
    np.savez(tmp_path / "crafted.npz", **(arrays | {"row_names": np.array(names)}))
    with pytest.raises(InputError, match="row_names holds .*, which is not a name"):
        write_exudyn_script(tmp_path / "crafted.npz", tmp_path / "crafted.py")


@pytest.mark.parametrize(
    "change",
    [
        {"time": {"end": f"0.2; {CODE}", "step": 1e-3, "rho_inf": 0.8}},
        {"time": {"end": float("nan"), "step": 1e-3, "rho_inf": 0.8}},
        {"time": {"end": 1e300, "step": 1.0, "rho_inf": 0.8}},
        {"slider": {"path": {"kind": "constant", "amount": CODE}}},
        {"slider": {"path": {"kind": "constant", "amount": float("inf")}}},
        {"slider": {"path": {"kind": f"ramp(t); {CODE} #", "times": [0.0, 1.0], "values": [0.0, 1.0]}}},
        {"slider": {"path": {"kind": "table", "file": "/etc/hostname"}}},  # a model names no files of its reader's
        {"slider": []},
        {"loads": "loads"},
    ],
    ids=lambda change: json.dumps(change)[:40],
)
def test_a_scene_of_anything_but_numbers_is_refused(plain: ReducedModel, change: dict) -> None:
    given = scene(SINE, STEP) | change
    with pytest.raises(InputError) as caught:
        script_data(System.of(replace(plain, provenance={"scene": given})), "beam.npz")
    assert caught.value.source == "beam.npz" and len(str(caught.value).splitlines()) == 1
