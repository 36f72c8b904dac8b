"""Random scenes, with damping or without: planar beams on one slider or two, booms in space, and driven booms."""

import numpy as np

from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.checks import check_scene

END = 2.0


def random_scene(seed: int) -> Scene:
    """Scene of a random planar beam, in seven of ten cases, or of a random boom in space.

    Loads go up to 44 Hz, some set in at once, and a third of the paths has kinks.
    """
    rng = np.random.default_rng(seed)
    if rng.random() >= 0.7:
        return scenes.load("boom_beam", _boom(rng))
    scene = Scene.model_validate(_beam(rng))
    check_scene(scene)
    return scene


def sliding_scene(seed: int) -> Scene:
    """Random scene; each fourth one is a beam on three sliders, all others are those of `random_scene`."""
    if seed % 4:
        return random_scene(seed)
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(0.3, 0.6, 2).tolist()
    scene = Scene.model_validate(_beam(rng, [0.0, first, first + second]))
    check_scene(scene)
    return scene


def pushing_scene(seed: int) -> Scene:
    """Scene of a random boom on twelve pads that only push; those at the sides of some have play."""
    rng = np.random.default_rng(seed)
    changes = _boom(rng)
    for ring in ("tail", "mouth"):
        changes += [f"pads.{ring}.unilateral=true", f"pads.{ring}.stiffness={10.0 ** rng.uniform(7.5, 9.0):.4g}"]
    if rng.random() < 0.4:
        changes.append(f"pads.mouth.clearance={{left={rng.uniform(1e-4, 1e-3):.3g},right=1e-4}}")
    return scenes.load("boom_beam", changes)


def random_signal(rng: np.random.Generator, amplitude: float, highest: float) -> dict:
    """Keys of a random signal of a load, with an amplitude in N and frequencies up to `highest` Hz."""
    match rng.integers(5):
        case 0:
            frequencies = [0.5, float(rng.uniform(5.0, highest))]
            return {"kind": "chirp", "amplitude": amplitude, "times": [0.0, END], "frequencies": frequencies}
        case 1:
            return {"kind": "sine", "amplitude": amplitude, "frequency": float(rng.uniform(0.5, highest))}
        case 2:
            return {"kind": "step", "time": float(rng.uniform(0.1, 0.5)), "after": amplitude}
        case 3:
            at, width = float(rng.uniform(0.2, 0.8)), float(rng.uniform(0.02, 0.3))
            times = [at, at + width / 2.0, at + width]
            return {"kind": "smooth_ramp", "times": times, "values": [0.0, amplitude, 0.0]}
        case _:
            return {"kind": "constant", "amount": amplitude}


def _beam(rng: np.random.Generator, offsets: list[float] | None = None) -> dict:
    """Keys of a random planar beam on sliders with these offsets, or on one or two."""
    length, stiffness = float(rng.uniform(3.0, 8.0)), float(10.0 ** rng.uniform(4.3, 6.0))
    mass = float(rng.uniform(40.0, 120.0))
    if offsets is None:
        offsets = [0.0, float(rng.uniform(0.3, 0.9))] if rng.random() < 0.5 else [0.0]
    values = rng.uniform(0.15 * length, 0.9 * length - offsets[-1], 2).tolist()
    loads = [{"name": "F", "on": length, "signal": random_signal(rng, 50.0, 44.0)}]
    if rng.random() < 0.4:
        loads.append(
            {"name": "G", "on": float(rng.uniform(0.3, 0.8) * length), "signal": random_signal(rng, 30.0, 20.0)}
        )
    ratio = float(rng.choice([0.0, 0.0, 0.005, 0.01, 0.02, 0.05]))
    kind = "ramp" if rng.random() < 0.4 else "smooth_ramp"
    path = {"kind": kind, "times": [0.2, 0.2 + float(rng.uniform(0.4, 1.4))], "values": values}
    return {
        "title": "random beam",
        "body": {"profile": {"length": length, "bending_stiffness": stiffness, "mass_per_length": mass}},
        "mesh": {"elements": 30},
        "supports": [{"on": 0.0, "kind": "clamped" if rng.random() < 0.3 else "pinned"}],
        "slider": {"path": path, "offsets": offsets},
        "loads": loads,
        "time": {"end": END, "step": 1e-3},
        "damping": {"ratio": ratio, "frequencies": [5.0, 40.0]},
        "reduction": {
            "basis": "free_modes",
            "flexibility": True,
            "coordinates": int(rng.choice([5, 6, 8, 10, 12, 16, 20])),
        },
        "simulation": {"simulators": ["march"]},
    }


