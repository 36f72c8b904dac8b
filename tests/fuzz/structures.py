"""Random structures in space, some of whose physical keys have extreme or wrong values."""

from pathlib import Path
from typing import Any

from fuzz import toml
from fuzz.mutations import Random
from fuzz.scenes import coarse, ran

from pmr import scene as scenes
from pmr.scene.model_traits import MODELS

FACES = ("bottom", "top", "left", "right")
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
#: Sizes that end somewhere: of floats, of what is allowed, of what a boom is.
EXTREME = (
    0.0, -0.0, 5e-324, 1e-300, 1e-150, 1e-30, 1e-12, 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e12, 1e15, 1e30, 1e150, 1e300,
    1.7976931348623157e308, float("inf"), float("nan"), -1.0, -1e300,
)  # fmt: skip
WRONG = ("rigid", "", "tip", "tail", "nose", "z", [], {}, True, None, [0.0, 0.0, 0.0], [1.0], "1.0", 10**400)
#: What a user's arithmetic leaves.
ROUND_OFF = (1e-16, 1e-15, 1e-12, 1e-9, 1e-6)


def case(number: int, rng: Random, folder: Path) -> str:
    """Read a random structure and run it if it is accepted; return the outcome in a few words."""
    data = structure(rng)
    for _ in range(pick(rng, (0, 0, 1, 1, 1, 2, 3))):
        change(data, rng)
    (folder / "scene.toml").write_text(toml.written(_without_none(data)))
    return ran(coarse(scenes.load(folder / "scene.toml")), folder, drawn=False)


def structure(rng: Random) -> dict[str, Any]:
    """Keys of a structure that mostly can be built; sizes, materials, pads and supports vary over decades."""
    model = pick(rng, ("beam2d", "beam3d", "beam3d", "beam3d", "shell", "solid", "auto"))
    length = 10 ** rng.uniform(0.0, 1.3)
    width, height = (length * 10 ** rng.uniform(-1.8, -0.8) for _ in range(2))
    wall = min(width, height) * 10 ** rng.uniform(-2.0, -0.9)
    box = {"length": length, "width": width, "height": height, "wall": wall}
    pad = {"length": length * rng.uniform(0.02, 0.08), "width": 0.3 * min(width, height)}
    low, high = sorted(rng.uniform(0.15, 0.85, 2) * length)
    data: dict[str, Any] = {
        "title": "Random structure",
        "body": {"model": model, "box": box, "material": material(rng), "shear": bool(rng.random() < 0.7)},
        "mesh": {"elements": int(rng.integers(3, 25)), "size": max(width, height) / 2.0, "along": length / 12.0},
        "pads": [ring(rng, "tail", pad, box), ring(rng, "mouth", pad, box) | {"moving": True, "at": 0.0}],
        "slider": {"path": {"kind": "smooth_ramp", "times": [0.1, 0.3], "values": [low, high]}},
        "loads": [load(rng, f"F{k}", length) for k in range(int(rng.integers(1, 3)))],
        "time": {"end": 0.4, "step": 0.02, "rho_inf": pick(rng, (0.0, 0.5, 0.9))},
        "observe": {"start": 0.1 * length, "end": 0.9 * length, "count": 5},
        "reduction": {"coordinates": pick(rng, (1, 3, 5, 6, 6, 7, 8, 8, 10, 12))},
        "compare": {"against": pick(rng, ([], [], ["full"]))},
        "damping": pick(rng, ({}, {"mass": 0.1, "stiffness": 1e-5}, {"ratio": 0.01, "frequencies": [5.0, 50.0]})),
    }
    for part, _, key in (of.partition(".") for of in (MODELS[model].without_effect if model != "auto" else ())):
        data[part].pop(key, None)
    if rng.random() < 0.8:
        data["supports"] = [{"name": "cylinder", "on": pick(rng, ("tail", "tip")), "directions": ["x"]}]
    if rng.random() < 0.3:
        directions = [d for d in DIRECTIONS if rng.random() < 0.5]
        clamp = {"on": pick(rng, ("tail", "tip")), "directions": directions, "points": "all"}
        data["supports"] = [*data.get("supports", []), clamp]
    if rng.random() < 0.6:
        data["gravity"] = {"direction": [float(c) for c in rng.normal(size=3)], "rise": pick(rng, (0.0, 0.1))}
    if rng.random() < 0.5:
        data["masses"] = [mass(rng, length)]
    if rng.random() < 0.2:
        data["recovery"] = {"every": 0.1, "stress": bool(rng.random() < 0.5), "series": False}
    if model == "beam2d":
        flatten(data, rng)
    if any("unilateral" in pads for pads in data["pads"]):
        data["compare"] = {"against": []}
    return data


