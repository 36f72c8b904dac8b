"""Runs in processes of their own and what stops them; models compared; the section's page."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from waiting import PATIENCE, is_alive, wait_until

from benchmarks import page_of_scale, requirements, scale
from benchmarks.ranks import HERE, MPI_SETTINGS, Bounds, record_of

MB = 2.0**20


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Makes a module of the given lines that processes find; returns its name."""

    def make(*lines: str) -> str:
        (tmp_path / "made_up.py").write_text("\n".join(lines) + "\n")
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))
        return "made_up"

    return make


def test_a_run_leaves_its_last_line(module) -> None:
    name = module("import sys, json", "print('words')", "print(json.dumps({'given': sys.argv[1:]}))")
    assert record_of(name, ["a", "b"], 1, Bounds(PATIENCE)) == {"given": ["a", "b"]}


def test_a_run_that_fails_says_why(module) -> None:
    found = record_of(module("raise ValueError('too coarse')"), [], 1, Bounds(PATIENCE))
    assert found == {"notes": ["failed: ValueError: too coarse"]}
    name = module("import sys", "sys.exit('Error: one\\nfrom the launcher\\n-----')")
    assert record_of(name, [], 1, Bounds(PATIENCE)) == {"notes": ["failed: Error: one"]}
    assert record_of(module("raise SystemExit(3)"), [], 1, Bounds(PATIENCE)) == {"notes": ["failed: it ended with 3"]}


def test_a_run_is_stopped_with_its_children(module, tmp_path: Path) -> None:
    name = module(
        "import subprocess, sys, time, pathlib",
        "child = subprocess.Popen([sys.executable, '-c', 'import os, time; os.setpgid(0, 0); time.sleep(10_000)'])",
        f"pathlib.Path({str(tmp_path / 'child')!r}).write_text(str(child.pid))",
        "held = bytearray(b'1') * 200_000_000",
        "time.sleep(10_000)",
    )
    (why,) = record_of(name, [], 1, Bounds(PATIENCE, 150 * MB))["notes"]
    assert why.startswith("stopped at 0.") and why.endswith("GiB of memory")
    child = int((tmp_path / "child").read_text())
    wait_until(lambda: not is_alive(child))


def test_a_run_is_stopped_when_it_takes_too_long(module) -> None:
    found = record_of(module("import time", "time.sleep(10_000)"), [], 1, Bounds(0.6))
    assert found == {"notes": ["stopped after 0.6 s"]}


def stored(file: Path, modes: np.ndarray, omega: list[float], table: np.ndarray) -> Path:
    np.savez(file, modes=modes, omega=np.array(omega), **{"table rows": table})
    return file


