"""What a run calls is compiled by another process while its own builds the models.

Types decide what is compiled, not sizes or values.  So the smallest systems stand for all: they step once, and what has
been compiled for them is stored (`pmr.simulation.native.compilation`), where the run's process finds it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from pmr.constraints.rows import Rows, carrier, fixed_row
from pmr.scene import Scene
from pmr.scene.names import ALONE
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.stepping import TimeStepping
from pmr.system.body import FullBody
from pmr.system.contacts import Contact, Place
from pmr.system.system import System

#: In one step, which pads that push ask to be made in parts.
DRIVE = Excitation({}, {}, TimeStepping(end=1.0, step=1.0))


def system_like(scene: Scene) -> Callable[[], System]:
    """A small system with a loop as the scene's has: of several bodies, or of one, whose contacts may only push."""
    if len(scene.sections) > 1:
        return several
    in_parts = scene.frame is not None or any(ring.unilateral for ring in scene.sections[0].pads)
    return pushed if in_parts else held


def compile_for(system: Callable[[], System]) -> None:
    """Compile and store all that a loop like this system's calls, or load it, where that has been done."""
    systems.simulate(system(), DRIVE)


def held() -> System:
    """A body whose contact holds both ways."""
    return System({ALONE: _mass(clearance=None)}, (Contact("pad", Place(ALONE, "pad"), compliance=1.0),))


def pushed() -> System:
    """A body whose contact only pushes."""
    return System({ALONE: _mass(0.0)}, (Contact("pad", Place(ALONE, "pad"), compliance=1.0, clearance=0.0),))


def several() -> System:
    """Two bodies, and a contact between them that only pushes."""
    inner, outer = (Place(name, "pad") for name in ("inner", "outer"))
    bodies = {place.body: _mass(0.0) for place in (inner, outer)}
    return System(bodies, (Contact("pad", inner, outer, compliance=1.0, clearance=0.0),))


def _mass(clearance: float | None) -> FullBody:
    """1 kg on a spring of 1 N/m, with a pad of 1 m/N in its way."""
    one = sp.csr_matrix(np.eye(1))
    pad = replace(fixed_row("pad", carrier(0, 1.0, 1), (0.0, 1.0)), compliance=1.0, clearance=clearance)
    return FullBody(one, 0.0 * one, one, np.zeros((1, 0)), one, Rows((pad,), 1), (), np.zeros(1))
