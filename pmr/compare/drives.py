"""Drives of a boom in the summary of a run: the luffing cylinder, and the hoist with its hook and rope."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmr.files.arrays import Array
from pmr.results import Response
from pmr.results.quantities import QUANTITIES, with_unit
from pmr.results.response import Extremes
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.hoist import HEIGHT, KEYS, KINDS
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.mechanism import CYLINDER, supports_at_lug

#: A support can't stand in for a cylinder if the cylinder's largest stiffness about the pivot is more than this times
#: its smallest.
TURNED = 1.1
#: A support lacks a cylinder's force along the boom if this is more than this share of the force across the boom.
LEANING = 0.1
#: Pressure in Pa of the surroundings: oil boils where its pressure is lower by this.
VACUUM = 1e5


def luffing_part(scene: Scene, response: Response) -> SummaryPart:
    r"""``luffing_cylinder`` of summary.json: extremes of ``force`` N, ``length`` m, ``speed`` m/s and ``power`` W.

    .. math::
        L(\varphi) = |R(\varphi)\, r_1 - r_0|, \qquad F = \mathfrak M / \tfrac{dL}{d\varphi}, \qquad P = F\, \dot L

    with the length L at the luffing angle :math:`\varphi`, the rotation R, the lug r_1 on the boom, the foot r_0 on the
    machine, the force F, the power P and the moment :math:`\mathfrak M` about the pivot of all forces with which the
    boom presses on its machine (`pmr.simulation.reactions`).  The pivot turns freely, and the cylinder alone keeps the
    angle, whatever holds the base in the scene.  The part is empty without such a cylinder.  Of a cylinder whose force
    drives the angle all columns are taken from the response, pressures, flows and volumes of oil among them, and there
    is a warning where a pressure is so low that the oil would boil.
    """
    if scene.frame is None or scene.frame.cylinder is None or CYLINDER not in response.other_names:
        return SummaryPart()
    t, along, prefix = response.t, scene.path_positions(response.t), f"{LUFFING_CYLINDER} "
    driven = [name for name in response.other_names if name.startswith(prefix)]
    histories, warnings = {name.removeprefix(prefix): response.other(name) for name in driven}, list[str]()
    if not driven:
        angle, force = scene.frame.angles[0], response.other(CYLINDER)
        length, arm = scene.frame.cylinder.length_and_arm(angle.value(t))
        speed = arm * angle.rate(t)
        histories = {"force": force, "length": length, "speed": speed, "power": force * speed}
        warnings = turning_warnings(scene, angle.value(t))
    extremes = {key: Extremes.from_history(history, t, along) for key, history in histories.items()}
    boiling = [
        f"the oil on the {key.removeprefix('pressure ')} side of the luffing cylinder would have "
        f"{with_unit(of.least, 'Pa')} {response.when(of.t_least)}, and boils: the model pulls on it"
        for key, of in extremes.items()
        if key.startswith("pressure") and of.least < -VACUUM
    ]
    figures = {key.replace(" ", "_"): of.summary() for key, of in extremes.items()}
    return SummaryPart({LUFFING_CYLINDER.replace(" ", "_"): figures}, warnings, boiling)


def turning_warnings(scene: Scene, angles: Array) -> list[str]:
    """A warning if a support with a stiffness stands in for a luffing cylinder that turns or leans; else nothing.

    The cylinder turns if its stiffness about the pivot varies by more than a factor of `TURNED` over the luffing
    `angles` (T,) in rad.  It leans if its force along the boom exceeds `LEANING` times its force across the boom.
    """
    if scene.frame is None or scene.frame.cylinder is None:
        return []
    names = [support.name for support in scene.sections[0].supports if support.stiffness != "rigid"]
    across = [name for name in supports_at_lug(scene) if name in names]
    if not across:
        return []
    arm = np.abs(scene.frame.cylinder.length_and_arm(angles)[1])
    factor = float(arm.max() / arm.min()) ** 2
    force_along, force_across = np.abs(scene.frame.cylinder.direction(angles)).T
    leaning = float(np.max(force_along / np.maximum(force_across, 1e-9)))
    differences = list[str]()
    if factor > TURNED:
        differences.append(
            "is as stiff at all angles, where a cylinder's stiffness about the pivot changes by "
            f"a factor of {factor:.2g}: deflections and frequencies are right at one angle alone"
        )
    if leaning > LEANING:
        differences.append(
            f"lacks the cylinder's force along the boom, up to {leaning:.2g} times that across it: normal and shear "
            "forces of the base up to the lug are off, and so is its stress"
        )
    if not differences:
        return []
    return [
        f"the support {across[0]!r} {'; it '.join(differences)}; frame.cylinder.stiffness, in place of the support, "
        "turns with the boom"
    ]


def slack_spans(t: Array, force: Array) -> list[dict[str, float]]:
    """For each span in which a rope is slack, its ``start`` and ``end`` in s, and the largest force in N behind it.

    `force` (T,) in N is that of the rope at the times t (T,) in s.  The force behind a span, ``snatch``, is the largest
    one until the rope is slack again or the run ends.
    """
    slack = np.concatenate([[False], force <= 0.0, [False]])
    starts, ends = np.flatnonzero(~slack[:-1] & slack[1:]), np.flatnonzero(slack[:-1] & ~slack[1:])
    spans = list[dict[str, float]]()
    for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        behind = force[end : starts[k + 1] if k + 1 < len(starts) else None]
        spans.append(
            {"start": float(t[start]), "end": float(t[min(end, len(t) - 1)]), "snatch": float(behind.max(initial=0.0))}
        )
    return spans


def hoist_part(scene: Scene, response: Response) -> SummaryPart:
    r"""``hoist`` of summary.json: extremes of `KEYS`, ``weight_force`` and ``factor`` of the rope's force, ``slack``.

    The weight's force is that of a payload at rest, :math:`m g / n` with n falls; the factor is the largest force over
    it, a hoist or stop factor of the motion.  ``slack`` lists the spans in which the rope is slack (`slack_spans`), of
    which a warning tells.
    """
    hoist = scene.hoist
    if hoist is None or scene.gravity is None or not response.of(KINDS[HEIGHT]).shape[1]:
        return SummaryPart()
    along = scene.path_positions(response.t)
    columns = {key: response.other(name) for key, name in KEYS.items()}
    figures: dict[str, Any] = {
        key: Extremes.from_history(values, response.t, along).summary() for key, values in columns.items()
    }
    weight = hoist.mass * scene.gravity.acceleration / hoist.falls
    largest = float(columns["force"].max())
    figures |= {"weight_force": weight, "factor": largest / weight}
    spans, warnings = slack_spans(response.t, columns["force"]), list[str]()
    if spans:
        figures["slack"] = spans
        worst = max(spans, key=lambda span: span["snatch"])
        more = f", and {len(spans) - 1} more times" if len(spans) > 1 else ""
        snatch = (
            f"snatches with up to {with_unit(worst['snatch'], 'N')}, {worst['snatch'] / weight:.3g} times the weight"
        )
        slack = f"from {worst['start']:.4g} s to {worst['end']:.4g} s{more}"
        warnings.append(
            f"the hoist rope is slack {slack}, and {snatch}: {QUANTITIES['hoist_force'].label} need short steps then"
        )
    return SummaryPart({"hoist": figures}, grave=warnings)
