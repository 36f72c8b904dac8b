"""Forty scenes on which tolerances are tried: beams on sliders, booms on pads that only push, telescopic booms.

Beams are clamped, pinned, or pinned with a roller, on one to three sliders, on uniform and graded meshes, with and
without a mass at the tip.  Paths have kinks, stops or none; loads are forces and moments, sudden or smooth, tones and
chirps far above the first modes; rho_inf is 0.6 to 1.  Booms are inclined and carry loads beside their axis.
"""

from typing import Any

import numpy as np

from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.run_settings import Accuracy

#: Kind of each scene by its seed: 26 beams, 7 booms on pads that rattle, 7 telescopic booms.
KINDS = ("beam",) * 26 + ("rattling",) * 7 + ("telescopic",) * 7


def tolerance_scene(seed: int) -> Scene:
    """Scene number `seed`, without a tolerance: one of the forty, or a further beam."""
    rng, kind = np.random.default_rng([seed, 46]), KINDS[seed] if seed < len(KINDS) else "beam"
    scene = {"beam": _beam, "rattling": _rattling, "telescopic": _telescopic}[kind](rng)
    scene = scene.model_copy(update={"title": f"{kind} {seed}"})
    check_scene(scene)
    return scene


def with_tolerance(scene: Scene, tolerance: float, mesh: bool = False) -> Scene:
    """Scene with an allowed relative error along the body and at the tip, of the mesh too if `mesh`."""
    allowed = Accuracy(tolerance=tolerance, mesh=mesh)
    return scene.model_copy(update={"accuracy": allowed})


def _beam(rng: np.random.Generator) -> Scene:
    """Scene of a random beam on sliders."""
    length, mass = float(rng.uniform(1.0, 15.0)), float(10.0 ** rng.uniform(-0.5, 1.3))
    first = float(rng.uniform(0.6, 12.0))  # Hz, of the beam on two pins
    stiffness = mass * (2.0 * np.pi * first * (length / np.pi) ** 2) ** 2
    force = 48.0 * stiffness / length**3 * 1e-3 * length  # bends it by a thousandth of its length
    periods = float(rng.uniform(1.0, 8.0))
    end = periods / first
    held = str(rng.choice(["clamped", "clamped", "pinned", "pinned and roller"]))
    supports = [{"on": 0.0, "kind": held.split()[0]}]
    supports += [{"on": length, "kind": "roller"}] * ("roller" in held)
    ahead = np.cumsum(rng.uniform(0.05, 0.22, int(rng.choice([0, 1, 1, 2])))) * length
    offsets = [0.0, *ahead.tolist()]
    path = _path(rng, 0.13 * length, 0.9 * length - offsets[-1], end)
    loads = [_load(rng, f"l{k}", length, force, first, end) for k in range(int(rng.integers(1, 4)))]
    masses = [{"name": "payload", "on": "tip", "mass": float(rng.uniform(0.1, 0.8)) * mass * length}]
    grading = float(rng.choice([1.0, rng.uniform(0.3, 1.0), rng.uniform(1.0, 4.5)]))
    inclined = {"acceleration": float(rng.uniform(0.02, 0.3)) * force / (mass * length), "rise": 0.0}
    inclined["inclination"] = float(rng.uniform(0.0, 40.0))
    return Scene.model_validate(
        {
            "title": "beam",
            "body": {"profile": {"length": length, "bending_stiffness": stiffness, "mass_per_length": mass}},
            "mesh": {"elements": int(rng.integers(24, 72)), "grading": grading},
            "supports": supports,
            "slider": {"path": path, "offsets": offsets},
            "loads": loads,
            "masses": masses if "roller" not in held and rng.random() < 0.4 else [],
            **({"gravity": inclined} if rng.random() < 0.4 else {}),
            "time": {
                "end": end,
                "step": end / int(rng.choice([2000, 3000, 4000])),
                "rho_inf": float(rng.choice([0.6, rng.uniform(0.6, 1.0), 0.95, 1.0])),
            },
            "damping": {
                "ratio": float(rng.choice([0.0, 0.003, 0.005, 0.02])),
                "frequencies": [first, float(rng.uniform(12.0, 28.0)) * first],
            },
            "reduction": {"basis": "free_modes", "flexibility": True, "coordinates": int(rng.choice([6, 12, 16]))},
            "simulation": {"simulators": ["march"]},
            "compare": {"against": [], "richer": "none"},
        }
    )


