"""The boom at points of a chart where a limit governs: shape, forces, stresses, and how it swings when it stops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmr.files.arrays import Array
from pmr.results.quantities import von_mises_stress
from pmr.scene.keys import SceneTable, Usual
from pmr.simulation.statics.loaded import LoadedStates
from pmr.simulation.statics.postures import HOOK, DeflectionOutputs, PostureMatrices
from pmr.simulation.statics.swings import DecelerationLoads, stopping_swing
from pmr.studies.allowed import JUST_BELOW, Place
from pmr.studies.limits import FIELD, Limit


class Stop(SceneTable):
    """A stop of luffing or slewing, in which the speed falls to zero at a constant rate."""

    of: Literal["luffing", "slewing"] = Field(description="Motion that is stopped")
    speed: Annotated[float, Field(gt=0.0)] = Field(
        description="Speed before the stop, in the scene's unit of angles per second"
    )
    within: Annotated[float, Field(gt=0.0), Usual(1e-3, 60.0, unit="s")] = Field(description="Duration of the stop, s")
    class_factor: Annotated[float, Field(ge=1.0)] | None = Field(
        default=None, description="Factor on the drive's forces that a standard gives, for comparison"
    )


@dataclass(frozen=True)
class StopMotion:
    """A stop of luffing or slewing (`angle`) from a `speed` in rad/s to rest in `duration` seconds.

    `acceleration_loads` (P, i) are the loads on i inputs at P postures by an acceleration of the angle of 1 rad/s^2.
    """

    angle: str
    speed: float
    duration: float
    acceleration_loads: Array

    def stop_figures(self, place: Place, load: float, limit: Limit | None) -> Array:
        """Return five numbers (5,) about this stop of the boom, at a place and under a `load` in kg.

        - The first number is the largest displacement of the tip during and after the stop, over the displacement under
          a steady deceleration that lasts and in the same direction; NaN if the tip does not move.
        - The next three are used shares of `limit`: at rest, under a steady deceleration that lasts, and the largest
          share during and after the stop; of both directions of motion the worse one is taken.  They are NaN if `limit`
          is None.
        - The last one is the speed in rad/s.

        If the boom is unstable, all numbers but the speed are NaN.
        """
        none, state = np.array([*[np.nan] * 4, self.speed]), place.equilibria.state(load)
        if not state.in_equilibrium:
            return none
        swing = stopping_swing(state.form, load, self._acting_loads(place, load), self.duration)
        if swing is None:
            return none
        tip = [n for n, kind in enumerate(place.postures.output_kinds) if kind == "tip"]
        steady = swing.steady[0][tip]
        factor = np.abs(swing.outputs[:, tip] @ steady).max() / (steady @ steady) if np.any(steady) else np.nan
        if limit is None:
            return np.append(factor, none[1:])
        share, rate = place.share(limit), self.speed / self.duration

        def most(outputs: Array, forces: Array) -> float:
            """Return the largest share of the limit when the boom stops in either direction.

            `outputs` and `forces` are those per unit of deceleration.
            """
            of, by = (state.outputs, state.forces), (rate * outputs, rate * forces)
            extremes = [np.vstack([values + more, values - more]) for values, more in zip(of, by, strict=True)]
            return float(share(LoadedStates.with_outputs(state, *extremes)).max())

        steadily, swinging = most(*(values[None] for values in swing.steady)), most(swing.outputs, swing.forces)
        return np.array([factor, place.used_share(limit, state), steadily, swinging, self.speed])

    def _acting_loads(self, place: Place, load: float) -> DecelerationLoads:
        """Return the loads by an acceleration of the angle of 1 rad/s^2, with the inertia of the `load` in kg."""
        at, k = place.postures, place.k
        f = self.acceleration_loads[k].copy()
        if self.angle == "luffing":  # the load hangs: only a lift of its rope accelerates it, nothing sideways
            x, _, z = at.place.tip[k]
            lifted = float(at.place.up[k] @ [-z, 0.0, x])  # m by a rotation of one radian
            f += load * lifted / place.gravity * at.loads.f[at.loads.names.index(HOOK), k]
        return DecelerationLoads(
            at.structure.B @ f, -at.rows.H[k] @ f, np.vstack([at.structure.direct, at.machine.loads[k]]) @ f
        )


def largest_governed_rows(load: Array) -> NDArray[np.int64]:
    """Return for each limit (l,) the row of `load` (p, l) in kg at which it governs the largest load; -1 if at none.

    A limit governs a row if its load is the smallest of the row; rows with a smallest load of 0 or NaN are ignored.
    """
    least = np.where(np.isnan(load), np.inf, load)
    which, most = least.argmin(axis=1), least.min(axis=1)
    numbers = np.full(load.shape[1], -1)
    for k in range(load.shape[1]):
        governed = np.flatnonzero((which == k) & np.isfinite(most) & (most > 0.0))
        if len(governed):
            numbers[k] = governed[np.argmax(most[governed])]
    return numbers


def governing_details(
    limits: Sequence[Limit],
    places: Sequence[Place | None],
    loads: Array,
    bent: DeflectionOutputs,
    stops: Sequence[StopMotion],
) -> dict[str, NDArray[Any]]:
    """Return arrays that describe the boom at p places: the n-th limit governs at the n-th, stability at the last.

    `loads` (p,) in kg act at the p places.  If a limit governs nowhere, its place is None and its rows are NaN; if all
    places are None, there are no arrays.

    - ``forces`` (p, m) N of m contacts, and their ``kinds`` (m,).
    - ``bent`` (p, b) m: b displacements across the boom, at the distances ``bent.x`` (b,) m from the tails of the
      sections with the numbers ``bent.section`` (b,), in the directions ``direction.names`` (b,).
    - ``stress`` (p, s) Pa: von Mises stress at s probes.
    - ``used`` (p, l): used shares of all limits, and the load over the buckling load as the last one.
    - ``luffing`` (p,) rad.
    - ``stops`` (p, stops, 5): numbers of `StopMotion.stop_figures`.
    - ``forces.names``, ``stress.names``, ``section.names``: names of contacts, probes, sections.
    """
    at = next((place.postures for place in places if place is not None), None)
    if at is None:
        return {}
    governing_limits = [*limits, None]  # stability has no share that a swing changes
    rows = list[dict[str, Array] | None]()
    for limit, place, load in zip(governing_limits, places, loads.tolist(), strict=True):
        if place is None:
            rows.append(None)
        else:
            rows.append(_place_arrays(limits, place, load, bent) | _stop_arrays(limit, place, load, stops))
    example_row = next(row for row in rows if row is not None)
    empty = {name: np.full_like(values, np.nan) for name, values in example_row.items()}
    arrays = {name: np.array([(row or empty)[name] for row in rows]) for name in example_row}
    names = {"forces": at.force_names, "stress": tuple(_stress_columns(at))}
    names |= {"direction": bent.direction, "section": bent.names}
    arrays |= {f"{of}.names": np.array(named, dtype=np.str_) for of, named in names.items()}
    return arrays | {
        "kinds": np.array(at.force_kinds, dtype=np.str_),
        "bent.x": bent.x,
        "bent.section": bent.section,
    }


def _stress_columns(at: PostureMatrices) -> dict[str, dict[str, int]]:
    """Return, by probe, the column of each stress component among the outputs of the postures `at`.

    Probes that limits of the stress field add are left out.
    """
    return {probe: components for probe, components in at.columns.stress_columns().items() if FIELD not in probe}


def _place_arrays(limits: Sequence[Limit], place: Place, load: float, bent: DeflectionOutputs) -> dict[str, Array]:
    """Return one place's row of each array of `governing_details` but ``stops``, slightly below `load` in kg.

    At the load at which stability is lost there is no equilibrium; therefore a slightly smaller load acts.
    """
    at, load = place.postures, load * (1.0 - JUST_BELOW)
    state = place.equilibria.state(load)
    shape = Place(bent.replace_outputs(at), place.k, place.amounts, place.gravity).equilibria.state(load)
    of_probes = [(list(numbers.values()), tuple(numbers)) for numbers in _stress_columns(at).values()]
    stress = np.array([float(von_mises_stress(state.outputs[numbers], names)) for numbers, names in of_probes])
    used = np.array([*(place.used_share(limit, state) for limit in limits), load / state.form.critical])
    luffing = at.place.luffing[place.k]
    return {"forces": state.forces, "bent": shape.outputs, "stress": stress, "used": used, "luffing": luffing}


def _stop_arrays(limit: Limit | None, place: Place, load: float, stops: Sequence[StopMotion]) -> dict[str, Array]:
    """Return one place's ``stops`` (stops, 5) of `governing_details`, under slightly less than `load` in kg."""
    stop_rows = [stop.stop_figures(place, load * (1.0 - JUST_BELOW), limit) for stop in stops]
    return {"stops": np.array(stop_rows).reshape(-1, 5)}
