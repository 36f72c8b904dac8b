"""A parameter study: scenes, each with keys changed as the study says, reduced, simulated and compared."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.files import npz
from pmr.files.arrays import Array, Summary
from pmr.results import Frequencies, Response
from pmr.results.fatigue import rainflow_cycles
from pmr.results.response import Extremes
from pmr.results.tables import force_extremes, probe_extremes, reaction_extremes, stress_by_part, summaries_by_section
from pmr.scene import Scene
from pmr.scene.keys import ALONE, SceneTable, qualified_name
from pmr.scene.model_ladder import candidate_scenes
from pmr.scene.tomlfiles import Change, result_name
from pmr.studies import tasks
from pmr.studies.study import StudyBase
from pmr.studies.tasks import KEY, Arguments, Needs, Plan, Scalar, Task, TaskResult, task_key

#: Beginning of the names of the columns of section forces, by the unit of the force.
BEAM_FORCE_COLUMNS = {"N": "beam_forces", "N m": "beam_moments"}
#: Number of frequencies in the table, and names of the path coordinates there: least, middle and largest.
FREQUENCIES, PLACES = 3, ("s_min", "s_middle", "s_max")
#: Number of frequencies of a single body with errors in the table.
COMPARED_FREQUENCIES = 3


@dataclass(frozen=True)
class ScenePoint:
    """One run of a parameter study: changes of a scene, words for them in the task's key, and the table's columns."""

    changes: tuple[Change, ...]
    words: tuple[str, ...]
    parameters: Mapping[str, Scalar]


def grid_points(grid: Mapping[str, object]) -> Iterator[ScenePoint]:
    """Yield a point for each combination of values from a grid's lists, the last list varying fastest.

    For example, ``{"reduction": {"modes": [4, 6], "coordinates": [10, 20]}}`` has four points, the first with the words
    ``modes=4`` and ``coordinates=10``.  An empty grid has one point, without changes.  A word begins with the last part
    of the dotted key; if two keys end alike, it begins with the whole key.

    The parameters of a point always have whole keys.  A value that does not fit into a cell is a JSON text there.
    Raises InputError with source ``"study"`` if the value of a key is not a list with values.
    """
    lists = dict(_lists(grid, ""))
    last = Counter(key.rpartition(".")[2] for key in lists)
    names = [key if last[key.rpartition(".")[2]] > 1 else key.rpartition(".")[2] for key in lists]
    for numbered in itertools.product(*map(enumerate, lists.values())):
        values = {key: value for key, (_, value) in zip(lists, numbered, strict=True)}
        yield ScenePoint(
            tuple(Change(_nest(key, value), "grid") for key, value in values.items()),
            tuple(f"{name}={_word(value, number)}" for name, (number, value) in zip(names, numbered, strict=True)),
            {key: value if _is_plain(value) else json.dumps(value) for key, value in values.items()},
        )


def _lists(tables: Mapping[str, object], prefix: str) -> Iterator[tuple[str, Sequence[Any]]]:
    """Yield dotted key and values of each list in nested tables; `prefix` is put before all keys.

    Raises InputError for an empty list, and for a value that is neither a list nor a table.
    """
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _lists(value, f"{prefix}{key}.")
        elif isinstance(value, list) and value:
            yield f"{prefix}{key}", value
        else:
            raise InputError("study", f"grid.{prefix}{key}", value, "a list of values is allowed, one for each run")


def _nest(key: str, value: object) -> dict[str, Any]:
    """Return nested tables that hold a value at a dotted key: ``{"a": {"b": value}}`` for ``"a.b"``."""
    first, _, following = key.partition(".")
    return {first: _nest(following, value) if following else value}


def _is_plain(value: object) -> bool:
    """Return whether a value fits into one cell of a table."""
    return isinstance(value, (float, int, str))


def _word(value: object, number: int) -> str:
    """Return a value as text for a task's key.

    If keys can't hold the characters of the text, it is ``no1`` for the first value of a list, ``no2`` for the second.
    `number` is the place of the value in its list, from 0.
    """
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if _is_plain(value) and KEY.fullmatch(f"0{text}") else f"no{number + 1}"


class Case(SceneTable):
    """A named change of the scene."""

    name: Annotated[str, Field(pattern=f"^{KEY.pattern}$")] = Field(description="Name of the case in tables")
    change: dict[str, Any] = Field(default={}, description="Keys of the scenes, and their values")


class Study(StudyBase):
    """All combinations of `scenes`, `cases` and `grid`; the keys in `change` are changed first, in all runs.

    A list in `grid` holds the values that its key takes in turn: ``[grid] reduction.coordinates = [10, 14, 20]``.
    """

    kind: Literal["scenes"] = Field(description="Kind of study")
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)] = Field(description="Scenes that are computed")
    change: dict[str, Any] = Field(default={}, description="Keys of the scenes to change in all runs")
    cases: tuple[Case, ...] = Field(default=(), description="Named changes, each of which is run")
    grid: dict[str, Any] = Field(default={}, description="Keys of the scenes and the values that each takes in turn")

    def plan(self) -> Plan:
        """Return a task for each run, and tasks for full models' frequencies and references, which runs may share.

        Some runs compute frequencies and references themselves, and add no shared tasks.  Their scenes have several
        sections, effects of second order, an accuracy or budget, or a model that measurements choose.  Raises
        InputError for a key that the scenes do not allow.
        """
        runs, common = [], dict[str, Task]()
        for file, point in self._run_points():
            key = task_key(",".join(point.words) or result_name(file))
            scene = _varied_scene(file, point, key)
            arguments, needs = tasks.scene_arguments(scene), dict[str, Task]()
            second_order = scene.frame is not None and scene.frame.second_order
            if not (len(scene.sections) > 1 or second_order or scene.goal is not None or candidate_scenes(scene)):
                needs = {name: tasks.reference_task(scene, name) for name in scene.compare.against}
                needs["frequencies"] = tasks.frequencies_task(scene)
            common |= {task.key: task for task in needs.values()}
            keys = {name: task.key for name, task in needs.items()}
            runs.append(Task(key, run_case, arguments, keys, point.parameters))
        return Plan(tuple(runs), tuple(common.values()))

    def _run_points(self) -> Iterator[tuple[Path, ScenePoint]]:
        """Yield the scene's file and the changes of each run, files first, then cases, the grid fastest."""
        for file in self.scenes:
            of_scene: dict[str, Scalar] = {"scene": result_name(file)} if len(self.scenes) > 1 else {}
            for i, case in enumerate(self.cases or [None]):
                named: dict[str, Scalar] = of_scene | ({"case": case.name} if case else {})
                before = [Change(self.change, "change")]
                before += [Change(case.change, f"cases[{i}].change")] if case else []
                for point in grid_points(self.grid):
                    words = (*map(str, named.values()), *point.words)
                    yield file, ScenePoint((*before, *point.changes), words, {**named, **point.parameters})


