"""What a run of a boom says: natural frequencies on its way, errors of its sections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.booms import columns_of
from pmr.compare.errors import relative_error
from pmr.compare.summary import Part
from pmr.results import Frequencies, FrequencyMap, Response
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.simulation.at_rest import amplitudes_at_rest, steepest
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: Frequencies that are compared, and places on the way at which: fewer where matrices are large.
CURVES, PLACES, FEWER_PLACES = 4, 13, 4
#: Extensions of each joint at which the first frequency is mapped.
MAPPED = 9
#: Share of the reach by which a published one may lie beyond it: it is rounded.
BESIDE = 1e-4


def on_the_way(boom: Scene, t: Array, count: int) -> NDArray[np.int64]:
    """Steps (S,) at which the boom first reaches so far, evenly from its shortest to its longest."""
    reach = boom.reach(t)
    goals = np.linspace(reach.min(), reach.max(), count if np.ptp(reach) > 1e-9 * reach.max() else 1)
    return np.array(list(dict.fromkeys(int(np.argmin(np.abs(reach - goal))) for goal in goals)))


def frequency_map(boom: Scene, system: System) -> FrequencyMap | None:
    """Lowest frequencies over the first two joints that move on paths of their own, every contact closed.

    All other such joints are where they start; None where fewer than two move.  With second order the boom rests at its
    steepest angle.
    """
    ends = {name: path.bounds(0.0, boom.time.end) for name, path in boom.paths.items() if not _follows(boom, name)}
    moving = [name for name, (low, high) in ends.items() if high - low > 1e-9 * high]
    if len(moving) < 2:
        return None
    first, second = moving[:2]
    a, b = (np.linspace(*ends[name], MAPPED) for name in (first, second))
    extensions = {name: np.full((MAPPED, MAPPED), boom.paths[name].value(0.0)) for name in ends}
    extensions[first], extensions[second] = np.meshgrid(a, b, indexing="ij")
    while missing := [name for name in boom.paths if name not in extensions]:
        for name in missing:
            joint = boom.sections[boom.names.index(name)].joint
            if joint is not None and joint.follows in extensions:
                extensions[name] = joint.offset + joint.ratio * extensions[joint.follows]
    x, c = system.coordinates(extensions), np.zeros((MAPPED**2, 0))
    if system.terms:
        placed = {name: np.broadcast_to(at, (MAPPED, MAPPED)).ravel() for name, at in extensions.items()}
        c = amplitudes_at_rest(boom, placed, steepest(boom))
    lowest = Assembly(system).frequencies(x.reshape(-1, x.shape[-1]), 1, c)[:, 0]
    return FrequencyMap((first, second), a, b, lowest.reshape(MAPPED, MAPPED))


def _follows(boom: Scene, name: str) -> bool:
    joint = boom.sections[boom.names.index(name)].joint
    return joint is not None and joint.follows is not None


def beside_published(boom: Scene, frequencies: Frequencies) -> Part:
    """``published_frequencies``: the first one where it is published, and what each model has there.

    What is published beyond this boom's reach is left out, with a line.
    """
    published = boom.published.frequencies if boom.published else ()
    low, high, slack = frequencies.along[0], frequencies.along[-1], BESIDE * frequencies.along[-1]
    within = [frequency for frequency in published if low - slack <= frequency.reach <= high + slack]
    rows = [
        {"reach": frequency.reach, "published": frequency.first}
        | {
            model: float(np.interp(frequency.reach, frequencies.along, f[:, 0]))
            for model, f in frequencies.models.items()
        }
        for frequency in within
    ]
    beyond = ", ".join(f"{frequency.reach:g}" for frequency in published if frequency not in within)
    warning = (
        f"published frequencies at a reach of {beyond} m are left out: this boom reaches {low:.6g} to {high:.6g} m"
    )
    return Part({"published_frequencies": rows} if rows else {}, [warning] if beyond else [])


def sections(
    boom: Scene,
    responses: Mapping[str, Response],
    sizes: Mapping[str, Mapping[str, int]],
    more: Mapping[str, Mapping[str, Any]],
) -> Part:
    """``sections`` of summary.json: name, coordinates, the error along each against the full model, what else is known.

    Of `more`, a table for each section, ``max_von_mises`` and ``stress_peak`` are gathered of all; of a body alone
    it is all that is said.
    """
    if ALONE in boom.bodies:
        return Part(dict(more.get(ALONE, {})))
    reduced, full, rows = responses["reduced"], responses.get("full"), []
    for name in boom.names:
        columns, figures = columns_of(name, reduced), {"name": name, "coordinates": dict(sizes[name])}
        if full is not None:
            error = relative_error(reduced.displacement[:, columns], full.displacement[:, columns])
            figures |= {"errors": {"reduced_vs_full": {"beam": error}}}
        rows.append(figures | dict(more.get(name, {})))
    peaks = [(row["name"], row["stress_peak"]) for row in rows if "stress_peak" in row]
    if not peaks:
        return Part({"sections": rows})
    highest = {
        model: max(({"section": name, **peak[model]} for name, peak in peaks), key=lambda row: float(row["value"]))
        for model in peaks[0][1]
    }
    most = {model: peak["value"] for model, peak in highest.items()}
    return Part({"sections": rows, "max_von_mises": most, "stress_peak": highest})
