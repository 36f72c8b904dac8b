"""The chapter of a boom of several sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from pmr.report import borne
from pmr.report.blocks import Block, Chapter, Drawing, Grid, KeyNumber, Player, Table, drawing
from pmr.report.booms import figures
from pmr.report.booms.lines import tip
from pmr.report.booms.motion import motion, said
from pmr.report.marks import ErrorTable, Row, signed_deviation
from pmr.report.numbers import SPACE, length, percent, plain, quantity, significant, times_the_true_error
from pmr.report.subject import is_round_off, not_drawn
from pmr.results import RunResult

PLACES = {
    "tip": "tip",
    "beam": "all sections",
    "pad_force": "pads",
    "cylinder_force": "cylinders",
    "cylinder_force_between_kinks": "cylinders between kinks",
    "support_force": "supports that give way",
}


def chapter(result: RunResult, anchor: str) -> Chapter:
    """Everything that the report says of one run; `anchor` is put before every identifier."""
    caption = f"The boom on its way out; deflection is drawn {plain(figures.exaggeration(result))} times its size."
    return Chapter(
        anchor=anchor,
        title=result.scene.title,
        opening=opening(result),
        sketch=drawing(f"{anchor}-boom", figures.boom, caption, result),
        key_numbers=list(_numbers(result)),
        warnings=[warning[:1].upper() + warning[1:] for warning in result.summary.get("warnings", ())],
        blocks=list(_blocks(result, anchor)),
    )


def opening(result: RunResult) -> str:
    """What it is about, in a sentence or two."""
    boom, low, high = result.scene, float(result.along.min()), float(result.along.max())
    out = f"{low:.4g}{SPACE}m to {high:.4g}{SPACE}m" if high > low else f"{low:.4g}{SPACE}m"
    return (
        f"A boom of {len(boom.sections)} sections, all of which bend: {', '.join(boom.names)}. It reaches {out} from "
        "the tail of the base."
    )


def rows(result: RunResult) -> list[Row]:
    """Lines of the error table, as the terminal shows them too."""
    summary, found = result.summary, list[Row]()
    for place, called in PLACES.items():
        if (error := summary["errors"].get("reduced_vs_full", {}).get(place)) is not None:
            found.append(Row("reduced against full", called, percent(error)))
    for place in summary.get("not_judged", ()):
        found.append(Row("reduced against full", PLACES.get(place, place), "not judged"))
    for one in summary["sections"]:
        if "errors" in one:
            found.append(Row("reduced against full", one["name"], percent(one["errors"]["reduced_vs_full"]["beam"])))
    for place, called in PLACES.items():
        if (size := summary.get("estimate", {}).get(place)) is not None:
            found.append(Row("estimated without the full model", called, percent(size)))
    if (allowed := summary.get("accuracy", {}).get("tolerance")) is not None:
        found.append(
            Row("allowed", ", ".join(PLACES[kind] for kind in summary["accuracy"]["outputs"]), percent(allowed))
        )
    found.append(Row("largest transverse displacement", "", length(summary["max_displacement"], 4)))
    if summary["max_error"] is not None:
        found.append(Row("largest difference, reduced to full", "", length(summary["max_error"], 4)))
    for model, value in summary.get("max_von_mises", {}).items():
        found.append(Row("largest von Mises stress", model, quantity(value, "Pa", 4)))
    return found


def estimate(result: RunResult) -> str:
    """What the estimate includes, or why there is none; empty where none was asked for."""
    found = result.summary.get("estimate")
    if found is None:
        return ""
    if found["beam"] is None:
        return f"The error can't be estimated without the full model: {found['reason']}."
    true = result.summary["errors"].get("reduced_vs_full", {}).get("beam")
    ratio = times_the_true_error(found["beam"], true)
    known = f", and is {ratio} along all sections" if ratio else ""
    return (
        f"The estimate includes a margin of a quarter{known}. It does not cover {'; nor '.join(found['not_covered'])}."
    )


def _numbers(result: RunResult) -> Iterator[KeyNumber]:
    summary, responses = result.summary, result.responses
    sizes = summary["coordinates"]
    yield KeyNumber(f"{plain(sizes['full'])}{SPACE}→{SPACE}{sizes['reduced']}", "coordinates")
    errors = summary["errors"].get("reduced_vs_full", {})
    for place, label in (
        ("tip", "error at the tip"),
        ("beam", "error along all sections"),
        ("pad_force", "error of the forces of pads"),
        ("cylinder_force", "error of the forces of cylinders"),
    ):
        if place in errors:
            yield KeyNumber(percent(errors[place]), label)
    if not errors and (said := summary.get("estimate", {}).get("beam")) is not None:
        yield KeyNumber(percent(said), "estimated error along all sections", "without the full model")
    if "full" in responses:
        ratio = responses["full"].seconds / responses["reduced"].seconds
        yield KeyNumber(f"{significant(ratio, 2)}{SPACE}×", "as fast as full")
    yield KeyNumber(
        quantity(responses["reduced"].seconds, "s"), "simulated in", f"{result.scene.time.end:g} s of motion"
    )


def _blocks(result: RunResult, prefix: str) -> Iterator[Block]:
    table = rows(result)
    compared = "full" in result.responses
    caption = "Normalised RMS errors, and largest values." if compared else "Over all times and places."
    heading = "Errors" if compared or result.summary.get("estimate", {}).get("beam") is not None else "Largest values"
    yield Block(heading=heading, text=estimate(result), errors=ErrorTable(caption, table, []))
    data = motion(result)
    text = "Sections slide in each other as their extensions say; the page on a screen plays it."
    yield Block(heading="Motion", text=text, player=Player("boom", data, said(data)))
    caption = "Lowest natural frequencies of the boom at rest, every pad closed."
    row = [
        drawing(f"{prefix}-extensions", figures.extensions, "Extension of each section over time.", result),
        drawing(f"{prefix}-frequencies", figures.frequencies, caption, result),
    ]
    published = _published(result) if "published_frequencies" in result.summary else ()
    drawn = [tuple(row)]
    if (over := result.frequencies.over_joints) is not None:
        caption = (
            f"First natural frequency in Hz over the extensions of {' and '.join(over.joints)}, every pad closed; the "
            "white line is the way of this run."
        )
        drawn.append((drawing(f"{prefix}-map", figures.frequency_map, caption, result),))
    yield Block(heading="Extensions and frequencies", rows=tuple(drawn), grids=published)
    yield _tip(result, prefix)
    yield _forces(result, prefix, "pads", "Pad forces", "Positive where a pad pushes the sections apart.")
    if result.summary["cylinders"]:
        note = "What a cylinder or rope pushes its section out with, friction included; negative where it pulls."
        yield _forces(result, prefix, "cylinders", "Cylinder forces", note)
    if grids := tuple(borne.reactions(result.responses["reduced"], result.along, "s is the reach")):
        yield Block(heading="Supports", grids=grids)
    if "max_von_mises" in result.summary:
        yield _stresses(result)
    yield _origin(result)


def _tip(result: RunResult, prefix: str) -> Block:
    difference = "; below, the difference to the full model" if "full" in result.responses else ""
    rows, still = [], []
    for d in (d for d in "yz" if tip(result, result.responses["reduced"], d) is not None):
        if is_round_off(result, partial(tip, result, direction=d)):
            still.append(d)
        else:
            caption = f"Displacement along {d}{difference}."
            rows.append((drawing(f"{prefix}-tip-{d}", figures.tip_history, caption, result, d),))
    return Block(heading="Motion of the tip", rows=tuple(rows), text=not_drawn(result, still))


def _published(result: RunResult) -> tuple[Grid]:
    assert result.scene.published is not None
    rows = []
    for one in result.summary["published_frequencies"]:
        models = [name for name in ("full", "reduced") if name in one]
        ours = [f"{one[name]:.4f} ({signed_deviation(one[name], one['published'])})" for name in models]
        rows.append((f"{one['reach']:.5g}{SPACE}m", f"{one['published']:g}", *ours))
    remarks = "".join(f" {remark}" for remark in result.scene.published.remarks)
    caption = f"First natural frequency in Hz beside the published one ({result.scene.published.source}).{remarks}"
    return (Grid(caption, ("reach", "published", *models), tuple(rows)),)


def _forces(result: RunResult, prefix: str, kind: str, heading: str, note: str) -> Block:
    found: Sequence[Mapping[str, Any]] = result.summary[kind]
    names = [f"force of {one['name']}" for one in found]
    rubbing = any("friction" in one for one in found)
    drawn: list[Drawing] = []
    for first in range(0, len(names), figures.MOST_FORCES):
        some = names[first : first + figures.MOST_FORCES]
        drawn.append(drawing(f"{prefix}-{kind}-{first}", figures.forces, f"{heading} over time. {note}", result, some))
    table = Grid(
        "Smallest and largest force, and when.",
        ("", "smallest", "at", "largest", "at", *(["friction up to"] if rubbing else [])),
        tuple(
            (
                str(one["name"]),
                quantity(one["min"], "N"),
                f"{one['t_min']:.4g}{SPACE}s",
                quantity(one["max"], "N"),
                f"{one['t_max']:.4g}{SPACE}s",
                *([quantity(one.get("friction", 0.0), "N")] if rubbing else []),
            )
            for one in found
        ),
    )
    return Block(heading=heading, rows=tuple((one,) for one in drawn), grids=(table,))


def _stresses(result: RunResult) -> Block:
    """Of every section: the largest stress of each model, when, and where it is along the section."""
    found = []
    for one in result.summary["sections"]:
        for model, peak in one.get("stress_peak", {}).items():
            at, where = f"{peak['t']:.4g}{SPACE}s", f"{peak['position'][0]:.3g}{SPACE}m"
            face = f"{peak['face']} of {peak['region']}" if peak["region"] else peak["face"]
            found.append((f"{one['name']}, {model}", quantity(peak["value"], "Pa", 4), at, where, face))
    head = ("", "von Mises", "at", "from the tail", "on")
    return Block(heading="Stress", grids=(Grid("Largest von Mises stress of each section.", head, tuple(found)),))


def _origin(result: RunResult) -> Block:
    summary = result.summary
    sizes = tuple(
        (one["name"], f"{plain(one['coordinates']['full'])} → {plain(one['coordinates']['reduced'])}")
        for one in summary["sections"]
    )
    seconds = {name: value for name, value in summary["seconds"].items() if name != "simulate"}
    seconds |= {f"simulation, {name}": value for name, value in summary["seconds"]["simulate"].items()}
    times = tuple((name, quantity(float(value), "s")) for name, value in seconds.items())
    run = tuple((name, str(summary[key])) for name, key in (("scene", "scene_hash"), ("commit", "commit")))
    columns = ((Table("Coordinates", sizes), Table("Run", run)), (Table("Wall time", times),))
    software = [f"{name}{SPACE}{version}" for name, version in summary["versions"].items() if isinstance(version, str)]
    return Block(heading="Provenance", columns=columns, software=software)
