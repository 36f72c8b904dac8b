"""Random machines for load charts: booms of two to four sections at one point, with all keys that a run takes."""

from typing import Any

import numpy as np

IN_SPACE = {"bottom": [-0.06, 0.06], "top": [-0.06, 0.06], "left": [0.0], "right": [0.0]}
PLANAR = {"bottom": [0.0], "top": [0.0]}
G = 9.80665
#: Walls that give way and shells are in every so many machines: they take the longest.
GIVING, SHELLS = 9, 5


#: What each machine stands on: outriggers of one stiffness but for one, a carrier and a counterweight that slews.
LEGS = [("a", [2.6, 2.1]), ("b", [-2.4, 2.1]), ("c", [-2.4, -2.1]), ("d", [2.6, -2.1])]
STAND = {
    "height": 1.5,
    "masses": [{"name": "carrier", "mass": 2e4, "at": [-0.6, 0.0, -0.8]}, {"name": "weight", "mass": 3e3, "at": [-1.5,
     0.0, 0.2], "slews": True}],
    "outriggers": [{"name": name, "at": at, "stiffness": 1e8 if name != "b" else 6e7} for name, at in LEGS],
}  # fmt: skip


def random_machine(seed: int) -> tuple[dict[str, Any], dict[str, float], float]:
    """Keys of a scene with a frame, extensions in m by section, and a luffing angle in degrees."""
    rng = np.random.default_rng([seed, 46])
    planar, count = bool(rng.random() < 0.3), int(rng.integers(2, 5))
    shell, giving = seed % SHELLS == SHELLS - 1, seed % GIVING == GIVING - 1
    planar, count = planar and not shell, 2 if shell else count
    length = float(rng.uniform(4.0, 7.0))
    ring = {"at": 0.2, "length": 0.3, "width": 0.05, "stiffness": float(10.0 ** rng.uniform(7.5, 9.0))}
    ring |= {"unilateral": bool(rng.random() < 0.6), "faces": PLANAR if planar else IN_SPACE}
    if shell:
        ring |= {"length": 0.6, "at": 0.35}
    sections, ropes = list[dict[str, Any]](), count > 2 and rng.random() < 0.5
    extensions = dict[str, float]()
    for k in range(count):
        box = {"length": length, "width": 0.34 - 0.04 * k, "height": 0.46 - 0.05 * k, "wall": 0.008 - 0.001 * k}
        body: dict[str, Any] = {"model": "beam2d" if planar else "beam3d", "box": box}
        probes = [{"name": "top", "at": [0.3 * length, 0.0, box["height"] / 2.0], "measures": ["stress"]}]
        if giving and not planar:
            body["walls"] = "give"
        if shell and k == count - 1:
            body["model"] = "shell"
            probes = []
        part: dict[str, Any] = {"name": f"s{k}", "body": body, "mesh": {"elements": 12}, "probes": probes}
        part["reduction"] = {"coordinates": 6 if planar else 10}
        if shell and k == count - 1:
            part["mesh"] = {"size": 0.15, "along": 0.6}
            part["observe"] = {"start": 0.2, "end": length - 0.2, "count": 5}
        if k == 0:
            part["supports"] = _supports(rng, planar, length)
        else:
            follows = ropes and k > 1
            extensions[f"s{k}"] = extensions["s1"] if follows else float(rng.uniform(0.15, 0.7) * length)
            constant = {"kind": "constant", "amount": extensions[f"s{k}"]}
            moved: dict[str, Any] = {"follows": f"s{k - 1}"} if follows else {"extension": constant}
            if follows:
                moved["rope"] = {"EA": 2e7, "strands": 2}
            moved["cylinder"] = {"stiffness": float(10.0 ** rng.uniform(7.0, 8.0))} if not follows else {}
            part["joint"] = {"tail": [ring], "mouth": [ring], **{key: one for key, one in moved.items() if one}}
        if k == count - 1:
            part["loads"] = [{"name": "wind", "on": "tip", "direction": "z" if planar else "y", "signal": _still(0.0)}]
        sections.append(part)
    if rng.random() < 0.5:
        basket: dict[str, Any] = {"name": "basket", "on": "tip", "mass": float(rng.uniform(50.0, 250.0))}
        place = [length + rng.uniform(-0.2, 0.8), rng.uniform(-0.5, 0.5), rng.uniform(-0.3, 0.3)]
        sections[-1]["masses"] = [basket if planar else basket | {"at": [float(x) for x in place]}]
    frame: dict[str, Any] = {"pivot": [float(rng.uniform(-0.4, 0.4)), 0.0, float(rng.uniform(-0.2, 0.2))]}
    frame |= {"unit": "degrees", "second_order": True, "cylinder": {"foot": [0.6, -1.2], "lug": [0.3 * length, -0.25]}}
    angle = float(rng.uniform(5.0, 70.0))
    frame["luffing"] = _still(angle)
    if not planar and rng.random() < 0.5:
        frame["slewing"] = _still(0.0)
    if rng.random() < 0.5:
        base = {"ry": _still(float(rng.uniform(-5.0, 5.0)))}
        frame["base"] = base if planar else base | {"rx": _still(float(rng.uniform(-4.0, 4.0)))}
    frame["ground"] = STAND
    scene = {"title": f"machine {seed}", "frame": frame, "sections": sections, "gravity": {}, "start": "equilibrium"}
    scene |= {
        "time": {"end": 0.02, "step": 0.01},
        "compare": {"against": []},
        "damping": {"ratio": 0.01, "frequencies": [1.0, 30.0]},
    }
    return scene, extensions, angle


def _still(amount: float) -> dict[str, Any]:
    """Keys of a constant signal."""
    return {"kind": "constant", "amount": amount}


def _supports(rng: np.random.Generator, planar: bool, length: float) -> list[dict[str, Any]]:
    """Keys of a clamp, or of a pin and a cylinder that raises the boom."""
    if rng.random() < 0.25:
        return [{"name": "clamp", "kind": "clamped"}]
    pin = {"name": "pin", "on": "tail", "directions": ["x", "z"] if planar else ["x", "y", "z", "rx", "rz"]}
    pin |= {} if planar else {"lug_spacing": 0.3}
    stiffness = float(10.0 ** rng.uniform(7.2, 8.5))
    return [pin, {"name": "luffing", "on": 0.3 * length, "directions": ["z"], "stiffness": stiffness}]
