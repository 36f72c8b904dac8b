"""Compare beams with shells of the same boxes: twenty random ones, of one to three sections.

``python -m benchmarks.walls [FIRST [LAST]]`` prints errors of beams over a whole run, with walls that give way and with
rigid ones: along the bodies, at the tip, in the forces of pads, in the largest displacement and in the two lowest
frequencies along the path.  In brackets is the estimate of ``budget.model``, over that error.

``python -m benchmarks.walls auto [FIRST [LAST]]`` runs the boxes with ``model = "auto"`` and its tolerance of 5 %, and
prints which models each run tried, its estimate and its error.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pmr
from pmr.compare.model_part import Motion, largest_model_error, model_budget
from pmr.fem.compat import MPI
from pmr.pipeline.model_errors import measure_model
from pmr.pipeline.scenes import run
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.model_ladder import comparable_scene
from pmr.system.system import System

Array = NDArray[np.float64]

BOXES, WITHIN = 20, 0.05
#: Modes of every body, of what is true.
MODES = 40
#: What `budget.model` states that is looked at.
STATED = ("beam", "tip", "pad_force", "largest", "frequency")
#: What the boxes are drawn with.
DRAWN = 52_300
END = 4.0
#: Faces, and the side of the box that each lies along.
ALONG = {"bottom": "width", "top": "width", "left": "height", "right": "height"}
CELLS = {"size": 0.1, "along": 0.15}
SHELL, GIVES = {"model": "shell"}, "walls give way"
BODIES = {GIVES: {"model": "beam3d", "walls": "give"}, "walls rigid": {"model": "beam3d"}}


def random_box(seed: int, body: dict[str, Any]) -> Scene:
    """Scene of a random box boom: seeds below 10 have one section, below 16 two, others three.

    Pads sit anywhere across the faces, on each face independently; `body` holds the keys of the structural model.
    """
    rng = np.random.default_rng(DRAWN + seed)
    return _one(rng, body) if seed < 10 else _several(rng, 2 if seed < 16 else 3, body)


def _one(rng: np.random.Generator, body: dict[str, Any]) -> Scene:
    """Scene of one section that slides through two rings of pads."""
    box = _box(rng)
    length = box["length"]
    low, high = float(rng.uniform(0.2, 0.35)) * length, float(rng.uniform(0.5, 0.7)) * length
    rings = [_ring(rng, [box]), _ring(rng, [box])]
    at = rings[0]["length"] / 2.0 + float(rng.uniform(0.0, 0.2))
    scene = Scene.model_validate(
        {
            "title": "Box",
            "pads": [{"name": "tail", "at": at, **rings[0]}, {"name": "mouth", "moving": True, **rings[1]}],
            "supports": [{"name": "cylinder", "directions": ["x"]}],
            "slider": {"path": _there_and_back(low, high)},
            **_body(box, body),
            **_carried(rng),
            **_common(),
            "observe": {"start": 0.05 * length, "end": 0.95 * length},
        }
    )
    check_scene(scene)
    return scene


def _several(rng: np.random.Generator, count: int, body: dict[str, Any]) -> Scene:
    """Scene of `count` sections that slide in one another."""
    boxes = [_box(rng)]
    for _ in range(1, count):
        before, wall = boxes[-1], _wall(rng)
        gap = float(rng.uniform(0.01, 0.03))
        smaller = {side: before[side] - before["wall"] - wall - 2.0 * gap for side in ("width", "height")}
        boxes.append({"length": before["length"], "wall": wall, **smaller})
    sections: list[dict[str, Any]] = []
    for k, box in enumerate(boxes):
        section = {"name": ("base", "middle", "fly")[k if k + 1 < count else 2], **_body(box, body)}
        section["observe"] = {"start": 0.05 * box["length"], "end": 0.95 * box["length"]}
        section["reduction"] = {"coordinates": 10 if k else 4}
        if k == 0:
            section["supports"] = [{"name": "clamp", "kind": "clamped", "points": "all"}]
        else:
            low, high = float(rng.uniform(0.1, 0.25)), float(rng.uniform(0.5, 0.7))
            pads = {end: [_joint_ring(rng, boxes[k - 1 : k + 1])] for end in ("tail", "mouth")}
            section["joint"] = {"extension": _there_and_back(low * box["length"], high * box["length"]), **pads}
        sections.append(section)
    sections[-1] |= _carried(rng)
    boom = Scene.model_validate({"title": "Boxes", "sections": sections, **_common(), "gravity": {"rise": 0.0}})
    check_scene(boom)
    return boom


def _box(rng: np.random.Generator) -> dict[str, float]:
    """Random dimensions of a box in m."""
    sizes = {"length": rng.uniform(4.0, 8.0), "width": rng.uniform(0.25, 0.5), "height": rng.uniform(0.3, 0.6)}
    return {key: float(value) for key, value in sizes.items()} | {"wall": _wall(rng)}


def _wall(rng: np.random.Generator) -> float:
    """Random thickness of a wall in m."""
    return float(rng.uniform(0.004, 0.012))


def _ring(rng: np.random.Generator, boxes: list[dict[str, float]]) -> dict[str, Any]:
    """Keys of a random ring: one pad or two on each face, anywhere across the face of the smallest of the boxes."""
    width, faces = float(rng.uniform(0.05, 0.09)), {}
    for face, side in ALONG.items():
        room = min(box[side] for box in boxes) / 2.0 - width / 2.0
        first = float(rng.uniform(-room, room))
        places = [first]
        if rng.random() < 0.6:  # another one, where it is beside the first
            second = float(rng.uniform(-room, room))
            places += [second] * (abs(second - first) > width)
        faces[face] = sorted(places)
    return {
        "faces": faces,
        "length": float(rng.uniform(0.2, 0.4)),
        "width": width,
        "stiffness": float(10.0 ** rng.uniform(7.7, 9.0)),
    }


def _joint_ring(rng: np.random.Generator, boxes: list[dict[str, float]]) -> dict[str, Any]:
    """Keys of a random ring between two sections; its pads hold both ways."""
    return {"at": 0.2 + float(rng.uniform(0.0, 0.2)), "unilateral": False, **_ring(rng, boxes)}


def _there_and_back(low: float, high: float) -> dict[str, Any]:
    """Keys of a path from `low` to `high` m and back."""
    return {"kind": "smooth_ramp", "times": [0.5, 2.0, 3.5], "values": [low, high, low]}


def _body(box: dict[str, float], body: dict[str, Any]) -> dict[str, Any]:
    """Keys of a body's box and model, and of its mesh if that has cells."""
    uses_cells = body["model"] in ("shell", "auto") or "walls" in body
    return {"body": {"box": box, **body}, "mesh": CELLS if uses_cells else {}}


