"""Pages of a load chart's governing points: where a limit governs the largest load, what the boom does there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.blocks import Block, Table, drawing
from pmr.report.figures.at_rest import AtRest, at_rest
from pmr.report.numbers import SPACE, plain, quantity
from pmr.report.studies.finished import FinishedStudy
from pmr.results.outputs import FORCES
from pmr.scene.names import ALONE

Array = NDArray[np.float64]
#: Arrays of a study's runs, one after the other.
Parts = Sequence[Mapping[str, NDArray[Any]]]
#: Share of the largest below which a force or displacement is round-off.
ROUND_OFF = 1e-9


def pages(study: FinishedStudy, names: list[str], arrays: Parts, prefix: str) -> Iterator[Block]:
    """A block for each limit that governs under some load, with a page of its own on paper."""
    for n in range(len(names)):
        best = [(float(a["load"][k, n]) if (k := int(a["at.place"][n])) >= 0 else -1.0) for a in arrays]
        row = int(np.argmax(best))
        if best[row] > 0.0:
            yield _page(study, names, n, row, arrays[row], f"{prefix}-at-{n + 1}")


def _page(
    study: FinishedStudy, names: list[str], n: int, row: int, arrays: Mapping[str, NDArray[Any]], anchor: str
) -> Block:
    k = int(arrays["at.place"][n])
    load, error = float(arrays["load"][k, n]), float(arrays["error"][k, n])
    out = {p.removeprefix("extension."): float(v) for p, v in study.results.runs[row].parameters.items() if v}
    angle, tails = float(arrays["at.luffing"][n]), np.cumsum([0.0, *out.values()])
    section, upwards = arrays["at.bent.section"].astype(int), arrays["at.direction.names"] == "z"
    sections = tuple(str(name) if name != ALONE else "boom" for name in arrays["at.section.names"])
    radius, height = arrays["place"][k]
    boom = AtRest(
        along=(arrays["at.bent.x"] + tails[section])[upwards],
        across=arrays["at.bent"][n][upwards],
        section=section[upwards],
        names=sections,
        luffing=angle,
    )
    caption = (
        f"The boom at rest under {load:.5g}{SPACE}kg, seen from the side, displacements drawn {boom.scale:g} times as "
        "large; thin where it is without any load."
    )
    stands = ", ".join(f"{name} out {value:.3g}{SPACE}m" for name, value in out.items())
    bar = f" ± {plain(float(f'{error:.2g}'))}" if np.isfinite(error) else ""
    text = (
        f"Raised by {np.rad2deg(angle):.3g}°{', ' if stands else ''}{stands}: radius {radius:.4g}{SPACE}m, height "
        f"{height:.4g}{SPACE}m. It carries {load:.5g}{bar}{SPACE}kg, by {names[n]}, the largest load that this limit "
        "governs."
    )
    text += "".join(f" {name}" for name in _stops(study, names[n], arrays["at.stops"][n]))
    drawn = drawing(anchor, at_rest, caption, boom)
    return Block(
        f"Governed by {names[n]}", ((drawn,),), text=text, columns=_columns(names, n, arrays, sections), page=True
    )


def _stops(study: FinishedStudy, limit: str, stops: Array) -> Iterator[str]:
    """Sentences on how it stops turning there."""
    for stop, (factor, at_rest_share, steady, most, speed) in zip(study.asked["stops"], stops.tolist(), strict=True):
        if np.isnan(factor):
            continue
        sentence = (
            f"If {stop['of']} at {np.rad2deg(speed):.3g}°/s stops within {stop['within']:g}{SPACE}s, the tip swings "
        )
        sentence += f"{factor:.3g} times as far as a steady deceleration moves it"
        if stop["class_factor"] is not None:
            sentence += f" (the study's own factor is {stop['class_factor']:g})"
        if most > steady or most > at_rest_share:
            sentence += f", and the use of {limit} goes from {100 * at_rest_share:.3g} to {100 * most:.4g}{SPACE}%"
            sentence += f", by the steady deceleration to {100 * steady:.4g}{SPACE}%"
        yield f"{sentence}."


def _columns(
    names: list[str], n: int, arrays: Mapping[str, NDArray[Any]], sections: tuple[str, ...]
) -> list[list[Table]]:
    """Shares of limits, stresses and displacements beside the forces."""
    used = zip(names, arrays["at.used"][n], strict=True)
    tables = [Table("Used of each limit", tuple((name, f"{100.0 * share:.3g}{SPACE}%") for name, share in used))]
    if len(stress := arrays["at.stress"][n]):
        probes = zip(arrays["at.stress.names"], stress, strict=True)
        tables.append(
            Table("Von Mises' stress", tuple((str(name), quantity(float(value), "Pa")) for name, value in probes))
        )
    direction, of, bent = arrays["at.direction.names"], arrays["at.bent.section"], _zero_round_off(arrays["at.bent"][n])
    for d, way in (("z", "upwards"), ("y", "to the left")):
        if (direction == d).any():
            deflections = [float(bent[(of == k) & (direction == d)][-1]) for k in range(len(sections))]
            tips = tuple((name, quantity(value, "m")) for name, value in zip(sections, deflections, strict=True))
            tables.append(Table(f"Tips of sections, across the boom {way}", tips))
    forces = zip(arrays["at.forces.names"], arrays["at.kinds"], _zero_round_off(arrays["at.forces"][n]), strict=True)
    some = tuple((str(name), quantity(float(f), "N")) for name, kind, f in forces if kind in FORCES)
    return [tables, [Table("Forces, positive where they push", some)]] if some else [tables]


def _zero_round_off(values: Array) -> Array:
    """Replace what is round-off beside the largest value by zero."""
    return np.where(np.abs(values) < ROUND_OFF * np.abs(values).max(initial=0.0), 0.0, values)