def _varied_scene(file: Path, point: ScenePoint, key: str) -> Scene:
    """Return the scene of the file with the changes of the point.

    The message of every InputError ends with the name of the run, `key`.  If the study set the refused value, the error
    names the key of the study in place of that of the scene.
    """
    try:
        return scenes.vary(file, point.changes)
    except InputError as error:
        source, of = error.source, error.key
        if source in {change.source for change in point.changes}:
            source, of = "study", f"{source}.{of}"
        raise InputError(source, of, error.value, f"{error.allowed} (run {key})") from None


def motion_figures(scene: Scene, response: Response, s: Array, frequencies: Array) -> dict[str, Scalar]:
    """Return columns of the table about a simulated model, from its response and frequencies.

    `frequencies` (S, f) are in Hz at ascending path coordinates `s` (S,) in m.

    - ``largest_force``: the largest contact force in N, without rigid supports.
    - ``forces.<contact>.{min,t_min,s_min,max,t_max,s_max}``: extremes of a contact force in N, their times in s and
      path coordinates in m.
    - ``reactions.<support>.{min,...}`` in N and ``moments.<support>.{min,...}`` in N m of rigid supports.
    - ``probes.<name>.{min,...}`` in the probe's unit, with ``range``, the range of the largest load cycle.
    - ``path.{s_min,s_max}`` in m.
    - ``frequencies.{s_min,s_middle,s_max}.<i>``: the i-th frequency in Hz at the least, the middle and the largest path
      coordinate; None if the model has fewer.  If several postures have one coordinate, the posture with the lowest
      frequency counts.
    """
    path, record = scene.path_positions(response.t), dict[str, Scalar]()
    if forces := force_extremes(response, path):
        record["largest_force"] = max(extremes.size for extremes in forces.values())
    for name, extremes in forces.items():
        record |= _extreme_figures(f"forces.{name}", extremes)
    for of, extremes in reaction_extremes(response, path).items():
        record |= _extreme_figures(f"{'moments' if of.unit == 'N m' else 'reactions'}.{of.support}", extremes)
    record |= {"path.s_min": float(s[0]), "path.s_max": float(s[-1])}
    middle = int(np.abs(s - (s[0] + s[-1]) / 2.0).argmin())
    for place, k in zip(PLACES, (0, middle, -1), strict=True):
        postures = frequencies[s == s[k], :FREQUENCIES].tolist()
        softest = min(postures, key=lambda posture: [of if np.isfinite(of) else np.inf for of in posture])
        for i, frequency in enumerate(softest, start=1):
            record[f"frequencies.{place}.{i}"] = frequency if np.isfinite(frequency) else None
    for name, extremes in probe_extremes(response, path).items():
        record |= _extreme_figures(f"probes.{name}", extremes)
        record[f"probes.{name}.range"] = float(rainflow_cycles(response.t, response.other(name))[:1, 0].sum())
    return record


