"""What a report says of a run, block by block: each shows itself if the result holds what it needs."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

import numpy as np

from pmr.report import borne, parameters, provenance, sentences
from pmr.report.blocks import Block, Chapter, Drawing, Grid, Player, Table, drawing
from pmr.report.errors import compared, error_table
from pmr.report.errors import rows as error_rows
from pmr.report.figures import budget, captions, forces, histories, inputs, shapes, sketch, spectra
from pmr.report.figures.canvas import ramp
from pmr.report.motion import line, player
from pmr.report.motion.album import album
from pmr.report.motion.instants import top
from pmr.report.numbers import SPACE, plain, significant
from pmr.report.subject import ACROSS, forces_called, is_round_off, loads, moving, not_drawn, tips
from pmr.report.subject import forces as forces_of
from pmr.report.subject import line as line_of
from pmr.results import RunResult
from pmr.scene.choice import transverse
from pmr.scene.members import member_at

Show = Callable[[RunResult, str], Block | None]


def chapter(result: RunResult, anchor: str) -> Chapter:
    """Everything that the report says of one run; `anchor` is put before every identifier."""
    found = error_rows(result)
    return Chapter(
        anchor=anchor,
        title=result.scene.title,
        opening=sentences.opening(result),
        sketch=drawing(f"{anchor}-sketch", sketch.sketch, sketch.caption(result), result),
        key_numbers=list(sentences.key_numbers(result)),
        points=sentences.points(result, found),
        warnings=[warning[:1].upper() + warning[1:] for warning in result.summary.get("warnings", ())],
        blocks=[block for show in SECTIONS if (block := show(result, anchor))],
    )


def errors(result: RunResult, prefix: str) -> Block | None:
    """Errors against what the run was compared with, beside published ones, or the largest values alone."""
    table = error_table(result)
    return Block(heading="Errors" if compared(result) else "Largest values", errors=table) if table.rows else None


def accuracy(result: RunResult, prefix: str) -> Block | None:
    """What was chosen to hold a tolerance and why, and what takes how much of it."""
    found = result.summary.get("accuracy")
    if found is None:
        return None
    first = result.summary["budget"]["first"]
    missing = result.summary["budget"]["mesh_reason"]
    caption = f"What reduction, step and mesh are off by; the {first} is to be improved first."
    unknown = f" The part of the mesh is not known: {missing}." if missing else ""
    drawn = drawing(f"{prefix}-budget", budget.budget, caption + unknown, result)
    text = "; ".join(found["reasons"])
    return Block(heading="Accuracy on order", rows=((drawn,),), text=f"{text[:1].upper()}{text[1:]}.")


def inputs_over_time(result: RunResult, prefix: str) -> Block:
    """What moves along the body, and what acts on it."""
    caption = f"{moving(result).capitalize()} position along the body over time."
    row = [drawing(f"{prefix}-position", inputs.position, caption, result)]
    if loads(result):
        row.append(drawing(f"{prefix}-loads", inputs.loads, f"Loads over time.{_weight(result)}", result))
    return Block(heading=f"{moving(result).capitalize()} and loads", rows=(tuple(row),))


def motion(result: RunResult, prefix: str) -> Block | None:
    """The motion: that of the fields, where these were recovered, else that of the axis."""
    fields, data, found = result.body.fields, player.player(result), album(result, prefix)
    if fields is None:
        if not len(line_of(result, result.responses["reduced"]).x):
            return None
        data = line.motion(result)
        strip = drawing(f"{prefix}-snapshots", shapes.snapshots, captions.snapshots(result), result)
        return Block(heading="Motion", player=Player("line", data, line.said(data)), without_scripts=(strip,))
    absent = f"There are no pictures: {found.absent}." if found.absent else ""
    scale: tuple[tuple[Drawing, ...], ...] = ()
    if fields.von_mises and (data or found.pictures):
        caption = "Colours of the pictures: the largest von Mises stress of each cell."
        scale = ((drawing(f"{prefix}-ramp", ramp, caption, top(fields) / 1e6),),)
    shown = Player("body", data, player.said(data)) if data else None
    return Block(heading="Motion", text=absent, player=shown, pictures=found.pictures, rows=scale)


def tip(result: RunResult, prefix: str) -> Block:
    """Displacement of the tip along every direction across the axis in which it moves."""
    rows, still = [], []
    for number, (direction, what) in enumerate(tips(result).items()):
        if is_round_off(result, what):
            still.append(direction)
            continue
        caption, label = captions.tip(result, ACROSS[direction], what), f"Tip {direction}"
        rows.append((drawing(f"{prefix}-tip-{direction}", histories.history, caption, result, what, label, "m", what),))
        if result.tip_error is not None:
            inside = "; in it the difference to the full model" if "full" in result.responses else ""
            said = f"How far off the tip may be {ACROSS[direction]} by the estimate{inside}."
            wide = result.tip_error[:, number]
            rows.append((drawing(f"{prefix}-band-{direction}", histories.band, said, result, what, wide),))
    return Block(heading="Motion of the tip", rows=tuple(rows), text=not_drawn(result, still))


def stress(result: RunResult, prefix: str) -> Block | None:
    """The largest von Mises stress."""
    if "reduced" not in result.body.peak_stress:
        return None
    below = "; below, the difference to the full model" if "full" in result.body.peak_stress else ""
    where = sentences.where_the_peak_is(result, "reduced")
    dot = f" The dot is the largest of all, {where}." if where else ""
    caption = f"Largest von Mises stress over the whole body{below}.{dot}"
    rows = ((drawing(f"{prefix}-stress", forces.stress, caption, result),),)
    return Block(heading="Stress", rows=rows, grids=borne.regions(result))


def contact(result: RunResult, prefix: str) -> Block | None:
    """Forces of pads or sliders, group by group."""
    groups = forces_of(result)
    rows = tuple(
        (drawing(f"{prefix}-forces-{number}", forces.forces, _of_forces(result, name, len(group)), result, group),)
        for number, (name, group) in enumerate(groups.items(), start=1)
    )
    heading = forces_called(result).capitalize()
    return Block(heading=heading, rows=rows, grids=borne.forces(result)) if rows else None


def energy(result: RunResult, prefix: str) -> Block:
    """Total energy and its parts."""
    said, total = "Total energy: kinetic and strain energy less the work of the loads", attrgetter("energy.total")
    caption = captions.history(result, said, total)
    first = drawing(f"{prefix}-energy", histories.history, caption, result, total, "Total energy", "J", total)
    parts = drawing(f"{prefix}-energy-parts", histories.energy_parts, captions.energy_parts(result), result)
    return Block(heading="Energy", rows=((first,), (parts,)))


def constraint(result: RunResult, prefix: str) -> Block | None:
    """How well the rows that move hold at both levels; where velocities are free, positions do to round-off."""
    if not np.isfinite(result.responses["reduced"].residual_velocity).all():
        return None
    row = []
    for name, unit in (("position", "m"), ("velocity", "m/s")):
        what, label = attrgetter(f"residual_{name}"), f"Residual of {name} in {unit}"
        caption = captions.residual(result, what, name)
        row.append(drawing(f"{prefix}-residual-{name}", histories.residual, caption, result, what, label))
    return Block(heading="Constraint", rows=(tuple(row),))


def basis(result: RunResult, prefix: str) -> Block | None:
    """Shapes of the basis, singular values of what it was made from, frequencies."""
    rows: list[tuple[Drawing, ...]] = []
    if len(transverse(member_at(result.scene))) == 1:
        rows.append((drawing(f"{prefix}-basis", shapes.basis, captions.basis(result), result),))
    row = []
    if result.scene.reduction.pooled:  # others have singular values of 1, all of them
        caption = "Singular values of the snapshots. κ is the share of the sum of their squares that the basis keeps."
        row.append(drawing(f"{prefix}-singular-values", spectra.singular_values, caption, result))
    if "reduced" in result.frequencies.models:
        row.append(drawing(f"{prefix}-frequencies", spectra.frequencies, captions.frequencies(result), result))
    rows += [tuple(row)] if row else []
    return Block(heading="Basis and eigenfrequencies", rows=tuple(rows)) if rows else None


def response(result: RunResult, prefix: str) -> Block | None:
    """What moves the tip by how much at which frequency, where it was asked for."""
    found = result.frequency_response
    if found is None:
        return None
    drawings, grids = [], []
    for k, name in enumerate(found.inputs):
        if not np.any(found.gain[:, :, k]):
            continue
        caption = f"Response of {found.outputs[k]} to {name} with the sliders at rest, each curve at one s in m."
        drawings.append(drawing(f"{prefix}-response-{k}", spectra.gain, caption, found, k))
        said = result.summary["frequency_response"]["gain"][name]
        rows = [
            (
                f"{plain(round(float(s), 3))}{SPACE}m",
                significant(said["static"][j]),
                significant(said["largest"][j]) if found.damped else "no damping",
                significant(said["at"][j]),
            )
            for j, s in enumerate(found.s)
        ]
        head = ("s", f"static, {said['unit']}", f"largest, {said['unit']}", "at, Hz")
        grids.append(Grid(f"{found.outputs[k]} under {name}", head, tuple(rows)))
    pairs = tuple(tuple(drawings[k : k + 2]) for k in range(0, len(drawings), 2))
    return Block(heading="Response in frequency", rows=pairs, grids=tuple(grids))


def origin(result: RunResult, prefix: str) -> Block:
    """What was asked for, how large it became, how long it took, where it ran."""
    columns = (
        (parameters.body(result), Table("Run", tuple(provenance.run(result)))),
        (parameters.motion(result), Table("Wall time", tuple(provenance.times(result.summary.get("seconds", {}))))),
        (parameters.method(result), Table("Sizes", tuple(provenance.sizes(result)))),
    )
    shown = [[table for table in column if table.rows] for column in columns]
    return Block(heading="Provenance", columns=shown, software=provenance.software(result))


#: In the order in which they stand in the page.
SECTIONS: tuple[Show, ...] = (
    errors, accuracy, motion, inputs_over_time, tip, stress, borne.probes, contact, energy, constraint,
    basis, response, origin,
)  # fmt: skip


def _weight(result: RunResult) -> str:
    gravity = result.scene.gravity
    if gravity is None:
        return ""
    rise = f", which comes up within the first {plain(gravity.rise)}{SPACE}s" if gravity.rise else ""
    return f" The weight acts too{rise}."


def _of_forces(result: RunResult, group: str, count: int) -> str:
    if not result.scene.pads:
        return "Slider force: the multiplier λ of the constraint. The slider pushes with −λ on the body."
    most = f" The first {forces.MOST_FORCES} of {count}." if count > forces.MOST_FORCES else ""
    in_parts = result.responses["reduced"].force_peaks is not None  # a step was made in parts, for pads that only push
    within = " Of those that only push the largest within each step." if in_parts else ""
    return f"Forces of the pads at the {group}, positive where they push the body inwards.{within}{most}"
