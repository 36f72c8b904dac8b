"""Random booms of several sections: accepted ones run to the end, and every section obeys Newton's law."""

from pathlib import Path
from typing import Any

import numpy as np
from fuzz import toml
from fuzz.mutations import Random
from fuzz.structures import pick
from fuzz.verdict import NonsenseError, ensure_finite, strictly_read
from impulses import impulses

from pmr import scene as scenes
from pmr.scene import Scene

STEP, STEPS = 2e-3, 20
NAMES = ("base", "second", "third", "fly")
#: What forces may miss of a section's change of momentum, over the largest of them.
MISSED = 1e-9


def case(number: int, rng: Random, folder: Path) -> str:
    """Read a random boom and run it if it is accepted; return the outcome in a few words."""
    (folder / "scene.toml").write_text(toml.written(boom(rng)))
    scene = scenes.load_any(folder / "scene.toml")
    return ran(scene, folder)


def boom(rng: Random) -> dict[str, Any]:
    """Keys of two to four beams, in a plane or in space, some of which can't be built.

    Some reach too far, are too wide, or have supports that hold no roll.
    """
    count, planar = int(rng.integers(2, 5)), bool(rng.random() < 0.6)
    length = float(rng.uniform(3.0, 8.0))
    sections = [{"name": NAMES[k], **section(rng, k, planar, length)} for k in range(count)]
    points = planar and bool(rng.random() < 0.3)
    for k in range(1, count):
        mixed = bool(rng.random() < 0.05)
        sections[k]["joint"] = joint(rng, planar, points != mixed) | extension(rng, k, length)
    sections[0]["supports"] = pick(rng, [held(planar)] * 3 + [luffing(planar, length)])
    if rng.random() < 0.5:
        sections[-1]["masses"] = [{"name": "payload", "on": "tip", "mass": float(10.0 ** rng.uniform(0.0, 3.0))}]
    amount = float(10.0 ** rng.uniform(1.0, 4.0))
    signals = ({"kind": "sine", "amplitude": amount, "frequency": float(rng.uniform(1.0, 30.0))}, -amount)
    sections[-1]["loads"] = [{"name": "F", "on": "tip", "direction": "z", "signal": pick(rng, signals)}]
    slope = float(rng.uniform(-0.5, 1.2))
    pushing = any(one["joint"]["tail"][0]["unilateral"] for one in sections[1:])
    return {
        "title": "Random boom",
        "sections": sections,
        "gravity": {"direction": [-np.sin(slope), 0.0, -np.cos(slope)], "rise": 0.0},
        "damping": {"mass": 0.0, "stiffness": 1e-5},
        "time": {"end": STEPS * STEP, "step": STEP, "rho_inf": pick(rng, (1.0, 1.0, 0.8))},
        "compare": {"against": [] if pushing else pick(rng, ([], ["full"]))},
    }


def section(rng: Random, number: int, planar: bool, length: float) -> dict[str, Any]:
    """Keys of a section."""
    shrink = 0.04 * (number + rng.uniform(-0.4, 0.4))
    box = {"width": 0.35 - shrink, "height": 0.45 - shrink, "wall": 8e-3, "length": length * rng.uniform(0.8, 1.1)}
    least = 3 if planar else 6
    return {
        "body": {"model": "beam2d" if planar else "beam3d", "box": box},
        "mesh": {"elements": int(rng.integers(4, 13))},
        "reduction": {"coordinates": int(rng.integers(1, 5)) + (least if number else 0)},
    }


def held(planar: bool) -> list[dict[str, Any]]:
    """Keys of a clamp."""
    return [{"kind": "clamped"} if planar else {"kind": "clamped", "points": "all"}]


def luffing(planar: bool, length: float) -> list[dict[str, Any]]:
    """Keys of a pivot and a luffing cylinder."""
    pivot = [{"kind": "pinned"}] if planar else [{"directions": ["x", "y", "z", "rx", "rz"], "on": "tail"}]
    return [*pivot, {"name": "luffing", "directions": ["z"], "on": 0.25 * length, "stiffness": 5e7}]


