"""What each pad bears, and which of those that hold both ways are pulled."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response
from pmr.results.extremes import Extremes
from pmr.results.tables import reaction_extremes
from pmr.scene import Scene
from pmr.scene.built import PadRing, force_of, reaction_of
from pmr.scene.choice import is_axial
from pmr.scene.members import members
from pmr.system.contacts import named

Array = NDArray[np.float64]

#: Share of a pad's largest push, and of a tenth of the largest force of any pad, from which on a pull is told.
PULLED = 0.01


def pad_loads(scene: Scene, response: Response) -> dict[str, Extremes]:
    """Forces in N, positive where a pad pushes the body inwards, of all pads whose force the response holds."""
    s = np.asarray(scene.slider.path.value(response.t))
    names = [name for ring in scene.pads for name, _, _ in ring.places]
    return {name: Extremes.of(force, response.t, s) for name in names if (force := _force(response, name)) is not None}


def reactions(scene: Scene, response: Response, path: Array) -> dict[str, object]:
    """``reactions`` of summary.json: ``name``, ``unit``, and what `Extremes.summary` says; empty without any.

    Of all supports, rigid or not, of a body or of the sections of a boom, whose names begin with the section's.
    """
    found = reaction_extremes(response, path)
    said = [{"name": of.support, "unit": of.unit, **one.summary()} for of, one in found.items()]
    for body, part in zip(scene.names, scene.sections, strict=True):
        for name, unit in part.springs.items():
            if (force := named(body, force_of(name))) in response.force_names:
                one = Extremes.of(response.force(force, 0), response.t, path)
                said.append({"name": named(body, name), "unit": unit, **one.summary()})
    return {"reactions": said} if said else {}


def missing(scene: Scene) -> list[str]:
    """Reactions that the models can't tell, a line each: along x of beams that don't move so, and of all points."""
    pulled = scene.gravity is not None and scene.gravity.direction[0] != 0.0
    # what slides in others is accelerated along them, and has cylinders
    still = [one.part.name or "the body" for one in members(scene) if not is_axial(one) and (pulled or one.jointed)]
    points = [
        named(body, str(one.on))
        for body, part in zip(scene.names, scene.sections, strict=True)
        for one in part.supports
        if one.points == "all"
    ]
    along = (
        f"{', '.join(still)}: planar beams without coordinates along x (body.profile.axial is false), so that "
        "reactions and cylinder forces along it are not computed"
    )
    of_points = f"what supports of all points ({', '.join(points)}) bear is not computed; points = 'mean' tells it"
    return [along] * bool(still) + [of_points] * bool(points)


def _force(response: Response, name: str) -> Array | None:
    """Of a pad, (T,) N; of a rigid one that stays, which is a support, the reaction."""
    if force_of(name) in response.force_names:
        return response.force(force_of(name), 0)
    return response.other(reaction_of(name)) if reaction_of(name) in response.other_names else None


def summary(scene: Scene, response: Response) -> dict[str, object]:
    """``pads`` of summary.json: ``name``, and what `Extremes.summary` says in N; empty for points."""
    loads = pad_loads(scene, response)
    return {"pads": [{"name": name, **load.summary()} for name, load in loads.items()]} if scene.pads else {}


def warnings(scene: Scene, response: Response) -> list[str]:
    """What a user should know of the pads, a line each."""
    return pulled(scene, response) + unknown(scene, response) + missing(scene)


def pulled(scene: Scene, response: Response) -> list[str]:
    """Rings with pads that hold both ways and are pulled, a line each: how many, which most, when, what to set.

    Points that hold a planar beam both ways are meant to, so only pads count.
    """
    loads = pad_loads(scene, response)
    largest = max((max(load.most, -load.least) for load in loads.values()), default=0.0)
    said = []
    for ring in scene.pads:
        found = {
            name: load
            for name, load in loads.items()
            if name in [called for called, _, _ in ring.places]
            and not ring.unilateral
            and -load.least > max(PULLED * max(load.most, 0.1 * largest), response.force_round_off)
        }
        if found:
            said.append(_line(ring, found))
    return said


def unknown(scene: Scene, response: Response) -> list[str]:
    """Pads whose force the model doesn't tell, in a line: a rigid pad that stays holds by the choice of coordinates."""
    names = [
        name
        for ring in scene.pads
        for name, face, _ in ring.places
        if ring.stiffness == "rigid" and not ring.moving and _force(response, name) is None
    ]
    if not names or not response.force_names:
        return []
    pads = f"the pads {', '.join(names)} are" if len(names) > 1 else f"the pad {names[0]} is"
    return [f"{pads} rigid and stay on the body: whether they are pulled isn't known; a stiffness in N/m tells it"]


def _line(ring: PadRing, found: Mapping[str, Extremes]) -> str:
    most = min(found, key=lambda name: found[name].least)
    load = found[most]
    pads = f"{len(found)} of {len(ring.places)} pads of the ring {ring.name} pull"
    if len(found) == 1:
        pads = f"one of {len(ring.places)} pads of the ring {ring.name} pulls"
    worst = f"{most} with up to {newton(-load.least)} at {load.t_least:g} s (s = {load.s_least:.4g} m)"
    most_of_all = "most of all " if len(found) > 1 else ""
    return f"{pads} the body outwards, {most_of_all}{worst}; if they can only push, set unilateral = true in this ring"


def newton(force: float) -> str:
    """A force as it is said."""
    return f"{force / 1e3:.3g} kN" if force >= 1e3 else f"{force:.3g} N"
