"""Results in space that formulas give on a coarse box, so every number of a report is known beforehand."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from pmr import Response, RunResult
from pmr.results import BodyResult, Energy, Fields, Frequencies, Loads, Paths, Shapes
from pmr.results.field_series import Grid
from pmr.scene import Scene
from pmr.scene.members import member_at

MakeSpace = Callable[..., RunResult]
STATIONS, STEPS = 5, 1000
SUMMARY = {
    "errors": {"reduced_vs_full": {"tip": 0.001, "beam": 0.002, "pad_force": 0.003}},
    "largest_differences": {"reduced_vs_full": {"tip": 0.01, "beam": 0.02, "pad_force": 450.0}},
    "max_displacement": 0.008,
    "max_error": 1.2e-5,
    "coordinates": {"full": 17766, "reduced": 3},
    "max_von_mises": {"full": 50.0e6, "reduced": 49.0e6},
    "stress_peak": {
        name: {"value": 49.0e6, "t": 0.5, "position": [1.5, 0.1, -0.2], "face": "outer", "cell": 3, "region": "bottom"}
        for name in ("full", "reduced")
    },
    "seconds": {"assemble": 2.5, "simulate": {"march": 0.005, "full": 50.0}},
    "basis": {"rows_left_out": ["cylinder"]},
    "versions": {"pmr": "0.1.0"},
    "machine": {"cores": "2"},
}
SCENE: dict[str, Any] = {
    "title": "Boom <3>",
    "body": {"model": "shell", "box": {"length": 6.0, "width": 0.3, "height": 0.4, "wall": 0.008}},
    "pads": [{"name": "tail", "at": 0.15, "faces": {"bottom": [-0.1, 0.1], "left": [0.0]}}, {"name": "mouth",
     "moving": True, "faces": {"bottom": [-0.1, 0.1], "top": [0.0], "right": [0.0]}}],
    "supports": [{"name": "cylinder", "directions": ["x"]}],
    "masses": [{"name": "payload", "on": "tip", "mass": 250.0}],
    "loads": [{"name": "tip force", "on": "tip", "signal": {"kind": "sine", "amplitude": 2000.0, "frequency": 2.0}},
     {"name": "gust", "on": "tip", "direction": "y", "signal": 500.0}],
    "gravity": {},
    "damping": {"ratio": 0.005, "frequencies": [10.0, 60.0]},
    "slider": {"path": {"kind": "ramp", "times": [0.2, 0.7], "values": [1.5, 4.0]}},
    "time": {"end": STEPS * 1e-3, "step": 1e-3},
    "observe": {"start": 0.2, "end": 5.8, "count": STATIONS},
    "recovery": {"every": 0.05},
}  # fmt: skip


@pytest.fixture(scope="session")
def make_space() -> MakeSpace:
    """Function that builds a result with chosen responses, summary, fields and keys of the scene."""

    def make(
        responses: Sequence[str] = ("full", "reduced"),
        summary: dict[str, Any] | None = None,
        fields: Fields | None = None,
        stress: Sequence[str] = ("full", "reduced"),
        **sections: Any,
    ) -> RunResult:
        """Build a result; `sections` are further keys of the scene."""
        scene = Scene.model_validate(SCENE | sections)
        t = np.arange(STEPS + 1) * 1e-3
        s = np.linspace(1.5, 4.0, 7)
        f = np.stack([5.0 + s, 20.0 + s], axis=1)
        times = fields.t if fields else np.linspace(0.0, 1.0, 21)
        shapes = Shapes(np.ones(3), np.linspace(0.2, 5.8, STATIONS), np.ones((STATIONS, 3)))
        planar = scene.body.model == "beam2d"
        faces = ("bottom", "top") if planar else ("bottom", "top", "left", "right")
        pads = [name for ring in scene.pads for name, face, _ in ring.named_pads if face in faces]
        return RunResult(
            scene=scene,
            summary=SUMMARY if summary is None else summary,
            responses={name: _response(name, t, 1 if planar else 2, pads) for name in responses},
            paths=Paths(("slider",), scene.slider.path.value(t)[:, None], scene.slider.path.rate(t)[:, None]),
            loads=Loads(
                tuple(member_at(scene).signals),
                tuple("m/s^2" if name == "gravity" else "N" for name in member_at(scene).signals),
                np.stack([signal.value(t) for signal in member_at(scene).signals.values()], axis=1),
            ),
            bodies={"": BodyResult(shapes, fields, {name: 49.0e6 * np.sin(np.pi * times) for name in stress})},
            frequencies=Frequencies(s, s[:, None], {"reduced": f}),
        )

    return make


def _response(name: str, t: np.ndarray, directions: int, pads: Sequence[str]) -> Response:
    """Response of a model at the times t (T,), in one or two directions, with the forces of these pads."""
    size = {"full": 1.0, "reduced": 1.001}[name]
    x = np.linspace(0.2, 5.8, STATIONS)
    along = np.stack([0.003 * np.sin(12.0 * t), 0.008 * np.cos(9.0 * t)][-directions:], axis=1) * size
    line = [np.outer(along[:, d], (x / 6.0) ** 2) for d in range(directions)]
    unknown, names = np.full(len(t), np.nan), ("y", "z")[-directions:]
    return Response(
        t=t,
        x=np.array([*np.tile(x, directions), *[6.0] * directions]),
        displacement=np.hstack([*line, along]),
        energy=Energy(size * np.sin(t) ** 2, size * np.cos(t) ** 2, -size * t),
        slider_force=1e3 * size * (1.0 + np.arange(len(pads))) * np.cos(5.0 * t)[:, None],
        residual_position=1e-12 + 0.0 * t,
        residual_velocity=unknown,
        seconds={"full": 50.0, "reduced": 0.005}[name],
        output_names=(*(f"{d} at {at:g} m" for d in names for at in x), *(f"tip {d}" for d in names)),
        force_names=tuple(f"force of {pad}" for pad in pads),
        kinds=(*(f"beam {d}" for d in names for _ in x), *(f"tip {d}" for d in names), *("pad",) * len(pads)),
        bodies=("",) * (directions * (STATIONS + 1) + len(pads)),
    )


@pytest.fixture(scope="session")
def boom(make_space: MakeSpace) -> RunResult:
    """Result of a boom as a shell, without fields."""
    return make_space()


CORNERS = np.array([(-0.15, -0.2), (0.15, -0.2), (0.15, 0.2), (-0.15, 0.2)])
SECTIONS, TIMES = 7, 21


@pytest.fixture(scope="session")
def make_fields() -> Callable[[str], Fields]:
    """Function that builds fields of a tube of 6 m x 0.3 m x 0.4 m that is bent downwards within a second.

    The stress of a cell rises towards x = 0.
    """

    def make(kind: str) -> Fields:
        """Build fields on cells of this kind."""
        x, t = np.linspace(0.0, 6.0, SECTIONS), np.linspace(0.0, 1.0, TIMES)
        section, k = np.arange(SECTIONS - 1), np.arange(4)
        if kind == "line":
            points = np.stack([x, 0.0 * x, 0.0 * x], axis=1)
            cells = np.stack([section, section + 1], axis=1)
        else:
            points = np.array([(xi, *corner) for xi in x for corner in CORNERS])
            ring = 4 * section[:, None]
            if kind == "hexahedron":  # solid all through
                cells = np.concatenate([ring + k, ring + 4 + k], axis=1)
            else:
                one, two = ring + k, ring + (k + 1) % 4
                first = np.stack([one, one + 4, two + 4], axis=2).reshape(-1, 3)
                second = np.stack([one, two + 4, two], axis=2).reshape(-1, 3)
                cells = np.concatenate([first, second])
        swing = np.sin(np.pi * t)
        displacement = np.zeros((TIMES, len(points), 3), np.float32)
        displacement[:, :, 2] = -0.008 * np.outer(swing, (points[:, 0] / 6.0) ** 2)
        stress = np.outer(swing, 50e6 * (1.0 - points[cells].mean(axis=1)[:, 0] / 6.0)).astype(np.float32)
        return Fields(Grid(kind, points, cells), t, displacement, {"outer": stress, "inner": stress / 2.0})

    return make
