"""Selected combinations of snapshots and modes, with every number of coordinates up to all that their pools hold.

Weyrer et al., section "Selected Combinations Investigation".  Errors are those against the full model's motion:
e_NRMS of the transverse displacement along the beam, and the absolute error of the strain energy summed over all
steps, in J.  Each is given for the three treatments of the supports' rows (`pmr.studies.nested`): ``round_off``
is the paper's.  Of a boom of sections, held at as many extensions, rows are ``dropped``, coordinates are those of each
section, and the singular values those of the last one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from pmr import scene as scenes
from pmr.compare import errors as compare
from pmr.files import records
from pmr.studies import marching, nested, shared, subjects
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult, number
from pmr.studies.results import RunRecord, StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.system.contacts import named

#: What is no longer the largest error possible, 1.
BELOW_MAXIMUM = 0.999
#: Coordinates for which kappa is stated.
STATED = 20


class Study(StudyBase):
    """`combinations` of snapshots and modes, from `fewest` coordinates on.

    Figures, for each combination and treatment, such as ``10x10.round_off``: ``.first`` number of coordinates whose
    error is below the maximum, ``.beam`` and ``.strain`` errors with all coordinates; for each combination ``.kappa``.
    """

    kind: Literal["combinations"] = Field(description="Kind of study")
    scene: Path = Field(description="Scene that is computed")
    combinations: Annotated[tuple[tuple[Count, Count], ...], Field(min_length=1)] = Field(
        description="Numbers of snapshots and of modes at each"
    )
    fewest: Count = Field(default=3, description="Smallest number of coordinates")

    def plan(self) -> Plan:
        scene = subjects.either(self.scene)
        nested.check(scene, [n for n, _ in self.combinations], [m for _, m in self.combinations], "combinations")
        library = nested.library_task(scene, [n for n, _ in self.combinations], max(m for _, m in self.combinations))
        reference = marching.full_task(scene)
        bases, runs = list[Task](), list[Task]()
        for snapshots, modes in self.combinations:
            chosen = {"snapshots": snapshots, "modes": modes}
            arguments = shared.scene_arguments(marching.moving(scene)) | chosen
            bases.append(Task(_name(chosen), basis, arguments, {"library": library.key}, chosen, cost=0.1))
            needs = {"basis": bases[-1].key, "full": reference.key}
            for coordinates in range(self.fewest, snapshots * modes + 1):
                arguments = shared.scene_arguments(marching.driven(scene)) | {"coordinates": coordinates}
                key, parameters = f"{_name(chosen)}-{coordinates}", chosen | {"coordinates": coordinates}
                runs.append(Task(key, errors, arguments, needs, parameters, cost=0.1))
        return Plan((*bases, *runs), (library, reference))

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        found, treatments = dict[str, Scalar](), nested.treatments(scenes.load_any(self.scene))
        for snapshots, modes in self.combinations:
            name = _name({"snapshots": snapshots, "modes": modes})
            found[f"{name}.kappa"] = next(run.figures["kappa"] for run in results.runs if run.key == name)
            runs = [run for run in results.runs if run.key.startswith(f"{name}-")]
            for treatment in treatments:
                found |= {f"{name}.{treatment}.{key}": value for key, value in _key_figures(runs, treatment)}
        for treatment in treatments:
            firsts = [found.get(f"{n}x{m}.{treatment}.first") for n, m in self.combinations]
            found[f"{treatment}.first"] = min(
                (int(number(first)) for first in firsts if first is not None), default=None
            )
        return found


def basis(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: one combination's basis; ``rank`` of its pool, ``kappa`` of 20 coordinates (or all), singular values."""
    from pmr.reduction.basis import kappa

    scene = shared.scene_of(arguments)
    found = nested.global_basis(scene, needs["library"], arguments["snapshots"], arguments["modes"])
    sigma = found.sigma[scene.names[-1]]
    arrays = {"singular_values": sigma}
    for treatment, bodies in found.models.items():
        for name, models in bodies.items():
            arrays |= records.arrays(models, f"{named(name, treatment)}.")
    record = {"rank": found.rank, "kappa": kappa(sigma, min(STATED, len(sigma)))}
    return TaskResult(record, arrays)


def errors(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``<treatment>.beam`` (e_NRMS) and ``<treatment>.strain`` (J) with so many coordinates.

    None where the model can't be simulated (noted), or where the pool spans fewer dimensions: what further vectors
    there are is round-off.
    """
    scene, arrays = shared.scene_of(arguments), needs["basis"].arrays
    excitation, full = marching.excitation_of(scene, needs["full"]), marching.full_motion(needs["full"])
    record: dict[str, Scalar] = {}
    for treatment in nested.treatments(scene):
        record |= {f"{treatment}.beam": None, f"{treatment}.strain": None}
        bodies = {
            name: records.record(nested.NestedModels, arrays, f"{named(name, treatment)}.") for name in scene.names
        }
        if all(arguments["coordinates"] - one.spent > one.longest.size for one in bodies.values()):
            continue
        models = {name: one.of(arguments["coordinates"]) for name, one in bodies.items()}
        found = nested.simulated(scene, models, treatment, excitation, full)
        if found is not None:
            record[f"{treatment}.beam"] = compare.nrms(found.displacement, full.displacement)
            record[f"{treatment}.strain"] = compare.absolute_error(found.strain.sum(), full.strain.sum())
    return TaskResult(record)


def _name(parameters: Mapping[str, Scalar]) -> str:
    return f"{parameters['snapshots']}x{parameters['modes']}"


def _key_figures(runs: list[RunRecord], treatment: str) -> Iterator[tuple[str, Scalar]]:
    """Of runs in the order of their coordinates."""
    known = [run for run in runs if run.figures[f"{treatment}.beam"] is not None]
    if known:
        below = (run for run in known if number(run.figures[f"{treatment}.beam"]) < BELOW_MAXIMUM)
        yield "first", next((run.parameters["coordinates"] for run in below), None)
        yield "beam", known[-1].figures[f"{treatment}.beam"]
        yield "strain", known[-1].figures[f"{treatment}.strain"]
