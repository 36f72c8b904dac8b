"""A frame that moves in words: its angles, the axes of the figures, and what is kept or left out of its effects."""

from __future__ import annotations

import numpy as np

from pmr.report.numbers import SPACE, percent, plain, significant
from pmr.results import RunResult


def frame(result: RunResult) -> str:
    """In a few sentences; empty without a frame."""
    motion = result.summary.get("frame")
    if motion is None:
        return ""
    angles = {"raised": motion["luffing"], "slewed": motion["slewing"]}
    angle_texts = [
        f"{way} {_range(angle)}" for way, angle in angles.items() if angle["max"] > angle["min"] or angle["max"]
    ]
    turns = f"The boom is {' and '.join(angle_texts)}. " if angle_texts else ""
    axes = "Deflections are measured in its own axes, which turn with it: x along it, z upwards where it lies level. "
    buckling = result.summary.get("buckling", {"factor": None})
    if not motion["second_order"]:
        size = f" ({percent(buckling['share'])} of the stiffness at most)" if "share" in buckling else ""
        left_out = f"the bending by axial forces{size}"
        if motion["gyroscopic"] is not None:
            turning = f"{percent(motion['gyroscopic'])}) and centrifugal forces ({percent(motion['centrifugal'])}"
            left_out += f", and gyroscopic forces ({turning} of the stiffness at the lowest frequency)"
        return f"{turns}{axes}Second order is left out: {left_out}; frame.second_order includes it."
    factor = buckling["factor"]
    if factor is None:
        return f"{turns}{axes}Second order is included; no axial force compresses the boom."
    return (
        f"{turns}{axes}Second order is included: the boom would buckle under {significant(factor)} times its "
        f"axial forces, at t = {plain(round(buckling['t'], 3))}{SPACE}s, with every pad closed.{_share(factor)}"
    )


def energy(result: RunResult) -> str:
    """Sentence on the sources of energy of a boom in space; empty without a frame."""
    energies = result.summary.get("energy")
    if energies is None:
        return ""
    size = {key: f"{significant(value)}{SPACE}J" for key, value in energies.items()}
    return (
        "The figures show the motion in the boom's axes, where weight and the frame's inertia count as loads. In space "
        f"the energy, less that of the same boom when rigid, changes by {size['change']} from start to end: the drives "
        f"of frame and extensions do {size['drives']}, loads and travelling pads {size['others']}, and damping and the "
        f"error of the steps take {size['lost']}."
    )


def _share(factor: float) -> str:
    r"""By how much second order increases the deflection of a boom at rest: about :math:`1 / (1 - 1/\lambda) - 1`."""
    if factor <= 1.0:
        return ""
    further = percent(1.0 / (factor - 1.0), 2)
    return f" At rest second order adds about {further} to its deflection then: 1/(λ − 1) of the buckling factor λ."


def _range(angle: dict[str, float]) -> str:
    low, high = (plain(round(float(np.rad2deg(angle[end])), 1)) for end in ("min", "max"))
    return f"by {high}°" if low == high else f"between {low}° and {high}°"