def _boom(rng: np.random.Generator) -> list[str]:
    """Settings by which the reference boom becomes a random one."""
    kind = "ramp" if rng.random() < 0.3 else "smooth_ramp"
    times, values = [0.2, round(rng.uniform(0.8, 1.8), 3)], [1.5, round(rng.uniform(2.0, 4.0), 3)]
    signal = ", ".join(f"{name} = {value!r}" for name, value in random_signal(rng, 1500.0, 40.0).items())
    ratio = rng.choice([0.0, 0.005, 0.02, 0.05])
    changes = [
        f"body.box.length={rng.uniform(5.0, 9.0):.3f}",
        "mesh.elements=24",
        "recovery.every=0.05",
        f"time.end={END}",
        f"slider.path={{kind={kind!r}, times={times}, values={values}}}",
        "observe.end=4.8",
        f"reduction.coordinates={rng.choice([8, 10, 12, 16])}",
        f"damping={{ratio={ratio}, frequencies=[10.0, 60.0]}}",
        f"loads=[{{name='tip', on='tip', direction='{rng.choice(['y', 'z'])}', signal={{{signal}}}}}]",
    ]
    places = rng.uniform(0.2, 4.8, 2).tolist()
    probes = (f"{{name='{name}',at=[{x!r},0.15,0.2]}}" for name, x in zip("ab", places, strict=True))
    return [*changes, f"probes=[{','.join(probes)}]"]


def random_boom(seed: int) -> Scene:
    """Two to four sections on pads that hold both ways, three of four planar, some joints follow the one before."""
    rng = np.random.default_rng(seed)
    planar, count, length = rng.random() < 0.75, int(rng.integers(2, 5)), float(rng.uniform(4.0, 7.0))
    sides = {"bottom": [0.0], "top": [0.0]} if planar else {"bottom": [-0.05, 0.05], "top": [0.0], "left": [0.0]}
    ring = {"at": 0.15, "stiffness": float(10.0 ** rng.uniform(7.0, 9.0)), "faces": sides, "unilateral": False}
    ways = ["ramp", "smooth_ramp", "smooth_ramp"]
    sections = []
    for k in range(count):
        box = {"length": length, "width": 0.30 - 0.04 * k, "height": 0.40 - 0.04 * k, "wall": 0.008 - 0.001 * k}
        least = (3 if planar else 6) if k else 0
        body = {"model": "beam2d" if planar else "beam3d", "box": box}
        part = {"name": f"section {k}", "body": body, "mesh": {"elements": int(rng.integers(10, 17))}}
        part["reduction"] = {"coordinates": least + int(rng.integers(1 if k else 2, 5))}
        if k == 0:
            part["supports"] = [{"kind": "clamped"}]
        else:
            first, last = rng.uniform(0.1 * length, 0.75 * length, 2).tolist()
            times = [0.1, 0.1 + float(rng.uniform(0.5, 1.0))]
            signal = {"kind": str(rng.choice(ways)), "times": times, "values": [first, last]}
            follows = k > 1 and rng.random() < 0.3
            driven = {"follows": f"section {k - 1}"} if follows else {"extension": signal}
            part["joint"] = {"tail": [ring], "mouth": [ring], **driven}
        if k == count - 1:
            part["masses"] = [{"name": "payload", "on": "tip", "mass": float(rng.uniform(50.0, 300.0))}]
            part["loads"] = [{"name": "F", "on": "tip", "signal": random_signal(rng, 1000.0, 15.0)}]
        sections.append(part)
    ratio = float(rng.choice([0.0, 0.005, 0.01, 0.03]))
    boom = Scene.model_validate(
        {
            "title": "random boom",
            "sections": sections,
            "damping": {"ratio": ratio, "frequencies": [1.0, 40.0]},
            "time": {"end": 1.2, "step": 1e-3, "rho_inf": float(rng.choice([0.8, 1.0]))},
        }
    )
    check_scene(boom)
    return boom