def _path(rng: np.random.Generator, low: float, high: float, end: float) -> dict[str, Any]:
    """Keys of a random path between `low` and `high` m within `end` s."""
    match rng.choice(["ramp", "ramp", "stops", "table", "sines"]):
        case "sines":
            middle, reach = 0.5 * (low + high), 0.5 * (high - low)
            first, second = 0.6 * reach, 0.3 * reach
            waves = rng.uniform(0.3, 2.0, 2) / end * [1.0, 3.0]
            terms = [
                {"kind": "sine", "amplitude": first, "frequency": float(waves[0]), "offset": middle},
                {"kind": "sine", "amplitude": second, "frequency": float(waves[1]), "phase": float(rng.uniform(0, 6))},
            ]
            return {"kind": "sum", "terms": terms}
        case "table":
            times = np.linspace(0.0, end, int(rng.integers(5, 11)))
            middle, reach = 0.5 * (low + high), 0.35 * (high - low)
            values = rng.uniform(middle - reach, middle + reach, len(times))
            return {"kind": "table", "times": times.tolist(), "values": values.tolist()}
        case "stops":
            count = int(rng.integers(2, 5))
            times = np.sort(rng.uniform(0.05, 1.0, 2 * count)) * end + np.arange(2 * count) * 0.01 * end
            values = np.repeat(rng.uniform(low, high, count + 1), 2)[1:-1]
            return {"kind": "smooth_ramp", "times": times.tolist(), "values": values.tolist()}
        case kind:
            count = int(rng.integers(2, 5))
            times = np.sort(rng.uniform(0.05, 0.95, count)) * end + np.arange(count) * 0.02 * end
            return {"kind": str(kind), "times": times.tolist(), "values": rng.uniform(low, high, count).tolist()}


def _load(rng: np.random.Generator, name: str, length: float, force: float, first: float, end: float) -> dict[str, Any]:
    """Keys of a random load; `first` is the beam's first frequency in Hz, `force` bends it by 1/1000 of its length."""
    turns = rng.random() < 0.25
    size = float(rng.uniform(0.3, 1.0)) * force * (0.2 * length if turns else 1.0)
    match rng.choice(["step", "steps", "sines", "chirp", "chirp", "pulses", "constant"]):
        case "step":
            signal: dict[str, Any] = {"kind": "step", "time": float(rng.uniform(0.05, 0.5)) * end, "after": size}
        case "steps":
            terms = [
                {"kind": "step", "time": float(at) * end, "after": float(share) * size}
                for at, share in zip(rng.uniform(0.1, 0.9, 3), rng.uniform(-1.0, 1.0, 3), strict=True)
            ]
            signal = {"kind": "sum", "terms": terms}
        case "sines":
            terms = [
                {"kind": "sine", "amplitude": size / 3.0, "frequency": float(tone), "phase": float(rng.uniform(0, 6))}
                for tone in rng.uniform(0.2, 1.0, 3) * [2.0, 8.0, 18.0] * first
            ]
            signal = {"kind": "sum", "terms": terms}
        case "chirp":  # through several modes, far above the first
            ends = [float(rng.uniform(1.0, 4.0)) * first, float(rng.uniform(9.0, 40.0)) * first]
            signal = {"kind": "chirp", "amplitude": size, "times": [0.0, end], "frequencies": ends}
        case "pulses":
            at = np.sort(rng.uniform(0.05, 0.9, 2)) * end
            width = float(rng.uniform(0.02, 0.05)) * end
            times = [at[0], at[0] + width, at[0] + 2 * width, *(at[1] + np.array([2.1, 3.1, 4.1]) * width)]
            signal = {"kind": "smooth_ramp", "times": times, "values": [0.0, size, 0.0, 0.0, -size, 0.0]}
        case _:
            signal = {"kind": "constant", "amount": size}
    on = float(rng.choice([rng.uniform(0.1, 0.95) * length, length]))
    return {"name": name, "on": on, "direction": "ry" if turns else "z", "signal": signal}


