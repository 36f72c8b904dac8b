"""Booms with a hoist: a cantilever of one section, as stiff as wanted, whose tip carries head sheaves."""

import tomllib
from dataclasses import replace
from typing import Any

import pmr
from pmr import System
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.system.states import SystemTrajectory
from pmr.system.terms import hoist_of

G, REACH, SECOND_MOMENT = 9.80665, 4.0, 1e-5
CANTILEVER = f"""
title = "Cantilever with a hoist"
start = "equilibrium"
[body]
model = "beam3d"
shear = false
material = {{ young = 2.1e17, density = 1e-3 }}
box = {{ length = {REACH}, width = 0.3, height = 0.4, wall = 0.01 }}
[body.section]
area = 1e-2
second_moment_y = {SECOND_MOMENT}
second_moment_z = {SECOND_MOMENT}
torsion_constant = 1e-5
[mesh]
elements = 2
[[supports]]
on = "tail"
kind = "clamped"
points = "all"
[slider]
path = {{ kind = "constant", amount = 0.5 }}
[[pads]]  # of no importance, but something has to slide
name = "shoe"
moving = true
faces = {{ bottom = [0.0] }}
stiffness = 1.0
[[masses]]
name = "head"
on = "tip"
mass = 100.0
[gravity]
[reduction]
coordinates = 3
[time]
end = 10.0
step = 1e-3
rho_inf = 1.0
[compare]
against = []
[hoist]
payload = 100.0
EA = 1e13
hanging = 2.0
"""


def cantilever(changes: dict[str, Any] | None = None) -> Scene:
    """Scene of the cantilever with `changes` by dotted keys; None takes a key away."""
    data: dict[str, Any] = tomllib.loads(CANTILEVER)
    for key, value in (changes or {}).items():
        table, *path = data, *key.split(".")
        for part in path[:-1]:
            table = table.setdefault(part, {})
        if value is None:
            del table[path[-1]]
        else:
            table[path[-1]] = value
    scene = Scene.model_validate(data)
    check_scene(scene)
    return scene


def reduced(scene: Scene) -> System:
    """Reduced system of a scene."""
    return pmr.reduce(scene).system


def simulate(system: System, scene: Scene) -> SystemTrajectory:
    """Motion of a system whose hoist, time and motions are those of another scene of the same bodies."""
    hoisting = replace(system, hoist=hoist_of(scene), provenance=scene.provenance)
    return systems.simulate_form(SystemForm.of(hoisting), Excitation.from_scene(scene))
