"""What is said of a frame that moves: its angles, what of the small motion's own terms is kept, and buckling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.compare.summary import Part
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.scene.frame_terms import frame_terms
from pmr.simulation import Excitation
from pmr.simulation.excitation import places
from pmr.simulation.frame import Turning
from pmr.system.assembly import Assembly
from pmr.system.buckling import buckling_factors
from pmr.system.system import System

Array = NDArray[np.float64]

#: Times at which the buckling factor is computed, ends included.
TIMES = 41


def frame(scene: Scene, system: System, excitation: Excitation, frequencies: Frequencies) -> Part:
    r"""``frame`` of summary.json, with second order ``buckling`` too; nothing without a frame.

    Of what turns, `gyroscopic` is :math:`2 |\omega| / \omega_1` and `centrifugal` :math:`(|\omega| / \omega_1)^2`, with
    the lowest frequency on the way: so large beside the stiffness is what is dropped without second order.  Frequencies
    are those of the boom as axial forces and the frame stress it, or ``unstressed`` without second order.
    """
    if scene.frame is None:
        return Part()
    luffing, slewing = scene.frame.angles
    t = excitation.times
    speed = float(np.linalg.norm(Turning.of(luffing, slewing, t).velocity, axis=1).max())
    lowest = 2.0 * np.pi * float(np.nanmin(frequencies.models["reduced"][:, 0]))  # 0 past the buckling load
    said = {
        "luffing": _range(luffing.value(t)),
        "slewing": _range(slewing.value(t)),
        "angular_velocity": speed,
        "second_order": scene.frame.second_order,
        "gyroscopic": 2.0 * speed / lowest if lowest else None,
        "centrifugal": (speed / lowest) ** 2 if lowest else None,
        "frequencies": "unstressed" if frequencies.t is None else "stressed",
    }
    if not scene.frame.second_order:
        return Part({"frame": said})
    t, factors = _factors(scene, system, excitation)
    factor, at = float(factors.min()), float(t[np.argmin(factors)])
    over = {"t": t.tolist(), "factor": [value if np.isfinite(value) else None for value in factors.tolist()]}
    buckling = {"factor": factor if np.isfinite(factor) else None, "t": at, "over": over}
    past = f"the boom is past its buckling load: at {at:g} s {factor:.3g} of the axial forces bends it without limit"
    return Part({"frame": said, "buckling": buckling}, [past] if factor <= 1.0 else [])


def _range(angle: Array) -> dict[str, float]:
    return {"min": float(angle.min()), "max": float(angle.max())}


def _factors(scene: Scene, system: System, excitation: Excitation) -> tuple[Array, Array]:
    """By which all axial forces would have to grow until the boom buckles, at `TIMES` times in s; inf where none is."""
    assembly, x = Assembly(system), places(system, excitation)
    axial = [term.name for term in frame_terms(scene) if term.of in ("field", "load", "cylinder")]
    steps = np.unique(np.linspace(0, excitation.stepping.steps, TIMES).astype(np.int64))
    found = np.full(len(steps), np.inf)
    for k, step in enumerate(steps):
        amplitudes = {name: float(excitation.terms[name].value(excitation.times[step])) for name in axial}
        found[k] = buckling_factors(assembly, x[step], amplitudes)[0]
    return excitation.times[steps], found
