r"""Natural frequencies on the way of a scene, beside closed forms and published ones, and responses in frequency.

Closed forms are those of the uniform Euler-Bernoulli beam, pinned at 0, supported at s, free at L.  The rotation of the
beam over the support is the one unknown; the moments with which the two spans resist it must cancel.  With a = beta s,
b = beta (L - s) and beta^4 = rho A omega^2 / (E I) the spans' dynamic stiffnesses are

.. math::
    k_1 = EI \beta \frac{2 \sin a \sinh a}{\sin a \cosh a - \cos a \sinh a}, \qquad
    k_2 = EI \beta \frac{\cos b \sinh b - \sin b \cosh b}{1 + \cos b \cosh b}

(a pinned-pinned and a free span; the limits beta -> 0 are 3 EI / s and -rho A omega^2 (L - s)^3 / 3).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pmr.compare.outputs import tip_names
from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.results import Frequencies, FrequencyMap, FrequencyResponse, Paths
from pmr.results.run import Part
from pmr.scene import Scene
from pmr.scene.choice import is_pinned_beam
from pmr.scene.keys import ALONE, LUFFING, SLIDER
from pmr.scene.members import member_at
from pmr.simulation import Excitation
from pmr.simulation.at_rest import amplitudes_at_rest, steepest
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: Frequencies that are compared, and places at which: beyond so many coordinates each of these costs some tenths of a
#: second and more.
CURVES, POSITIONS, FEWER_POSITIONS, LARGE = 6, 49, 11, 300
#: Places along the path, and frequencies, of responses in frequency.
RESPONSES, RESPONSE_FREQUENCIES = 5, 400
_UNITS = {"N": "m/N", "m/s^2": "m/(m/s²)"}


def visited_positions(scene: Scene, size: int) -> Array:
    """Path coordinates (S,) in m, evenly over the path, at which frequencies of `size` coordinates are compared."""
    low, high = scene.path_bounds
    return np.linspace(low, high, POSITIONS if size <= LARGE else FEWER_POSITIONS) if high > low else np.array([low])


def reduced_frequencies(model: ReducedModel, s: Array, count: int) -> Array:
    """The `count` lowest frequencies (S, count) in Hz at the path coordinates s (S,) m.

    Where fewer coordinates are free than asked for, the rest is NaN.
    """
    system = System.of(model)
    return Assembly(system).frequencies(system.coordinates({SLIDER: s}), count)


def closed_form_frequencies(scene: Scene, s: Array, count: int) -> Array:
    """The `count` lowest frequencies (S, count) in rad/s of the scene's beam, or (S, 0) where there is no closed form.

    With axial coordinates those of the bar, held at 0 and free at its end, stand among those of bending.
    """
    profile = scene.body.profile
    if profile is None or not is_pinned_beam(member_at(scene)):
        return np.empty((len(s), 0))
    axial = np.empty(0)
    if profile.axial and profile.axial_stiffness is not None:
        axial = axial_frequencies(profile.length, profile.axial_stiffness, profile.mass_per_length, count)
    beam = profile.length, profile.bending_stiffness, profile.mass_per_length
    within = np.minimum(s, profile.length)  # a path may pass the end by round-off
    bending = [bending_frequencies(float(at), *beam, count) for at in within]
    return np.array([np.sort(np.concatenate([row, axial]))[:count] for row in bending])


_STEP = np.pi / 400.0  # of beta L; neighbouring roots are further apart than this
_AT_ONCE = 1000  # steps


def bending_frequencies(s: float, length: float, bending_stiffness: float, mass_per_length: float, count: int) -> Array:
    """The `count` lowest circular frequencies in rad/s with the support at s, 0 < s <= length (m).

    Raises ValueError if s does not lie on the beam, or on the pin.
    """
    if not 0.0 < s <= length:
        raise ValueError(f"s = {s:g} m: allowed are 0 < s <= {length:g} m")
    share, first = s / length, 1
    roots: list[float] = []
    while len(roots) < count:
        x = _STEP * np.arange(first, first + _AT_ONCE + 1)
        values = _residual(x, share)
        sign_changes = np.flatnonzero((values[:-1] == 0.0) | (values[:-1] * values[1:] < 0.0))
        for i in sign_changes[: count - len(roots)]:
            root = x[i] if values[i] == 0.0 else brentq(_residual, x[i], x[i + 1], args=(share,), xtol=1e-14)
            roots.append(float(root))
        first += _AT_ONCE
    beta = np.array(roots) / length
    return beta**2 * np.sqrt(bending_stiffness / mass_per_length)


def axial_frequencies(length: float, axial_stiffness: float, mass_per_length: float, count: int) -> Array:
    """(2 n - 1) pi / (2 L) sqrt(EA / rho A) in rad/s: a bar held at one end (Blevins 1979, table 8-16)."""
    n = np.arange(1, count + 1)
    return (2 * n - 1) * np.pi / (2.0 * length) * np.sqrt(axial_stiffness / mass_per_length)


def _residual(x: Any, share: float) -> Any:
    """(k_1 + k_2) times both denominators over cosh a cosh b, at beta L = x and s / L = share: no overflow."""
    a, b = x * share, x * (1.0 - share)
    supported = 2.0 * np.sin(a) * np.tanh(a) * (1.0 / np.cosh(b) + np.cos(b))
    free = (np.cos(b) * np.tanh(b) - np.sin(b)) * (np.sin(a) - np.cos(a) * np.tanh(a))
    return supported + free


def frequency_response(
    system: System, places: Array, along: Array, tips: Collection[str], c: Array
) -> FrequencyResponse:
    """How far the tip moves under each load, with all paths at rest: what a drive or a controller meets.

    By `Assembly.answers`, from a tenth of the lowest natural frequency to the highest, at `places` (S, sides) in m,
    which `along` (S,) in m tells apart, with amplitudes c (S, k) of the system's terms; `tips` are names of outputs.

    An InputError is raised where a contact only pushes.
    """
    if pushing := [contact.name for contact in system.contacts if contact.clearance is not None]:
        allowed = f"contacts that hold both ways are allowed: {', '.join(pushing)} only push"
        raise InputError("scene", "observe.frequency_response", True, allowed)
    assembly = Assembly(system)
    rows, natural = assembly.along(places), assembly.frequencies(places, assembly.size, c)
    names = system.output_names
    which = [k for k, name in enumerate(names) if name in tips]
    f = np.geomspace(0.1 * np.nanmin(natural), 1.2 * np.nanmax(natural), RESPONSE_FREQUENCIES)
    omega = 2.0 * np.pi * np.append(0.0, f)
    answers = np.array([assembly.answers(rows.at(k), omega, c[k])[:, which] for k in range(len(along))])
    static = answers[:, 0].real
    furthest = np.abs(static).max(axis=0).argmax(axis=0)  # of each load, the direction in which it moves the tip
    inputs = np.arange(len(system.input_names))
    return FrequencyResponse(
        along,
        f,
        np.abs(answers[:, 1:])[:, :, furthest, inputs],
        static[:, furthest, inputs],
        damped=bool(assembly.D.count_nonzero()),
        outputs=tuple(names[which[k]] for k in furthest),
        inputs=system.input_names,
        units=tuple(_UNITS.get(unit, f"m/({unit})") for unit in system.input_units),
    )


def frequency_part(response: FrequencyResponse | None) -> Part:
    """``frequency_response``: of each load static and largest gain, and where that is, at each place."""
    if response is None:
        return Part()
    figures: dict[str, Any] = {"s": response.s.tolist(), "damped": response.damped, "gain": {}}
    for k, name in enumerate(response.inputs):
        peak = response.gain[:, :, k].argmax(axis=1)
        figures["gain"][name] = {
            "output": response.outputs[k],
            "unit": response.units[k],
            "static": response.static[:, k].tolist(),
            "largest": response.gain[np.arange(len(peak)), peak, k].tolist() if response.damped else None,
            "at": response.f[peak].tolist(),
        }
    return Part({"frequency_response": figures})


#: Coordinates of full sections above which few places are visited.
LARGE_SYSTEM = 1200


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


def shown_paths(scene: Scene, excitation: Excitation) -> Paths:
    """Paths of a result: those of sections or of a body alone, without the angle that a luffing cylinder turns with."""
    count = len(scene.paths)
    return Paths(tuple(scene.paths), excitation.s[:, :count], excitation.rates[:, :count])


def places_on_way(scene: Scene, excitation: Excitation, size: int) -> Visited:
    """From one end of the way to the other; fewer places where frequencies of a large full model are found.

    With second order frequencies change with time, too: what stays where it is, is looked at again and again.
    """
    alone = ALONE in scene.bodies
    count = PLACES_OF_BOOM if size <= LARGE_SYSTEM else FEWER_PLACES_OF_BOOM
    stays = not np.ptp(excitation.s[:, : len(scene.paths)], axis=0).any()
    if stays and (excitation.terms or scene.holding_cylinder is not None):
        t = np.linspace(0.0, scene.time.end, count)
        s = np.column_stack([path.value(t) for path in excitation.paths.values()])
        if not np.ptp(np.hstack([s, excitation.amplitudes(list(excitation.terms), t)]), axis=0).any():
            t, s = t[:1], s[:1]
        return Visited(s[:, 0] if alone else scene.reach(t), s, CURVES if alone else CURVES_OF_BOOM, t)
    if alone:
        along = visited_positions(scene, size)
        return Visited(along, along[:, None], CURVES, _first_there(excitation, along))
    return _first_reached(scene, excitation, count)


def _first_there(excitation: Excitation, s: Array) -> Array:
    """When the only path is nearest to s (S,) m first, (S,) s."""
    return np.array([excitation.times[np.argmin(np.abs(excitation.s[:, 0] - at))] for at in s])


def _first_reached(scene: Scene, excitation: Excitation, count: int) -> Visited:
    """Places at which the sections first reach so far."""
    steps = on_the_way(scene, excitation.times, count)
    t = excitation.times[steps]
    return Visited(scene.reach(t), excitation.s[steps], CURVES_OF_BOOM, t)


def frequencies_on_way(scene: Scene, system: System, excitation: Excitation, at: Visited) -> Frequencies:
    """Frequencies of the reduced system, with every contact closed.

    Terms have the amplitudes of that time.  Beside those of a body alone are the closed form's, where there is one; two
    joints that move have a map.
    """
    c = excitation.amplitudes(system.term_names, at.t)
    curves = {"reduced": Assembly(system).frequencies(at.sides(system), at.count, c)}
    t = at.t if system.terms else None
    if ALONE not in system.bodies:
        return Frequencies(at.along, at.s, curves, frequency_map(scene, system), t)
    closed = np.empty((0, 0)) if system.terms else closed_form_frequencies(scene, at.along, at.count) / (2.0 * np.pi)
    return Frequencies(at.along, at.s, curves | ({"closed_form": closed} if closed.size else {}), t=t)


def response_on_way(scene: Scene, system: System, excitation: Excitation) -> FrequencyResponse | None:
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


#: Frequencies that are compared, and places on the way at which: fewer where matrices are large.
CURVES_OF_BOOM, PLACES_OF_BOOM, FEWER_PLACES_OF_BOOM = 4, 13, 4
#: Extensions of each joint at which the first frequency is mapped.
MAPPED = 9
#: Share of the reach by which a published one may lie beyond it: it is rounded.
BESIDE = 1e-4


def on_the_way(boom: Scene, t: Array, count: int) -> NDArray[np.int64]:
    """Steps (S,) at which the boom first reaches so far, evenly from its shortest to its longest."""
    reach = boom.reach(t)
    goals = np.linspace(reach.min(), reach.max(), count if np.ptp(reach) > 1e-9 * reach.max() else 1)
    return np.array(list(dict.fromkeys(int(np.argmin(np.abs(reach - goal))) for goal in goals)))


def frequency_map(boom: Scene, system: System) -> FrequencyMap | None:
    """Lowest frequencies over the first two joints that move on paths of their own, every contact closed.

    All other such joints are where they start; None where fewer than two move.  With second order the boom rests at its
    steepest angle.
    """
    ends = {name: path.bounds(0.0, boom.time.end) for name, path in boom.paths.items() if not _follows(boom, name)}
    moving = [name for name, (low, high) in ends.items() if high - low > 1e-9 * high]
    if len(moving) < 2:
        return None
    first, second = moving[:2]
    a, b = (np.linspace(*ends[name], MAPPED) for name in (first, second))
    extensions = {name: np.full((MAPPED, MAPPED), boom.paths[name].value(0.0)) for name in ends}
    extensions[first], extensions[second] = np.meshgrid(a, b, indexing="ij")
    while missing := [name for name in boom.paths if name not in extensions]:
        for name in missing:
            joint = boom.sections[boom.names.index(name)].joint
            if joint is not None and joint.follows in extensions:
                extensions[name] = joint.offset + joint.ratio * extensions[joint.follows]
    turned = {LUFFING: np.full((MAPPED, MAPPED), steepest(boom))} if LUFFING in system.paths else {}
    x, c = system.coordinates(extensions | turned), np.zeros((MAPPED**2, 0))
    if system.terms:
        placed = {name: np.broadcast_to(at, (MAPPED, MAPPED)).ravel() for name, at in extensions.items()}
        c = amplitudes_at_rest(boom, placed, steepest(boom))
    lowest = Assembly(system).frequencies(x.reshape(-1, x.shape[-1]), 1, c)[:, 0]
    return FrequencyMap((first, second), a, b, lowest.reshape(MAPPED, MAPPED))


def _follows(boom: Scene, name: str) -> bool:
    joint = boom.sections[boom.names.index(name)].joint
    return joint is not None and joint.follows is not None


def published_part(boom: Scene, frequencies: Frequencies) -> Part:
    """``published_frequencies``: the first one where it is published, and what each model has there.

    What is published beyond this boom's reach is left out, with a line.
    """
    published = boom.published.frequencies if boom.published else ()
    low, high, slack = frequencies.along[0], frequencies.along[-1], BESIDE * frequencies.along[-1]
    within = [frequency for frequency in published if low - slack <= frequency.reach <= high + slack]
    rows = [
        {"reach": frequency.reach, "published": frequency.first}
        | {
            model: float(np.interp(frequency.reach, frequencies.along, f[:, 0]))
            for model, f in frequencies.models.items()
        }
        for frequency in within
    ]
    beyond = ", ".join(f"{frequency.reach:g}" for frequency in published if frequency not in within)
    warning = (
        f"published frequencies at a reach of {beyond} m are left out: this boom reaches {low:.6g} to {high:.6g} m"
    )
    return Part({"published_frequencies": rows} if rows else {}, [warning] if beyond else [])
