"""Friction of a stiff section on two pads, its cylinder elastic, beside statics: steady sliding, reversal, rest."""

from __future__ import annotations

import numpy as np
import pytest

import pmr
from pmr.scene import Scene

G, LENGTH, AT, MU, SPEED = 9.80665, 6.0, 0.15, 0.2, 1e-3
BOX = {"length": LENGTH, "width": 0.26, "height": 0.36, "wall": 0.007}
#: kg of the section that slides, at its middle; half of its outer height, m.
MASS = 1000.0
ARM = BOX["height"] / 2.0


def sliding(extension: dict[str, object], end: float, friction: float = MU, step: float = 5e-3) -> Scene:
    """A massless stiff box with a mass at its tip, in a stiff one that is clamped."""
    pads = [{"at": AT, "stiffness": 1e9, "unilateral": False, "friction": friction}]
    stiff = {"young": 2.1e15, "density": 1e-3}
    return Scene.model_validate(
        {
            "title": "sliding",
            "gravity": {},
            "start": "equilibrium",
            "sections": [
                {
                    "name": "base",
                    "body": {"model": "beam2d", "box": BOX | {"width": 0.3, "height": 0.4}, "material": stiff},
                    "mesh": {"elements": 6},
                    "supports": [{"on": "tail", "kind": "clamped"}],
                },
                {
                    "name": "fly",
                    "body": {"model": "beam2d", "box": BOX, "material": stiff},
                    "mesh": {"elements": 6},
                    "masses": [{"name": "payload", "on": "tip", "mass": MASS}],
                    "joint": {
                        "tail": pads,
                        "mouth": pads,
                        "extension": extension,
                        "friction_speed": SPEED,
                        "cylinder": {"stiffness": 5e8},
                    },
                },
            ],
            "time": {"end": end, "step": step, "rho_inf": 0.0},  # what friction sets ringing comes to rest
            "compare": {"against": []},
        }
    )


def pressed(s: np.ndarray, way: float) -> np.ndarray:
    """Sum of the pads' forces in N: moments about the tail's pad, each force as much nearer to the tail as it rubs."""
    nearer = MU * ARM * way
    tail, mouth, tip = AT - nearer, LENGTH - AT - s - nearer, LENGTH
    on_mouth = MASS * G * (tip - tail) / (mouth - tail)
    return np.abs(on_mouth) + np.abs(on_mouth - MASS * G)


def cylinder(scene: Scene) -> tuple[pmr.Response, np.ndarray]:
    found = pmr.simulate(scene, pmr.reduce(scene).reduced)
    return found, found.force("force of cylinder of fly", 0)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_steady_sliding_needs_what_all_pads_resist_with(way: float) -> None:
    path = {"kind": "ramp", "times": [0.0, 2.0], "values": [2.0 - 0.2 * way, 2.0 + 0.2 * way]}
    found, force = cylinder(sliding(path, 1.5))
    late = found.t > 1.001
    s = 2.0 + way * 0.2 * (found.t - 1.0)
    expected = way * MU * pressed(s, way)
    assert force[late] == pytest.approx(expected[late], rel=1e-6)


def test_a_cycle_takes_what_friction_dissipates() -> None:
    """The loop of the cylinder's force over the extension, whose sides are closed forms."""
    path = {"kind": "sine", "amplitude": 0.3, "frequency": 0.5, "offset": 2.0}
    found, force = cylinder(sliding(path, 4.0, step=5e-4))  # a step in which it turns counts half
    t, s = found.t, 2.0 + 0.3 * np.sin(np.pi * found.t)
    once = t >= 2.0
    work = np.sum((force[1:] + force[:-1])[once[1:]] / 2.0 * np.diff(s)[once[1:]])
    at = np.linspace(1.7, 2.3, 1001)
    lost = MU * (pressed(at, 1.0) + pressed(at, -1.0))
    area = np.sum((lost[1:] + lost[:-1]) / 2.0 * np.diff(at))
    assert work == pytest.approx(area, rel=1e-3)


def test_at_rest_nothing_slides() -> None:
    found, force = cylinder(sliding({"kind": "constant", "amount": 2.0}, 0.2))
    without, free = cylinder(sliding({"kind": "constant", "amount": 2.0}, 0.2, 0.0))
    assert force == pytest.approx(free, abs=1e-9 * MASS * G)
    assert found.displacement == pytest.approx(without.displacement, abs=1e-12)