def flatten(data: dict[str, Any], rng: Random) -> None:
    """Keep what a planar beam allows: forces along x and z, moments about y, no lateral weight."""
    for acting in data["loads"]:
        acting["direction"] = pick(rng, ("x", "z", "z", "ry"))
    for weight in [data["gravity"]] if "gravity" in data else []:
        weight["direction"][1] = 0.0


def material(rng: Random) -> dict[str, float]:
    """Keys of a random material."""
    return {
        "young": 10 ** rng.uniform(6.0, 12.0),
        "poisson": float(rng.uniform(0.0, 0.45)),
        "density": 10 ** rng.uniform(1.0, 4.5),
    }


def ring(rng: Random, name: str, pad: dict[str, float], box: dict[str, float]) -> dict[str, Any]:
    """Keys of pads on some faces, mostly on all of them, within the body."""
    faces: dict[str, list[float]] = {}
    for face in FACES if rng.random() < 0.6 else [face for face in FACES if rng.random() < 0.6] or FACES[:1]:
        half = (box["width"] if face in ("bottom", "top") else box["height"]) / 2.0
        at = float(rng.uniform(0.0, half - pad["width"] / 2.0))
        faces[face] = pick(rng, ([0.0], [at], [-at, at]))
    only_push = bool(rng.random() < 0.15)
    stiffness = pick(rng, (*(10 ** rng.uniform(3.0, 10.0) for _ in range(4)), "rigid"))
    found: dict[str, Any] = {"name": name, "at": pad["length"], "faces": faces, "stiffness": stiffness, **pad}
    return found | ({"unilateral": True, "clearance": pick(rng, (0.0, 1e-3))} if only_push else {})


def load(rng: Random, name: str, length: float) -> dict[str, Any]:
    """Keys of a random load."""
    signal = pick(rng, (10 ** rng.uniform(0.0, 4.0), {"kind": "sine", "amplitude": 100.0, "frequency": 3.0}))
    on = pick(rng, ("tip", "tip", float(rng.uniform(0.0, length))))
    return {"name": name, "on": on, "direction": pick(rng, DIRECTIONS[1:3] + DIRECTIONS), "signal": signal}


def mass(rng: Random, length: float) -> dict[str, Any]:
    """Keys of a random point mass."""
    found: dict[str, Any] = {"name": "payload", "on": pick(rng, ("tip", "tail")), "mass": 10 ** rng.uniform(-1.0, 4.0)}
    if rng.random() < 0.5:
        a, b, c = 10 ** rng.uniform(-2.0, 3.0, 3)
        found["inertia"] = [float(a + b), float(b + c), float(c + a)]
    if rng.random() < 0.3:
        found["at"] = [length, float(rng.normal()), float(rng.normal())]
    return found | {"coupling": pick(rng, ("average", "average", "rigid"))}


def change(data: dict[str, Any], rng: Random) -> None:
    """Change a random value: make it extreme or wrong, off by round-off or by decades, or remove it.

    Values that keep the run short are left alone.
    """
    fixed = ("time", "title", "compare")
    leaves = [place for place in _leaves({k: v for k, v in data.items() if k not in fixed}) if place[1] != "elements"]
    holder, key = leaves[int(rng.integers(len(leaves)))]
    value, kind = holder[key], rng.random()
    if kind < 0.15 or (kind < 0.35 and isinstance(value, float)):
        holder[key] = float(pick(rng, EXTREME))
    elif kind < 0.42:
        holder[key] = pick(rng, WRONG)
    elif kind < 0.47:
        holder[key] = None
    elif isinstance(value, float):
        off = pick(rng, ROUND_OFF) * (-1.0) ** rng.integers(2)
        holder[key] = value * (1.0 + off) if kind < 0.65 else value * 10 ** rng.uniform(-6.0, 6.0)
    elif isinstance(value, str):
        holder[key] = pick(rng, (*FACES, *DIRECTIONS, "tail", "tip", "corners", "wall", "rigid", "average"))


def pick(rng: Random, choices: Any) -> Any:
    """Choose at random."""
    return choices[int(rng.integers(len(choices)))]


def _leaves(data: Any) -> list[tuple[Any, Any]]:
    """Every value that is no table, as its table or list and its key there; lists count as values too."""
    found = []
    for key in list(data) if isinstance(data, dict) else range(len(data)):
        if isinstance(data[key], dict | list):
            found += _leaves(data[key])
        if not isinstance(data[key], dict):
            found.append((data, key))
    return found


def _without_none(data: Any) -> Any:
    """Remove all entries that are None, as TOML has no such value."""
    if isinstance(data, dict):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    return [_without_none(value) for value in data if value is not None] if isinstance(data, list) else data
