"""A crane that is raised, slewed and telescoped by some metres within a tenth of its workflow's time, on a truck."""

from functools import cache

import plain_machines

import pmr
from pmr import System
from pmr.simulation.moving import MovingFrame

STEP, RHO = 2e-3, 0.9
CHANGES = (
    "compare.against=[]",
    "section.mesh.elements=6",
    "frame.second_order=true",
    "frame.luffing.times=[0.0,1.4]",
    "frame.slewing.times=[-0.2,1.6]",
    "frame.base.x={kind='sine',amplitude=0.02,frequency=2.0}",
    "frame.base.rx={kind='sine',amplitude=2.0,frequency=1.5}",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.9],values=[0.6,2.5]}",
    "time.end=0.1",
    f"time.step={STEP}",
)


@cache
def shaken_crane() -> tuple[System, MovingFrame]:
    """Reduced crane with terms of second order, and its frame."""
    system = pmr.reduce(pmr.load_scene(plain_machines.CRANE, [*CHANGES])).system
    frame = MovingFrame.from_system(system)
    assert frame is not None
    return system, frame