def _carried(rng: np.random.Generator) -> dict[str, Any]:
    """Keys of a random payload and random loads at the tip."""
    push = {"kind": "chirp", "amplitude": float(rng.uniform(500, 2000)), "times": [0.0, END], "frequencies": [0.5, 3.0]}
    gust = {"kind": "smooth_ramp", "times": [1.0, 1.5, 2.0], "values": [0.0, float(rng.uniform(200, 1000)), 0.0]}
    return {
        "masses": [{"name": "payload", "on": "tip", "mass": float(rng.uniform(100.0, 400.0))}],
        "loads": [
            {"name": "push", "on": "tip", "direction": "z", "signal": push},
            {"name": "gust", "on": "tip", "direction": "y", "signal": gust},
        ],
    }


def _common() -> dict[str, Any]:
    """Keys that all scenes share."""
    return {
        "gravity": {},
        "damping": {"ratio": 0.01, "frequencies": [3.0, 60.0]},
        "time": {"end": END, "step": 2e-3},
        "compare": {"against": []},
        "simulation": {"simulators": ["march"]},
    }


def reduced(scene: Scene) -> System:
    """System of the scene's reduced bodies."""
    return pmr.reduce(scene).system


def moved(scene: Scene) -> Motion:
    """Motion over the whole run with `MODES` modes of each section, so that only the model's own error is left."""
    parts = []
    for part in comparable_scene(scene).sections:
        reduction = part.reduction.model_copy(update={"coordinates": MODES})
        parts.append(part.model_copy(update={"reduction": reduction}))
    finer = comparable_scene(scene).model_copy(update={"sections": tuple(parts)})
    return Motion.compute(finer, reduced(finer))


def off(true: Mapping[str, Any], stated: Mapping[str, Any]) -> str:
    """List errors by kind of output, each followed in brackets by its estimate over it, if there is one."""
    known = [kind for kind in STATED if true.get(kind)]
    over = {kind: f" ({stated[kind] / true[kind]:.2f})" for kind in known if kind in stated}
    return ", ".join(f"{kind} {100.0 * true[kind]:.2f} %{over.get(kind, '')}" for kind in known)


def auto(first: int = 0, last: int = BOXES) -> None:
    """Print two lines for each box, and in how many the chosen model is within 5 % of the shell."""
    held = 0
    for seed in range(first, last):
        start, outcome = time.process_time(), run(random_box(seed, {"model": "auto"}))
        assert outcome is not None  # as there is one rank
        result = outcome.result
        own = Motion.compute(result.scene, outcome.system, result.responses["reduced"])
        true = model_budget(result.scene, own, moved(random_box(seed, SHELL)), "shell")
        held += largest_model_error(true) <= WITHIN
        chosen, stated = result.summary["chosen_model"], result.summary.get("budget", {}).get("model", {})
        tried = ", ".join(f"{one['name']} {one['walls']} {100.0 * one['error']:.2f} %" for one in chosen["tried"])
        print(f"{seed}: {chosen['name']}, walls {chosen['walls']}; tried: {tried}", flush=True)
        print(f"    {off(true, stated)}; {time.process_time() - start:.0f} s of the processor's time", flush=True)
    print(f"within {100.0 * WITHIN:.0f} %: {held} of {last - first}")


def main(first: int = 0, last: int = BOXES) -> None:
    """Print four lines for each box, and in how many beams whose walls give way are within 5 % of the shell."""
    within, held = 0, 0
    for seed in range(first, last):
        start, shell = time.process_time(), moved(random_box(seed, SHELL))
        said = f"{np.nanmin(shell.frequencies):.2f} Hz, {1e3 * np.abs(shell.response.displacement).max():.1f} mm"
        print(f"{seed}: {said}", flush=True)
        for name, body in BODIES.items():
            scene = random_box(seed, body)
            true = model_budget(scene, moved(scene), shell, "shell")
            stated = measure_model(scene, MPI.COMM_WORLD, None)
            print(f"    {name}: {off(true, stated)}", flush=True)
            if name == GIVES:
                within += max(true["largest"], true["frequency"]) <= WITHIN
                held += (
                    largest_model_error(stated) > WITHIN or largest_model_error(true) <= WITHIN
                )  # a shell is taken, or the beam
        print(f"    {time.process_time() - start:.0f} s of the processor's time", flush=True)
    print(f"within {100.0 * WITHIN:.0f} %: {within} of {last - first}; what `auto` takes holds that in {held}")


if __name__ == "__main__":
    asked = sys.argv[1:]
    if asked[:1] == ["auto"]:
        auto(*(int(one) for one in asked[1:3]))
    else:
        main(*(int(one) for one in asked[:2]))
