"""What no reduced model of a structure has: arrays that contradict each other, values that are none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pmr.reduced.model import ReducedModel

#: Share of the largest entry up to which a matrix may be asymmetric, or an eigenvalue negative: far above round-off.
SYMMETRIC = 1e-6


def contradiction(model: ReducedModel) -> str | None:
    """What is wrong with the arrays, in words; None where shapes agree, breaks increase and all is finite."""
    for name, axes in {"M": 2, "output_positions": 1}.items():
        if getattr(model, name).ndim != axes:
            return f"{name} has shape {getattr(model, name).shape}, {axes} axes are allowed"
    r, i, o, m = len(model.M), len(model.input_names), len(model.output_positions), len(model.row_names)
    shapes = {"M": (r, r), "D": (r, r), "K": (r, r), "B": (r, i), "outputs": (o, r)}
    for name, shape in shapes.items():
        array = getattr(model, name)
        if array.shape != shape:
            return f"{name} has shape {array.shape}, {shape} is allowed"
        if not np.isfinite(array).all():
            return f"{name} is not finite"
    if not np.isfinite(model.output_positions).all():
        return "output_positions are not finite"
    if not {len(model.output_names), len(model.output_units)} <= {0, o}:
        return f"{len(model.output_names)} names and {len(model.output_units)} units are given for {o} outputs"
    if wrong := _asymmetry(model):
        return wrong
    if model.rows.c.shape[2:] != (m, r) or not np.isfinite(model.rows.c).all():
        return f"the rows have shape {model.rows.c.shape[2:]} or are not finite, {(m, r)} is allowed"
    if not (np.all(np.diff(model.rows.x) > 0.0) and np.isfinite(model.rows.x).all()):
        return "the rows' breaks do not increase"
    pads = model.row_compliance
    if pads.shape != (m,) or not np.all(np.isfinite(pads) & (pads >= 0.0)):
        return f"pads has shape {pads.shape} or negative values, {(m,)} from 0 on are allowed"
    clearance = model.row_clearance
    if clearance.shape != (m,) or not np.all(np.isnan(clearance) | (clearance >= 0.0) & np.isfinite(clearance)):
        return f"clearance has shape {clearance.shape} or values that are no lengths, {(m,)} from 0 on are allowed"
    parts = [part.contradiction(m, i, o) for part in (model.flexibility, model.enrichment) if part is not None]
    return next((wrong for wrong in parts if wrong), None)


def _asymmetry(model: ReducedModel) -> str | None:
    """What is wrong with M, D or K, in words: a mass or a stiffness that is not positive lets motions grow."""
    for name in ("M", "D", "K"):
        matrix = getattr(model, name)
        size = np.abs(matrix).max(initial=0.0)
        if np.abs(matrix - matrix.T).max(initial=0.0) > SYMMETRIC * size:
            return f"{name} is not symmetric"
        lowest = np.linalg.eigvalsh(matrix / size)[0] if size else 0.0
        if lowest < -SYMMETRIC or (name == "M" and lowest <= 0.0):
            return f"{name} has a negative eigenvalue" if lowest < 0.0 else f"{name} is singular"
    return None
