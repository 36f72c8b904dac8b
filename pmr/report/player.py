r"""Motion of bodies as data for the animations of a page.

The values X (frames, n) of a motion, those of one frame in each row, are factorised approximately:

.. math:: X \approx A\,(A^T X)

The columns of A (frames, k) are the leading eigenvectors of X X^T.  The page gets A and the k shapes A^T X (k, n),
which are a fraction of the size of X, and computes each picture as a sum of shapes.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.report.bodies import (
    Block,
    Surface,
    body_shifts,
    body_surfaces,
    build_surroundings,
    cell_stresses,
    displacement_scale,
    fields_by_body,
    largest_colour_stress,
    moment_of_peak,
    mouth_positions,
    times,
)
from pmr.report.columns import (
    AxisPoints,
    axis_points,
    body_axes,
    encode_array,
    interpolate,
    playback_speeds,
    ring_forces,
    rope_axis,
    rope_places,
    spread_indices,
)
from pmr.report.figures import shapes
from pmr.report.figures.canvas import PENS, section_colours
from pmr.report.figures.histories import responses_in_drawing_order
from pmr.report.figures.space import slews
from pmr.report.numbers import enlargement, format_input, format_percent, format_quantity
from pmr.report.renderer import RAMP
from pmr.report.subject import fixtures, input_loads, is_alone, reach, slider_offsets
from pmr.results import RunResult

FRAMES = 1500  # largest number of frames of an animation
POINTS = 26  # largest number of points along the axis of a body
REACH = 0.1  # largest deflection in the drawing, as a share of the length of the beam


def axis_motion(result: RunResult) -> dict[str, Any]:
    """Data of the animation of the bodies' axes, ready for JSON.

    Values over the frames are encoded by `pmr.report.columns.encode_array`.  The data have

    - `lanes`, one for each model: for each body the points x in m, their displacements (frames, points) in m and, for
      a section of a boom, the position of its tail (frames,) in m;
    - `pads`, one for all pads of a ring on one face: position (frames,) along x in m, and force (frames,) divided by
      the largest of all pad forces;
    - `loads`: forces (frames, 3) or moments (frames,), each divided by its largest value;
    - the slider's positions `s` (frames,) in m, the `offsets` in m of sliders or pads from s, and the `supports`;
    - the head sheaves and the hook of a `hoist` (frames, 2, 3) in m in the boom's axes, None without one;
    - `largest`, the largest displacement in m, and `scale`, the factor by which displacements are drawn;
    - `views`: for the ``side`` the least and the largest coordinate in m to the right, then upwards, of all that is
      drawn, and for the ``plan`` from above if a frame slews; `label` is the text below the side view;
    - the position in m of the `pivot`, and luffing and slewing `angles` in rad, empty without a moving frame.

    With a moving frame, only the reduced model has a lane, with lateral displacements too, and there are neither
    offsets nor supports.
    """
    response, frame = result.responses["reduced"], result.frame
    t, axis, aside = response.t, axis_points(result, response), dict[str, Array]()
    frames, models = spread_indices(len(t), FRAMES), responses_in_drawing_order(result)
    if frame is not None:
        aside = {of.body: of.displacements(response) for of in axis_points(result, response, "y")}
        models = {"reduced": response}
    every = [of.displacements(response) for response in models.values() for of in axis_points(result, response)]
    largest = max(float(np.abs(deflection).max()) for deflection in (*every, *aside.values()))
    end, alone = reach(result), is_alone(result)
    scale = enlargement(largest, (REACH if alone and frame is None else shapes.REACH) * end)
    data = {
        "largest": largest,
        "scale": scale,
        "times": [float(t[0]), float(t[-1])],
        "frames": len(frames),
        "lanes": [_lane_data(result, name, frames, aside) for name in models],
        "pads": _pad_data(result, axis, frames),
        "loads": _load_data(result, axis, frames),
        "speeds": playback_speeds(float(t[-1] - t[0])),
        "s": encode_array(result.abscissa[frames]),
        "hoist": _hoist_data(result, frames, scale),
    }
    if frame is None:
        reached = [scale * of(0.0, *(float(extent(w)) for w in every)) for of, extent in ((min, np.min), (max, np.max))]
        hung = rope_places(result, frames, scale)
        ends = [] if hung is None else [hung[:, 1, [0, 2]].min(axis=0), hung[:, 1, [0, 2]].max(axis=0)]
        low, high = (of([[0.0, reached[0]], [end, reached[1]], *ends], axis=0).tolist() for of in (np.min, np.max))
        return data | {
            "label": "x in m" if alone else "along the boom in m",
            "views": {"side": [low[0], high[0], low[1], high[1]]},
            "offsets": slider_offsets(result),
            "supports": [{"at": fixture.position, "kind": fixture.kind} for fixture in fixtures(result)],
            "pivot": [0.0, 0.0, 0.0],
            "angles": [],
        }
    few = spread_indices(len(t), 300)
    drawn_axes = [*body_axes(result, few, scale), *filter(None, (rope_axis(result, few, scale),))]
    plan = {"plan": _view_extent([drawn_axis.plan for drawn_axis in drawn_axes])} if slews(result) else {}
    return data | {
        "label": "distance and height in m",
        "views": {"side": _view_extent([drawn_axis.side for drawn_axis in drawn_axes])} | plan,
        "offsets": [],
        "supports": [],
        "pivot": list(frame.tail_position),
        "angles": [encode_array(angle.value(t[frames])) for angle in frame.angles],
    }


def _hoist_data(result: RunResult, frames: NDArray[np.int64], scale: float) -> dict[str, Any] | None:
    """Data of a hoist: its head sheaves and its hook (frames, 2, 3) in m in the boom's axes; None without a hoist."""
    places = rope_places(result, frames, scale)
    return None if places is None else encode_array(places.ravel())


