"""What a step costs as the model grows: in modes, coordinates, moving rows, outputs; in sections of a boom."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
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
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.system.from_scene import system_of
from pmr.system.system import System

MODES = (4, 8, 16, 32, 48, 64, 96, 128, 151)
ELEMENTS = (10, 20, 50, 100)
MANY_ELEMENTS = (*ELEMENTS, 200, 400)
ROWS = (1, 2, 3, 4, 5, 6)
OUTPUTS = (1, 4, 16, 51)
SECTIONS = (2, 3, 4, 6, 9, 12)
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
    cases = {(count, r): _boom(count, r) for count in SECTIONS for r in EACH}
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
        "exponent": exponent(np.array(SECTIONS) - 1.0, us.reshape(len(SECTIONS), -1)[:, EACH.index(8)]),
        "off": float(np.abs(terms @ fitted / us - 1.0).max()),
    }


def _chain(count: int) -> str:
    """A scene of so many boxes of 6 m in one another, that all extend at once."""
    pads = "at = 0.15, stiffness = 1e8, faces = { bottom = [0.0], top = [0.0] }"
    lines = ['title = "Chain"', "[section]", 'body = { model = "beam2d", box.length = 6.0 }', "mesh.elements = 20"]
    lines += [f"joint = {{ tail = [{{ {pads} }}], mouth = [{{ {pads} }}] }}", "[gravity]", "rise = 0.0"]
    for k in range(count):
        lines += ["[[sections]]", f'name = "s{k}"']
        lines += [f"body.box = {{ width = {0.6 - 0.04 * k}, height = {0.8 - 0.05 * k}, wall = 0.006 }}"]
        lines += ['joint.extension = { kind = "smooth_ramp", times = [0.0, 1.5], values = [1.0, 2.5] }'] * (k > 0)
        lines += ['supports = [{ name = "clamp", kind = "clamped" }]', "reduction.coordinates = 3"] * (k == 0)
    load = 'name = "tip force", on = "tip", direction = "z", signal = { kind = "constant", amount = 1.0 }'
    lines += [f"loads = [{{ {load} }}]", "[damping]", "ratio = 0.005", "frequencies = [1.0, 30.0]"]
    return "\n".join([*lines, "[time]", "end = 1.5", "step = 1e-3"])


def _boom(count: int, r: int) -> tuple[System, Excitation]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "chain.toml")
        file.write_text(_chain(count), encoding="utf-8")
        boom = load_scene(file, [f"section.reduction.coordinates={r}"])
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
            seen = systems.observe(SystemForm.alone(form), drive, outputs=chosen)
            best[size] = min(best[size], seen.seconds / drive.stepping.steps)
    return {"size": list(best), "ns": [1e9 * seconds for seconds in best.values()]}


def _slope(series: dict[str, Any], above: int) -> float:
    """Exponent among the larger sizes, where the loops over modes and not the rest of a step take the time."""
    size, ns = np.array(series["size"], float), np.array(series["ns"])
    return exponent(size[size >= above], ns[size >= above])
