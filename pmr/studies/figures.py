"""What a run of a study says, as figures of its row: errors, forces, frequencies, what probes measure.

Booms of several sections are run here, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.results import Frequencies, Response
from pmr.results.fatigue import cycles
from pmr.results.tables import force_extremes, parts_of, probe_extremes, reaction_extremes, stress_by_part
from pmr.scene import Scene
from pmr.scene.keys import ALONE, named
from pmr.studies.engine.task import Scalar, TaskResult

Array = NDArray[np.float64]

#: What names of section forces begin with, by their units.
BEAM_ROOMS = {"N": "beam_forces", "N m": "beam_moments"}
#: Frequencies that are stated, at these places of the path: where s is least, in the middle, where it is largest.
FREQUENCIES, PLACES = 3, ("s_min", "s_middle", "s_max")
#: Frequencies of a body alone whose errors are stated.
COMPARED_FREQUENCIES = 3


def error_figures(summary: Mapping[str, Any], *kinds: str) -> dict[str, Scalar]:
    """``<kind>.<a>_vs_<b>.<place>`` of ``errors`` or ``absolute_errors``; ``max_displacement``, ``max_error`` in m.

    `summary` is that of a run, or the part that `pmr.compare.summary.comparison_part` makes of responses.
    """
    record: dict[str, Scalar] = {
        f"{kind}.{pair}.{place}": error
        for kind in kinds
        for pair, places in summary[kind].items()
        for place, error in places.items()
    }
    return record | {key: summary[key] for key in ("max_displacement", "max_error") if summary[key] is not None}


def figures_of(scene: Scene, response: Response, s: Array, omega: Array) -> dict[str, Scalar]:
    """Figures of a simulated model with frequencies omega (S, f) in rad/s at path coordinates s (S,) in m, ascending.

    ``largest_force`` of all in N but for rigid supports; ``forces.<of>.{min,t_min,s_min,max,t_max,s_max}`` in N, s
    and m; of rigid supports ``reactions.<of>.{min,...}`` in N and ``moments.<of>.{min,...}`` in N m;
    ``path.{s_min,s_max}`` in m, and ``frequencies.<place>.<i>`` in Hz there and midway;
    ``probes.<name>.{min,...}`` likewise in the probe's unit, with ``range``, the largest of its load cycles.
    """
    return dict((*_forces(scene, response), *_frequencies(s, omega), *_probes(scene, response)))


def stresses(summary: Mapping[str, Any]) -> dict[str, Scalar]:
    """``stress.<region>.{max,t_max,x,y,z}``: the largest von Mises stress in Pa of the reduced model, when and where.

    `summary` is that of a run, or of what was recovered; a mesh without regions is ``whole body``.
    """
    record = dict[str, Scalar]()
    for region, peak in stress_by_part(summary).get("reduced", {}).items():
        stated = {"max": peak["value"], "t_max": peak["t"]} | dict(zip("xyz", peak["position"], strict=True))
        record |= {f"stress.{region}.{key}": float(value) for key, value in stated.items()}
    return record


def of_bodies(summary: Mapping[str, Any]) -> dict[str, Scalar]:
    """Figures of bodies by name: `stresses`, ``mass.<body>`` in kg, and of beams their section forces.

    ``mass`` is that of all with what is attached, ``utilisation`` the largest stress over the yield stress, with
    ``utilisation_t`` in s, ``utilisation_section``, and ``_x``, ``_y``, ``_z`` in m there;
    ``beam_forces.<quantity>.{min,t_min,x_min,max,...}`` in N, ``beam_moments.<quantity>.`` in N m.
    """
    record, masses = stresses(summary), {mass["name"]: mass for mass in summary.get("masses", ())}
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
    for name, part in parts_of(summary).items():
        for quantity, forces in part.get("section_forces", {}).get("reduced", {}).items():
            if room := BEAM_ROOMS.get(forces["unit"]):
                figures = {key: value for key, value in forces.items() if key != "unit"}
                record |= {f"{room}.{named(name, quantity)}.{key}": value for key, value in figures.items()}
    return record


def _forces(scene: Scene, response: Response) -> Iterator[tuple[str, Scalar]]:
    extremes = force_extremes(response, scene.along(response.t))
    if extremes:
        yield "largest_force", max(max(extreme.most, -extreme.least) for extreme in extremes.values())
    for name, extreme in extremes.items():
        yield from ((f"forces.{name}.{key}", value) for key, value in extreme.summary().items())
    for of, extreme in reaction_extremes(response, scene.along(response.t)).items():
        room = "moments" if of.unit == "N m" else "reactions"
        yield from ((f"{room}.{of.support}.{key}", value) for key, value in extreme.summary().items())


def _frequencies(s: Array, omega: Array) -> Iterator[tuple[str, Scalar]]:
    yield "path.s_min", float(s[0])
    yield "path.s_max", float(s[-1])
    middle = int(np.abs(s - (s[0] + s[-1]) / 2.0).argmin())
    for place, k in zip(PLACES, (0, middle, -1), strict=True):
        for i, omega_of_mode in enumerate(omega[k, :FREQUENCIES], start=1):
            yield (
                f"frequencies.{place}.{i}",
                float(omega_of_mode) / (2.0 * np.pi) if np.isfinite(omega_of_mode) else None,
            )


def _probes(scene: Scene, response: Response) -> Iterator[tuple[str, Scalar]]:
    for name, extreme in probe_extremes(response, scene.along(response.t)).items():
        yield from ((f"probes.{name}.{key}", value) for key, value in extreme.summary().items())
        largest = cycles(response.t, response.other(name))[:1, 0]
        yield f"probes.{name}.range", float(largest.sum())


def boom_arguments(boom: Scene) -> dict[str, Any]:
    """A boom as arguments of a task; the hash stands for the content of files that it names."""
    plain = boom.model_copy(update={"title": "", "published": None})
    return {"boom": plain.model_dump(mode="json"), "hash": plain.hash}


def run_boom_case(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: one run of a boom of sections, or with second order; see `ran`."""
    return ran(Scene.model_validate(arguments["boom"]))