def driven_boom(seed: int) -> Scene:
    """Scene of a random boom of two to five sections that cylinders push out fast or with kinks; most are planar.

    The cylinders are rigid or elastic.
    """
    rng = np.random.default_rng([seed, 21])
    planar, count, length = rng.random() < 0.75, int(rng.integers(2, 6)), float(rng.uniform(4.0, 7.0))
    sides = {"bottom": [0.0], "top": [0.0]} if planar else {"bottom": [-0.05, 0.05], "top": [0.0], "left": [0.0]}
    material = {"young": 70e9, "density": 2700.0} if rng.random() < 0.4 else {"young": 210e9, "density": 7850.0}
    sections = []
    for k in range(count):
        box = {"length": length, "width": 0.34 - 0.04 * k, "height": 0.44 - 0.04 * k, "wall": 0.009 - 0.001 * k}
        body = {"model": "beam2d" if planar else "beam3d", "box": box, "material": material}
        least = (3 if planar else 6) if k else 0
        part = {"name": f"section {k}", "body": body, "mesh": {"elements": int(rng.integers(12, 21))}}
        part["reduction"] = {"coordinates": least + int(rng.integers(2, 5))}
        if k == 0:
            part["supports"] = [{"kind": "clamped"}]
        else:
            ring = {"at": 0.15, "stiffness": float(10.0 ** rng.uniform(7.0, 9.0)), "faces": sides, "unilateral": False}
            stiffness = "rigid" if rng.random() < 0.5 else float(10.0 ** rng.uniform(6.5, 9.0))
            follows = k > 1 and rng.random() < 0.3
            if follows and sections[-1]["joint"]["cylinder"]["stiffness"] != "rigid":
                stiffness = sections[-1]["joint"]["cylinder"]["stiffness"]  # what hangs on what gives way does so too
            driven = {"follows": f"section {k - 1}"} if follows else {"extension": _extension(rng, length)}
            part["joint"] = {"tail": [ring], "mouth": [ring], "cylinder": {"stiffness": stiffness}, **driven}
        if k == count - 1:
            part["masses"] = [{"name": "payload", "on": "tip", "mass": float(rng.uniform(50.0, 400.0))}]
            part["loads"] = [{"name": "F", "on": "tip", "signal": random_signal(rng, 1000.0, 10.0)}]
        sections.append(part)
    ratio = float(rng.choice([0.0, 0.003, 0.005, 0.01, 0.03]))
    boom = Scene.model_validate(
        {
            "title": "driven boom",
            "sections": sections,
            "gravity": {"rise": 0.0, "inclination": float(rng.choice([0.0, rng.uniform(0.0, 60.0)]))},
            "damping": {"ratio": ratio, "frequencies": [1.0, 30.0]},
            "time": {"end": 1.6, "step": float(rng.choice([5e-4, 1e-3])), "rho_inf": float(rng.choice([0.8, 1.0]))},
        }
    )
    check_scene(boom)
    return boom


def _extension(rng: np.random.Generator, length: float) -> dict:
    """Keys of a random extension that takes half a second to one, with kinks or without, sometimes there and back."""
    values = rng.uniform(0.1 * length, 0.7 * length, int(rng.integers(2, 4))).tolist()
    times = (0.1 + np.cumsum([0.0, *rng.uniform(0.4, 0.7, len(values) - 1)])).tolist()
    return {"kind": str(rng.choice(["ramp", "smooth_ramp"])), "times": times, "values": values}
