"""Where the pads of a box boom sit: on its faces, all of them, wherever the path takes them."""

from __future__ import annotations

from pmr.errors import InputError
from pmr.scene.built import Box, Face, PadRing
from pmr.scene.scene import Scene

#: Round-off of a user's arithmetic, as a share of the face.
SLACK = 1e-9


def check_pads(scene: Scene) -> None:
    """Refuse a pad that lies beside its face or leaves it in part, at any time; faces that are read check themselves.

    Raises InputError with the pad, where it reaches to and what the face offers.
    """
    length, box = scene.body.length, scene.body.box
    for i, ring in enumerate(scene.pads):
        if length is not None:
            _along(scene, length, ring, f"pads[{i}].at")
        for place in ring.places:
            if box is not None:
                _across(box, ring, place, f"pads[{i}].faces.{place[1]}")


def flat_breadth(box: Box, face: Face) -> float:
    """Breadth in m of a face's flat part, between the corners' radii: of the mid-surface, whatever the model is."""
    return (box.width if face in ("bottom", "top") else box.height) - 2.0 * box.radius


def _along(scene: Scene, length: float, ring: PadRing, key: str) -> None:
    low, high = scene.travel if ring.moving else (0.0, 0.0)
    start, end = low + ring.at - ring.length / 2.0, high + ring.at + ring.length / 2.0
    slack = SLACK * length
    if start >= -slack and end <= length + slack:
        return
    name, face, _ = ring.places[0] if ring.places else (ring.name, "any", 0.0)
    moved = f" as s goes from {low:.6g} to {high:.6g} m" if ring.moving else ""
    allowed = (
        f"the pad {name} reaches from {start:.6g} to {end:.6g} m along the axis{moved}; "
        f"the face {face} offers 0 to {length:.6g} m, all of a pad has to be on it"
    )
    if ring.moving:
        raise InputError("scene", "slider.path" if scene.slider.travel is None else "slider.travel", None, allowed)
    raise InputError("scene", key, ring.at, allowed)


def _across(box: Box, ring: PadRing, place: tuple[str, Face, float], key: str) -> None:
    name, face, across = place
    half = flat_breadth(box, face) / 2.0
    if abs(across) + ring.width / 2.0 <= half * (1.0 + SLACK):
        return
    start, end = across - ring.width / 2.0, across + ring.width / 2.0
    allowed = (
        f"the pad {name} reaches from {start:.6g} to {end:.6g} m across; "
        f"the flat face {face} offers {-half:.6g} to {half:.6g} m, all of a pad has to be on it"
    )
    raise InputError("scene", key, across, allowed)
