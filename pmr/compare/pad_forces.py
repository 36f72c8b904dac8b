"""What each pad bears, and which of those that hold both ways are pulled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import PadRing
from pmr.system.body import force_of

Array = NDArray[np.float64]

#: Share of a pad's largest push, and of a tenth of the largest force of any pad, from which on a pull is told.
PULLED = 0.01


@dataclass(frozen=True)
class PadLoad:
    """Smallest and largest force of a pad in N, positive where it pushes the body inwards, and when (s)."""

    name: str
    least: float
    t_least: float
    most: float
    t_most: float

    def summary(self) -> dict[str, object]:
        """For summary.json."""
        return {"name": self.name, "min": self.least, "t_min": self.t_least, "max": self.most, "t_max": self.t_most}


def pad_loads(scene: Scene, response: Response) -> list[PadLoad]:
    """Of all pads of a scene whose force the response holds, in the order of the scene."""
    return [load for ring in scene.pads for load in _of_ring(ring, response)]


def summary(scene: Scene, response: Response) -> dict[str, object]:
    """``pads`` of summary.json: ``name``, ``min`` and ``max`` in N, ``t_min`` and ``t_max`` in s; empty for points."""
    return {"pads": [load.summary() for load in pad_loads(scene, response)]} if scene.pads else {}


def warnings(scene: Scene, response: Response) -> list[str]:
    """What a user should know of the pads, a line each."""
    return pulled(scene, response) + unknown(scene, response)


def pulled(scene: Scene, response: Response) -> list[str]:
    """Rings with pads that hold both ways and are pulled, a line each: which, how much, when, what to set.

    Points that hold a planar beam both ways are meant to, so only pads count.
    """
    largest = max((max(load.most, -load.least) for load in pad_loads(scene, response)), default=0.0)
    said = []
    for ring in scene.pads:
        found = [
            load
            for load in _of_ring(ring, response)
            if not ring.unilateral
            and -load.least > max(PULLED * max(load.most, 0.1 * largest), response.force_round_off)
        ]
        if found:
            s = scene.slider.path.value(np.array([load.t_least for load in found]))
            said.append(_line(ring, found, s))
    return said


def unknown(scene: Scene, response: Response) -> list[str]:
    """Pads whose force the model doesn't tell, in a line: a rigid pad that stays holds by the choice of coordinates."""
    names = [
        name
        for ring in scene.pads
        for name, face, _ in ring.places
        if ring.stiffness == "rigid" and not ring.moving and force_of(name) not in response.force_names
    ]
    if not names or not response.force_names:
        return []
    pads = f"the pads {', '.join(names)} are" if len(names) > 1 else f"the pad {names[0]} is"
    return [f"{pads} rigid and stay on the body: whether they are pulled isn't known; a stiffness in N/m tells it"]


def _of_ring(ring: PadRing, response: Response) -> Iterator[PadLoad]:
    for name, _, _ in ring.places:
        if (called := force_of(name)) in response.force_names:
            force, t = response.force(called, 0), response.t
            first, last = int(np.argmin(force)), int(np.argmax(force))
            yield PadLoad(name, float(force[first]), float(t[first]), float(force[last]), float(t[last]))


def _line(ring: PadRing, found: Sequence[PadLoad], s: Array) -> str:
    parts = [
        f"{load.name.removeprefix(f'{ring.name} ')} with up to {_newton(-load.least)} at {load.t_least:g} s "
        f"(s = {at:.4g} m)"
        for load, at in zip(found, s, strict=True)
    ]
    many = len(found) > 1
    which = f"pads of the ring {ring.name} pull" if many else f"a pad of the ring {ring.name} pulls"
    they = "they" if many else "it"
    return f"{which} the body outwards: {', '.join(parts)}; if {they} can only push, set unilateral = true in this ring"


def _newton(force: float) -> str:
    return f"{force / 1e3:.3g} kN" if force >= 1e3 else f"{force:.3g} N"
