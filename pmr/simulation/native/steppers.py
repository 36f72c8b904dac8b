"""One step at a time, of a body or a boom: which of the steppers takes it."""

from __future__ import annotations

from typing import Any

from pmr.scene.names import ALONE
from pmr.simulation.native.stepper import Stepper
from pmr.simulation.native.system_stepper import SystemStepper
from pmr.system.body import SlidingBody
from pmr.system.system import System


def stepper(body: SlidingBody | System, *arguments: Any, **options: Any) -> Stepper | SystemStepper:
    """`Stepper` of a body or of a system of one, `SystemStepper` of a system of several: `pmr.Stepper`.

    Arguments and errors as for these.
    """
    if isinstance(body, System) and ALONE not in body.bodies:
        return SystemStepper(body, *arguments, **options)
    alone = body.ensure_constant("stepper").bodies[ALONE] if isinstance(body, System) else body
    return Stepper(alone, *arguments, **options)