def _extreme_figures(name: str, extremes: Extremes) -> dict[str, Scalar]:
    """Return columns ``<name>.{min,t_min,s_min,max,t_max,s_max}`` of the extremes of a history."""
    return {f"{name}.{key}": value for key, value in extremes.summary().items()}


def stress_figures(summary: Summary) -> dict[str, Scalar]:
    """Return ``stress.<region>.{max,t_max,x,y,z}``: the largest von Mises stress of the reduced model in each region.

    ``max`` is in Pa, its time ``t_max`` in s, its position ``x``, ``y``, ``z`` in m.  `summary` is the summary of a run
    or of a recovery.  The region of a mesh without regions is called ``whole body``.
    """
    record = dict[str, Scalar]()
    for region, peak in stress_by_part(summary).get("reduced", {}).items():
        stated = {"max": peak["value"], "t_max": peak["t"]} | dict(zip("xyz", peak["position"], strict=True))
        record |= {f"stress.{region}.{key}": float(value) for key, value in stated.items()}
    return record


def body_figures(summary: Summary) -> dict[str, Scalar]:
    """Return columns of the table about bodies, from the summary of a run.

    - ``stress.<region>...``: the columns of `stress_figures`.
    - ``mass`` in kg of all bodies, and ``mass.<body>`` of each body of several, with the masses attached to them.
    - ``damage.<probe>``: damage by fatigue.
    - ``utilisation``: the reduced model's largest stress as a share of the yield stress, at ``utilisation_t`` in s, at
      ``utilisation_{x,y,z}`` in m, and of several bodies in ``utilisation_section``.
    - ``beam_forces.<quantity>.{min,t_min,x_min,max,...}``: the reduced model's section forces in N;
      ``beam_moments.<quantity>...`` in N m.  The quantity's name begins with that of its section if there are several.

    Columns about which the summary has nothing are left out.
    """
    record, masses = stress_figures(summary), {mass["name"]: mass for mass in summary.get("masses", ())}
    weights = {name: float(mass["mass"] + mass["attached"]) for name, mass in masses.items()}
    if weights:
        record["mass"] = sum(weights.values())
        record |= {f"mass.{name}": weight for name, weight in weights.items() if name != ALONE}
    for row in summary.get("fatigue", ()):
        record[f"damage.{row['name']}"] = row["damage"]
    if used := summary.get("utilisation", {}).get("reduced"):
        record |= {"utilisation": used["value"], "utilisation_t": used["t"]}
        record |= {f"utilisation_{axis}": float(at) for axis, at in zip("xyz", used["position"], strict=True)}
        record |= {"utilisation_section": used["section"]} if used["section"] != ALONE else {}
    for name, part in summaries_by_section(summary).items():
        for quantity, forces in part.get("section_forces", {}).get("reduced", {}).items():
            if room := BEAM_FORCE_COLUMNS.get(forces["unit"]):
                figures = {key: value for key, value in forces.items() if key != "unit"}
                record |= {f"{room}.{qualified_name(name, quantity)}.{key}": value for key, value in figures.items()}
    return record


