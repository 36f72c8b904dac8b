r"""Frequencies of a reduced model with its rows held at one path coordinate after the other; tip responses.

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
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from pmr.compare.summary import Part
from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.results import FrequencyResponse
from pmr.scene import Scene
from pmr.scene.choice import is_pinned_beam
from pmr.scene.keys import SLIDER
from pmr.scene.members import member_at
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
