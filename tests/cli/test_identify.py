"""The command that fits keys of a scene to measured frequencies."""

import json
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import InputError
from pmr.export.state_space import state_space
from pmr.observe.identify import FrequencyTable
from pmr.system.assembly import Assembly

CHANGES = ["mesh.elements=10", "reduction.estimate=false", "start=rest"]
LENGTH, STIFFNESS, PLACES = "body.profile.length", "body.profile.bending_stiffness", np.array([0.05, 0.1, 0.15])


def write_frequencies(file: Path) -> None:
    """Write frequencies of the beam with another length and stiffness, and half its damping; one place is held out."""
    system = pmr.reduce(pmr.load_scene("dropbear", [*CHANGES, f"{LENGTH}=0.47", f"{STIFFNESS}=270.0"])).system
    x = np.column_stack([PLACES] * len(system.sides))
    f, d = Assembly(system).frequencies(x, 2), Assembly(system).damping_ratios(x, 1)
    poles = np.linalg.eigvals(state_space(system, {system.paths[0]: PLACES}, "beam").A)  # complex, in pairs
    lowest = np.take_along_axis(poles, np.argmin(np.abs(poles), axis=1)[:, None], axis=1)
    np.testing.assert_allclose(d, -lowest.real / np.abs(lowest), rtol=1e-3)
    table = np.column_stack([PLACES, f, 0.5 * d, np.arange(3) % 2]).tolist()
    rows = [",".join(map(repr, row)) for row in table]
    file.write_text("\n".join(["s [m],f1 [Hz],f2 [Hz],d1,held_out", *rows]) + "\n")


@pytest.mark.slow
def test_the_scene_is_written_with_the_values_that_its_frequencies_have(tmp_path: Path, run_command) -> None:
    write_frequencies(file := tmp_path / "f.csv")
    words = ["identify", "dropbear", "--measured", str(file), "--out", str(tmp_path / "out")]
    spaced = ["loads.0.name=the sensor", "loads.the sensor.on=0.3", "start=rest"]  # the last one a second time
    words += [part for change in [*CHANGES, *spaced] for part in ("--set", change)]
    fit = [part for key in (f"{LENGTH}=0.5", f"{STIFFNESS}=250", "damping.ratio=0.01") for part in ("--fit", key)]
    done = run_command(*words, *fit)
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "out" / "identify.json").read_text())
    for name, value in ((LENGTH, 0.47), (STIFFNESS, 270.0), ("damping.ratio", 0.005)):
        assert figures["parameters"][name]["value"] == pytest.approx(value, rel=1e-6)
        assert 0.0 < figures["parameters"][name]["error"] < 0.1 * value
    assert max(figures["rms"]["held_out"]) < 1e-7 < 0.01 < max(figures["rms"]["start"])
    for place in figures["places"]:
        assert place["d1"]["model"] == pytest.approx(place["d1"]["measured"], rel=1e-6)
    fitted = pmr.load_scene(tmp_path / "out" / "fitted.toml")
    assert fitted.body.profile is not None and fitted.body.profile.length == pytest.approx(0.47, rel=1e-6)
    assert fitted.mesh.elements == 10 and (fitted.loads[0].name, fitted.loads[0].on) == ("the sensor", 0.3)
    for wrong, said in (
        (["--fit", LENGTH], "KEY=START"),
        (["--fit", f"{LENGTH}=0"], "other than zero"),
        (["--fit", "body.nothing=1.0"], "body.nothing"),
        (["--fit", f"{LENGTH}=0.5", "--set", "reduction.coordinates=1"], "the model has fewer"),
    ):
        refused = run_command(*words, *wrong)
        assert refused.returncode == 2 and said in refused.stderr and refused.stderr.count("\n") == 1, refused.stderr
    file.write_text(file.read_text().replace("s [m]", "roller"))
    refused = run_command(*words, "--fit", f"{LENGTH}=0.5")
    assert refused.returncode == 2 and "a column for each path is allowed" in refused.stderr


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("", "columns"), ("s,g1\n1,2\n", "columns"), ("s,f2\n1,2\n", "columns"), ("s [m],f1 [rad/s]\n1,2\n", "columns"),
        ("s [rad],f1 [Hz]\n1,2\n", "columns"), ("s,f1,f1\n1,2,3\n", "columns"), ("s,f1,held_out\n1,2,3\n", "values"),
        ("s,f1,deviation\n1,2,0\n", "deviation"), ("s,f1\n,2\n", "values"), ("s,f1\n1,x\n", "line 2, f1"),
        ("s,f1,f2\n1,160.3,26.3\n", "frequencies"), ("s,f1,d1\n1,26.3,7\n", "damping"),
    ],
)  # fmt: skip
def test_a_table_that_is_none_is_refused(tmp_path: Path, text: str, key: str) -> None:
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(InputError) as refused:
        FrequencyTable.read(tmp_path / "f.csv")
    assert refused.value.key == key and "f.csv" in str(refused.value)
