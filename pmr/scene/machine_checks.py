"""What a machine that moves by itself asks of the rest of a scene."""

from __future__ import annotations

from pmr.scene.choice import model_of
from pmr.scene.frame import Frame
from pmr.scene.machine import Machine
from pmr.scene.members import members
from pmr.scene.scene import Scene
from pmr.scene.simulators import Needs, refuse
from pmr.scene.structure_checks import refusal


def check_machine(scene: Scene, frame: Frame, machine: Machine) -> None:
    """Refuse what its equations leave out, and simulators without them."""
    motions = {} if frame.base is None else frame.base.motions
    for direction in machine.free:
        if direction in motions and not machine.is_sprung(direction):
            allowed = f"a spring or a damper in {direction} is allowed on what moves: the machine is free there"
            raise refusal(f"frame.base.{direction}", None, allowed)
    if frame.base is not None and frame.base.accelerations:
        allowed = "x, y and z are allowed beside frame.machine: where accelerations lead is not known"
        raise refusal("frame.base.acceleration", None, allowed)
    if frame.second_order == "auto":
        raise refusal("frame.second_order", "auto", "true or false is allowed beside frame.machine")
    if scene.goal is not None:
        key = "accuracy" if scene.accuracy is not None else "budget"
        raise refusal(key, None, "none is allowed beside frame.machine, whose motion depends on model and step")
    for member in members(scene):
        if model_of(member) == "beam2d":
            key = scene.key_of(member.number, "body.model")
            raise refusal(key, "beam2d", "a model in space is allowed beside frame.machine")
    _check_contacts(scene)
    for name in scene.simulation.simulators:
        refuse(name, Needs(machine=machine.free))


def _check_contacts(scene: Scene) -> None:
    """Pads hold both ways and do not rub: those that open in parts of a step see no motion of a machine there."""
    for number, part in enumerate(scene.sections):
        for k, pads in enumerate(part.pads):
            _check_ring(f"sections[{number}].pads[{k}]", pads.unilateral, 0.0)
        for end in ("tail", "mouth") if part.joint is not None else ():
            for k, ring in enumerate(getattr(part.joint, end)):
                _check_ring(f"sections[{number}].joint.{end}[{k}]", ring.unilateral, ring.friction)


def _check_ring(key: str, unilateral: bool, friction: float) -> None:
    if unilateral:
        allowed = "false is allowed beside frame.machine: pads that hold both ways"
        raise refusal(f"{key}.unilateral", True, allowed)
    if friction:
        raise refusal(f"{key}.friction", friction, "0 is allowed beside frame.machine")
