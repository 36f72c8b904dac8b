"""Small scenes of every kind, by the letters of the columns in the manual's table."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from bricks import bricks
from fuzz import toml
from fuzz.bases import BEAM, BOOM, FLEXIBLE, PAPER, PLANAR_BOOM, PUSHING, SHELL


def changed(base: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """Copy a scene with some of its sections replaced; sections that are None are left out."""
    return {key: value for key, value in (deepcopy(base) | changes).items() if value is not None}


def nothing(folder: Path) -> None:
    """Write no file beside the scene."""


def matrices(folder: Path) -> None:
    """Write matrices of a bar of bricks into a folder."""
    bricks((12, 2, 2), (2.0, 0.2, 0.3)).save(folder / "bar.npz")


def line(folder: Path) -> None:
    """Write a mesh of a beam of 5 m whose nodes are closer at its end into a folder."""
    x = 5.0 * np.linspace(0.0, 1.0, 11) ** 0.8
    cells = np.column_stack([np.arange(10), np.arange(1, 11)])
    meshio.write(folder / "line.vtu", meshio.Mesh(np.column_stack([x, 0.0 * x, 0.0 * x]), [("line", cells)]))


def vectors(folder: Path) -> None:
    """Write Hermite polynomials as basis vectors into a folder: w, w' at each node.

    They are on the coordinates of `BEAM` without its axial ones, which its pin holds.
    """
    x = np.linspace(0.0, 1.0, 11)
    V = np.stack([np.column_stack([x**k, k / 5.0 * x ** (k - 1)]).ravel() for k in range(1, 9)], axis=1)
    np.savez(folder / "vectors.npz", V=V)


@dataclass(frozen=True)
class Kind:
    """Scene, a function that writes what it needs beside it, and a position `at` of its paths in m."""

    scene: dict[str, Any]
    at: float = 1.55
    write: Callable[[Path], None] = nothing

    @property
    def has_sections(self) -> bool:
        """Whether the scene is a boom of sections."""
        return "sections" in self.scene

    def written(self, folder: Path) -> Path:
        """Write the scene and what it needs into a folder, and return the scene file."""
        self.write(folder)
        file = folder / "scene.toml"
        file.write_text(toml.written(self.scene))
        return file


FULL = {"against": ["full"]}
SMOOTH = {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [1.5, 1.9]}
ONCE = {"simulators": ["march"], "repeats": 1}
FREE = {"basis": "free_modes", "flexibility": True, "coordinates": 6}
PLANE_BEAM = changed(BEAM, slider={"path": SMOOTH}, simulation=ONCE, compare=FULL)
LONG_PATH = {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [0.6, 1.1]}
FACES: dict[str, Any] = {face: [0.0] for face in ("bottom", "top", "left", "right")}
STEPPED = {"end": 0.05, "step": 1e-3}


def boom(title: str, model: str, joint: dict[str, Any], lengths: float = 6.0, **mesh: Any) -> dict[str, Any]:
    """Scene of two boxes in space, or three in a plane, each in the one before it."""
    boxes = [{"width": 0.30 - d, "height": 0.40 - d, "wall": 0.008, "length": lengths} for d in (0.0, 0.04, 0.08)]
    clamp = {"kind": "clamped"} if model == "beam2d" else {"kind": "clamped", "points": "all"}
    sections: list[dict[str, Any]] = [
        {"name": "base", "body": {"box": boxes[0]}, "supports": [clamp], "reduction": {"coordinates": 3}},
        {"name": "mid", "body": {"box": boxes[1]}},
        {
            "name": "fly",
            "body": {"box": boxes[2]},
            "masses": [{"name": "payload", "on": "tip", "mass": 100.0}],
            "loads": [
                {
                    "name": "F",
                    "on": "tip",
                    "direction": "z",
                    "signal": {"kind": "sine", "amplitude": 500.0, "frequency": 5.0},
                }
            ],
        },
    ]
    if model != "beam2d":
        sections.pop(1)
    extension = {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [0.25 * lengths, 0.3 * lengths]}
    return {
        "title": title,
        "section": {
            "body": {"model": model},
            "mesh": mesh or {"elements": 10},
            "observe": {"start": 0.0, "end": lengths, "count": 9},
            "reduction": {"coordinates": 5 if model == "beam2d" else 8},
            "joint": {"extension": extension} | joint,
        },
        "sections": sections,
        "gravity": {"rise": 0.0},
        "damping": {"ratio": 0.01, "frequencies": [2.0, 50.0]},
        "time": STEPPED,
        "simulation": {"repeats": 1},
    }


def rings(**more: Any) -> dict[str, Any]:
    """Keys of pads at both ends of an overlap, with further keys of the rings."""
    ring = {"at": 0.2, "length": 0.2, "stiffness": 1e8, "unilateral": False} | more
    return {"tail": [ring], "mouth": [ring]}


PLANE = {"bottom": [0.0], "top": [0.0]}
SPACE = {"bottom": [-0.06, 0.06], "top": [0.0], "left": [0.0], "right": [0.0]}
RAISED = {
    "pivot": [0.0, 0.0, 0.0],
    "luffing": {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [0.3, 0.6]},
    "second_order": True,
}
ON_MACHINE = {
    "pivot": [0.0, 0.0, 0.0],
    "luffing": {"kind": "smooth_ramp", "times": [0.0, 0.2], "values": [0.3, 0.6]},
    "machine": {"mass": 3000.0, "inertia": [1000.0, 2000.0, 2000.0], "free": ["z", "ry"], "stiffness": {"z": 2e6,
     "ry": 3e6}, "damping": {"z": 2e4, "ry": 3e4}},
}  # fmt: skip
HOISTED = {"cylinder": {"stiffness": 5e7}}


def on_machine(scene: dict[str, Any]) -> dict[str, Any]:
    """Hold the base of a scene in the mean, as a machine that moves requires, and add the machine."""
    scene["sections"][0]["supports"] = [{"name": "clamp", "kind": "clamped", "points": "mean"}]
    return scene | {"frame": ON_MACHINE}


#: By the letter of their columns.
KINDS = {
    "A": Kind(changed(PLANE_BEAM, reduction={"basis": "eigenmodes", "snapshots": 4, "modes": 4, "coordinates": 8})),
    "B": Kind(changed(PAPER, simulation={"simulators": ["march", "exudyn"], "repeats": 1}, published=None)),
    "C": Kind(changed(PLANE_BEAM, reduction=FREE)),
    "D": Kind(changed(FLEXIBLE, accuracy=None, reduction=FREE, simulation=ONCE, compare=FULL)),
    "F": Kind(changed(PLANE_BEAM, reduction={"basis": "file", "file": "vectors.npz", "coordinates": 8}), write=vectors),
    "G": Kind(changed(PLANE_BEAM, mesh={"file": "line.vtu"}, reduction=FREE), write=line),
    "H": Kind(changed(PLANAR_BOOM, time=STEPPED, recovery=None)),
    "I": Kind(changed(BOOM, time=STEPPED, recovery=None, compare=FULL)),
    "J": Kind(changed(PUSHING, time=STEPPED, recovery=None, compare=FULL)),
    "K": Kind(changed(SHELL, slider={"path": LONG_PATH}, recovery=None, compare=FULL), at=0.62),
    "L": Kind(changed(SHELL, body={"model": "solid", "box": {"length": 2.0, "width": 0.3, "height": 0.4, "wall": 0.02}},
     slider={"path": LONG_PATH}, recovery=None, compare=FULL), at=0.62),
    "M": Kind(changed(SHELL, body={"model": "matrices"}, mesh={"file": "bar.npz"}, pads=[{"name": "tail", "at": 0.15,
     "length": 0.2, "faces": FACES}, {"name": "mouth", "moving": True, "length": 0.2, "faces": FACES}],
     supports=[{"on": "tail", "directions": ["x"]}, {"on": "tip", "directions": ["rx"], "stiffness": 1e6}], masses=None,
     slider={"path": LONG_PATH}, recovery=None, compare=FULL), at=0.62, write=matrices),
    "N": Kind(boom("Sections in a plane", "beam2d", rings(faces=PLANE) | HOISTED)),
    "O": Kind(boom("Sections in space", "beam3d", rings(faces=SPACE))),
    "P": Kind(boom("Sections of shells", "shell", rings(faces=SPACE), lengths=2.0, size=0.2, along=0.4), at=0.62),
    "Q": Kind(boom("Sections that push", "beam2d", rings(faces=PLANE, unilateral=True) | HOISTED)),
    "R": Kind(boom("Rigid overlaps", "beam2d", rings(stiffness="rigid") | {"rigid_overlap": True})),
    "S": Kind(boom("Sections in a frame", "beam2d", rings(faces=PLANE) | HOISTED) | {"frame": RAISED}),
    "T": Kind(changed(PLANAR_BOOM, time=STEPPED, recovery=None, gravity={}, frame=RAISED)),
    "U": Kind(on_machine(boom("Sections on a machine", "beam3d", rings(faces=SPACE)))),
}  # fmt: skip