def joint(rng: Random, planar: bool, points: bool) -> dict[str, Any]:
    """Keys of a joint: pads of one kind at both ends, or points; unilateral ones may have play."""
    unilateral = bool(rng.random() < 0.5)
    stiffness = 10.0 ** rng.uniform(6.0, 7.0 if unilateral else 9.0)  # stiff ones that push take many parts a step
    ring: dict[str, Any] = {"unilateral": unilateral, "stiffness": float(stiffness)}
    if unilateral and rng.random() < 0.3:
        ring["clearance"] = float(rng.uniform(0.0, 2e-3))
    if not unilateral and rng.random() < 0.1:
        ring["stiffness"] = "rigid"
    if rng.random() < 0.4:
        ring["friction"] = float(rng.uniform(0.0, 0.3))
    if not points:
        beside = [-0.06, 0.06] if rng.random() < 0.9 else [0.0]
        ring["faces"] = {"bottom": beside, "top": beside} | ({} if planar else {"left": [0.0], "right": [0.0]})
    ends = {end: [ring | {"at": float(rng.uniform(0.15, 0.4))}] for end in ("tail", "mouth")}
    cylinder = {} if rng.random() < 0.7 else {"cylinder": {"stiffness": float(10.0 ** rng.uniform(6.0, 9.0))}}
    rigid = {"rigid_overlap": True} if planar and rng.random() < 0.15 else {}
    return ends | cylinder | rigid


def extension(rng: Random, number: int, length: float) -> dict[str, Any]:
    """Keys of an extension or an overlap, or of a section that follows another one."""
    if number > 1 and rng.random() < 0.4:
        return {"follows": NAMES[int(rng.integers(1, number))], "ratio": float(rng.uniform(0.3, 1.2))}
    low, high = (rng.uniform(0.3, 0.75, 2) * length).tolist()
    signals = (low, {"kind": "smooth_ramp", "times": [0.0, STEPS * STEP], "values": [low, 0.9 * low + 0.1 * high]})
    return {pick(rng, ("extension", "extension", "overlap")): pick(rng, signals)}


def ran(boom: Scene, folder: Path) -> str:
    """Run a boom to the end; fail unless results are finite, files valid, and Newton's law holds."""
    from pmr import run
    from pmr.fem.compat import MPI

    outcome = run(boom, MPI.COMM_SELF)
    assert outcome is not None
    result = outcome.result
    for name, response in result.responses.items():
        for part in ("displacement", "slider_force", "force_peaks"):
            ensure_finite(f"{name}.{part}", getattr(response, part))
    result.save(folder / "results")
    summary = strictly_read((folder / "results" / "summary.json").read_text())
    missed = newton(boom)
    if not missed < MISSED:
        raise NonsenseError(f"forces miss {missed:.1e} of a change of momentum")
    return f"{summary['max_displacement']:.2e} m, Newton to {missed:.0e}, {len(summary['warnings'])} warnings"


def newton(boom: Scene) -> float:
    r"""Largest difference between impulses on a section and its change of momentum in a step, as a share.

    It is relative to the largest force times the step.  Momentum is :math:`r^T M V \dot q` of the full mass, with r a
    translation; forces of pads count by their faces.
    """
    from pmr.fem.compat import MPI
    from pmr.fullmodel.build import build_bodies
    from pmr.reduction.bodies import reduce_bodies
    from pmr.simulation import Excitation
    from pmr.simulation.native import systems
    from pmr.system.from_scene import system_of

    built = build_bodies(boom, MPI.COMM_SELF)
    sections = reduce_bodies(boom, built)
    system = system_of(boom, {name: one.model for name, one in sections.items()})
    given = Excitation.from_scene(boom)
    found = systems.simulate(system, given, systems.static_start(system, given))
    assert found.parts is not None
    ones, worst, size = np.ones(STEPS + 1, np.int64), 0.0, max(np.abs(found.peaks).max(), np.abs(found.forces).max())
    pads = impulses(given.stepping, ones, found.forces) if found.impulses is None else found.impulses
    fine = given.with_stepping(given.stepping.divide(int(found.parts.max())))
    loads = dict(zip(system.input_names, fine.forces(system.input_names).T, strict=True))
    for name in boom.names[1:]:
        one = built[name]
        up = one.model.rigid.coordinates[:, one.structure.model.directions.index("z")]
        whole = one.model.gather()
        assert whole is not None
        force = sum(loads[f"{name}.{load}"] * (up @ whole.B)[k] for k, load in enumerate(whole.input_names))
        given_by = impulses(given.stepping, found.parts, np.reshape(force, (-1, 1)))[:, 0]
        for contact, pushed in zip(system.contacts, pads.T, strict=True):
            for place, sign in ((contact.inner, -1.0), (contact.outer, 1.0)):
                if place is not None and place.body == name:
                    given_by = given_by + sign * contact.direction * outward(place.row) * pushed
        v = found.bodies[name].v
        momentum = v @ (up @ whole.M @ sections[name].V[:, : v.shape[1]])
        worst = max(worst, np.abs(np.diff(momentum) - given_by[1:]).max() / (size * given.stepping.step))
    return float(worst)


def outward(row: str) -> float:
    """Component along z of what a row measures."""
    return 1.0 if row == "deflection" or " top" in row else -1.0 if " bottom" in row else 0.0