def ran(scene: Scene, shared: Any = None) -> TaskResult:
    """Result of a run as a row of a table, with its warnings; `shared` is a `pmr.pipeline.bodies.Precomputed`.

    Figures: ``errors.<a>_vs_<b>.<place>`` (e_NRMS), ``coordinates.full`` and ``.reduced``, ``max_displacement`` and
    ``max_error`` (m), ``cylinders.<name>.{min,max}`` and ``ropes.<name>.{min,max}`` (N), what `figures_of` and
    `of_bodies` say; ``largest_force`` of a boom is that of its pads.  Of a body alone also ``basis.kappa`` and
    ``frequency_error.<i>``, the largest relative error of the i-th frequency over the path.  Arrays: ``t`` (s), ``tip``
    and ``reach``, of a body alone its path (m), ``frequencies.<model>`` (Hz); ``singular_values`` of a body alone.
    """
    from pmr.files.whole import users_folder
    from pmr.pipeline import run

    once = scene.simulation.model_copy(update={"simulators": scene.simulation.simulators[:1]})
    outcome = run(scene.model_copy(update={"simulation": once}), measures=users_folder(), shared=shared)
    assert outcome is not None  # a task runs on one rank
    result, summary = outcome.result, outcome.result.summary
    record = error_figures(summary, "errors")
    record |= {f"coordinates.{model}": size for model, size in summary["coordinates"].items()}
    frequencies, response = result.frequencies, result.responses["reduced"]
    arrays = {"t": response.t, "tip": response.tip, "reach": frequencies.along}
    if (shapes := result.body.shapes) is not None:
        record |= {"basis.kappa": summary["basis"]["kappa"]} | _frequency_errors(frequencies)
        arrays["singular_values"] = shapes.singular_values
    record |= figures_of(scene, response, frequencies.along, 2.0 * np.pi * frequencies.models["reduced"]) | of_bodies(
        summary
    )
    if len(scene.sections) > 1 and summary["pads"]:
        record["largest_force"] = max(max(pad["max"], -pad["min"]) for pad in summary["pads"])
    cylinders, ropes = summary.get("cylinders", ()), summary.get("ropes", ())
    record |= {f"cylinders.{row['name']}.{key}": row[key] for row in cylinders for key in ("min", "max")}
    record |= {f"ropes.{row['name']}.{key}": row["force"][key] for row in ropes for key in ("min", "max")}
    arrays |= {f"frequencies.{model}": values for model, values in frequencies.models.items()}
    seconds = {f"simulate.{name}": row.seconds for name, row in result.responses.items()}
    return TaskResult(record, arrays, seconds, tuple(summary["warnings"]))


def _frequency_errors(frequencies: Frequencies) -> dict[str, Scalar]:
    """The largest relative errors over the path; None of those that fewer coordinates do not have."""
    if "full" not in frequencies.models:
        return {}
    off = np.abs(frequencies.models["reduced"] / frequencies.models["full"] - 1.0).max(axis=0)[:COMPARED_FREQUENCIES]
    return {f"frequency_error.{i}": float(e) if np.isfinite(e) else None for i, e in enumerate(off, start=1)}