def run_case(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: run a scene with its first simulator; the results are a row of the table, with arrays and warnings.

    References and frequencies of a single body's full model come from `needs`; if that is empty, the run computes them.

    Record: ``errors.<model>_vs_<reference>.<output>`` (e_NRMS), ``coordinates.full`` and ``.reduced``,
    ``max_displacement`` and ``max_error`` (m), ``cylinders.<name>.{min,max}`` and ``ropes.<name>.{min,max}`` (N), and
    the columns of `motion_figures` and `body_figures`.  For a boom, ``largest_force`` is the largest force of its pads.
    For a single body also ``basis.kappa`` and ``frequency_error.<i>``, the largest relative error of the i-th frequency
    over the path.

    Arrays:

    - ``t`` (T,) in s and ``tip`` (T,) in m by the reduced model.
    - ``frequencies.<model>`` (S, f) in Hz at the positions ``reach`` (S,) in m.  A position is the path coordinate of a
      body alone, or the reach of a boom.
    - ``singular_values``, for a single body alone.
    """
    from pmr.files.whole import user_cache_folder
    from pmr.pipeline import run
    from pmr.pipeline.bodies import Precomputed

    scene, precomputed = tasks.scene_of(arguments), None
    if needs:
        responses: dict[str, Response] = {}
        for name in scene.compare.against:
            responses[name] = npz.record_from_arrays(Response, needs[name].arrays)
        precomputed = Precomputed(responses, needs["frequencies"].arrays["omega"] / (2.0 * np.pi))
    once = scene.with_keys(simulation={"simulators": scene.simulation.simulators[:1]})
    outcome = run(once, measures=user_cache_folder(), shared=precomputed)
    assert outcome is not None  # a task runs on one rank
    result, summary = outcome.result, outcome.result.summary
    errors = {f"{pair}.{place}": e for pair, places in summary["errors"].items() for place, e in places.items()}
    record: dict[str, Scalar] = {f"errors.{name}": error for name, error in errors.items()}
    record |= {key: summary[key] for key in ("max_displacement", "max_error") if summary[key] is not None}
    record |= {f"coordinates.{model}": size for model, size in summary["coordinates"].items()}
    frequencies, response = result.frequencies, result.responses["reduced"]
    arrays = {"t": response.t, "tip": response.tip, "reach": frequencies.along}
    if (shapes := result.body.shapes) is not None:
        record |= {"basis.kappa": summary["basis"]["kappa"]} | _frequency_errors(frequencies)
        arrays["singular_values"] = shapes.singular_values
    record |= motion_figures(scene, response, frequencies.along, frequencies.models["reduced"]) | body_figures(summary)
    if len(scene.sections) > 1 and summary["pads"]:
        record["largest_force"] = max(max(pad["max"], -pad["min"]) for pad in summary["pads"])
    cylinders, ropes = summary.get("cylinders", ()), summary.get("ropes", ())
    record |= {f"cylinders.{row['name']}.{key}": row[key] for row in cylinders for key in ("min", "max")}
    record |= {f"ropes.{row['name']}.{key}": row["force"][key] for row in ropes for key in ("min", "max")}
    arrays |= {f"frequencies.{model}": values for model, values in frequencies.models.items()}
    seconds = {f"simulate.{name}": motion.seconds for name, motion in result.responses.items()}
    return TaskResult(record, arrays, seconds, tuple(summary["warnings"]))


def _frequency_errors(frequencies: Frequencies) -> dict[str, Scalar]:
    """Return ``frequency_error.<i>``, the largest error of the i-th frequency over the path, as a fraction.

    A value is None if the reduced model has no i-th frequency.  The result is empty without frequencies of the full
    model.
    """
    if "full" not in frequencies.models:
        return {}
    off = np.abs(frequencies.models["reduced"] / frequencies.models["full"] - 1.0).max(axis=0)[:COMPARED_FREQUENCIES]
    return {f"frequency_error.{i}": float(e) if np.isfinite(e) else None for i, e in enumerate(off, start=1)}
