"""The summary of a case for those who decide: key numbers, and a paragraph."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pmr.report.marks import Row, verdicts
from pmr.report.numbers import SPACE, length, percent, plain, quantity, significant, unit_for
from pmr.results import RunResult
from pmr.scene import StructureScene

_PLACES = {"tip": "error at the tip", "beam": "error along the beam", "pad_force": "error of the pad forces"}


@dataclass(frozen=True)
class KeyNumber:
    """A key number and what it is."""

    value: str
    label: str


def key_numbers(result: RunResult) -> list[KeyNumber]:
    """The numbers that stand above everything else; what a run does not hold is left out."""
    return list(_numbers(result))


def paragraph(result: RunResult, table: list[Row]) -> str:
    """What the case says, in a few sentences."""
    return " ".join(_sentences(result, table))


def noun(result: RunResult) -> str:
    """What is reduced, in a word: a planar scene is a beam."""
    return "model" if isinstance(result.scene, StructureScene) else "beam"


def estimate(result: RunResult) -> str:
    """The error estimate in a sentence, beside the true error where that is known; else empty."""
    found = result.summary.get("estimate")
    true = result.summary.get("errors", {}).get("reduced_vs_full", {}).get("beam")
    if found is None or (found["beam"] is None and true is not None):
        return ""
    if found["beam"] is None:
        return f"The error can't be estimated without the full {noun(result)}: {found['reason']}."
    tip, beam = percent(found["tip"]), percent(found["beam"])
    said = f"The estimate, which needs no full {noun(result)}, is {tip} at the tip and {beam} along the beam"
    if found.get("pad_force") is not None:
        said = f"{said.replace(' and ', ', ')} and {percent(found['pad_force'])} in the forces of sliders and pads"
    known = (
        f", {significant(found['beam'] / true, 3)} times the true error"
        if true
        else "; it includes a margin of a quarter"
    )
    left_out = found.get("not_covered")
    rest = f" It does not cover {'; nor '.join(left_out)}." if left_out else ""
    return f"{said}{known}.{rest}"


def step(result: RunResult) -> str:
    """The error of the time step in a sentence; empty where there is no figure."""
    found = result.summary.get("step", {})
    if found.get("beam") is None:
        return ""
    tip, beam = percent(found["tip"]), percent(found["beam"])
    size = "is" if found["settled"] else "is at least"
    of = ", of the mean motion," if found["by"] == "mean" else ""
    return f"The error of the time step itself{of} {size} {tip} at the tip and {beam} along the beam."


def speed_ratio(result: RunResult) -> float | None:
    """How many times as fast the reduced model is simulated as the full one."""
    full, reduced = (result.responses.get(name) for name in ("full", "reduced"))
    if full is None or reduced is None or reduced.seconds <= 0.0 or full.seconds <= 0.0:
        return None
    return full.seconds / reduced.seconds


def _numbers(result: RunResult) -> Iterator[KeyNumber]:
    coordinates = result.summary.get("coordinates", {})
    reduced = coordinates.get("reduced", result.shapes.shapes.shape[1])
    arrow = f"{coordinates['full']}{SPACE}→{SPACE}{reduced}" if "full" in coordinates else f"{reduced}"
    yield KeyNumber(arrow, "coordinates")
    errors = result.summary.get("errors", {}).get("reduced_vs_full", {})
    for place, label in _PLACES.items():
        if place in errors:
            yield KeyNumber(percent(errors[place]), label)
    estimated = result.summary.get("estimate", {}).get("beam")
    if estimated is not None:
        yield KeyNumber(percent(estimated), "estimated, along the beam")
    if result.summary.get("max_error") is not None:
        yield KeyNumber(length(result.summary["max_error"]), "largest difference to full")
    stress = result.summary.get("max_von_mises", {})
    if "reduced" in stress:
        unit = unit_for(stress["reduced"], "Pa")
        values = [significant(stress[name] / unit.size) for name in ("full", "reduced") if name in stress]
        yield KeyNumber(f"{f'{SPACE}→{SPACE}'.join(values)}{SPACE}{unit.name}", "largest von Mises stress")
    ratio = speed_ratio(result)
    if ratio is not None:
        yield KeyNumber(f"{significant(ratio, 2)}{SPACE}×", "speed against full")


def _sentences(result: RunResult, table: list[Row]) -> Iterator[str]:
    yield size(result)
    yield from accuracy(result)
    if said := estimate(result):
        yield said
    if said := step(result):
        yield said
    yield from speed(result)
    count = sum(verdicts(table).values())
    if count:
        told = ", ".join(f"{number} {text}" for text, number in verdicts(table).items())
        yield f"Beside {count} published figures: {told}."


def size(result: RunResult) -> str:
    """Coordinates before and after."""
    coordinates = result.summary.get("coordinates", {})
    reduced = coordinates.get("reduced", result.shapes.shapes.shape[1])
    motion = f"{plain(result.scene.time.end)}{SPACE}s of motion are simulated."
    if "full" not in coordinates:
        return f"The reduced {noun(result)} has {reduced} coordinates; {motion}"
    full = coordinates["full"]
    less = percent(1.0 - reduced / full, 2 if reduced > 0.005 * full else 4)  # no reduction is by 100 %
    return f"The reduced {noun(result)} has {reduced} coordinates instead of {full}, a reduction by {less}; {motion}"


def accuracy(result: RunResult) -> Iterator[str]:
    """Errors against the references that the run has."""
    errors = result.summary.get("errors", {})
    if against := _tip_and_beam(errors.get("reduced_vs_full")):
        tip, beam = against
        error = f"a normalised RMS error of {tip} at the tip and {beam} along the beam"
        yield f"It follows the full {noun(result)} with {error}."
    largest, most = result.summary.get("max_displacement"), result.summary.get("max_error")
    if largest is not None and most is not None:
        yield f"The largest difference is {length(most)} where displacements reach {length(largest)}."
    if against := _tip_and_beam(errors.get("reduced_vs_ancf")):
        tip, beam = against
        yield f"Against the independent ANCF beam the errors are {tip} and {beam}."


def _tip_and_beam(errors: Mapping[str, float] | None) -> tuple[str, str] | None:
    if not errors or not {"tip", "beam"} <= set(errors):
        return None
    return percent(errors["tip"]), percent(errors["beam"])


def speed(result: RunResult) -> Iterator[str]:
    """Seconds of the simulations."""
    reduced, ratio = result.responses["reduced"], speed_ratio(result)
    if reduced.seconds <= 0.0:
        return
    took = f"Its simulation took {quantity(reduced.seconds, 's')}"
    pace = result.scene.time.end / reduced.seconds
    paced = f"{significant(pace, 2)} times faster than real time" if pace > 1.0 else "slower than real time"
    if ratio is None:
        yield f"{took}, {paced}."
        return
    full = quantity(result.responses["full"].seconds, "s")
    yield f"{took}, {paced}; that of the full {noun(result)} took {full}, {significant(ratio, 2)} times as long."
