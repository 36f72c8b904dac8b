"""What a report asks of a result, whatever was simulated: names, places, lengths, which column is what.

Nothing else in the report asks how a scene says them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.report.numbers import SPACE, plain, quantity
from pmr.results import Response, RunResult
from pmr.scene import Scene
from pmr.scene.built import force_of
from pmr.scene.choice import choose, model_of, transverse
from pmr.scene.members import member_at
from pmr.scene.signals import SignalBase

Array = NDArray[np.float64]
Quantity = Callable[[Response], Array]

MODELS = {
    "beam2d": "a planar beam",
    "beam3d": "a beam in space",
    "shell": "a shell",
    "solid": "a solid",
    "matrices": "given matrices",
}
#: Directions across the axis, as they are called.
ACROSS = {"y": "lateral, y", "z": "vertical, z"}


@dataclass(frozen=True)
class Force:
    """A force on the body: what a response calls it, and what it is called within its group.

    `column` is where it stands in a response without names.
    """

    column: int
    name: str
    called: str

    def of(self, response: Response) -> Array:
        """The force over time, (T,) N."""
        return response.force(self.called, self.column)


@dataclass(frozen=True)
class Line:
    """Places along the axis, (o,) m, and the columns of a response that hold their displacement along the vertical."""

    x: Array
    columns: NDArray[np.int64]


@dataclass(frozen=True)
class Acting:
    """A load: `at` is its distance along the axis in m; `direction` is ``along``, ``up``, ``aside`` or ``turn``."""

    name: str
    direction: str
    at: float
    where: str
    signal: SignalBase

    @property
    def unit(self) -> str:
        return "N m" if self.direction == "turn" else "N"


@dataclass(frozen=True)
class Fixture:
    """What holds the body across its axis at a place that does not move, `at` in m: ``clamped`` or a point."""

    at: float
    kind: str


@dataclass(frozen=True)
class Model:
    """What a body is represented by, and why, in clauses."""

    name: str
    because: str


def reduced_size(result: RunResult) -> int:
    """Coordinates of the reduced model; of its basis, where the summary says nothing."""
    shapes = result.body.shapes
    basis = 0 if shapes is None else shapes.shapes.shape[1]
    return int(result.summary.get("coordinates", {}).get("reduced", basis))


def spoken(model: str) -> str:
    """A model in words."""
    return MODELS.get(model, f"a {model.replace('_', ' ')}")


def represented(result: RunResult) -> Model:
    """What the body is represented by."""
    scene = result.scene
    if scene.body.model != "auto":
        return Model(spoken(scene.body.model), "as the scene names it")
    chosen = choose(member_at(scene))
    return Model(spoken(chosen.model), f"since {'; '.join(chosen.reasons)}")


def tips(result: RunResult) -> Mapping[str, Quantity]:
    """The tip's displacement, (T,) m, along each of these directions: the last columns, where none has a name."""
    across = transverse(member_at(result.scene))
    return {d: _column(_tip(result, d), k - len(across)) for k, d in enumerate(across)}


def is_round_off(result: RunResult, what: Callable[[Response], Array | None]) -> bool:
    """Whether a displacement exceeds in no model what round-off may make of it."""
    found = result.responses.values()
    signals = [signal for one in found if (signal := what(one)) is not None]
    return max(float(np.abs(signal).max()) for signal in signals) <= max(one.round_off for one in found)


def not_drawn(result: RunResult, directions: Sequence[str]) -> str:
    """Why the tip's displacement along these directions has no figure; empty without any."""
    if not directions:
        return ""
    floor = max(one.round_off for one in result.responses.values())
    size = f"at most {quantity(floor, 'm')}, which may be round-off alone" if floor > 0.0 else "zero at all times"
    return f"Without a figure is the displacement of the tip along {' and '.join(directions)}: it is {size}."


def line(result: RunResult, response: Response) -> Line:
    """Where a response has the body's displacement along the vertical; nowhere, if it says nothing of columns."""
    across, names = transverse(member_at(result.scene)), response.output_names
    if len(across) == 1:
        return Line(response.x, np.arange(len(response.x)))
    tip = [_tip(result, across[-1])]
    columns = np.array([k for k, name in enumerate(names) if name in tip or name.startswith(f"{across[-1]} at ")], int)
    return Line(response.x[columns], columns)


