"""The allowed mean pressure of pads: its share in runs, a warning beyond it, and a limit of load charts."""

import csv
from pathlib import Path
from typing import Any

import pytest
from finished import finished
from fuzz import toml
from ways.kinds import PLANE, RAISED, boom

import pmr
from pmr import InputError
from pmr.report.first_page import largest_value_rows
from pmr.report.studies import render_studies
from pmr.report.verdict import verdict
from pmr.scene import load_any
from pmr.studies import call
from pmr.studies.limits import Limit

EXTENSION, ANGLE = 3.6, 0.3
ALLOWED = {"tail": 2e6, "mouth": 4e6}  # Pa
SIZE = {"tail": (0.2, 0.05), "mouth": (0.3, 0.06)}  # m
STUDY: dict[str, Any] = {
    "kind": "chart", "title": "Boxes on pads", "scene": "scene.toml", "up_to": 8000.0, "extensions": [EXTENSION],
    "luffing": [ANGLE], "error_bars": False, "limits": [{"name": "pressure", "of": "pad", "factor": 1.25}],
}  # fmt: skip


def scene(mass: float = 100.0, **allowed: float) -> dict[str, Any]:
    """Boom of three sections at rest, whose pads have the `allowed` pressures in Pa by the ends of their joints."""
    joint = {
        end: [{"at": 0.2, "length": size[0], "width": size[1], "faces": PLANE, "unilateral": True, "stiffness": 1e8}
              | ({"allowed_pressure": allowed[end]} if end in allowed else {})]
        for end, size in SIZE.items()
    }  # fmt: skip
    described = boom("Three boxes", "beam2d", joint)
    fly = described["sections"][-1]
    fly["masses"][0] |= {"mass": mass, "payload": True}
    fly["loads"] = []
    described["section"]["joint"]["extension"] = {"kind": "constant", "amount": EXTENSION}
    frame = RAISED | {"luffing": {"kind": "constant", "amount": ANGLE}}
    compare = {"against": [], "richer": "none", "play": 0.0}
    return described | {"frame": frame, "compare": compare, "start": "equilibrium", "gravity": {}}


def written(folder: Path, described: dict[str, Any]) -> Path:
    file = folder / "scene.toml"
    file.write_text(toml.written(described))
    return file


def run(folder: Path, described: dict[str, Any]) -> pmr.RunResult:
    outcome = pmr.run(load_any(written(folder, described)))
    assert outcome is not None
    return outcome.result


@pytest.mark.slow
def test_a_run_states_the_share_of_the_pad_that_uses_the_most_and_warns_beyond_it(tmp_path: Path) -> None:
    result = run(tmp_path, scene(**ALLOWED))
    shares = {}
    for pad in result.summary["pads"]:
        end = pad["name"].split()[1]
        length, width = SIZE[end]
        assert pad["allowed_pressure"] == ALLOWED[end]
        shares[pad["name"]] = max(pad["max"], -pad["min"]) / (length * width) / ALLOWED[end]
        assert pad["pressure"] == pytest.approx(shares[pad["name"]] * ALLOWED[end], rel=1e-12)
    most = max(shares, key=lambda name: shares[name])
    row = dict(largest_value_rows(result))["largest use of the allowed pressure of a pad"]
    assert most in row and f": {100.0 * shares[most]:.1f}" in row and 0.1 < shares[most] < 1.0
    assert not any("allowed_pressure" in line for line in result.summary["warnings"])
    lower = {end: pressure * shares[most] / 1.5 for end, pressure in ALLOWED.items()}
    beyond = run(tmp_path, scene(**lower))
    (warning,) = [line for line in beyond.summary["warnings"] if "allowed_pressure" in line]
    assert warning.startswith(f"the pad {most} bears more than its allowed_pressure, 1.5 times as much at ")
    assert "Largest use of the allowed pressure" in verdict(beyond).text and verdict(beyond).is_exceeded
    bare = run(tmp_path, scene())
    assert "allowed_pressure" not in bare.summary["pads"][0] and "pressure" in bare.summary["pads"][0]
    assert "largest use of the allowed pressure of a pad" not in dict(largest_value_rows(bare))


@pytest.mark.slow
def test_a_limit_of_pads_without_an_amount_is_the_allowed_pressure_of_each_pad(tmp_path: Path) -> None:
    """A run at rest under the load uses the share 1 / factor of the pad that governs; pads without it are left out."""
    written(tmp_path, scene(**ALLOWED))
    finished(tmp_path, toml.written(STUDY))
    (row,) = csv.DictReader((tmp_path / "chart.csv").read_text().splitlines())
    load = float(row["pressure [kg]"])
    page = render_studies(tmp_path)
    least, most = (f"{1e-6 * of(ALLOWED.values()):.4g}" for of in (min, max))
    assert f"allowed_pressure of the scene: {least} to {most} MPa" in page and "walls are not looked at" in page
    result = run(tmp_path, scene(load, **ALLOWED))
    shares = {pad["name"]: pad["pressure"] / pad["allowed_pressure"] for pad in result.summary["pads"]}
    assert max(shares.values()) == pytest.approx(1.0 / 1.25, rel=0.01)
    assert row["governing member"] == max(shares, key=lambda name: shares[name])
    written(tmp_path, scene(mouth=ALLOWED["mouth"]))
    finished(tmp_path, toml.written(STUDY))
    length, width = SIZE["mouth"]
    alone = {"name": "pressure", "of": "pad", "most": ALLOWED["mouth"], "factor": 1.25, "which": ["* mouth *"]}
    loads = [next(csv.DictReader((tmp_path / "chart.csv").read_text().splitlines()))["pressure [kg]"]]
    finished(tmp_path, toml.written(STUDY | {"limits": [alone | {"area": [length, width]}]}))
    loads += [next(csv.DictReader((tmp_path / "chart.csv").read_text().splitlines()))["pressure [kg]"]]
    assert float(loads[0]) == pytest.approx(float(loads[1]), rel=1e-9)


def test_what_has_no_size_or_no_allowed_pressure_is_refused(tmp_path: Path) -> None:
    on_axis = scene(**ALLOWED)
    del on_axis["section"]["joint"]["tail"][0]["faces"]
    with pytest.raises(
        InputError, match="an allowed pressure goes with faces, on which pads have a length and a width"
    ):
        load_any(written(tmp_path, on_axis))
    with pytest.raises(InputError, match="allowed_pressure"):
        load_any(written(tmp_path, scene(tail=-1.0)))
    written(tmp_path, scene(tail=2e6))
    for which, says in ((["*"], ""), (["* mouth *"], "or allowed_pressure of pads in the scene")):
        (tmp_path / "study.toml").write_text(toml.written(STUDY | {"limits": [STUDY["limits"][0] | {"which": which}]}))
        if not says:
            call.load(tmp_path / "study.toml")
            continue
        with pytest.raises(InputError, match=says):
            call.load(tmp_path / "study.toml")
    with pytest.raises(ValueError, match="area goes with most"):
        Limit(name="pads", of="pad", area=(0.3, 0.06))
