"""Booms on a pin and an elastic luffing cylinder, and statics of a rigid boom by hand."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pmr.scene import Scene
from pmr.scene.checks import check_scene

G, DENSITY, LENGTH, EXTENSION, PULL = 9.80665, 7850.0, 6.0, 4.0, 5000.0
FOOT, LUG = complex(0.5, -1.0), complex(1.5, -0.3)  # m: x + i z from the pin
BOXES = ((0.30, 0.40, 0.008), (0.24, 0.34, 0.006))  # m: width, height and wall
TAILS = (0.0, EXTENSION)


def boom(angle: Any, model: str, stiffness: float, young: float = 2.1e15, **changed: Any) -> Scene:
    """Scene of two sections with a load at the tip, raised by an angle in degrees or a signal's keys."""
    planar = model == "beam2d"
    pads: dict[str, Any] = {"at": 0.2, "stiffness": 1e12, "unilateral": False}
    pads |= {} if planar else {"length": 0.2, "faces": {"bottom": [-0.06, 0.06], "left": [0.0]}}
    sections = list[dict[str, Any]]()
    for k, (width, height, wall) in enumerate(BOXES):
        box = {"length": LENGTH, "width": width, "height": height, "wall": wall}
        material = {"young": young, "poisson": 0.3, "density": DENSITY}
        part: dict[str, Any] = {"name": f"s{k}", "body": {"model": model, "box": box, "material": material}}
        sections.append(part | {"mesh": {"elements": 8}, "reduction": {"coordinates": 6}})
    directions = ["x", "z"] if planar else ["x", "y", "z", "rx", "rz"]
    sections[0]["supports"] = [{"name": "pin", "on": "tail", "directions": directions}]
    sections[1]["joint"] = {"extension": {"kind": "constant", "amount": EXTENSION}, "tail": [pads], "mouth": [pads]}
    pull = {"name": "pull", "on": "tip", "direction": "z", "axes": "ground"}
    sections[1]["loads"] = [pull | {"signal": {"kind": "constant", "amount": -PULL}}]
    cylinder = {"foot": [FOOT.real, FOOT.imag], "lug": [LUG.real, LUG.imag], "stiffness": stiffness}
    luffing = angle if isinstance(angle, dict) else {"kind": "constant", "amount": angle}
    frame = {"pivot": [0.0, 0.0, 0.0], "unit": "degrees", "luffing": luffing, "cylinder": cylinder}
    scene: dict[str, Any] = {"title": "turning", "frame": frame, "sections": sections, "gravity": {}}
    scene |= {"start": "equilibrium", "time": {"end": 0.02, "step": 0.01}, "compare": {"against": []}}
    made = Scene.model_validate(scene | changed)
    check_scene(made)
    return made


@dataclass(frozen=True)
class Rigid:
    """Statics of a rigid boom raised by an angle in rad: forces by moments about the pin; the cylinder is elastic."""

    angle: float

    @property
    def _cylinder(self) -> complex:
        """Vector x + i z in m from the cylinder's foot to its lug."""
        return LUG * np.exp(1j * self.angle) - FOOT

    @property
    def arm(self) -> float:
        """Lever arm in m of the cylinder about the pin."""
        return float((FOOT.conjugate() * LUG * np.exp(1j * self.angle)).imag / abs(self._cylinder))

    @property
    def _weights(self) -> list[float]:
        """Weights of the sections in N."""
        return [DENSITY * 2.0 * wall * (width + height) * LENGTH * G for width, height, wall in BOXES]

    @property
    def force(self) -> float:
        """Force of the cylinder in N."""
        centres = [tail + LENGTH / 2.0 for tail in TAILS]
        about = PULL * (EXTENSION + LENGTH) + sum(w * x for w, x in zip(self._weights, centres, strict=True))
        return float(about * np.cos(self.angle) / self.arm)

    @property
    def pin(self) -> complex:
        """Force x + i z in N on the pin, in the boom's axes."""
        pressed = self.force * self._cylinder / abs(self._cylinder) - 1j * (PULL + sum(self._weights))
        return complex(pressed * np.exp(-1j * self.angle))

    def sag(self, stiffness: float) -> float:
        """Deflection in m of the tip across the boom, downwards, by a cylinder of this stiffness in N/m."""
        return self.force / (stiffness * self.arm**2) * (EXTENSION + LENGTH) * self.arm

    def frequency(self, stiffness: float) -> float:
        """Frequency in Hz at which the boom turns about the pin on the cylinder; boxes are slender rods."""
        inertia = sum(
            weight / G / LENGTH * ((tail + LENGTH) ** 3 - tail**3) / 3.0
            for weight, tail in zip(self._weights, TAILS, strict=True)
        )
        return float(np.sqrt(stiffness * self.arm**2 / inertia) / (2.0 * np.pi))