def forces(result: RunResult) -> dict[str, list[Force]]:
    """Forces by what they come from, that which stays first: all that the reduced model's response holds."""
    scene, response = result.scene, result.responses["reduced"]
    if scene.points:
        count = response.slider_force.shape[1]
        called = response.force_names or ("",) * count
        return {"": [Force(k, f"slider {k + 1}" if count > 1 else "", name) for k, name in enumerate(called)]}
    columns = {name: column for column, name in enumerate(response.force_names or _unnamed(scene))}
    found: dict[str, list[Force]] = {}
    for ring in sorted(scene.pads, key=lambda ring: ring.moving):
        for name, _, _ in ring.places:
            if (called_so := force_of(name)) in columns:
                pad = Force(columns[called_so], name.removeprefix(f"{ring.name} "), called_so)
                found.setdefault(ring.name, []).append(pad)
    return found


def moving(result: RunResult) -> str:
    """What moves along the body, in a word."""
    return "slider" if result.scene.points else "mouth"


def forces_called(result: RunResult) -> str:
    """Forces between the body and what holds it, in words."""
    sliders = len(result.scene.points)
    return "pad forces" if not sliders else "slider force" if sliders == 1 else "slider forces"


def offsets(result: RunResult) -> tuple[float, ...]:
    """Distances in m ahead of s at which something moves along the body."""
    return result.scene.points or tuple(dict.fromkeys(ring.at for ring in result.scene.pads if ring.moving))


def length(result: RunResult) -> float:
    """Where the body ends along its axis, m."""
    scene = result.scene
    if scene.body.length is not None:
        return scene.body.length
    return float(result.body.fields.points[:, 0].max()) if result.body.fields is not None else scene.observe.end or 0.0


def loads(result: RunResult) -> list[Acting]:
    """Loads in the order of the model's inputs; the weight, which may follow them, is none of these."""
    end, found = length(result), []
    for one in result.scene.loads:
        kind = {"x": "along", "y": "aside", "z": "up"}.get(one.direction, "turn")
        where = f"on {one.on}" if isinstance(one.on, str) else f"at {plain(one.on)}{SPACE}m"
        at = end if isinstance(one.on, str) else one.on
        found.append(Acting(one.name, kind, at, f"{where} along {one.direction}", one.signal))
    return found


def held(result: RunResult) -> list[str]:
    """Names of what holds the body along its axis."""
    return [support.name for support in result.scene.supports if support.held == ("x",)]


def fixtures(result: RunResult) -> list[Fixture]:
    """What holds the body across its axis without moving along it."""
    scene, end = result.scene, length(result)
    supports = [
        Fixture(end if support.on == "tip" else 0.0, support.shown)
        if isinstance(support.on, str)
        else Fixture(support.on, support.shown)
        for support in scene.supports
        if {"y", "z"} & set(support.held)
    ]
    return supports + [Fixture(ring.at, "roller") for ring in result.scene.pads if not ring.moving]


def stress_times(result: RunResult) -> Array:
    """Times (F,) in s of the largest stresses."""
    count = max(map(len, result.body.peak_stress.values()), default=0)
    if result.body.fields is not None and len(result.body.fields.t) == count:
        return result.body.fields.t
    recovery = result.scene.recovery
    return np.arange(count) * (recovery.every if recovery else 0.0)


def _unnamed(scene: Scene) -> list[str]:
    """Forces in the order of results that don't say it: outputs before rows, those of rows that move last."""
    faces = ("bottom", "top") if model_of(member_at(scene)) == "beam2d" else ("bottom", "top", "left", "right")
    staying = [ring for ring in scene.pads if not ring.moving and ring.stiffness != "rigid"]
    ordered = [*sorted(staying, key=lambda ring: ring.unilateral), *(ring for ring in scene.pads if ring.moving)]
    return [force_of(name) for ring in ordered for name, face, _ in ring.places if face in faces]


def _tip(result: RunResult, direction: str) -> str:
    """What the displacement of the tip along a direction is called."""
    return result.scene.observe.tip_along(direction)


def _column(name: str, unnamed: int) -> Quantity:
    def displacement(response: Response) -> Array:
        column = response.output_names.index(name) if name in response.output_names else unnamed
        return response.displacement[:, column]

    return displacement
