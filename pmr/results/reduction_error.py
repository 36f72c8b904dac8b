"""What the summary of a run says of the reduction's error: beside the full model, or as it is estimated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Kinds of figures, as summaries call them.
KINDS = ("beam", "tip", "pad_force", "cylinder_force", "support_force", "frequency")


def reduction_error(summary: Mapping[str, Any]) -> tuple[str, dict[str, float]]:
    """Source of the errors of a reduction, in words, and the errors by kind, fractions; no words where none is there.

    Forces that jump at kinks of extensions count between kinks; those of sliders that strike at kinks don't count.
    Frequencies are estimated, with a full model too.
    """
    errors, estimate = summary.get("errors", {}).get("reduced_vs_full", {}), summary.get("estimate") or {}
    source, how = (errors, "beside the full model") if "beam" in errors else (estimate, "estimated")
    if source.get("beam") is None:
        return "", {}
    kinds = [kind for kind in KINDS if kind != "pad_force" or "impacts" not in summary]
    by_kind = {kind: source.get(f"{kind}_between_kinks", source.get(kind)) for kind in kinds}
    by_kind["frequency"] = estimate.get("frequency")
    return how, {kind: float(error) for kind, error in by_kind.items() if error is not None}
