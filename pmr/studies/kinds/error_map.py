"""Error map: which combination of snapshots and modes serves best when coordinates are limited.

Weyrer et al., section "Optimal Combinations for Maximum Budget": for each combination the e_NRMS of the transverse
displacement along the beam, averaged over the largest few numbers of coordinates, so that a lucky one does not decide.
All three treatments of the supports' rows are mapped (`pmr.studies.nested`): ``round_off`` is the paper's.  Of a boom
of sections, held at as many extensions, rows are ``dropped``, and coordinates are those of each section.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pmr import scene as scenes
from pmr.compare import errors as compare
from pmr.errors import InputError
from pmr.studies import marching, nested, shared, subjects
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult
from pmr.studies.results import StudyResults
from pmr.studies.study import Count, StudyBase

MOST = 1000  # snapshots or modes: far more than a beam has use for


class Study(StudyBase):
    """All combinations of up to `most_snapshots` and `most_modes` whose pools hold `smallest_pool` to `largest_pool`.

    Each is simulated with the `averaged` largest numbers of coordinates up to `budget` or the size of its pool, but not
    below `fewest`; the `marked` best ones are named.  Figures: for each treatment ``best`` (such as ``5x6``), its mean
    error ``error``, ``marked`` names, and ``pool``, the median pool size of the marked ones; ``combinations`` mapped
    and ``singular`` ones.
    """

    kind: Literal["error_map"] = Field(description="Kind of study")
    scene: Path = Field(description="Scene that is computed")
    most_snapshots: Annotated[Count, Field(le=MOST)] = Field(
        default=30, description="Largest number of slider positions"
    )
    most_modes: Annotated[Count, Field(le=MOST)] = Field(
        default=16, description="Largest number of modes at each position"
    )
    smallest_pool: Count = Field(default=3, description="Smallest number of snapshots in all")
    largest_pool: Count = Field(default=120, description="Largest number of snapshots in all")
    budget: Count = Field(default=20, description="Most coordinates")
    averaged: Count = Field(default=5, description="Numbers of coordinates whose errors are averaged")
    fewest: Count = Field(default=3, description="Smallest number of coordinates")
    marked: Count = Field(default=15, description="Number of best combinations that are named")
    curve: Count | None = Field(default=None, description="Pool size for which a curve is drawn")

    def plan(self) -> Plan:
        scene = subjects.either(self.scene)
        counts, modes = range(1, self.most_snapshots + 1), range(1, self.most_modes + 1)
        nested.check(scene, counts, modes, "most_snapshots")
        chosen = [(n, m) for n in counts for m in modes if self.smallest_pool <= n * m <= self.largest_pool]
        if not chosen:
            allowed = f"pools of {self.smallest_pool} to {self.largest_pool} snapshots leave no combination"
            raise InputError("study", "largest_pool", self.largest_pool, allowed)
        library = nested.library_task(scene, counts, self.most_modes)
        reference = marching.full_task(scene)
        arguments = shared.scene_arguments(marching.moving(scene))
        needs = {"library": library.key, "full": reference.key}
        runs = []
        for n, m in chosen:
            parameters = {"snapshots": n, "modes": m}
            coordinates = {"coordinates": self.coordinates(n * m)}
            runs.append(Task(f"{n}x{m}", tile, arguments | parameters | coordinates, needs, parameters, cost=0.1))
        return Plan(tuple(runs), (library, reference))

    def coordinates(self, pool: int) -> list[int]:
        """The numbers of coordinates over which the errors of a combination are averaged."""
        top = min(self.budget, pool)
        return list(range(max(self.fewest, top - self.averaged + 1), top + 1))

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {"combinations": len(results.runs)}
        pools = results.column("snapshots") * results.column("modes")
        for treatment in nested.treatments(scenes.load_any(self.scene)):
            error = np.array(results.column(f"{treatment}.error"), dtype=float)
            order = np.argsort(error, kind="stable")[: self.marked]  # those without an error come last
            keys = [results.runs[i].key for i in order if np.isfinite(error[i])]
            if keys:
                found |= {f"{treatment}.best": keys[0], f"{treatment}.error": float(error[order[0]])}
                found |= {f"{treatment}.marked": " ".join(keys), f"{treatment}.pool": float(np.median(pools[order]))}
            found[f"{treatment}.singular"] = int(np.sum(~np.isfinite(error)))
        return found


def tile(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``<treatment>.error``, the mean over `coordinates`, and the ``rank`` of the pool.

    A mean is None where one of its models can't be simulated (noted).  Arrays: ``coordinates`` (c,) and for each
    treatment the errors (c,).
    """
    scene = shared.scene_of(arguments)
    excitation, full = marching.excitation_of(scene, needs["full"]), marching.full_motion(needs["full"])
    basis = nested.global_basis(scene, needs["library"], arguments["snapshots"], arguments["modes"])
    known: dict[tuple[tuple[int, int], ...], float] = {}

    def error(treatment: str, coordinates: int) -> float:
        models = {name: one.of(coordinates) for name, one in basis.models[treatment].items()}
        key = tuple((0, 0) if one is None else (one.size, len(one.row_names)) for one in models.values())
        if key not in known:  # of 20 coordinates, two of them held, 18 are left, as of 18 without the rows
            found = nested.simulated(scene, models, treatment, excitation, full)
            known[key] = np.nan if found is None else compare.nrms(found.displacement, full.displacement)
        return known[key]

    record: dict[str, Scalar] = {"rank": basis.rank}
    arrays = {"coordinates": np.array(arguments["coordinates"])}
    for treatment in basis.models:
        errors = np.array([error(treatment, r) for r in arguments["coordinates"]])
        mean = float(errors.mean())
        record[f"{treatment}.error"] = mean if np.isfinite(mean) else None
        arrays[treatment] = errors
    return TaskResult(record, arrays)
