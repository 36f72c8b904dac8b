"""The first natural frequency of a boom over the extensions of two joints that move by themselves."""

from __future__ import annotations

import numpy as np

from pmr.compare.booms import frequencies
from pmr.results import FrequencyMap
from pmr.scene import Boom
from pmr.system.system import System

#: Extensions of each joint.
PLACES = 9


def frequency_map(boom: Boom, system: System) -> FrequencyMap | None:
    """Of the first two joints that have a path of their own and move, within its bounds, every contact closed.

    All other such joints are where they start; None where fewer than two move.
    """
    ends = {name: path.bounds(0.0, boom.time.end) for name, path in boom.paths.items() if not _follows(boom, name)}
    moving = [name for name, (low, high) in ends.items() if high - low > 1e-9 * high]
    if len(moving) < 2:
        return None
    first, second = moving[:2]
    a, b = (np.linspace(*ends[name], PLACES) for name in (first, second))
    extensions = {name: np.full((PLACES, PLACES), boom.paths[name].value(0.0)) for name in ends}
    extensions[first], extensions[second] = np.meshgrid(a, b, indexing="ij")
    while missing := [name for name in boom.paths if name not in extensions]:
        for name in missing:
            joint = boom.sections[boom.names.index(name)].joint
            if joint is not None and joint.follows in extensions:
                extensions[name] = joint.offset + joint.ratio * extensions[joint.follows]
    x = system.coordinates(extensions)
    found = frequencies(system, x.reshape(-1, x.shape[-1]))[:, 0]
    return FrequencyMap((first, second), a, b, found.reshape(PLACES, PLACES))


def _follows(boom: Boom, name: str) -> bool:
    joint = boom.sections[boom.names.index(name)].joint
    return joint is not None and joint.follows is not None
