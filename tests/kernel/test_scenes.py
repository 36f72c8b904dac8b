"""Whole scenes beside the simulator `march`: start, drivers, parts of steps, trajectories and energy of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmr.kernel.kernel import Kernel, Record, Settings, State
from pmr.kernel.signals import Signals
from pmr.pipeline import reduce
from pmr.scene import load_any
from pmr.simulation.excitation import Excitation
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.march import March
from pmr.simulation.native.systems import static_start
from pmr.simulation.recorded import recorded
from pmr.system.system import System

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SCENES = ("evolved_residual", "boom_beam", "boom_two", "boom_three", "boom_four", "boom_three_shell")
#: Of the largest coordinate, and of the largest force.
POSITIONS, FORCES = 1e-12, 1e-9


def marched(march: March) -> dict[str, np.ndarray]:
    """All that it records, the start included."""
    found: dict[str, list[Any]] = {}

    def take(first: int, rows: Any) -> None:
        for name in ("z", "v", "multipliers", "parts", "impulses", "peaks", "energy"):
            array = getattr(rows, name)
            if array is not None:
                found.setdefault(name, []).append(np.array(array[0 if first == 0 else 1 :]))

    march.observe(1, take)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def drivers(system: System, kernel: Kernel, excitation: Excitation) -> Signals:
    """Paths, loads and amplitudes in the kernel's order."""
    names, P = kernel.names("drivers"), kernel.paths
    paths = dict(excitation.paths) if len(excitation.paths) != 1 else {names[0]: excitation.path}
    loads = [excitation.loads[name] for name in names[P : P + kernel.inputs]]
    return Signals([*(paths[name] for name in names[:P]), *loads])


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("name", SCENES)
def test_a_scene_moves_as_march_says(name: str) -> None:
    """Coordinates, rates, forces, impulses, peaks, energy and work, and the same parts in each step."""
    system = reduce(load_any(WORKFLOWS / f"{name}.toml")).system
    excitation = recorded(system, name).excitation
    initial = static_start(system, excitation) if excitation.start == "equilibrium" else {}
    form = SystemForm.of(system)
    march = March(form, excitation, initial)
    expected, used, loop = marched(march), form.used, march.loop
    parts = (1,) if loop.levels is None else tuple(loop.levels.parts.tolist())
    omega = 0.0 if loop.control is None else float(loop.control.bounds[1])
    kernel = Kernel.of(system, form.forms)
    stepping = excitation.stepping
    state = State(kernel, Settings(stepping.step, stepping.rho_inf, parts, omega))
    signals, record = drivers(system, kernel, excitation), Record(kernel, stepping.steps)
    state.start(excitation.start, signals.at(0.0)[0])
    state.advance(signals, stepping.steps, record)
    found: dict[str, np.ndarray] = {what: record[what] for what in ("multipliers", "impulses", "peaks", "energy")}
    found |= {what: record[what][:, kernel.used_modes] for what in ("z", "v")}
    if expected["z"].shape[1] > len(used):
        expected |= {what: expected[what][:, used] for what in ("z", "v")}
    for what, within in {"z": POSITIONS, "v": FORCES, "multipliers": FORCES, "energy": POSITIONS}.items():
        if what in expected:
            largest = np.abs(expected[what]).max()
            np.testing.assert_allclose(found[what], expected[what][1:], atol=within * largest, rtol=0.0, err_msg=what)
    if len(parts) > 1:
        np.testing.assert_array_equal(record.parts, expected["parts"][1:])
        for what in ("impulses", "peaks"):
            largest = np.abs(expected[what]).max()
            np.testing.assert_allclose(found[what], expected[what][1:], atol=FORCES * largest, rtol=0.0, err_msg=what)
