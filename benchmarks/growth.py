"""Time of a step over the numbers of modes, coordinates, moving rows, outputs, and sections of a boom."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks import beams
from benchmarks.timing import exponent
from pmr import load_scene
from pmr.compare.estimate import estimate_error
from pmr.compare.evaluation import SimulatedSystem
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.reduction.bodies import reduce_bodies
from pmr.scene.signals import Constant, SmoothRamp
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.excitation import side_positions
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.systems import March
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System

MODES = (4, 8, 16, 32, 48, 64, 96, 128, 151)
ELEMENTS = (10, 20, 50, 100)
MANY_ELEMENTS = (*ELEMENTS, 200, 400)
ROWS = (1, 2, 3, 4, 5, 6)
OUTPUTS = (1, 4, 16, 51)
SECTIONS = (2, 3, 4, 6, 9, 12)
EACH = 8  # coordinates of every section but the base
STEPS, PLACES, LOWEST = 1500, 48, 6  # of a boom: steps, places and frequencies


def measure(long: bool, repeats: int = 40) -> dict[str, Any]:
    """Nanoseconds of a step, the least of all repeats, and exponents fitted over the size; sizes are taken in turn."""
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
        "booms": booms(max(1, repeats // 4)),
    }


def booms(repeats: int) -> dict[str, Any]:
    """Measure booms on bilateral pads: processor time in s of a step, of an estimate, and of frequencies at a position.

    Return them with the exponents over the number of joints n - 1 of n sections, and with a and b of a step's time, a
    (n - 1) + b (n - 2): a joint takes a, and two joints on one section take b more.  That is linear, but grows from two
    sections to three by more than the number of joints.
    """
    best = {name: dict.fromkeys(SECTIONS, np.inf) for name in _WAYS}
    for name, (way, once) in _WAYS.items():
        of_sections = {count: way(boom(count)) for count in SECTIONS}
        of_sections[SECTIONS[0]]()  # compiled or loaded
        for _ in range(1 if once else repeats):
            for count, seconds in of_sections.items():
                best[name][count] = min(best[name][count], seconds())
    found = {name: np.array(list(seconds.values())) for name, seconds in best.items()}
    joints = np.array(SECTIONS) - 1.0
    terms = np.column_stack([joints, joints - 1.0]) / found["step"][:, None]
    fitted = np.linalg.lstsq(terms, np.ones(len(joints)), rcond=None)[0]
    made = [boom(count).system for count in SECTIONS]
    return {
        "steps": STEPS,
        "sections": list(SECTIONS),
        "contacts": [len(system.contacts) for system in made],
        "coordinates": [sum(body.size for body in system.bodies.values()) for system in made],
        "seconds": {name: seconds.tolist() for name, seconds in found.items()},
        "exponents": {name: exponent(joints, seconds) for name, seconds in found.items()},
        "fitted": fitted.tolist(),
        "off": float(np.abs(terms @ fitted - 1.0).max()),
    }


@dataclass(frozen=True)
class Boom:
    """Boom of some sections: their reduced models without residual flexibility, and the system that is simulated."""

    models: dict[str, ReducedModel]
    system: System

    def driven(self, steps: int) -> Excitation:
        """Excitation under which all sections extend within 1.5 s, in so many steps."""
        paths = {name: SmoothRamp(times=(0.0, 1.5), values=(1.0, 2.5)) for name in self.system.paths}
        loads = {name: Constant(amount=1.0) for name in self.system.input_names}
        return Excitation(paths, loads, TimeStepping(1.5, 1.5 / steps))


def step(boom: Boom) -> Callable[[], float]:
    """Function that returns the processor time in s of a step, as the solver measures it."""
    march = March(SystemForm.of(boom.system), boom.driven(STEPS), {})

    def seconds() -> float:
        """Simulate all steps and return the processor time in s of one."""
        with patch.object(time, "perf_counter", time.process_time):
            return march.rerun() / STEPS

    return seconds


def _estimate(boom: Boom) -> Callable[[], float]:
    """Function that returns the processor time in s of an error estimate."""
    return lambda: _processor(lambda: estimate_error(boom.models, SimulatedSystem(boom.system, boom.driven(STEPS))))


def _frequencies(boom: Boom) -> Callable[[], float]:
    """Function that returns the processor time in s of the frequencies at one position."""
    x = side_positions(boom.system, boom.driven(PLACES))
    return lambda: _processor(lambda: Assembly(boom.system).frequencies(x, LOWEST)) / len(x)


#: And whether it takes so long that once is enough.
_WAYS = {"step": (step, False), "estimate": (_estimate, True), "frequencies": (_frequencies, False)}


def _processor(work: Callable[[], object]) -> float:
    """Processor time in s of some work."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _chain(count: int) -> str:
    """Scene of `count` boxes of 6 m in one another that all extend at once, as TOML."""
    pads = "at = 0.15, stiffness = 1e8, faces = { bottom = [0.0], top = [0.0] }"
    lines = ['title = "Chain"', "[section]", 'body = { model = "beam2d", box.length = 6.0 }', "mesh.elements = 40"]
    lines += [f"joint = {{ tail = [{{ {pads} }}], mouth = [{{ {pads} }}] }}", "[gravity]", "rise = 0.0"]
    for k in range(count):
        lines += ["[[sections]]", f'name = "s{k}"']
        lines += [f"body.box = {{ width = {0.6 - 0.04 * k}, height = {0.8 - 0.05 * k}, wall = 0.006 }}"]
        lines += ['joint.extension = { kind = "smooth_ramp", times = [0.0, 1.5], values = [1.0, 2.5] }'] * (k > 0)
        lines += ['supports = [{ name = "clamp", kind = "clamped" }]', "reduction.coordinates = 3"] * (k == 0)
    load = 'name = "tip force", on = "tip", direction = "z", signal = { kind = "constant", amount = 1.0 }'
    lines += [f"loads = [{{ {load} }}]", "[damping]", "ratio = 0.005", "frequencies = [1.0, 30.0]"]
    return "\n".join([*lines, "[time]", "end = 1.5", "step = 1e-3"])


@cache
def boom(count: int) -> Boom:
    """Reduce a boom of `count` sections."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "chain.toml")
        file.write_text(_chain(count), encoding="utf-8")
        boom = load_scene(file, [f"section.reduction.coordinates={EACH}"])
    reduced = reduce_bodies(boom, build_bodies(boom, MPI.COMM_SELF))
    given = system_of(boom, {name: one.model for name, one in reduced.items()})
    system = System(given.bodies, tuple(replace(contact, clearance=None) for contact in given.contacts))
    return Boom({name: one.modal for name, one in reduced.items()}, system)


def _series(forms: dict[int, tuple[ModalForm, int]], repeats: int) -> dict[str, Any]:
    """Least nanoseconds of a step by size, from modal forms with their numbers of outputs."""
    drive = beams.sliding(1500)
    best = dict.fromkeys(forms, np.inf)
    for _ in range(repeats):
        for size, (form, outputs) in forms.items():
            chosen = np.linspace(0, len(form.body.outputs) - 1, outputs).astype(int).tolist()
            seen = systems.observe(SystemForm.of_modal_body(form), drive, outputs=chosen)
            best[size] = min(best[size], seen.seconds / drive.stepping.steps)
    return {"size": list(best), "ns": [1e9 * seconds for seconds in best.values()]}


def _slope(series: dict[str, Any], above: int) -> float:
    """Exponent over the sizes from `above` on, where the loops over modes take most of a step."""
    size, ns = np.array(series["size"], float), np.array(series["ns"])
    return exponent(size[size >= above], ns[size >= above])
