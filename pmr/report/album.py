"""Pictures of bodies: whole bodies at up to three extensions, the part with the largest stress, and the mesh."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array
from pmr.report.blocks import Picture
from pmr.report.columns import rope_places
from pmr.report.moving_bodies import Block, Moment, MovingBodies, pad_blocks
from pmr.report.numbers import SPACE, format_quantity, prose
from pmr.report.player import Piece, Shot, Vector, frame_shots, render_shot
from pmr.report.sentences import wall_place_clause
from pmr.report.subject import is_alone
from pmr.report.trust import wall_stress_words
from pmr.results.quantities import stress_name, wall_stress
from pmr.scene.members import body_ring

WIDTH = 1500  # px, of a picture
SIDE = (0.34, -0.88, 0.30)  # direction from the body to the camera
NEARLY = 0.005  # s, difference of two times that are stated as one
NEAR = 1.0  # m, height of the part of the body that the close picture shows
STEEL, PAD, SECTION = "#b9c4cd", "#3b4a57", "#9fb0bd"
GROUND, CYLINDER = "#d9d2c5", "#5b6875"
ROD, ROPE, PAYLOAD = 0.06, 0.02, 0.2  # m, half the thickness of a luffing cylinder, of a rope and of a payload
RING, RING_EDGE = (0.056, 0.066), (0.05, 0.072)  # m, inner and outer radius of the ring in the close picture


def make_album(bodies: MovingBodies, prefix: str) -> tuple[Picture, ...]:
    """Draw the pictures of bodies; `prefix` begins their identifiers.  Empty if the bodies have no recovered fields."""
    views = _Views(bodies).shots() if bodies.are_recovered else ()
    return tuple(
        Picture(
            f"{prefix}-{view.name}", *view.shot.size, base64.b64encode(render_shot(view.shot)).decode(), view.caption
        )
        for view in views
    )


class View(NamedTuple):
    """A planned picture: its name, what is rendered, and its caption."""

    name: str
    shot: Shot
    caption: str


class _Views:
    """Maker of all pictures of a run, from its bodies, the limits of colours and the motion of the boom's axes."""

    def __init__(self, bodies: MovingBodies) -> None:
        self.bodies, self.result = bodies, bodies.result
        self.pose = bodies.result.pose(bodies.t)
        self.limits = (0.0, bodies.colour_limit / 1e6)

    def shots(self) -> Iterator[View]:
        """Yield the pictures to be rendered, in the order of the page.

        They are the views of whole bodies at `MovingBodies.moments`, then, if there are stresses, the close view of the
        largest one.
        """
        chosen = self.bodies.moments()
        views = [Shot((*self._pieces_at(m, SIDE), *self._ground_pieces(m)), SIDE, self.limits) for m in chosen]
        for number, (moment, shot) in enumerate(zip(chosen, frame_shots(views, WIDTH), strict=True), start=1):
            yield View(f"view-{number}", shot, self._caption(moment, is_first=number == 1))
        if self.bodies.cell_stresses:
            yield self._peak_view(self.bodies.moment_of_peak())

    def _pieces_at(
        self, moment: Moment, direction: Vector, edges: float = 0.6, opacity: float = 0.22, shown: str | None = None
    ) -> Iterator[Piece]:
        """Yield the bodies and all that surrounds them at a moment, as seen from a `direction`, in the ground's axes.

        A body encloses those that slide in it: walls on the side of the camera are drawn in front of them, walls on the
        other side behind them.  `edges` is the width of mesh lines in px.

        `shown` is the name of a body.  The bodies that enclose it are drawn with the `opacity` (0 to 1).  If `shown` is
        None, all bodies are opaque.  The next outer section of a body alone always has the `opacity`.
        """
        sight = np.array(direction) if self.pose is None else self.pose.rotation[moment.frame].T @ direction
        pieces, names = list(self._body_pieces(moment, edges)), list(self.bodies.surfaces)
        enclosing = 0 if shown is None else names.index(shown)
        pieces[:enclosing] = [replace(piece, opacity=opacity) for piece in pieces[:enclosing]]
        for number, piece in enumerate(reversed(pieces), start=1):
            layer = np.where(piece.faces_towards(sight), 1.0, -1.0) * float(number)
            pieces[-number] = replace(piece, layer=layer)
        outermost = len(pieces) + 1.0
        for block in self.bodies.surroundings.section:
            piece = Piece(block.corners, block.sides, None, SECTION)
            layer = np.where(piece.faces_towards(sight), 1.0, -1.0) * (outermost + 1.0)
            pieces.append(replace(piece, opacity=opacity, edges=1.0, layer=layer))
        pads = self._pads(moment, sight)
        for piece in (*pieces, *pads, *self._cylinder_pieces(moment), *self._rope_pieces(moment)):
            yield replace(piece, points=self._turn_to_ground(moment.frame, piece.points))

    def _body_pieces(self, moment: Moment, edges: float) -> Iterator[Piece]:
        """Yield the bodies at a moment, with displacements enlarged by the factor `self.bodies.scale`.

        Colours show the von Mises stress in MPa if the fields have stresses; `edges` is the width of mesh lines in px.
        """
        for name, surface in self.bodies.surfaces.items():
            fields = self.bodies.fields[name]
            displaced = surface.point_displacements(fields, fields.displacement[moment.frame])
            points = surface.points + self.bodies.scale * displaced + (self.bodies.shifts[name][moment.frame], 0.0, 0.0)
            stresses = self.bodies.cell_stresses.get(name)
            values = None if stresses is None else stresses[moment.frame, surface.cell] / 1e6
            yield Piece(points, surface.faces, values, STEEL, edges=edges)

    def _pads(self, moment: Moment, sight: Array) -> Iterator[Piece]:
        """Yield the pads at a moment; those of a boom's joints are on the outside of the outer sections.

        Pads of a joint whose ring states no `faces` are not drawn.  `sight` (3,) is the direction to the camera in the
        boom's axes.
        """
        yield from (_pad_piece(block, 1, sight) for block in self.bodies.surroundings.near)
        yield from (
            _pad_piece(block, 1, sight, np.array([-moment.s, 0.0, 0.0])) for block in self.bodies.surroundings.tail
        )
        bodies, frame = list(self.result.scene.bodies.items()), moment.frame
        for number, ((outer, of_outer), (inner, of_inner)) in enumerate(pairwise(bodies)):
            if of_inner.joint is None or outer not in self.bodies.surfaces:
                continue
            points, box = self.bodies.surfaces[outer].points, of_outer.body.box
            extent, tails = np.array([points.min(axis=0), points.max(axis=0)]), self.bodies.shifts
            mouth = tails[outer][frame] + of_outer.length
            at_ends = [(ring, tails[inner][frame] + ring.at) for ring in of_inner.joint.tail]
            at_ends += [(ring, mouth - ring.at) for ring in of_inner.joint.mouth]
            for ring, at in at_ends:
                if ring.faces is not None:
                    along = self._drawn_displacement(outer, frame, at - tails[outer][frame])
                    along[0] += at
                    for block in pad_blocks(body_ring(ring, "pad"), extent, box):
                        yield _pad_piece(block, len(bodies) - number, sight, along)

    def _drawn_displacement(self, body: str, frame: int, x: float) -> Array:
        """Return the mean displacement (3,) in m of a body's cross-section nearest to x in m, enlarged as drawn.

        `frame` is the number of the time among those of the body's fields.
        """
        surface, fields = self.bodies.surfaces[body], self.bodies.fields[body]
        apart = np.abs(surface.points[:, 0] - x)
        displaced = surface.point_displacements(fields, fields.displacement[frame])[apart <= apart.min() + 1e-6]
        return np.asarray(self.bodies.scale * displaced.mean(axis=0), float)

    def _cylinder_pieces(self, moment: Moment) -> Iterator[Piece]:
        """Yield the luffing cylinder from its foot to its lug as a bar; nothing if the frame has no cylinder."""
        frame = self.result.frame
        if frame is not None and (cylinder := frame.cylinder) is not None:
            (angle,) = frame.angles[0].value(np.array([moment.t]))
            x, z = cylinder.direction(angle)
            lug = np.array([cylinder.lug[0], 0.0, cylinder.lug[1]]) - frame.tail_position
            foot = lug - float(cylinder.length_and_arm(angle)[0]) * np.array([x, 0.0, z])
            lug += self._drawn_displacement(next(iter(self.bodies.surfaces)), moment.frame, lug[0])
            yield _bar(foot, lug, ROD)

    def _rope_pieces(self, moment: Moment) -> Iterator[Piece]:
        """Yield the rope of a hoist as a bar from its head sheaves to its hook, and a cube for the payload.

        Nothing is yielded without a hoist, or if the response has no places of a hook.
        """
        response, frame = self.result.responses["reduced"], self.result.frame
        step = int(np.argmin(np.abs(response.t - moment.t)))
        if (places := rope_places(self.result, [step], self.bodies.scale)) is not None:
            head, hook = places[0] - (0.0 if frame is None else np.array(frame.tail_position))
            down = (hook - head) / max(float(np.linalg.norm(hook - head)), 1e-9)
            yield _bar(head, hook, ROPE)
            yield _bar(hook, hook + 2.0 * PAYLOAD * down, PAYLOAD)

    def _ground_pieces(self, moment: Moment) -> Iterator[Piece]:
        """Yield a level plane below a boom.

        The plane is at the height of the ground if the scene has one, else at the foot of the luffing cylinder.  It is
        at the pivot if there is no cylinder, or if the foot is above the pivot.  Nothing is yielded for a body alone,
        for a boom that is almost upright, or if no weight acts.
        """
        frame, gravity = self.result.frame, self.result.scene.gravity
        if is_alone(self.result) or gravity is None:
            return
        up, pivot, below = -np.array(gravity.direction), np.zeros(3), 0.0
        if frame is not None:
            (angle,) = frame.angles[0].value(np.array([moment.t]))
            up, pivot = np.array([np.sin(angle), 0.0, np.cos(angle)]), -np.array(frame.tail_position)
            below = 0.0 if frame.cylinder is None else min(frame.cylinder.foot[1], 0.0)
            below = below if frame.ground is None else -frame.ground.height
        ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
        if (level := float(np.linalg.norm(ahead))) > 0.1:
            ahead, aside = ahead / level, np.cross(up, ahead / level)
            long = moment.extension * level
            corners = [(-0.1 * long, -1.0), (1.05 * long, -1.0), (1.05 * long, 1.0), (-0.1 * long, 1.0)]
            points = np.array([pivot + below * up + x * ahead + 0.1 * long * y * aside for x, y in corners])
            points = self._turn_to_ground(moment.frame, points)
            yield Piece(points, np.array([(0, 1, 2, 3)]), None, GROUND, 0.5, layer=-np.inf)

    def _turn_to_ground(self, frame: int, points: Array) -> Array:
        """Turn points (..., 3) in m from the boom's axes into the ground's axes at the stored time number `frame`.

        If the scene has no moving frame, the points are returned unchanged.
        """
        return points if self.pose is None else self.pose.positions_at(frame, points)

    def _peak_view(self, moment: Moment) -> View:
        """Build the view of the largest stress, seen from the side on which it occurs, with the body's axis level."""
        name, place = self.bodies.place_of_peak(moment)
        points = self.bodies.surfaces[name].points
        low, high = points.min(axis=0), points.max(axis=0)
        middle = (low + high) / 2.0
        from_left, above = place[1] > high[1] - 0.05 * (high[1] - low[1]), place[2] >= middle[2]
        ways = np.array([(SIDE[0], -SIDE[1] if from_left else SIDE[1], 0.45 if above else -0.45), (0.0, 0.0, 1.0)])
        if self.pose is not None:
            ways = self.pose.rotate_at(moment.frame, ways)
        direction, up = ways
        pieces = self._pieces_at(moment, direction, edges=0.8, opacity=0.08, shown=name)
        moved = self._drawn_displacement(name, moment.frame, place[0])
        moved[0] += self.bodies.shifts[name][moment.frame]
        points = np.array([(place[0], middle[1], middle[2]), place]) + moved
        centre, marked = self._turn_to_ground(moment.frame, points)
        shot = Shot((), direction, self.limits, centre, NEAR, (WIDTH, WIDTH * 3 // 8), up)
        nearer = marked + 0.01 * shot.view[2]  # what is nearer to the camera is drawn over the rest of a layer
        rings = _ring(marked, shot.view, RING_EDGE, "#ffffff"), _ring(nearer, shot.view, RING, PAD)
        shot = replace(shot, pieces=(*pieces, *rings))
        walls, peak = wall_stress(self.result.summary), self.bodies.summary_peak.get("t", moment.t)
        caption = prose(
            "close_picture",
            walls=f"{wall_stress_words(self.result.summary)}, {wall_place_clause(self.result, walls)}" if walls else "",
            is_enclosed=name != next(iter(self.bodies.surfaces)),
            side="left" if from_left else "right",
            height="above" if above else "below",
            t=_two_decimals(moment.t, "s"),
            peak=_two_decimals(peak, "s")
            if abs(peak - moment.t) > NEARLY
            else "",  # fields are kept at some times only
        )
        return View("close", shot, caption)

    def _caption(self, moment: Moment, is_first: bool) -> str:
        """Return the caption of a view.

        The caption states the extension beyond the mouth (or the reach), the time and the largest stress.  The first
        view's caption also states what holds for all views, such as the scale of displacements.
        """
        stress = ""
        if self.bodies.cell_stresses:
            stress = f"; the {stress_name(self.result.scene)} is {format_quantity(moment.peak, 'Pa')}"
        return prose(
            "picture",
            extension=_two_decimals(moment.extension, "m"),
            is_alone=is_alone(self.result),
            t=_two_decimals(moment.t, "s"),
            stress=stress,
            scale=self.bodies.scale,
            is_first=is_first,
        )


def _two_decimals(value: float, unit: str) -> str:
    """Format a value with two decimals and its unit."""
    return f"{value:.2f}{SPACE}{unit}"


def _bar(start: Array, end: Array, half: float) -> Piece:
    """Return a square bar in the colour of cylinders from the point `start` to `end` (3,) in m, closed at both ends.

    `half` is half its thickness in m.  The bar must not be parallel to y.
    """
    along = (end - start) / np.linalg.norm(end - start)
    across = np.cross(along, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    aside = np.cross(across, along)
    corners = half * np.array([across, aside, -across, -aside])
    sides = [*((k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)), (0, 1, 2, 3), (4, 5, 6, 7)]
    return Piece(np.concatenate([start + corners, end + corners]), np.array(sides), None, CYLINDER)


def _ring(centre: Array, view: Array, radii: tuple[float, float], colour: str) -> Piece:
    """Return a ring in `colour` around the point `centre` (3,) in m, in front of all else.

    The rows of `view` (3, 3) are the image's axes to the right, upwards and to the camera; the ring is in the plane of
    the image.  `radii` are the inner and the outer radius in m.
    """
    turns = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    circle = np.cos(turns)[:, None] * view[0] + np.sin(turns)[:, None] * view[1]
    points, k = centre + (np.array(radii)[:, None, None] * circle).reshape(-1, 3), np.arange(len(turns))
    after = np.roll(k, -1)
    faces = np.stack([k, len(k) + k, len(k) + after, after], axis=1)
    return Piece(points, faces, None, colour, layer=np.inf)


def _pad_piece(block: Block, number: int, sight: Array, along: Array | float = 0.0) -> Piece:
    """Return a pad on the outside of a body, moved by `along` (3,) in m.

    `number` is the place of the body in the order from the innermost body, 1, outwards.  It decides what is drawn in
    front of the pad.  `sight` (3,) is the direction to the camera.
    """
    piece = Piece(block.corners, block.sides, None, PAD)
    across = piece.normals[np.ptp(block.corners @ piece.normals.T, axis=0).argmin()]  # where the pad is thinnest
    side = 1.0 if (across @ block.corners.mean(axis=0)) * (across @ sight) >= 0.0 else -1.0
    return replace(piece, points=block.corners + along, layer=side * (number + 0.5))
