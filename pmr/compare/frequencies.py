r"""Natural frequencies along a scene's path, with closed forms and published values, and frequency responses.

Closed forms are those of the uniform Euler-Bernoulli beam that is pinned at 0, supported at s and free at L.  The only
unknown is the rotation of the beam over the support; the moments with which the two spans resist this rotation must
cancel.  With the mass per length rho A, the bending stiffness E I, a = beta s, b = beta (L - s) and beta^4 = rho A
omega^2 / (E I), the dynamic stiffnesses k_1 of the pinned-pinned span and k_2 of the free span are

.. math::
    k_1 = EI \beta \frac{2 \sin a \sinh a}{\sin a \cosh a - \cos a \sinh a}, \qquad
    k_2 = EI \beta \frac{\cos b \sinh b - \sin b \cosh b}{1 + \cos b \cosh b}

The limits for beta -> 0 are 3 EI / s and -rho A omega^2 (L - s)^3 / 3.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from pmr.compare.outputs import tip_names
from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.results import Frequencies, FrequencyMap, FrequencyResponse, Paths
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.choice import is_pinned_beam
from pmr.scene.keys import ALONE, LUFFING, SLIDER
from pmr.scene.members import member_at
from pmr.simulation import Excitation
from pmr.simulation.at_rest import amplitudes_at_rest, critical_luffing
from pmr.simulation.statics.equilibrium import equilibrium
from pmr.system.assembly import Assembly
from pmr.system.system import System

#: For a single body: number of frequencies that are compared; number of positions in which they are compared; number of
#: positions for models of more than `LARGE` coordinates, where each position takes tenths of a second and more;
#: `LARGE`.
CURVES, POSITIONS, FEWER_POSITIONS, LARGE = 6, 49, 11, 300
#: Number of positions along the path at which frequency responses are computed, and number of their frequencies.
RESPONSES, RESPONSE_FREQUENCIES = 5, 400
_UNITS = {"N": "m/N", "m/s^2": "m/(m/s²)"}


def comparison_positions(scene: Scene, size: int) -> Array:
    """Path coordinates (S,) in m, evenly spaced over the path, at which frequencies of models are compared.

    `size` is the number of coordinates of the full model.  S is `POSITIONS`, or `FEWER_POSITIONS` for a `size` above
    `LARGE`, or 1 if nothing moves.
    """
    low, high = scene.path_bounds
    return np.linspace(low, high, POSITIONS if size <= LARGE else FEWER_POSITIONS) if high > low else np.array([low])


def closed_form_frequencies(scene: Scene, s: Array, count: int) -> Array:
    """The `count` lowest frequencies (S, count) in rad/s of the scene's beam with its slider at s (S,) in m.

    The frequencies are in ascending order; if the beam has axial coordinates, the frequencies include those of the bar,
    held at 0 and free at its end.  The shape is (S, 0) if there is no closed form.
    """
    profile = scene.body.profile
    if profile is None or not is_pinned_beam(member_at(scene)):
        return np.empty((len(s), 0))
    axial = np.empty(0)
    if profile.axial and profile.axial_stiffness is not None:
        n = np.arange(1, count + 1)  # a bar that is held at one end (Blevins 1979, table 8-16)
        axial = (
            (2 * n - 1) * np.pi / (2.0 * profile.length) * np.sqrt(profile.axial_stiffness / profile.mass_per_length)
        )
    beam = profile.length, profile.bending_stiffness, profile.mass_per_length
    within = np.minimum(s, profile.length)  # a path may pass the end by round-off
    bending = [bending_frequencies(float(at), *beam, count) for at in within]
    return np.array([np.sort(np.concatenate([row, axial]))[:count] for row in bending])


_STEP = np.pi / 400.0  # step in beta L; neighbouring roots are further apart


def bending_frequencies(s: float, length: float, bending_stiffness: float, mass_per_length: float, count: int) -> Array:
    """The `count` lowest circular frequencies (count,) in rad/s of a beam that is pinned at 0 and supported at s.

    The beam has the `length` in m and is free at its end; 0 < s <= `length`.  `bending_stiffness` is in N m^2,
    `mass_per_length` in kg/m.  Raises ValueError if s is not on the beam, or is at the pin.
    """
    if not 0.0 < s <= length:
        raise ValueError(f"s = {s:g} m: allowed are 0 < s <= {length:g} m")
    # without the support, root k + 1 is (k + 1/4) pi; with it, each root is at most the next one of these
    share, x = s / length, _STEP * np.arange(1, (count + 1) * np.pi / _STEP)
    values = _characteristic(x, share)
    sign_changes = np.flatnonzero((values[:-1] == 0.0) | (values[:-1] * values[1:] < 0.0))[:count]
    roots = [
        x[i] if values[i] == 0.0 else brentq(_characteristic, x[i], x[i + 1], args=(share,), xtol=1e-14)
        for i in sign_changes
    ]
    beta = np.array(roots) / length
    return beta**2 * np.sqrt(bending_stiffness / mass_per_length)


def _characteristic(x: Array | float, share: float) -> Any:
    r"""Characteristic function, in the shape of x (any shape), of a beam pinned at 0, supported at s and free at L.

    The roots of the function in x are beta L of the natural frequencies; `share` is s / L. It is

    .. math::
        2 \sin a \tanh a\, (1 / \cosh b + \cos b) + (\cos b \tanh b - \sin b)\, (\sin a - \cos a \tanh a), \qquad
        a = x\, s / L, \quad b = x\, (1 - s / L)

    The function follows from the sum of the dynamic stiffnesses k_1 and k_2 in this module's docstring, divided by EI
    beta.  This sum is multiplied by the denominators of k_1 and k_2 and divided by cosh a cosh b, so that nothing
    overflows.
    """
    a, b = x * share, x * (1.0 - share)
    supported = 2.0 * np.sin(a) * np.tanh(a) * (1.0 / np.cosh(b) + np.cos(b))
    free = (np.cos(b) * np.tanh(b) - np.sin(b)) * (np.sin(a) - np.cos(a) * np.tanh(a))
    return supported + free


def frequency_part(response: FrequencyResponse | None) -> SummaryPart:
    """Entry ``frequency_response`` of summary.json; nothing if `response` is None.

    For each load and each position s in m it has the ``static`` gain and the ``largest`` gain.  ``at`` is the frequency
    in Hz at which the largest gain occurs.  Without damping, the largest gain is None.
    """
    if response is None:
        return SummaryPart()
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
    return SummaryPart({"frequency_response": figures})


#: If full sections together have more coordinates than this, frequencies are computed in `FEWER_PLACES_OF_BOOM`
#: positions only.
LARGE_SYSTEM = 1200


@dataclass(frozen=True)
class WayPoints:
    """Positions on the way of a scene, S of them on P paths, and the number of frequencies compared in each."""

    along: Array  # (S,) m: path coordinate of a single body, or reach of sections
    s: Array  # (S, P) m: coordinates of all paths
    count: int
    t: Array  # (S,) s: time at which the run is there; axial forces of this time stress the system

    def sides(self, system: System) -> Array:
        """Path coordinates (S, sides) in m in a system; each contact has a side on each body that it joins."""
        return system.side_coordinates(dict(zip(system.paths or (SLIDER,), self.s.T, strict=True)))


def result_paths(scene: Scene, excitation: Excitation) -> Paths:
    """Paths that a result shows, with coordinates and rates at all steps.

    The paths are those of sections or of a single body, without the angle of a luffing cylinder.
    """
    count = len(scene.paths)
    return Paths(tuple(scene.paths), excitation.s[:, :count], excitation.rates[:, :count])


def way_points(scene: Scene, system: System, excitation: Excitation, size: int) -> WayPoints:
    """Positions at which frequencies are compared, from one end of the scene's way to the other.

    `size` is the number of coordinates of the full model, 0 if there is none; large models have fewer positions.  A run
    may be at a position several times, with other extensions, axial forces or luffing angles.  The time at which the
    reduced `system` has its lowest frequency then counts.

    If nothing moves along its path, second order or a luffing cylinder may still change the stiffness.  Then the
    positions are all the same, at evenly spaced times.  If the stiffness does not change either, there is a single
    position.
    """
    alone = ALONE in scene.bodies
    count = PLACES_OF_BOOM if size <= LARGE_SYSTEM else FEWER_PLACES_OF_BOOM
    stays = not np.ptp(excitation.s[:, : len(scene.paths)], axis=0).any()
    if stays and (excitation.terms or scene.holding_cylinder is not None):
        t = np.linspace(0.0, scene.time.end, count)
        s = np.column_stack([path.value(t) for path in excitation.paths.values()])
        if not np.ptp(np.hstack([s, excitation.amplitudes(list(excitation.terms), t)]), axis=0).any():
            t, s = t[:1], s[:1]
        return WayPoints(s[:, 0] if alone else scene.reach(t), s, CURVES if alone else CURVES_OF_BOOM, t)
    if alone:
        along = comparison_positions(scene, size)
        return _at_slider_positions(system, excitation, along)
    return _at_reaches(scene, system, excitation, count)


def _at_slider_positions(system: System, excitation: Excitation, s: Array) -> WayPoints:
    """Positions of a single body at the path coordinates s (S,) in m, at the times of `_softest_step`."""
    steps = [_softest_step(system, excitation, excitation.s[:, 0], at) for at in s]
    return WayPoints(s, s[:, None], CURVES, excitation.times[steps])


def _at_reaches(scene: Scene, system: System, excitation: Excitation, count: int) -> WayPoints:
    """Positions of a boom whose reach is nearest to `count` evenly spaced values, each at the time of `_softest_step`.

    If a step is nearest to several of these values, it counts once.  A boom that keeps its reach has one position.
    """
    reach = scene.reach(excitation.times)
    goals = np.linspace(reach.min(), reach.max(), count if np.ptp(reach) > 1e-9 * reach.max() else 1)
    steps = list(dict.fromkeys(_softest_step(system, excitation, reach, goal) for goal in goals))
    return WayPoints(reach[steps], excitation.s[steps], CURVES_OF_BOOM, excitation.times[steps])


def _softest_step(system: System, excitation: Excitation, along: Array, goal: float) -> int:
    """Number of the step at which a run is at the position `goal` and the reduced system has its lowest frequency.

    `along` (T,) in m are the positions of all T steps; the `goal` is in m, too.  The run may pass the goal, or come
    nearest to it, several times; up to `POSTURES` of these steps are compared.  If the frequency at the first of them
    exceeds the lowest by at most the share `ALIKE`, the first step is returned.  Otherwise it is the step with the
    lowest frequency.
    """
    d = np.round(np.abs(along - goal), 9)
    near = d <= max(0.5 * np.abs(np.diff(along)).max(initial=0.0), d.min())
    steps = np.flatnonzero(near & (d <= np.append(np.inf, d[:-1])) & (d <= np.append(d[1:], np.inf)))
    steps = steps[np.unique(np.linspace(0, len(steps) - 1, POSTURES).round().astype(int))]
    if len(steps) > 1:
        c = excitation.amplitudes(system.term_names, excitation.times[steps])
        at = WayPoints(along[steps], excitation.s[steps], 1, excitation.times[steps])
        lowest = Assembly(system).frequencies(at.sides(system), 1, c)[:, 0]
        return int(steps[0 if lowest[0] <= (1.0 + ALIKE) * lowest.min() else lowest.argmin()])
    return int(steps[0])


def frequencies_on_way(scene: Scene, system: System, excitation: Excitation, points: WayPoints) -> Frequencies:
    """Natural frequencies in Hz of the reduced system in the positions `points`, with every contact closed.

    If pads only push, the lowest frequency without the pads that are open at rest is computed, too
    (`_resting_frequencies`).  Terms have the amplitudes of the times `points.t`.  For a single body without terms, the
    result includes frequencies in closed form where they are known.  For a boom with at least two joints that move, it
    includes a map of the first frequency over the extensions of two of them.
    """
    c = excitation.amplitudes(system.term_names, points.t)
    curves = {"reduced": Assembly(system).frequencies(points.sides(system), points.count, c)}
    t, resting = points.t if system.terms else None, _resting_frequencies(scene, system, points, c)
    if ALONE not in system.bodies:
        return Frequencies(points.along, points.s, curves, frequency_map(scene, system), t, resting)
    closed = None if system.terms else closed_form_frequencies(scene, points.along, points.count) / (2.0 * np.pi)
    if closed is not None and closed.size:
        curves["closed_form"] = closed
    return Frequencies(points.along, points.s, curves, t=t, resting=resting)


def _resting_frequencies(scene: Scene, system: System, points: WayPoints, c: Array) -> Array | None:
    """Lowest natural frequency (S,) in Hz in S positions, without the pads that are open in equilibrium there.

    The equilibrium is that under the full weight and the loads of the times `points.t`; the terms have the amplitudes c
    (S, k).  A pad that touches without a force counts as closed.  The result is NaN where no equilibrium is found, and
    None if no pad only pushes.
    """
    if np.isnan(system.clearance).all():
        return None
    gravity = scene.gravity and scene.gravity.model_copy(update={"rise": 0.0})
    excitation = Excitation.from_scene(scene.model_copy(update={"gravity": gravity}))
    f, x, assembly = excitation.forces(system.input_names, points.t), points.sides(system), Assembly(system)
    lowest = np.full(len(x), np.nan)
    for k in range(len(x)):
        with suppress(InputError):  # nothing holds the boom there
            closed = equilibrium(assembly, x[k], f[k], c[k]).closed
            lowest[k] = assembly.frequencies(x[k : k + 1], 1, c[k : k + 1], closed[None])[0, 0]
    return lowest


def lowest_mode_part(scene: Scene, system: System, excitation: Excitation, natural: Frequencies) -> SummaryPart:
    """Entry ``lowest_mode`` of summary.json: the direction in which the lowest mode moves the tip most.

    The direction is ``y`` or ``z``.  The lowest mode is the mode of the reduced system with the lowest of the
    frequencies `natural`; the tip is that of the last section.  Without displacements of the tip the entry is missing.
    """
    assembly, tips, omega = Assembly(system), tip_names(scene), natural.models.get("reduced", np.empty((0, 0)))
    outputs = [k for k, name in enumerate(system.output_names) if name in tips]
    if not outputs or not omega.size or not np.isfinite(omega[:, 0]).any():
        return SummaryPart()
    k = int(np.nanargmin(omega[:, 0]))
    t = np.zeros(len(natural.along)) if natural.t is None else natural.t
    x = WayPoints(natural.along, natural.paths, 1, t).sides(system)[k]
    mode = assembly.modes(assembly.contact_rows(x, effects=False), 1, excitation.amplitudes(system.term_names, t)[k])
    motion = np.abs(assembly.outputs.toarray()[outputs] @ mode.phi[:, 0])
    name = system.output_names[outputs[int(motion.argmax())]]
    return SummaryPart({"lowest_mode": {"direction": name[-1]}} if motion.any() else {})


def response_on_way(scene: Scene, system: System, excitation: Excitation) -> FrequencyResponse | None:
    """Frequency response of the last body's tip in up to `RESPONSES` positions on the way; None unless it is asked for.

    It is the displacement per unit of each load over frequency, with all paths at rest: the plant on which a drive or a
    controller acts.  There are `RESPONSE_FREQUENCIES` frequencies, from a tenth of the lowest natural frequency to 1.2
    times the highest.  For each load, the output is that displacement of the tip which is largest under the static load
    in any position.

    Raises InputError if a contact only pushes, or if a natural frequency is 0.
    """
    if not scene.sections[-1].observe.frequency_response:
        return None
    if pushing := [contact.name for contact in system.contacts if contact.clearance is not None]:
        allowed = f"contacts that hold both ways are allowed: {', '.join(pushing)} only push"
        raise InputError("scene", "observe.frequency_response", True, allowed)
    if ALONE in system.bodies:
        at = _at_slider_positions(system, excitation, np.unique(np.linspace(*scene.path_bounds, RESPONSES)))
    else:
        at = _at_reaches(scene, system, excitation, RESPONSES)
    places, c, assembly = at.sides(system), excitation.amplitudes(system.term_names, at.t), Assembly(system)
    rows, natural = assembly.contact_rows_over_time(places), assembly.frequencies(places, assembly.size, c)
    if not np.nanmin(natural) > 0.0:
        allowed = "false is allowed: bodies move freely or buckle, so that a static load moves them without limit"
        raise InputError("scene", "observe.frequency_response", True, allowed)
    names, tips = system.output_names, tip_names(scene)
    tip_outputs = [k for k, name in enumerate(names) if name in tips]
    f = np.geomspace(0.1 * np.nanmin(natural), 1.2 * np.nanmax(natural), RESPONSE_FREQUENCIES)
    omega = 2.0 * np.pi * np.append(0.0, f)
    all_answers = (assembly.frequency_responses(rows.at_time(k), omega, c[k]) for k in range(len(c)))
    answers = np.array([of_outputs[:, tip_outputs] for of_outputs in all_answers])
    static = answers[:, 0].real
    furthest = np.abs(static).max(axis=0).argmax(axis=0)  # for each load: direction in which it moves the tip most
    inputs = np.arange(len(system.input_names))
    gain, damped = np.abs(answers[:, 1:])[:, :, furthest, inputs], bool(assembly.D.count_nonzero())
    outputs = tuple(names[tip_outputs[k]] for k in furthest)
    units = tuple(_UNITS.get(unit, f"m/({unit})") for unit in system.input_units)
    return FrequencyResponse(at.along, f, gain, static[:, furthest, inputs], damped, outputs, system.input_names, units)


#: For a boom: number of frequencies that are compared, of positions, and of positions for large models.
CURVES_OF_BOOM, PLACES_OF_BOOM, FEWER_PLACES_OF_BOOM = 4, 13, 4
#: Number of steps at one position that are compared, and share by which the frequency of the first may be higher.
POSTURES, ALIKE = 25, 1e-3
#: Number of extensions of each joint at which the first frequency is mapped.
MAPPED = 9
#: Share of the reach by which a published reach, which is rounded, may exceed the boom's reach.
BESIDE = 1e-4


def frequency_map(boom: Scene, system: System) -> FrequencyMap | None:
    """Map of the lowest frequency over the extensions of the first two joints that move on paths of their own.

    Every contact is closed.  Other joints with paths of their own are at their start; joints that follow others move
    with them.  With second order, the boom rests at its steepest angle.  None is returned if fewer than two such joints
    move.
    """
    ends = {
        name: path.bounds(0.0, boom.time.end) for name, path in boom.paths.items() if not _follows_other(boom, name)
    }
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
    turned = {LUFFING: np.full((MAPPED, MAPPED), critical_luffing(boom))} if LUFFING in system.paths else {}
    x, c = system.side_coordinates(extensions | turned), np.zeros((MAPPED**2, 0))
    if system.terms:
        placed = {name: np.broadcast_to(at, (MAPPED, MAPPED)).ravel() for name, at in extensions.items()}
        c = amplitudes_at_rest(boom, placed, critical_luffing(boom))
    lowest = Assembly(system).frequencies(x.reshape(-1, x.shape[-1]), 1, c)[:, 0]
    return FrequencyMap((first, second), a, b, lowest.reshape(MAPPED, MAPPED))


def _follows_other(boom: Scene, name: str) -> bool:
    """Whether the joint of the section called `name` follows the joint of another section."""
    joint = boom.sections[boom.names.index(name)].joint
    return joint is not None and joint.follows is not None


def published_part(boom: Scene, frequencies: Frequencies) -> SummaryPart:
    """Entry ``published_frequencies`` of summary.json: first frequency at each published reach, published and by model.

    Frequencies of models are interpolated over the reach.  If several postures have the same reach, as in a boom that
    luffs at one length, the lowest frequency counts.  Published values beyond this boom's reach are left out, and a
    warning says so.
    """
    published = boom.published.frequencies if boom.published else ()
    low, high, slack = frequencies.along[0], frequencies.along[-1], BESIDE * frequencies.along[-1]
    within = [frequency for frequency in published if low - slack <= frequency.reach <= high + slack]
    rows, reaches = list[dict[str, float]](), np.unique(frequencies.along)
    lowest = {
        name: [f[frequencies.along == reach, 0].min() for reach in reaches] for name, f in frequencies.models.items()
    }
    for at in within:
        of_models = {name: np.interp(at.reach, reaches, f) for name, f in lowest.items()}
        rows.append({"reach": at.reach, "published": at.first} | {name: float(f) for name, f in of_models.items()})
    beyond = ", ".join(f"{frequency.reach:g}" for frequency in published if frequency not in within)
    warning = (
        f"published frequencies at boom lengths of {beyond} m are left out: this boom is {low:.6g} to {high:.6g} m long"
    )
    return SummaryPart({"published_frequencies": rows} if rows else {}, [warning] if beyond else [])
