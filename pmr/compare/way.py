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
from pmr.scene.keys import ALONE
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
    t: Array  # (S,) s: when the run is there first, which says how the system is stressed

    def sides(self, system: System) -> Array:
        """X (S, sides) in m of the contacts' places."""
        return system.coordinates(dict(zip(system.paths, self.s.T, strict=True)))


def places_on_way(scene: Scene, excitation: Excitation, size: int) -> Visited:
    """From one end of the way to the other; fewer places where frequencies of a large full model are found.

    With second order frequencies change with time, too: what stays where it is, is looked at again and again.
    """
    alone = ALONE in scene.bodies
    count = boom_figures.PLACES if size <= LARGE else boom_figures.FEWER_PLACES
    if excitation.terms and not np.ptp(excitation.s, axis=0).any():
        t = np.linspace(0.0, scene.time.end, count)
        if not np.ptp(excitation.amplitudes(list(excitation.terms), t), axis=0).any():
            t, count = t[:1], 1
        s = np.broadcast_to(excitation.s[0], (count, excitation.s.shape[1]))
        return Visited(s[:, 0] if alone else scene.reach(t), s, CURVES if alone else boom_figures.CURVES, t)
    if alone:
        along = visited_positions(scene, size)
        return Visited(along, along[:, None], CURVES, _first_there(excitation, along))
    return _first_reached(scene, excitation, count)


def _first_there(excitation: Excitation, s: Array) -> Array:
    """When the only path is nearest to s (S,) m first, (S,) s."""
    return np.array([excitation.times[np.argmin(np.abs(excitation.s[:, 0] - at))] for at in s])


def _first_reached(scene: Scene, excitation: Excitation, count: int) -> Visited:
    """Places at which the sections first reach so far."""
    steps = boom_figures.on_the_way(scene, excitation.times, count)
    t = excitation.times[steps]
    return Visited(scene.reach(t), excitation.s[steps], boom_figures.CURVES, t)


def frequencies(scene: Scene, system: System, excitation: Excitation, at: Visited) -> Frequencies:
    """Frequencies of the reduced system, with every contact closed.

    Terms have the amplitudes of that time.  Beside those of a body alone are the closed form's, where there is one; two
    joints that move have a map.
    """
    c = excitation.amplitudes(system.term_names, at.t)
    curves = {"reduced": Assembly(system).frequencies(at.sides(system), at.count, c)}
    t = at.t if system.terms else None
    if ALONE not in system.bodies:
        return Frequencies(at.along, at.s, curves, boom_figures.frequency_map(scene, system), t)
    closed = np.empty((0, 0)) if system.terms else closed_form_frequencies(scene, at.along, at.count) / (2.0 * np.pi)
    return Frequencies(at.along, at.s, curves | ({"closed_form": closed} if closed.size else {}), t=t)


def in_frequency(scene: Scene, system: System, excitation: Excitation) -> FrequencyResponse | None:
    """Frequency response of the last body's tip along the way; None unless the scene wants it."""
    if not scene.sections[-1].observe.frequency_response:
        return None
    if ALONE in system.bodies:
        s = np.unique(np.linspace(*scene.path_bounds, RESPONSES))
        at = Visited(s, s[:, None], CURVES, _first_there(excitation, s))
    else:
        at = _first_reached(scene, excitation, RESPONSES)
    c = excitation.amplitudes(system.term_names, at.t)
    return frequency_response(system, at.sides(system), at.along, tip_names(scene), c)