def test_models_are_compared_whatever_their_rigid_modes(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    V, omega, table = (
        np.linalg.qr(random.normal(size=(40, 5)))[0],
        [0.0, 0.0, 1.0, 2.0, 3.0],
        random.normal(size=(9, 2)),
    )
    table[:, 1] *= 1e-6
    one = stored(tmp_path / "1.npz", V, omega, table)
    turned = V.copy()
    turned[:, :2] = V[:, :2] @ np.linalg.qr(random.normal(size=(2, 2)))[0]
    found = scale.difference(one, stored(tmp_path / "2.npz", turned, omega, table))
    assert max(found.values()) < 1e-14
    changed = table.copy()
    changed[4, 1] += 1e-3 * np.abs(table[:, 1]).max()
    turned[:, 3] *= 1.0 + 1e-4
    found = scale.difference(one, stored(tmp_path / "2.npz", turned, [0.0, 0.0, 1.0, 2.0, 3.0 * (1 + 1e-5)], changed))
    assert found == pytest.approx({"frequencies": 1e-5, "modes": 1e-4, "rows": 1e-3}, rel=1e-6)
    turned[:, 0] = V[:, 4]
    assert scale.difference(one, stored(tmp_path / "2.npz", turned, omega, table))["modes"] > 0.1


def record(size: int, ranks: int) -> dict:
    seconds = {stage: 1e-6 * size**1.5 for stage in (*scale.STAGES, "total")}
    return {
        "cells": 0.1, "size": size, "ranks": ranks, "seconds": seconds, "processor": 1e-5 * size,
        "peak_MB": [200.0 + 1e-2 * size / ranks] * ranks, "peak_MB_after": dict.fromkeys(scale.STAGES, [300.0]),
        "loaded_MB": [200.0] * ranks, "load": (1.0, 2.0), "notes": [],
    }  # fmt: skip


def test_exponents_and_a_page_with_a_size_that_was_too_large() -> None:
    records = [record(size, ranks) for size in (1000, 10_000, 40_000) for ranks in (1, 2)]
    records.append({"cells": 0.01, "ranks": 1, "seconds": {}, "notes": ["stopped at 20.1 GiB of memory"]})
    fitted = scale.exponents(records, 2)
    assert fitted == pytest.approx(dict.fromkeys((*scale.STAGES, "total"), 1.5) | {"processor": 1.0, "memory": 1.0})
    apart = dict.fromkeys(page_of_scale.COMPARED, 1e-12) | {"inputs": 3e-8}
    found = {
        "records": records,
        "exponents": {str(ranks): scale.exponents(records, ranks) for ranks in (1, 2)},
        "agreement": [{"size": 1000} | apart],
    }
    content = page_of_scale.scale(json.loads(json.dumps(found)), "x")
    assert "0.586" in content.headline and "40\u202f000" in content.headline
    assert any("10\u00a0mm, one rank: stopped at 20.1 GiB" in text for text in content.paragraphs)
    assert [len(grid.rows) for block in content.blocks for grid in block.grids] == [6, 6, 2, 1]
    assert [one["holds"] for one in requirements.judged({"scale": found})] == [False]
    nothing = page_of_scale.scale({"records": records[-1:]}, "x")
    assert nothing.paragraphs and not nothing.blocks


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[dict], list[Path]]:
    """Records that the SLURM script's runs on one rank and on two print, and the files that these leave."""
    folder = tmp_path_factory.mktemp("scale")
    launch = folder / "launch"
    launch.write_text(f'#!/bin/sh\nexec mpiexec "$@" "{folder}/$2.npz"\n')  # -n RANKS python -m ... CELLS, and a file
    launch.chmod(0o755)
    command = ["bash", "workflows/scale.slurm", "0.2", "1", "2"]
    environment = os.environ | MPI_SETTINGS | {"PMR_LAUNCH": str(launch)}
    done = subprocess.run(command, cwd=HERE, env=environment, capture_output=True, text=True, check=True)
    records = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return records, [folder / "1.npz", folder / "2.npz"]


@pytest.mark.slow
def test_what_is_measured_is_a_run(runs: tuple[list[dict], list[Path]]) -> None:
    records, files = runs
    for found, ranks in zip(records, (1, 2), strict=True):
        assert found["size"] == 5_112 and found["ranks"] == ranks == len(found["peak_MB"])
        seconds = found["seconds"]
        assert set(seconds) == {*scale.STAGES, "total"}
        assert 0.0 < sum(seconds[stage] for stage in scale.STAGES) < seconds["total"]  # which may hold a compilation
        peaks = np.array([*found["peak_MB_after"].values(), found["peak_MB"]])
        assert np.all(np.diff(peaks, axis=0) >= 0.0)
        assert scale.own_memory(found) < 300.0 * ranks
    assert max(scale.difference(*files).values()) < 1e-8


@pytest.mark.slow
def test_the_slurm_script_runs_each_number_of_ranks(runs: tuple[list[dict], list[Path]]) -> None:
    assert [(record["ranks"], len(record["peak_MB"])) for record in runs[0]] == [(1, 1), (2, 2)]
