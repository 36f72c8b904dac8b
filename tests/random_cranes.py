"""Random scenes of booms that luff, slew and extend with second order, of one to four sections."""

from typing import Any

import numpy as np

from pmr.scene import Scene
from pmr.scene.checks import check_scene

END, STEP = 2.0, 1e-3
PLANAR = {"bottom": [0.0], "top": [0.0]}
IN_SPACE = {"bottom": [-0.05, 0.05], "top": [-0.05, 0.05], "left": [0.0], "right": [0.0]}


def random_crane(seed: int) -> Scene:
    """Scene of a random boom with 1 + `seed` % 4 sections.

    Half of them are planar; some are soft, carry much, are clamped, have pads that only push, or are damped by rho 0.6.
    """
    rng = np.random.default_rng([seed, 2_300])
    planar, count = bool(rng.random() < 0.5), 1 + seed % 4
    length, soft = float(rng.uniform(4.0, 7.0)), float(10.0 ** rng.uniform(-2.0, 0.0))
    pushes = count > 1 and rng.random() < 0.2
    ring = {"at": 0.15, "stiffness": float(10.0 ** rng.uniform(7.5, 9.0)), "unilateral": pushes}
    ring["faces"] = PLANAR if planar else IN_SPACE
    sections = []
    for k in range(count):
        box = {"length": length, "width": 0.30 - 0.04 * k, "height": 0.40 - 0.04 * k, "wall": 0.008 - 0.001 * k}
        material = {"young": 210e9 * soft, "density": 7850.0}
        part: dict[str, Any] = {
            "name": f"section {k}",
            "body": {"model": "beam2d" if planar else "beam3d", "box": box, "material": material},
            "mesh": {"elements": int(rng.integers(10, 16))},
            "reduction": {"coordinates": (3 if planar else 6) + int(rng.integers(0, 4)) + (k == 0) * 2},
        }
        if k == 0:
            part["supports"] = _held(rng, planar, length)
        else:
            low, high = sorted(rng.uniform(0.12 * length, 0.75 * length, 2).tolist())
            times = [0.1, 0.1 + float(rng.uniform(0.8, 1.6))]
            values = [low, high] if rng.random() < 0.7 else [high, low]
            kind = str(rng.choice(["ramp", "smooth_ramp", "smooth_ramp"]))
            signal = {"kind": kind, "times": times, "values": values}
            follows = k > 1 and rng.random() < 0.25
            moved = {"follows": f"section {k - 1}"} if follows else {"extension": signal}
            part["joint"] = {"tail": [ring], "mouth": [ring], **moved}
        if k == count - 1:
            part["masses"] = [{"name": "payload", "on": "tip", "mass": float(rng.uniform(50.0, 600.0)) * soft**0.5}]
            gust = {"kind": "smooth_ramp", "times": [0.5, 0.8, 1.4], "values": [0.0, 300.0 * soft, 0.0]}
            part["loads"] = [{"name": "gust", "on": "tip", "direction": "z" if planar else "y", "signal": gust}]
        sections.append(part)
    bodies = {"sections": sections} if count > 1 else _alone(rng, sections[0], ring)
    scene = Scene.model_validate(
        {
            "title": "random crane",
            "frame": _frame(rng, planar),
            **bodies,
            "damping": {"ratio": float(rng.choice([0.0, 0.005, 0.02])), "frequencies": [1.0, 30.0]},
            "time": {"end": END, "step": STEP, "rho_inf": float(rng.choice([0.6, 0.9, 1.0]))},
            "simulation": {"simulators": ["march"], "repeats": 1},
        }
    )
    check_scene(scene)
    return scene


def _alone(rng: np.random.Generator, section: dict[str, Any], ring: dict[str, Any]) -> dict[str, Any]:
    """Keys of a section that a cylinder pushes through two rings of pads on the frame."""
    length = section["body"]["box"]["length"]
    low, high = rng.uniform(0.25 * length, 0.75 * length, 2).tolist()
    path = {"kind": "smooth_ramp", "times": [0.1, 1.7], "values": [low, high]}
    pads = {"length": 0.2, "width": 0.06, **{key: ring[key] for key in ("faces", "stiffness", "unilateral")}}
    return {
        **{key: section[key] for key in ("body", "mesh", "reduction", "masses", "loads")},
        "supports": [{"name": "cylinder", "directions": ["x"]}],
        "pads": [{"name": "tail", "at": 0.3, **pads}, {"name": "mouth", "moving": True, **pads}],
        "slider": {"path": path},
        "observe": {"start": 0.05 * length, "end": 0.95 * length},
    }


def _held(rng: np.random.Generator, planar: bool, length: float) -> list[dict[str, Any]]:
    """Keys of a clamp, or of a pin and a luffing cylinder across the boom."""
    if rng.random() < 0.4:
        return [{"name": "clamp", "kind": "clamped"}]
    across = ["x", "z"] if planar else ["x", "y", "z", "rx", "rz"]
    at, stiffness = float(rng.uniform(0.2, 0.5)) * length, float(10.0 ** rng.uniform(7.0, 8.5))
    return [
        {"name": "pin", "on": "tail", "directions": across},
        {"name": "luffing cylinder", "on": at, "directions": ["z"], "stiffness": stiffness},
    ]


def _frame(rng: np.random.Generator, planar: bool) -> dict[str, Any]:
    """Keys of a frame that luffs by up to 80 degrees and, in space, slews by up to 90 degrees, within 2 s."""
    first, last = rng.uniform(-5.0, 75.0, 2).tolist()
    begin = float(rng.uniform(0.1, 0.5))
    frame: dict[str, Any] = {
        "pivot": [float(rng.uniform(-0.5, 1.0)), 0.0, float(rng.uniform(-0.3, 0.3))],
        "unit": "degrees",
        "second_order": True,
        "luffing": {"kind": "smooth_ramp", "times": [begin, begin + 1.4], "values": [first, last]},
    }
    if not planar:
        turn = float(rng.uniform(-90.0, 90.0))
        frame["slewing"] = {
            "kind": "smooth_ramp",
            "times": [0.2, 0.2 + float(rng.uniform(1.0, 1.7))],
            "values": [0.0, turn],
        }
    return frame