def _rattling(rng: np.random.Generator) -> Scene:
    """Scene of a random boom on twelve pads that only push, some with play, inclined, with loads beside its axis."""
    kind = "ramp" if rng.random() < 0.3 else "smooth_ramp"
    times, values = [0.2, round(rng.uniform(0.7, 1.3), 3)], [1.5, round(rng.uniform(2.0, 4.0), 3)]
    sizes, tones = rng.uniform(600.0, 2500.0, 2), rng.uniform(1.0, 12.0, 2)
    loads = ", ".join(
        f"{{name='{way}',on='tip',direction='{way}',signal={{kind='sine',amplitude={size:.6g},frequency={tone:.6g}}}}}"
        for way, size, tone in zip(("z", str(rng.choice(["y", "rx"]))), sizes, tones, strict=True)
    )
    changes = [
        f"body.box.length={rng.uniform(5.0, 8.0):.3f}",
        "mesh.elements=24",
        "time.end=1.5",
        f"time.step={rng.choice([5e-4, 1e-3])}",
        f"time.rho_inf={rng.choice([0.6, 0.8, 1.0])}",
        f"slider.path={{kind={kind!r}, times={times}, values={values}}}",
        "observe.end=4.8",
        f"reduction.coordinates={rng.choice([8, 10, 12])}",
        f"damping={{ratio={rng.choice([0.005, 0.02])}, frequencies=[10.0, 60.0]}}",
        f"gravity.inclination={rng.uniform(0.0, 30.0):.4g}",
        f"loads=[{loads}]",
        "compare.against=[]",
        "compare.richer='none'",
    ]
    for ring in ("tail", "mouth"):
        changes += [f"pads.{ring}.unilateral=true", f"pads.{ring}.stiffness={10.0 ** rng.uniform(7.5, 9.0):.4g}"]
    if rng.random() < 0.5:
        changes.append(f"pads.mouth.clearance={{left={rng.uniform(1e-4, 1e-3):.3g},right=1e-4}}")
    return scenes.load("boom_beam", changes).model_copy(update={"recovery": None})


def _telescopic(rng: np.random.Generator) -> Scene:
    """Scene of two or three sections on bilateral or unilateral pads, inclined, with a payload and a chirp."""
    count, length = int(rng.integers(2, 4)), float(rng.uniform(4.0, 7.0))
    pushes = rng.random() < 0.4
    ring = {"at": 0.15, "stiffness": float(10.0 ** rng.uniform(7.0, 8.7)), "unilateral": pushes}
    sections: list[dict[str, Any]] = []
    for k in range(count):
        box = {"length": length, "width": 0.34 - 0.04 * k, "height": 0.46 - 0.05 * k, "wall": 0.009 - 0.001 * k}
        part: dict[str, Any] = {
            "name": f"s{k}",
            "body": {"model": "beam2d", "box": box},
            "mesh": {"elements": int(rng.integers(16, 31))},
            "reduction": {"coordinates": (3 if k else 0) + int(rng.integers(2, 5))},
        }
        if k == 0:
            part["supports"] = [{"kind": "clamped"}]
        else:
            first, last = rng.uniform(0.15 * length, 0.7 * length, 2).tolist()
            start = float(rng.uniform(0.1, 0.4))
            signal = {"kind": str(rng.choice(["ramp", "smooth_ramp"])), "times": [start, start + 0.7]}
            part["joint"] = {"tail": [ring], "mouth": [ring], "extension": signal | {"values": [first, last]}}
        if k == count - 1:
            part["masses"] = [{"name": "m", "on": "tip", "mass": float(rng.uniform(50.0, 350.0))}]
            tones = [float(rng.uniform(0.2, 1.0)), float(rng.uniform(3.0, 20.0))]
            chirp = {"kind": "chirp", "amplitude": 500.0, "times": [0.0, 1.5], "frequencies": tones}
            part["loads"] = [{"name": "F", "on": "tip", "direction": "z", "signal": chirp}]
        sections.append(part)
    return Scene.model_validate(
        {
            "title": "telescopic",
            "sections": sections,
            "gravity": {"rise": 0.0, "inclination": float(rng.uniform(0.0, 40.0))},
            "damping": {"ratio": float(rng.choice([0.002, 0.005, 0.02])), "frequencies": [1.0, 30.0]},
            "time": {"end": 1.5, "step": 1e-3, "rho_inf": float(rng.choice([0.7, 0.8, 1.0]))},
            "compare": {"against": [], "richer": "none"},
        }
    )
