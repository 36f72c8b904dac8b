"""The sentences below the figures, where they depend on the case."""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter

import numpy as np

from pmr.report.columns import Quantity, unseen
from pmr.report.figures import shapes
from pmr.report.figures.canvas import PENS
from pmr.report.figures.timeline import Array, Span, Timeline, in_order, reference
from pmr.report.numbers import NOTHING, SPACE, length, percent
from pmr.report.subject import moving_part
from pmr.results import RunResult, Shapes

LEVEL = 1e-6  # relative difference of neighbouring frequencies that are one


def model_words(simulator: str) -> str:
    """A simulator's model in a sentence."""
    return "ANCF" if simulator == "ancf" else f"the {simulator} model"


def history(result: RunResult, what: str, focus: Quantity, where: str = "") -> str:
    """Below a quantity's history, whose detail is about `focus` and lies `where`."""
    below = difference_clause(result, Timeline(result).signals(focus), "below, the difference")
    return f"{what}{below}.{_window_sentence(Timeline(result).detail(focus), where)}"


def difference_clause(result: RunResult, signals: Mapping[str, Array], shown: str) -> str:
    """A clause on the difference to the reference: where it is `shown`, or that there is as good as none."""
    base, limit = reference(result), unseen(result)
    if base is None or base not in signals:
        return ""
    if Timeline(result).apart(signals)[0]:
        return f"; {shown} to {model_words(base)}"
    share = "the time step's error" if limit > NOTHING else f"{percent(NOTHING, 1)} of the largest value"
    return f"; {model_words(base)} differs by less than {share}"


def _window_sentence(window: Span | None, where: str) -> str:
    """Sentence about the part of a history that is enlarged; empty where none is."""
    if window is None:
        return ""
    return f" The frame, {window.start:.2f}{SPACE}s to {window.end:.2f}{SPACE}s{where}, is enlarged on the right."


def tip(result: RunResult, direction: str, what: Quantity) -> str:
    """Below the tip's history along a direction."""
    about = "deviates most" if Timeline(result).apart(Timeline(result).signals(what))[0] else "moves most"
    return history(result, f"Displacement of the tip, {direction}", what, f", where it {about}")


def tip_alone(result: RunResult, direction: str, what: Quantity, apart: float) -> str:
    """Caption of the tip's displacement where the others are `apart` (m) from it at most, which is nothing."""
    time, signal = Timeline(result), what(result.responses["reduced"])
    window = time.window(int(np.argmax(np.abs(signal))))
    sentence = f"Displacement of the tip, {direction}; that of {model_words(reference(result) or '')} differs by "
    return f"{sentence}{length(apart, 2)} at most.{_window_sentence(window, ', where it moves most')}"


def snapshots(result: RunResult) -> str:
    """Below the strip of deflected beams."""
    moments = f"at the largest tip displacement in each of {shapes.SNAPSHOTS} equal parts of the time"
    what = "boom" if moving_part(result) == "boom" else "body"
    return f"The deflected {what} {moments}. The transverse scale is exaggerated."


def energy_parts(result: RunResult) -> str:
    """Below the parts of the energy."""
    time = Timeline(result)
    of = [time.signals(attrgetter(f"energy.{part}")) for part in ("strain", "kinetic", "external")]
    base = reference(result) if any(time.apart(*of)) else None
    on_the_right = f"; on the right, the differences to {model_words(base)}" if base else ""
    return f"Strain, kinetic and external energy, which is minus the work of the loads{on_the_right}."


def residual(result: RunResult, what: Quantity, level: str) -> str:
    """Below a constraint residual; says of which simulator it is not known."""
    unknown = [PENS[name].label for name in in_order(result) if name not in Timeline(result).signals(what)]
    missing = f" It is not known for {' and '.join(unknown)}." if unknown else ""
    return f"Constraint residual at {level} level, the largest value of each interval.{missing}"


def basis(of: Shapes) -> str:
    """Below the shapes of the basis."""
    count = of.shapes.shape[1]
    first = f"the first {shapes.MOST_SHAPES} of {count}" if count > shapes.MOST_SHAPES else f"all {count}"
    flat = " A flat line belongs to a vector that moves the body along its axis only."
    scaled = f"Transverse shapes of the basis vectors, {first}, each over its largest value."
    return f"{scaled}{flat if shapes.has_flat(of) else ''}"


def frequencies(result: RunResult) -> str:
    """Caption of the eigenfrequencies."""
    lowest = result.frequencies
    if lowest.t is not None:
        stays = len(lowest.along) > 1 and not np.ptp(lowest.along)
        when = "over time" if stays else "when it is there first"
        return f"Lowest natural frequencies {when}, as the frame and axial forces stress the boom, every pad closed."
    if moving_part(result) == "boom":
        return "Lowest natural frequencies of the boom at rest, every pad closed."
    omega = result.frequencies.models["reduced"]
    level = np.abs(np.diff(omega, axis=0)) < LEVEL * omega[1:]
    along = " Level stretches belong to vibration along the axis." if level.any() else ""
    return f"Lowest eigenfrequencies while the {moving_part(result)} rests.{along}"
