"""The telescopic boom that everything in space is measured by: box section, pads, payload, gusts.

One section of 6 m x 0.3 m x 0.4 m with a wall of 8 mm (mid-surface dimensions) slides out of the next one: pads at its
tail stay where they are on it, those at the mouth move along it from s = 1.5 m to 4 m and back.  Any model in space
whose faces are named bottom, top, left and right and whose ends are tail and tip will do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmr.models import StructuralModel
from pmr.pads import Hold, Pad, Pads
from pmr.scene.structures import PointMass, rayleigh
from pmr.signals import Chirp, SignalBase, SmoothRamp
from pmr.simulate.stepping import TimeStepping
from pmr.structure import GRAVITY, Action, PadForce, Structure, Weight

LENGTH = 6.0  # m
PAIRS = (("right", -0.1), ("left", 0.1))  # where along y the pads of a pair sit, m
SIDES = (("left side", "left"), ("right side", "right"))
#: Where the beam line is observed, m.
STATIONS = tuple(float(x) for x in np.linspace(0.2, 5.8, 29))


@dataclass(frozen=True)
class Scene:
    """A structure, its path, one signal for each of its loads, and the time grid."""

    structure: Structure
    path: SignalBase
    loads: tuple[SignalBase, ...]
    stepping: TimeStepping


def reference_scene(model: StructuralModel, span: float = 10.0, gust: float = 1.0) -> Scene:
    """Ten seconds of work with a payload of 250 kg, and gusts that last `gust` seconds each.

    Outputs: displacement along y, then z, at `STATIONS`, then of the tip along y and z in m, then the forces of the
    pads at the tail in N; those at the mouth are the rows' multipliers.  Gravity comes up within the
    first second, while the boom rests; the first gust and the first motion follow.
    """
    pads = boom_pads((1.5, 4.0))
    line = [Action(f"{d} at {x:g} m", x, d) for d in "yz" for x in STATIONS]
    structure = Structure(
        model,
        masses=(PointMass(name="payload", on="tip", mass=250.0),),
        loads=(Action("tip force", "tip", "z"), Action("gust", "tip", "y"), Weight()),
        outputs=(*line, *(Action(f"tip {d}", "tip", d) for d in "yz"), *(PadForce(pad.name) for pad in pads.fixed)),
        damping=rayleigh(0.005, 10.0, 60.0),
        pads=pads,
    )
    loads = (
        Chirp(amplitude=2000.0, times=(0.0, 10.0), frequencies=(0.5, 6.0)),
        _gusts(gust),
        SmoothRamp(times=(0.0, 1.0), values=(0.0, GRAVITY)),
    )
    path = SmoothRamp(times=(1.0, 5.0, 9.0), values=(1.5, 4.0, 1.5))
    return Scene(structure, path, loads, TimeStepping(end=span, step=1e-3))


def _gusts(duration: float) -> SmoothRamp:
    """Pulses of 1 kN around t = 2.5 s, 5 s (the other way) and 7.5 s."""
    rise = duration / 2.0
    times = tuple(t + d for t in (2.5, 5.0, 7.5) for d in (-rise, 0.0, rise))
    return SmoothRamp(times=times, values=(0.0, 1e3, 0.0, 0.0, -1e3, 0.0, 0.0, 1e3, 0.0))


def boom_pads(travel: tuple[float, float], stiffness: float = 3e8) -> Pads:
    """Pads of 0.3 m at the tail, centred at x = 0.15 m, and at the mouth, each: pairs on bottom and top, one a side.

    A rigid cylinder holds the tail along x.
    """

    def ring(where: str, at: float) -> tuple[Pad, ...]:
        pairs = [
            Pad(f"{where} {face} {side}", face, at, across=y, stiffness=stiffness)
            for face in ("bottom", "top")
            for side, y in PAIRS
        ]
        return (*pairs, *(Pad(f"{where} {name}", face, at, stiffness=stiffness) for name, face in SIDES))

    return Pads(ring("tail", 0.15), ring("mouth", 0.0), (Hold("cylinder", "tail"),), travel)
