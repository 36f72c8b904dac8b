"""Sizes and proportions of bodies, loads and paths that a computation in double precision can carry."""

from __future__ import annotations

import numpy as np

from pmr.scene.parts import OneBody
from pmr.scene.signals import SignalBase
from pmr.scene.structure_checks import refusal

#: Of a box: what its length is over its smaller side, and that side over its wall.
SLENDER, THIN = (0.01, 1e4), (0.0, 1e4)
#: Of a beam: its length over a section's radius of gyration.
GYRATION = (0.01, 1e6)
LARGEST_LOAD = 1e120  # N or N m; models are linear in it, their energies are its squares


def check_loads(part: OneBody, end: float) -> None:
    """Refuse loads that no computation in double precision can carry until `end` s."""
    for i, load in enumerate(part.loads):
        with np.errstate(all="ignore"):
            largest = float(np.abs(load.signal.bounds(0.0, end)).max())
        if not largest <= LARGEST_LOAD:
            allowed = f"at most {LARGEST_LOAD:g} N or N m are allowed, here it is {largest:.3g}"
            raise refusal(f"loads[{i}].signal", None, allowed)


def check_proportions(part: OneBody) -> None:
    """Refuse dimensions in proportions that no computation in double precision can carry."""
    box, section, profile = part.body.box, part.body.section, part.body.profile
    if profile is not None and profile.axial_stiffness is not None:
        radius = float(np.sqrt(profile.bending_stiffness / profile.axial_stiffness))
        slender = profile.length / radius
        _check_ratio("body.profile.axial_stiffness", slender, GYRATION, "length over radius of gyration")
    if box is not None:
        side = min(box.width, box.height)
        _check_ratio("body.box.length", box.length / side, SLENDER, "length over the smaller side")
        _check_ratio("body.box.width", box.width / box.height, (1e-3, 1e3), "width over height")
        _check_ratio("body.box.wall", side / min(box.walls.values()), THIN, "the smaller side over the wall")
        if section is not None:
            for name in ("second_moment_y", "second_moment_z", "torsion_constant"):
                slender = box.length / float(np.sqrt(getattr(section, name) / section.area))
                _check_ratio(f"body.section.{name}", slender, GYRATION, "length over radius of gyration")


def _check_ratio(key: str, ratio: float, allowed: tuple[float, float], what: str) -> None:
    if not allowed[0] <= ratio <= allowed[1]:
        ratio_allowed = f"a ratio of {what} from {allowed[0]:g} to {allowed[1]:g} is allowed, here it is {ratio:.3g}"
        raise refusal(key, None, ratio_allowed)


def jump_of(path: SignalBase, least: float) -> str | None:
    """Describe where a signal in m first jumps by more than `least`; None where it does not."""
    at = np.array(path.breaks)
    # All at once: one call costs as much as the signal has knots, and a file of them has thousands.
    before, after = path.value(np.nextafter(at, -np.inf)), path.value(at)
    for k in np.flatnonzero(np.abs(after - before) > least):
        return f"jumps from {before[k]:g} m to {after[k]:g} m at {at[k]:g} s; continuous paths are allowed"
    return None
