"""What a boom does at places where a limit governs its load chart: shape, forces, stresses, and what else is used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.results.quantities import mises
from pmr.simulation.statics.postures import Bent, Postures
from pmr.studies.allowed import Place
from pmr.studies.field_probes import FIELD
from pmr.studies.limits import Limit
from pmr.studies.stops import Stopping

Array = NDArray[np.float64]
#: Share of a load by which less of it is looked at.
BELOW = 1e-6


def chosen(load: Array) -> NDArray[np.int64]:
    """By limit (l,) the number of the place of those of loads (p, l) kg at which it governs the largest; or -1."""
    least = np.where(np.isnan(load), np.inf, load)
    which, most = least.argmin(axis=1), least.min(axis=1)
    numbers = np.full(load.shape[1], -1)
    for k in range(load.shape[1]):
        governed = np.flatnonzero((which == k) & np.isfinite(most) & (most > 0.0))
        if len(governed):
            numbers[k] = governed[np.argmax(most[governed])]
    return numbers


def details(
    limits: Sequence[Limit], places: Sequence[Place | None], loads: Array, bent: Bent, stops: Sequence[Stopping]
) -> dict[str, NDArray[Any]]:
    """Arrays of places, each of one limit, None without one, under their loads (p,) kg.

    ``forces`` (p, m) N, ``bent`` (p, b) m across the boom at ``bent.x`` of ``bent.section`` along ``direction.names``,
    ``stress`` (p, s) Pa, von Mises', ``used`` (p, l), shares of all limits and of what it buckles under, and
    ``luffing`` (p,) rad, with the names of all, and ``stops`` (p, stops, 5) as `pmr.studies.stops` has them.
    """
    at = next((place.at for place in places if place is not None), None)
    if at is None:
        return {}
    governing_limits = [*limits, None]  # stability has no share that swings
    rows = [
        None if place is None else _row(limits, place, load, bent) | _swings(governing_limits[n], place, load, stops)
        for n, (place, load) in enumerate(zip(places, loads.tolist(), strict=True))
    ]
    example_row = next(row for row in rows if row is not None)
    empty = {name: np.full_like(place, np.nan) for name, place in example_row.items()}
    arrays = {name: np.array([(row or empty)[name] for row in rows]) for name in example_row}
    names = {
        "forces": at.force_names,
        "stress": tuple(at.columns.stresses()),
        "direction": bent.direction,
        "section": bent.names,
    }
    arrays |= {f"{name}.names": np.array(place, dtype=np.str_) for name, place in names.items()}
    return arrays | {"kinds": np.array(at.force_kinds, dtype=np.str_), "bent.x": bent.x, "bent.section": bent.section}


def _probes(at: Postures) -> dict[str, dict[str, int]]:
    """Probes of the scene itself."""
    return {probe: components for probe, components in at.columns.stresses().items() if FIELD not in probe}


def _row(limits: Sequence[Limit], place: Place, load: float, bent: Bent) -> dict[str, Array]:
    """Just below the load, where the limit of stability would leave nothing standing."""
    at, load = place.at, load * (1.0 - BELOW)
    state = place.loaded.state(load)
    shape = Place(bent.measured(at), place.k, place.amounts, place.gravity).loaded.state(load)
    stress = [
        float(mises(state.outputs[list(components.values())], tuple(components))) for components in _probes(at).values()
    ]
    used = [place.used(limit, state) for limit in limits]
    return {
        "forces": state.forces,
        "bent": shape.outputs,
        "stress": np.array(stress),
        "used": np.array([*used, load / state.form.critical]),
        "luffing": at.luffing[place.k],
    }


def _swings(limit: Limit | None, place: Place, load: float, stops: Sequence[Stopping]) -> dict[str, Array]:
    stop_rows = [stop.row(place, load * (1.0 - BELOW), limit) for stop in stops]
    return {"stops": np.array(stop_rows).reshape(-1, 5)}
