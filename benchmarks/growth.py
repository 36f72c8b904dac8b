"""What a step costs as the model grows: in modes, coordinates, moving rows, outputs; in sections of a boom."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks import beams
from benchmarks.timing import exponent
from pmr import load_scene
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.reduction.bodies import reduce_bodies
from pmr.scene.signals import Constant, SmoothRamp
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import simulator as march
from pmr.simulation.native import systems
from pmr.system.from_scene import system_of
from pmr.system.system import System

MODES = (4, 8, 16, 32, 48, 64, 96, 128, 151)
ELEMENTS = (10, 20, 50, 100)
MANY_ELEMENTS = (*ELEMENTS, 200, 400)
ROWS = (1, 2, 3, 4, 5, 6)
OUTPUTS = (1, 4, 16, 51)
BOOMS = ("boom_two", "boom_three", "boom_four")
EACH = (4, 8, 16)  # coordinates of every section but the base


def measure(long: bool, repeats: int = 40) -> dict[str, Any]:
    """Nanoseconds of a step, the least of all repeats, and fitted exponents; sizes are taken in turn."""
    elements = MANY_ELEMENTS if long else ELEMENTS
    whole = beams.modal()
    modes = _series({r: (beams.leading(whole, r), 1) for r in MODES}, repeats)
    full = _series({beams.full("evolved", count).size: (beams.modal(count), 1) for count in elements}, repeats)
    rows = _series({m: (beams.leading(beams.modal(50, m), 40), 1) for m in ROWS}, repeats)
    outputs = _series({o: (beams.leading(whole, 20), o) for o in OUTPUTS}, repeats)
    return {
        "modes": modes | {"exponent": _slope(modes, above=32)},
        "full": full | {"exponent": _slope(full, above=100)},
        "rows": rows | {"coordinates": 40},
        "outputs": outputs | {"coordinates": 20},
        "booms": booms(repeats),
    }


def booms(repeats: int) -> dict[str, Any]:
    """Microseconds of a step of booms on pads that hold both ways, and a + b m^2 + c m r fitted to them."""
    cases = {(name, r): _boom(name, r) for name in BOOMS for r in EACH}
    best = dict.fromkeys(cases, np.inf)
    for _ in range(repeats):
        for key, (system, drive) in cases.items():
            seconds = systems.simulate(system, drive).seconds
            best[key] = min(best[key], 1e6 * seconds / drive.stepping.steps)
    m = np.array([len(system.contacts) for system, _ in cases.values()])
    r = np.array([sum(body.size for body in system.bodies.values()) for system, _ in cases.values()])
    us = np.array(list(best.values()))
    terms = np.column_stack([np.ones(len(m)), m**2, m * r])
    fitted = np.linalg.lstsq(terms / us[:, None], np.ones(len(m)), rcond=None)[0]
    return {
        "sections": [len(system.bodies) for system, _ in cases.values()],
        "contacts": m.tolist(),
        "coordinates": r.tolist(),
        "us": us.tolist(),
        "fitted": fitted.tolist(),
        "off": float(np.abs(terms @ fitted / us - 1.0).max()),
    }


def _boom(name: str, r: int) -> tuple[System, Excitation]:
    boom = load_scene(beams.WORKFLOWS / f"{name}.toml", [f"section.reduction.coordinates={r}"])
    bodies = {name: one.model for name, one in reduce_bodies(boom, build_bodies(boom, MPI.COMM_SELF)).items()}
    given = system_of(boom, bodies)
    system = System(bodies, tuple(replace(contact, clearance=None) for contact in given.contacts))
    paths = {name: SmoothRamp(times=(0.0, 1.5), values=(1.0, 2.5)) for name in system.paths}
    loads = {name: Constant(amount=1.0) for name in system.input_names}
    return system, Excitation(paths, loads, TimeStepping(1.5, 1e-3))


def _series(forms: dict[int, tuple[ModalForm, int]], repeats: int) -> dict[str, Any]:
    drive = beams.sliding(1500)
    best = dict.fromkeys(forms, np.inf)
    for _ in range(repeats):
        for size, (form, outputs) in forms.items():
            chosen = np.linspace(0, len(form.body.outputs) - 1, outputs).astype(int)
            seen = march.observe(form, drive, outputs=chosen)
            best[size] = min(best[size], seen.seconds / drive.stepping.steps)
    return {"size": list(best), "ns": [1e9 * seconds for seconds in best.values()]}


def _slope(series: dict[str, Any], above: int) -> float:
    """Exponent among the larger sizes, where the loops over modes and not the rest of a step take the time."""
    size, ns = np.array(series["size"], float), np.array(series["ns"])
    return exponent(size[size >= above], ns[size >= above])
