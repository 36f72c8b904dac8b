"""Runs of a study, and their figures as a row of its table: errors, forces, frequencies, what probes measure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.results import Frequencies, Response
from pmr.results.fatigue import cycles
from pmr.results.response import Extremes
from pmr.results.tables import force_extremes, parts_of, probe_extremes, reaction_extremes, stress_by_part
from pmr.scene import Scene
from pmr.scene.keys import ALONE, named
from pmr.studies.tasks import Scalar, TaskResult

Array = NDArray[np.float64]

#: What names of section forces begin with, by their units.
BEAM_ROOMS = {"N": "beam_forces", "N m": "beam_moments"}
#: Frequencies that are stated, at these places of the path: where s is least, in the middle, where it is largest.
FREQUENCIES, PLACES = 3, ("s_min", "s_middle", "s_max")
#: Frequencies of a body alone whose errors are stated.
COMPARED_FREQUENCIES = 3


def figures_of(scene: Scene, response: Response, s: Array, frequencies: Array) -> dict[str, Scalar]:
    """Figures of a simulated model with frequencies (S, f) in Hz at path coordinates s (S,) in m, ascending.

    ``largest_force`` of all in N but for rigid supports; ``forces.<of>.{min,t_min,s_min,max,t_max,s_max}`` in N, s
    and m; of rigid supports ``reactions.<of>.{min,...}`` in N and ``moments.<of>.{min,...}`` in N m;
    ``path.{s_min,s_max}`` in m, and ``frequencies.<place>.<i>`` in Hz there and midway;
    ``probes.<name>.{min,...}`` likewise in the probe's unit, with ``range``, the largest of its load cycles.
    """
    path, record = scene.along(response.t), dict[str, Scalar]()
    if forces := force_extremes(response, path):
        record["largest_force"] = max(extremes.size for extremes in forces.values())
    for name, extremes in forces.items():
        record |= _extreme_figures(f"forces.{name}", extremes)
    for of, extremes in reaction_extremes(response, path).items():
        record |= _extreme_figures(f"{'moments' if of.unit == 'N m' else 'reactions'}.{of.support}", extremes)
    record |= {"path.s_min": float(s[0]), "path.s_max": float(s[-1])}
    middle = int(np.abs(s - (s[0] + s[-1]) / 2.0).argmin())
    for place, k in zip(PLACES, (0, middle, -1), strict=True):
        for i, frequency in enumerate(frequencies[k, :FREQUENCIES].tolist(), start=1):
            record[f"frequencies.{place}.{i}"] = frequency if np.isfinite(frequency) else None
    for name, extremes in probe_extremes(response, path).items():
        record |= _extreme_figures(f"probes.{name}", extremes)
        record[f"probes.{name}.range"] = float(cycles(response.t, response.other(name))[:1, 0].sum())
    return record


def _extreme_figures(name: str, extremes: Extremes) -> dict[str, Scalar]:
    """``<name>.{min,t_min,s_min,max,t_max,s_max}``."""
    return {f"{name}.{key}": value for key, value in extremes.summary().items()}


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


def run_scene(scene: Scene, shared: Any = None) -> TaskResult:
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
    errors = {f"{pair}.{place}": e for pair, places in summary["errors"].items() for place, e in places.items()}
    record: dict[str, Scalar] = {f"errors.{name}": error for name, error in errors.items()}
    record |= {key: summary[key] for key in ("max_displacement", "max_error") if summary[key] is not None}
    record |= {f"coordinates.{model}": size for model, size in summary["coordinates"].items()}
    frequencies, response = result.frequencies, result.responses["reduced"]
    arrays = {"t": response.t, "tip": response.tip, "reach": frequencies.along}
    if (shapes := result.body.shapes) is not None:
        record |= {"basis.kappa": summary["basis"]["kappa"]} | _frequency_errors(frequencies)
        arrays["singular_values"] = shapes.singular_values
    record |= figures_of(scene, response, frequencies.along, frequencies.models["reduced"]) | of_bodies(summary)
    if len(scene.sections) > 1 and summary["pads"]:
        record["largest_force"] = max(max(pad["max"], -pad["min"]) for pad in summary["pads"])
    cylinders, ropes = summary.get("cylinders", ()), summary.get("ropes", ())
    record |= {f"cylinders.{row['name']}.{key}": row[key] for row in cylinders for key in ("min", "max")}
    record |= {f"ropes.{row['name']}.{key}": row["force"][key] for row in ropes for key in ("min", "max")}
    arrays |= {f"frequencies.{model}": values for model, values in frequencies.models.items()}
    seconds = {f"simulate.{name}": motion.seconds for name, motion in result.responses.items()}
    return TaskResult(record, arrays, seconds, tuple(summary["warnings"]))


def _frequency_errors(frequencies: Frequencies) -> dict[str, Scalar]:
    """The largest relative errors over the path; None of those that fewer coordinates do not have."""
    if "full" not in frequencies.models:
        return {}
    off = np.abs(frequencies.models["reduced"] / frequencies.models["full"] - 1.0).max(axis=0)[:COMPARED_FREQUENCIES]
    return {f"frequency_error.{i}": float(e) if np.isfinite(e) else None for i, e in enumerate(off, start=1)}
