"""Summary of a hoist: height and swing of its hook, the force of its rope, and where the rope is slack or snatches."""

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
