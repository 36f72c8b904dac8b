"""Simulations of a boom: its reduced sections, and its full ones as a reference that is checked before it judges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from pmr.compare.booms import respond
from pmr.compare.trust import distrust
from pmr.environment import Clock
from pmr.errors import SimulationError
from pmr.results import Response
from pmr.scene import Boom
from pmr.simulate.booms import excitation_of
from pmr.simulate.native import multibody
from pmr.simulate.native.multibody_march import parts_of
from pmr.system.system import System


def simulate(boom: Boom, systems: Mapping[str, System], clock: Clock) -> tuple[dict[str, Response], dict[str, str]]:
    """Of every system, and why there is none of the full one; all of them take the reduced one's steps."""
    found, missing = dict[str, Response](), dict[str, str]()
    parts = parts_of(systems["reduced"], excitation_of(boom, systems["reduced"]))
    for name, system in systems.items():
        excitation = excitation_of(boom, system)
        excitation = excitation.with_stepping(replace(excitation.stepping, parts=parts))
        try:
            with clock.stage(name) as done:
                start = multibody.static_start(system, excitation)
                response = respond(system, multibody.simulate(system, excitation, start, done))
        except SimulationError as error:
            if name == "reduced":
                raise
            missing[name] = str(error)
            continue
        reason = distrust(response) if name == "full" else None
        if reason is None:
            found[name] = response
        else:
            missing[name] = reason
    return found, missing
