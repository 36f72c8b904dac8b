"""What a motion does to a structure: dynamic factors of forces, use of the yield stress, fatigue, and missed peaks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pmr.compare.responses import march_once
from pmr.compare.simulated import excitation_of_scene
from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array, Summary
from pmr.results import Response
from pmr.results.fatigue import Damage, RepeatedCycles, SNLine
from pmr.results.quantities import reactions_on_machine, with_unit
from pmr.results.response import ROUND_OFF, Output
from pmr.results.run import SummaryPart
from pmr.results.tables import support_forces
from pmr.scene import Scene
from pmr.scene.built import Load
from pmr.scene.joints import BoomSection as Body
from pmr.scene.keys import SLIDER
from pmr.scene.run_settings import SpectrumLine
from pmr.scene.signals import Constant
from pmr.simulation.at_rest import scene_at_rest
from pmr.simulation.native.form import SystemForm
from pmr.system.system import System

#: Kinds of outputs, in N or without a unit, of which the largest one has a dynamic factor, and that of the forces of
#: supports of several directions.
RESULTANT = "resultant"
KINDS = ("pad", "support", "reaction", RESULTANT, "cylinder", "outrigger", "tipping")


def dynamic_factors_part(scene: Scene, system: System | SystemForm, response: Response) -> SummaryPart:
    """Entry ``dynamic_factors`` of summary.json: the largest value of each kind of `KINDS`, and its value at rest.

    A row is about the output of its ``kind`` with the largest magnitude, which has the ``name``.  ``largest`` is its
    value at the time ``t`` in s, and ``rest`` its value in the boom at rest.  The boom at rest has the posture and the
    loads of this time, and its full weight.  Forces are in N.  The kind ``resultant`` is the force of a support, all
    its directions together, with the name that it has in ``supports``.  A kind is left out if one of both values is
    within the round-off, or if nothing holds the boom at rest under these loads.  Forces at the pivot and on the ground
    are left out, as supports and outriggers share them.

    The entry is missing for scenes without a frame, with a hoist or with ``frame.base``, and for those that compute the
    motion of their machine, luffing angle or extension.
    """
    frame = scene.frame
    if frame is None or scene.hoist is not None or scene.computed_key is not None or frame.base is not None:
        return SummaryPart()
    rows = list[dict[str, Any]]()
    form, at_rest = SystemForm.of(system), dict[int, Response | None]()  # by the step, which kinds may share
    for kind in KINDS:
        histories = _histories_of_kind(scene, response, kind)
        largest, name = max(
            ((float(np.abs(values).max()), name) for name, values in histories.items()), default=(0.0, "")
        )
        floor = response.force_floor if kind != "tipping" else ROUND_OFF
        if largest <= floor:
            continue
        values = histories[name]
        step = int(np.abs(values).argmax())
        if step not in at_rest:
            at_rest[step] = _response_at_rest(_still(scene, float(response.t[step])), form)
        if (still := at_rest[step]) is None:
            continue
        rest = float(_histories_of_kind(scene, still, kind)[name][0])
        if abs(rest) > floor:
            rows.append({"name": name, "kind": kind, "t": float(response.t[step]),
                         "largest": float(values[step]), "rest": rest})  # fmt: skip
    return SummaryPart({"dynamic_factors": rows} if rows else {})


def _histories_of_kind(scene: Scene, response: Response, kind: str) -> dict[str, Array]:
    """Return the histories (T,) of one `kind` of `KINDS`, by name: forces in N, or shares without unit.

    They are outputs, except for the kind `RESULTANT`: its histories are the resultants of the supports that have forces
    along two or more directions.  Moments are left out, and so are forces on the machine.
    """
    if kind == RESULTANT:
        return support_forces(scene, response, directions=2)
    return {
        output.name: response.column(number)
        for number, output in enumerate(response.outputs)
        if output.kind == kind and output.unit in ("N", "1") and not output.name.startswith(reactions_on_machine(scene))
    }


def _response_at_rest(posture: Scene, form: SystemForm) -> Response | None:
    """Response of a system to a scene at rest, `posture`; None if nothing holds the boom, as where loads lift it."""
    excitation = excitation_of_scene(posture, form.system)
    try:
        return march_once(posture, form, excitation)
    except (SimulationError, InputError):
        return None


def _still(scene: Scene, t: float) -> Scene:
    """Scene at rest for two steps, in its posture at the time `t` in s and under the loads of this time."""
    extensions = {
        part.name: np.array([scene.extension(number).value(t)])
        for number, part in enumerate(scene.sections)
        if part.joint is not None
    }
    if len(scene.sections) == 1 and scene.sections[0].slider is not None:
        extensions[SLIDER] = np.array([scene.sections[0].slider.path.value(t)])
    luffing, slewing = (float(signal.value(t)) for signal in scene.present_frame.angles)
    names = {load.name for part in scene.sections for load in part.loads}
    still = scene_at_rest(scene, extensions, luffing, slewing, dict.fromkeys(names, 0.0))
    sections = tuple(
        rest.model_copy(update={"loads": tuple(_steady(load, t) for load in part.loads)})  # names may occur twice
        for rest, part in zip(still.sections, scene.sections, strict=True)
    )
    time = still.time.model_copy(update={"end": 2.0 * still.time.step})
    return still.model_copy(update={"sections": sections, "start": "equilibrium", "time": time})


def _steady(load: Load, t: float) -> Load:
    """Load whose value is, at all times, that of `load` at the time `t` in s."""
    return load.model_copy(update={"signal": Constant(amount=float(load.signal.value(t)))})


#: Share by which a history exceeds its largest value at the times of recovery before a warning says so, and the least
#: size of such a history as a share of the largest one of its kind and unit.
MISSED, SMALL = 0.05, 0.2


#: Kinds of outputs that have their peaks where stress has them.
STRESSING = ("pad", "support", "reaction", "probe")


def missed_stress_part(scene: Scene, response: Response) -> SummaryPart:
    """Part with a warning if a pad, a support or a probe has its peak between the times of recovered stresses.

    The warning names the history that exceeds its largest value at these times the most, by a share of `MISSED` or
    more.  Histories that are round-off, or small compared with others of the same kind and unit, are left out.  The
    part is empty if no history exceeds it by that much, if stresses are not recovered, or if the response does not have
    all steps.
    """
    steps, recovery = scene.recovered_steps, scene.recovery
    if recovery is None or not recovery.stress or len(response.t) != scene.time.steps + 1:
        return SummaryPart()
    histories, largest = dict[Output, Array](), dict[tuple[str, str], float]()
    for number, output in enumerate(response.outputs):
        if output.kind in STRESSING and not output.name.startswith(reactions_on_machine(scene)):
            histories[output] = np.abs(response.column(number))
            of = output.kind, output.unit
            largest[of] = max(largest.get(of, 0.0), float(histories[output].max()))
    excess, missed = 1.0 + MISSED, None
    for output, history in histories.items():
        peak, floor = float(history.max()), 0.0 if output.kind == "probe" else response.force_floor
        if peak > max(floor, SMALL * largest[output.kind, output.unit], excess * float(history[steps].max())):
            excess, missed = peak / max(float(history[steps].max()), 1e-9 * peak), output
    if missed is None:
        return SummaryPart()
    history = histories[missed]
    most, at_most = (with_unit(float(of.max()), missed.unit) for of in (history, history[steps]))
    t = response.t[np.argmax(history)]
    line = f"the largest stress may be missed: {missed.name} has {most} at {t:g} s, and at most {at_most} at the times "
    return SummaryPart(warnings=[f"{line}of recovery; recovery.every = {recovery.every:g} s, a smaller one shows more"])


def fatigue_part(scene: Scene, response: Response) -> SummaryPart:
    r"""Entry ``fatigue`` of summary.json, a row for each probe's stress, the worst first; empty without ``[fatigue]``.

    .. math:: D = \sum_l D(f_l\, \sigma, n_l)

    for each stress component :math:`\sigma` by itself.  The lines l of the spectrum occur n_l times, with the factor
    f_l on stresses; D is the damage by a history that is repeated (`pmr.results.fatigue.RepeatedCycles`).  ``life`` is
    the number of times that the whole spectrum may occur until D is 1, and None if D is 0.  A warning names the worst
    stress if its D is above 1.
    """
    settings = scene.fatigue
    if settings is None:
        return SummaryPart()
    spectrum = settings.spectrum or (SpectrumLine(cycles=settings.cycles),)
    line = SNLine(settings.slope, settings.reference, settings.cut_off or 0.0)
    damage_of_probe, life_of_probe = dict[str, float](), dict[str, float | None]()
    for output in response.outputs:
        if output.kind == "probe" and output.unit == "Pa":
            cycles = RepeatedCycles.count(response.t, response.other(output.name))
            damages = [(of.cycles, cycles.damage(line, of.factor)) for of in spectrum]
            damage_of_probe[output.name] = sum(damage.after(times) for times, damage in damages)
            life_of_probe[output.name] = _endured_spectra(damages)
    worst_first = sorted(damage_of_probe.items(), key=lambda item: -item[1])
    rows = [{"name": name, "damage": d, "life": life_of_probe[name]} for name, d in worst_first]
    failed = [
        f"{name} fails by fatigue: its damage is {d:.3g}, and 1 is allowed" for name, d in worst_first[:1] if d > 1.0
    ]
    return SummaryPart({"fatigue": rows}, grave=failed)


def _endured_spectra(damages: Sequence[tuple[float, Damage]]) -> float | None:
    """Return the number of times that a spectrum may occur until its damage is 1; None if a spectrum does no damage.

    `damages` has for each line of the spectrum the number of times that it occurs, and the damage by its history.  The
    first time a history does the damage `Damage.once`, each further time `Damage.further`.  If failure comes before
    each line has occurred once, the result is the reciprocal of the damage of one spectrum.
    """
    growth = sum(times * damage.further for times, damage in damages)
    first = sum(damage.once - damage.further for times, damage in damages if times > 0.0)
    if growth > 0.0 and (endured := (1.0 - first) / growth) * min(times for times, _ in damages) >= 1.0:
        return endured
    total = sum(damage.after(times) for times, damage in damages)
    return 1.0 / total if total > 0.0 else None


def utilisation_part(scene: Scene, stresses: Mapping[str, Summary]) -> SummaryPart:
    """Entry ``utilisation`` of summary.json, by model, for bodies whose material has a yield stress.

    ``value`` is the largest stress over the yield stress of its material; ``stress`` and ``yield`` in Pa, ``t`` in s,
    ``position`` in m in the axes of the ``section``, which is the name of the body.  A warning says if the yield stress
    is exceeded.  The part is empty if no stress can be compared with a yield stress.

    Parameters
    ----------
    stresses : mapping
        By name of the body: result of `pmr.reduction.recovery.RecoveredBody.summary`.
    """
    largest = dict[str, dict[str, Any]]()
    for name, part in scene.bodies.items():
        figures = stresses.get(name, {})
        for model, peak in figures.get("stress_peak", {}).items():
            for entry in _utilisations(part, peak, figures.get("stress_by_region", {}).get(model, {})):
                if entry["value"] > largest.get(model, {"value": -1.0})["value"]:
                    largest[model] = entry | {"section": name}
    if not largest:
        return SummaryPart()
    used = largest["reduced"]["value"]
    over = f"the largest stress is {used:.3g} times the yield stress, but the model stays elastic"
    return SummaryPart({"utilisation": largest}, grave=[over] * (used > 1.0))


def _utilisations(part: Body, peak: Summary, regions: Summary) -> Iterator[dict[str, Any]]:
    """Yield rows of ``utilisation``: of the body's own material, then of each region with a material of its own.

    Materials without a yield stress have no row.  `peak` is the largest stress of the body, `regions` have the largest
    stress of each region by name.
    """
    materials = {name: region.material for name, region in part.body.regions.items() if region.material is not None}
    if peak.get("region") in materials:  # else the largest stress is in the body's own material
        own_regions = [of_region for name, of_region in regions.items() if name not in materials]
        peak = max(own_regions, key=lambda of_region: float(of_region["value"]), default={})
    peaks = [(peak, part.body.material)] if peak else []
    peaks += [(regions[name], material) for name, material in materials.items() if name in regions]
    for largest, material in peaks:
        if material.yield_stress is not None:
            used = {"value": largest["value"] / material.yield_stress, "stress": largest["value"]}
            where = {key: largest[key] for key in ("t", "position", "face", "region")}
            yield used | {"yield": material.yield_stress} | where
