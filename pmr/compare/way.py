"""Places on the way of a system: natural frequencies there, and what loads do to its tip by frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.compare import boom_figures
from pmr.compare.booms import tip_names
from pmr.compare.frequencies import CURVES, RESPONSES, closed_form_frequencies, frequency_response, visited_positions
from pmr.results import Frequencies, FrequencyResponse
from pmr.scene import Scene
from pmr.scene.names import ALONE
from pmr.simulation import Excitation
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: Coordinates of full sections above which few places are visited.
LARGE = 1200


@dataclass(frozen=True)
class Visited:
    """Places, and how many frequencies are compared there."""

    along: Array  # (S,) m: the path coordinate of a body alone, the reach of sections
    s: Array  # (S, P) m: coordinates of all paths
    count: int

    def sides(self, system: System) -> Array:
        """X (S, sides) in m of the contacts' places."""
        return system.coordinates(dict(zip(system.paths, self.s.T, strict=True)))


def visited(scene: Scene, excitation: Excitation, size: int) -> Visited:
    """From one end of the way to the other; fewer places where frequencies of a large full model are found."""
    if ALONE in scene.bodies:
        s = visited_positions(scene, size)
        return Visited(s, s[:, None], CURVES)
    count = boom_figures.PLACES if size <= LARGE else boom_figures.FEWER_PLACES
    return _reached(scene, excitation, count)


def _reached(scene: Scene, excitation: Excitation, count: int) -> Visited:
    """Where the sections first reach so far."""
    steps = boom_figures.on_the_way(scene, excitation.times, count)
    return Visited(scene.reach(excitation.times[steps]), excitation.s[steps], boom_figures.CURVES)


def frequencies(scene: Scene, system: System, at: Visited, full: Array | None) -> Frequencies:
    """Of the reduced system, with every contact closed, beside the `full` model's (S, f) in Hz where they are known.

    Beside those of a body alone are the closed form's, where there is one; two joints that move have a map.
    """
    curves = {"reduced": Assembly(system).frequencies(at.sides(system), at.count)}
    curves |= {} if full is None else {"full": full}
    if ALONE not in system.bodies:
        return Frequencies(at.along, at.s, curves, boom_figures.frequency_map(scene, system))
    closed = closed_form_frequencies(scene, at.along, at.count) / (2.0 * np.pi)
    return Frequencies(at.along, at.s, curves | ({"closed_form": closed} if closed.size else {}))


def in_frequency(scene: Scene, system: System, excitation: Excitation) -> FrequencyResponse | None:
    """Of the last body's tip, from one end of the way to the other; None unless it asks for it."""
    if not scene.sections[-1].observe.frequency_response:
        return None
    if ALONE in system.bodies:
        s = np.unique(np.linspace(*scene.path_bounds, RESPONSES))
        at = Visited(s, s[:, None], CURVES)
    else:
        at = _reached(scene, excitation, RESPONSES)
    return frequency_response(system, at.sides(system), at.along, tip_names(scene))
