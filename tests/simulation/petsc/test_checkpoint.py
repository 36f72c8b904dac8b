"""Simulations that were cut off go on to the same result."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed import distributed
from driving import driven
from oracle import rich_body
from petsc_alone import observe
from processes import python
from waiting import wait_until

from pmr import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.model import FullModel
from pmr.scene.signals import Constant, Ramp, Sine
from pmr.simulation import TimeStepping
from pmr.simulation.petsc import Checkpoint

SCRIPT = Path(__file__).with_name("interrupted.py")
PATH = Sine(amplitude=0.7, frequency=4.0, offset=2.0)
LOADS = (Constant(amount=30.0), Constant(amount=5.0))
STEPPING = TimeStepping(end=0.01, step=1e-3, rho_inf=0.8)


class InterruptionError(Exception):
    pass


def interrupt_at(share: float):
    def progress(done: float) -> None:
        if done >= share:
            raise InterruptionError

    return progress


@pytest.fixture(scope="module")
def model() -> FullModel:
    return distributed(rich_body(), MPI.COMM_SELF)


@pytest.mark.slow
def test_a_simulation_killed_goes_on_to_the_same_digits(tmp_path: Path) -> None:
    """kill -9 somewhere in the middle; nothing of the process has a chance to tidy up."""
    checkpoint, whole, resumed = tmp_path / "checkpoint.npz", tmp_path / "whole.npz", tmp_path / "resumed.npz"
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), str(checkpoint), str(tmp_path / "never.npz"), "0.75"], env=dict(os.environ)
    )
    wait_until(lambda: checkpoint.exists() and _header(checkpoint)["step"] >= 20, process)
    process.kill()
    process.wait()
    assert 20 <= _header(checkpoint)["step"] <= 60 and not (tmp_path / "never.npz").exists()
    for arguments in ((str(checkpoint), str(resumed), "1"), ("", str(whole), "1")):
        done = python(str(SCRIPT), *arguments)
        assert done.returncode == 0, done.stderr
    with np.load(resumed) as found, np.load(whole) as expected:
        assert 0 < found["steps"] < expected["steps"] == 80
        for name in ("y", "multipliers", "residual", "kinetic", "total", "q", "v"):
            np.testing.assert_array_equal(found[name], expected[name])


def _header(file: Path) -> dict[str, Any]:
    with np.load(file) as data:
        return json.loads(str(data["header"]))


@pytest.mark.mpi
@pytest.mark.parametrize("ranks", [(MPI.COMM_SELF, MPI.COMM_WORLD), (MPI.COMM_WORLD, MPI.COMM_SELF)])
def test_as_many_ranks_as_one_likes_go_on(tmp_path: Path, ranks: tuple[MPI.Comm, MPI.Comm]) -> None:
    world = MPI.COMM_WORLD
    cut_off, resumed = (distributed(rich_body(), comm) for comm in ranks)
    states = [0.002, 0.009]
    file = Path(world.bcast(str(tmp_path / "checkpoint.npz")))
    own = Checkpoint(file if world.rank == 0 or cut_off.comm.size > 1 else tmp_path / "unused.npz", seconds=0.0)
    with pytest.raises(InterruptionError):
        observe(cut_off, driven(PATH, LOADS, STEPPING), states, None, interrupt_at(0.5), own)
    world.barrier()
    if resumed.comm.size < world.size:  # each goes on by itself: from a copy, or one finds what another has finished
        file = Path(shutil.copy(file, tmp_path / f"{world.rank}.npz"))
        world.barrier()
    steps: list[float] = []
    found = observe(resumed, driven(PATH, LOADS, STEPPING), states, None, steps.append, Checkpoint(file, seconds=60.0))
    expected = observe(resumed, driven(PATH, LOADS, STEPPING), states)
    assert len(steps) == 5
    parts = [(found.y, expected.y), (found.multipliers, expected.multipliers), (found.states.q, expected.states.q),
             (found.states.v, expected.states.v), (found.energy.total, expected.energy.total)]  # fmt: skip
    for a, b in parts:
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-9 * np.abs(b).max())
    world.barrier()


def test_a_finished_simulation_is_not_repeated(model: FullModel, tmp_path: Path) -> None:
    checkpoint, steps = Checkpoint(tmp_path / "c.npz"), []
    first = observe(model, driven(PATH, LOADS, STEPPING), checkpoint=checkpoint)
    second = observe(model, driven(PATH, LOADS, STEPPING), progress=steps.append, checkpoint=checkpoint)
    assert steps == [] and 0.0 < _header(checkpoint.file)["seconds"] <= min(first.seconds, second.seconds)
    np.testing.assert_array_equal(second.y, first.y)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["c.npz"]


def test_another_simulation_does_not_go_on_from_it(model: FullModel, tmp_path: Path) -> None:
    checkpoint = Checkpoint(tmp_path / "c.npz")
    observe(model, driven(PATH, LOADS, STEPPING), checkpoint=checkpoint)
    stiffer = replace(model, K=model.K.copy())
    stiffer.K.scale(1.01)
    pushed_elsewhere = replace(model, B=model.B.copy())
    pushed_elsewhere.B.scale(-1.0)
    *others, slider = model.rows.rows
    turned = replace(slider, carriers=-slider.carriers)  # as of a pad on the opposite face
    held_elsewhere = replace(model, rows=replace(model.rows, rows=(*others, turned)))
    slower, longer = Sine(amplitude=0.7, frequency=3.0, offset=2.0), TimeStepping(0.02, 1e-3, 0.8)
    between = Ramp(times=(0.0, 2e-3, 2.5e-3, 3e-3), values=(30.0, 30.0, 40.0, 30.0))  # the same at all steps
    assert np.array_equal(between.value(1e-3 * np.arange(11)), np.full(11, 30.0))
    for arguments, what in [
        ((stiffer, driven(PATH, LOADS, STEPPING)), "matrices"),
        ((pushed_elsewhere, driven(PATH, LOADS, STEPPING)), "matrices"),
        ((held_elsewhere, driven(PATH, LOADS, STEPPING)), "rows"),
        ((model, driven(slower, LOADS, STEPPING)), "path"),
        ((model, driven(PATH, LOADS[::-1], STEPPING)), "loads"),
        ((model, driven(PATH, (between, LOADS[1]), STEPPING)), "loads"),
        ((model, driven(PATH, LOADS, longer)), "path, loads, time grid"),
        ((model, driven(PATH, LOADS, STEPPING), [0.005]), "states"),
    ]:
        with pytest.raises(InputError, match=f"c.npz: another simulation's checkpoint: {what} differ"):
            observe(*arguments, checkpoint=checkpoint)


@pytest.mark.parametrize("damage", [lambda data: data[: len(data) // 2], lambda data: b"", lambda data: b"x" * 100])
def test_a_damaged_file_is_refused(model: FullModel, tmp_path: Path, damage) -> None:
    checkpoint = Checkpoint(tmp_path / "c.npz")
    observe(model, driven(PATH, LOADS, STEPPING), checkpoint=checkpoint)
    checkpoint.file.write_bytes(damage(checkpoint.file.read_bytes()))
    with pytest.raises(InputError, match="this is none"):
        observe(model, driven(PATH, LOADS, STEPPING), checkpoint=checkpoint)


def test_another_format_is_refused(model: FullModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkpoint = Checkpoint(tmp_path / "c.npz")
    monkeypatch.setattr("pmr.simulation.petsc.simulator.FORMAT_VERSION", 0)
    observe(model, driven(PATH, LOADS, STEPPING), checkpoint=checkpoint)
    monkeypatch.undo()
    with pytest.raises(InputError, match="another format"):
        observe(model, driven(PATH, LOADS, STEPPING), checkpoint=checkpoint)