def _load_data(result: RunResult, axis: list[AxisPoints], frames: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Data of the loads on the bodies, ready for JSON.

    The components of a force along the axes of the boom form one vector (frames, 3).
    """
    by_load, sections = dict[tuple[str, str], dict[str, Any]](), [of.body for of in axis]
    forces = dict[tuple[str, str], Array]()
    for load in [load for load in input_loads(result) if load.direction != "whole"]:
        turns = load.direction == "turn"
        key, values = (load.body, load.name if turns else load.axis_of), load.values[frames]
        by_load.setdefault(key, {"name": key[1], "section": sections.index(load.body), "at": load.position})
        if turns:
            by_load[key]["moment"] = encode_array(values / (np.abs(values).max() or 1.0))
        else:
            axes = forces.setdefault(key, np.zeros((len(frames), 3)))
            axes[:, ("along", "aside", "up").index(load.direction)] = values
    for key, force in forces.items():
        by_load[key]["force"] = encode_array(force.ravel() / (float(np.linalg.norm(force, axis=1).max()) or 1.0))
    return list(by_load.values())


def _view_extent(views: list[Array]) -> list[float]:
    """Least and largest coordinate to the right, then least and largest coordinate upwards, in m.

    They cover the points (S, n, 2) of all `views`, and the pivot at 0.
    """
    every = np.concatenate([np.zeros((1, 2)), *(view.reshape(-1, 2) for view in views)])
    return [float(end) for k in (0, 1) for end in (every[:, k].min(), every[:, k].max())]


def _lane_data(result: RunResult, name: str, frames: NDArray[np.int64], lateral: Mapping[str, Array]) -> dict[str, Any]:
    """Data of one model's lane: the axis of each body with its colour and width, and its displacements.

    `name` is the model's; `frames` are numbers of the reduced response's times.  Sections of a boom have their own
    colours, and outer sections are drawn thicker; a body alone is drawn in the style of the model.  `lateral` has the
    lateral displacements (times, points) in m, by body.
    """
    response, t, pen = result.responses[name], result.responses["reduced"].t, PENS[name]
    lines_of_model = axis_points(result, response)
    beams, colours = [], section_colours(of.body for of in lines_of_model)
    for k, of in enumerate(lines_of_model):
        points = spread_indices(len(of.x), POINTS)
        beam = {
            "label": of.body or pen.label,
            "colour": colours[of.body] if of.body else pen.colour,
            "width": 3 + 3 * (len(lines_of_model) - 1 - k) if of.body else pen.width,
            "dash": pen.dash,
            "x": of.x[points].round(6).tolist(),
            "w": encode_array(interpolate(t, response.t, of.displacements(response)[:, points])[frames]),
        }
        if of.body:
            beam["tail"] = encode_array(interpolate(t, response.t, of.tail)[frames])
        if of.body in lateral:
            beam["v"] = encode_array(lateral[of.body][:, points][frames])
        beams.append(beam)
    return {"label": pen.label, "beams": beams}


def _pad_data(result: RunResult, axis: list[AxisPoints], frames: NDArray[np.int64]) -> list[dict[str, Any]]:
    """Data of the pads of each ring on one face, at the times with the numbers `frames`.

    ``section`` is the number of the body that the pads touch; rings on bodies without a drawn axis are left out.
    """
    rings_of_run, names = list(ring_forces(result)), [of.body for of in axis]
    largest = max((float(np.abs(ring.force).max()) for ring in rings_of_run), default=0.0) or 1.0
    return [
        {
            "section": names.index(ring.body),
            "way": 1 if ring.above else -1,
            "at": encode_array(ring.positions[frames]),
            "force": encode_array(ring.force[frames] / largest),
        }
        for ring in rings_of_run
        if ring.body in names
    ]


def scale_words(data: dict[str, Any]) -> str:
    """Sentence on the factor by which deflections are enlarged, and on how large they are."""
    if data["largest"] == 0.0:
        return "Nothing moves across the axis."
    factor = data["scale"]
    drawn_as = "at its true size" if factor == 1.0 else f"{format_input(factor)} times its size"
    bars = " Bars are the forces of pads above and below." if data["pads"] else ""
    bars += " The square is the payload on its rope." if data.get("hoist") else ""
    return f"Deflection is drawn {drawn_as}; it reaches {format_quantity(data['largest'], 'm')}.{bars}"


EXACT = 1e-4  # size of a shape, as a share of the size of the largest one, below which the shape is left out
MOST_SHAPES = 32
MOST_FACES = 60_000  # bodies with more faces have pictures but no animation, so that a page stays below 5 MB
MOST_VALUES = 400_000  # most values in all shapes of a quantity: two bytes each, and a third more in base64


def body_motion(result: RunResult) -> dict[str, Any]:
    """Data of the animation of bodies with fields, ready for JSON; empty for a single time or for too many faces.

    Its keys are the number of ``frames``, first and last of the ``times`` in s, ``speeds`` of playback, the ``first``
    frame shown (that of the peak), the ``length`` of what is drawn, the ``path`` of the mouth, the ``scale`` of
    displacements, ``bodies``, the least x of the section's blocks (``back``), the ``ramp`` of colours, the blocks
    ``section``, ``near`` and ``tail`` of the surroundings, the largest share ``lost`` of a motion, and ``pose``.

    Each body has its P points in m, its triangles, and its shift along x in m.  Its displacement in m is the product of
    k coefficients (frames, k) and k shapes (k, 3 P).  The stress of its S faces, divided by the stress of the last
    colour, is a product of other coefficients (frames, k) and shapes (k, S).  Triangles j and S + j are the two halves
    of quadrilateral j.  If the scene has a frame, ``pose`` is the motion of the frame, which moves all bodies; else it
    is None.
    """
    bodies = body_surfaces(result)
    if (
        not bodies
        or len(t := times(result)) < 2
        or sum(len(body_surface.faces) for body_surface in bodies.values()) > MOST_FACES
    ):
        return {}
    around, alongs = build_surroundings(result, next(iter(bodies.values()))), body_shifts(result)
    shown = [
        _body_data(result, name, surface, alongs[name], MOST_VALUES // len(bodies)) for name, surface in bodies.items()
    ]
    back = min([0.0, *(float(block.corners[:, 0].min()) for block in around.section)])
    return {
        "frames": len(t),
        "times": [float(t[0]), float(t[-1])],
        "speeds": playback_speeds(float(t[-1] - t[0])),
        "first": moment_of_peak(result).frame,
        "length": reach(result),
        "path": encode_array(mouth_positions(result)),
        "scale": displacement_scale(result),
        "bodies": shown,
        "back": back,
        "ramp": RAMP,
        "section": [_block_data(block) for block in around.section],
        "near": [_block_data(block) for block in around.near],
        "tail": [_block_data(block) for block in around.tail],
        "lost": max(body_surface["lost"] for body_surface in shown),
        "pose": _frame_motion(result),
    }


def _frame_motion(result: RunResult) -> dict[str, Any] | None:
    """Motion of a frame: rotations (frames, 9), origins (frames, 3) in m, angles, centre and size of the picture.

    It is None if the scene has no frame.
    """
    frame, pose = result.frame, result.pose(times(result))
    if frame is None or pose is None:
        return None
    bodies, alongs = body_surfaces(result), body_shifts(result)
    ends = [
        pose.positions(
            np.array([body_surface.points.min(axis=0), body_surface.points.max(axis=0)]) + _along_axis(alongs[name])
        )
        for name, body_surface in bodies.items()
    ]
    every = np.concatenate([np.zeros((1, 3)), *(places.reshape(-1, 3) for places in ends)])
    low, high = every.min(axis=0), every.max(axis=0)
    return {
        "rotation": encode_array(pose.rotation.ravel()),
        "origin": encode_array(pose.origin.ravel()),
        "centre": ((low + high) / 2.0).tolist(),
        "size": float(np.linalg.norm(high - low)),
        "angles": [encode_array(np.rad2deg(angle.value(times(result)))) for angle in frame.angles],
    }


def _along_axis(shifts: Array) -> Array:
    """Turn shifts (F,) in m along x into vectors (F, 1, 3)."""
    return np.asarray(shifts[:, None, None] * np.array([1.0, 0.0, 0.0]))


def _body_data(result: RunResult, name: str, surface: Surface, shifts: Array, most_values: int) -> dict[str, Any]:
    """Data of one body: surface, `shifts` (frames,) in m, shapes of its motion and its stress, and the share left out.

    `most_values` limits the number of values in all shapes of a quantity.
    """
    fields = fields_by_body(result)[name]
    motion, lost = compress(
        surface.point_displacements(fields, fields.displacement).reshape(len(fields.t), -1), most_values
    )
    stress = cell_stresses(fields)[:, surface.cell] / largest_colour_stress(result) if fields.von_mises else None
    return {
        "points": encode_array(surface.points.ravel()),
        "triangles": _encode_indices(surface.triangles),
        "edges": _encode_indices(surface.edges),
        "faces": len(surface.faces),
        "along": encode_array(shifts),
        "motion": motion,
        "stress": None if stress is None else compress(stress, most_values).factors,
        "lost": lost,
    }


def drawing_sentence(data: dict[str, Any]) -> str:
    """Sentence on how the motion of bodies is drawn; empty if `data` is empty, as then there is no animation."""
    if not data:
        return ""
    count, lost = sum(body["motion"]["count"] for body in data["bodies"]), format_percent(data["lost"], 1)
    shapes = "one shape that leaves" if count == 1 else f"{count} shapes that leave"
    drawn = f"Displacements are drawn {format_input(data['scale'])} times their size"
    return f"{drawn}, from {shapes} out {lost} of the motion."


class CompressedFrames(NamedTuple):
    """Factors of frames, ready for JSON, and the share of the frames missing in their product."""

    factors: dict[str, Any]
    lost: float


def compress(frames: NDArray[np.float32], most_values: int) -> CompressedFrames:
    """Factorise frames (F, n) into coefficients (F, k) and shapes (k, n), and encode both for a page.

    The factors and the error are returned.  The error is the RMS difference between the product and the frames, divided
    by the RMS value of the frames.  The number k n of values in the shapes is at most `most_values`.
    """
    X = frames.astype(float)
    squares, vectors = np.linalg.eigh(X @ X.T)
    squares, vectors = np.maximum(squares[::-1], 0.0), vectors[:, ::-1]
    most = max(1, min(MOST_SHAPES, most_values // X.shape[1]))
    count = max(1, int(np.count_nonzero(squares[:most] > EXACT**2 * squares[0])))
    A = vectors[:, :count]
    A = A * np.sign(A[np.abs(A).argmax(axis=0), np.arange(count)])  # the sign of an eigenvector is arbitrary
    shapes = A.T @ X
    lost = float(np.sqrt(squares[count:].sum() / squares.sum())) if squares[0] > 0.0 else 0.0
    each = [encode_array(shape) for shape in shapes]
    factors = {"count": count, "coefficients": [encode_array(column) for column in A.T], "shapes": each}
    return CompressedFrames(factors, lost)


def _encode_indices(values: NDArray[np.int64]) -> str:
    """Encode the indices `values` as little-endian 32-bit integers in base64."""
    return base64.b64encode(np.ascontiguousarray(values, "<u4").tobytes()).decode()


def _block_data(block: Block) -> dict[str, Any]:
    """Data of a cuboid: its corners in m and its sides."""
    return {"corners": block.corners.round(4).ravel().tolist(), "sides": block.sides.tolist()}
