r"""Error of a structural model against a richer one of the same bodies, pads and loads, for the error budget.

Both models are simulated under the scene's paths and loads, the richer one reduced, the other one as the run's full
model or reduced in the same way.  With the histories
:math:`y_o(t_j)` of the outputs o of a kind (displacements, forces of pads) at the steps j, and of the richer model with
the mark "richer", the error is

.. math::
    e = \frac{\lVert y^{richer}_o(t_j) - y_o(t_j) \rVert}{\lVert y^{richer}_o(t_j) \rVert}

over all outputs of the kind that both models have, and all steps (forces: `pmr.compare.errors.force_errors`).  For
frequencies, the error is the largest :math:`|f / f^{richer} - 1|` of the two lowest frequencies f at positions all
along the path.  Only those modes of the richer model are compared that move most in directions in which the poorer
model moves: a planar beam has no lateral modes.  With second order, both models have the axial forces that act when the
run is at that position.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from pmr.compare.errors import ForceHistories, clear_round_off, force_errors, force_histories, zero_round_off
from pmr.compare.motion import probe_round_off
from pmr.compare.outputs import probe_errors
from pmr.compare.responses import march_once, refuse_growth
from pmr.compare.second_order import with_choice_of_terms
from pmr.files.arrays import Array, Summary
from pmr.results import Response
from pmr.results.quantities import COMPARED
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.excitation import side_positions
from pmr.simulation.reactions import outputs_of
from pmr.system.assembly import Assembly
from pmr.system.body import other_outputs
from pmr.system.system import System

#: Number of frequencies that are compared, of modes among which they are chosen, and of positions along the path.  The
#: error of beams with walls that give way is largest on an eighth of the path; nine positions missed this part for two
#: of twenty booms (`benchmarks.walls`).
FREQUENCIES, MODES, PLACES = 2, 12, 33
#: A mode is compared if at least this share of its motion is in directions of the poorer model.
KNOWN = 0.5
#: Share of the largest motion of any mode up to which a mode's motion is round-off.
NO_MOTION = 1e-9
#: Share of the largest frequency below which a frequency belongs to a rigid-body motion.
RIGID = 1e-3
DIRECTIONS = ("x", "y", "z")
STRESS = "stresses, which depend on how walls bend at pads, under loads and at corners"
IMPACTS = "impacts of pads that lift off and close again, as their times differ from model to model"


@dataclass(frozen=True)
class Motion:
    """Frequencies, motions of modes and response of one model in a run, with f modes at P positions."""

    frequencies: Array  # (P, f) Hz
    mode_motions: Array  # (P, 3, f): sums of the squared displacements of all outputs along x, y, z in each mode
    response: Response
    frequency_error: float = 0.0  # known relative error of the two lowest frequencies
    round_off: Mapping[str, float] = field(default_factory=dict)  # of rotations and probes, by name, in their units

    @classmethod
    def compute(cls, scene: Scene, system: System, response: Response | None = None) -> Motion:
        """Compute the frequencies at up to `PLACES` positions, and simulate the motion if `response` is None.

        Raises an `InputError` if the motion grows without bound.
        """
        scene = with_choice_of_terms(scene, system.terms)
        excitation = Excitation.from_scene(scene)
        steps = evenly_spaced_steps(excitation)
        x, c = side_positions(system, excitation)[steps], excitation.amplitudes(system.term_names)[steps]
        if response is None:
            with refuse_growth(scene):
                response = march_once(scene, system, excitation)
        assembly, kinds = Assembly(system), [kind for body in system.bodies.values() for kind in body.output_kinds]
        frequencies, motions, along = list[Array](), list[Array](), assembly.contact_rows_over_time(x, effects=False)
        for k, amplitudes in enumerate(c):
            omega, phi = assembly.modes(along.at_time(k), MODES, amplitudes)
            frequencies.append(omega / (2.0 * np.pi))
            shapes = assembly.outputs @ phi
            rows = ([kind in (f"beam {d}", f"tip {d}") for kind in kinds] for d in DIRECTIONS)
            motions.append(np.array([(shapes[which] ** 2).sum(axis=0) for which in rows]))
        others = np.concatenate([other_outputs(body) for body in system.bodies.values()])
        names = [output.name for output, is_other in zip(outputs_of(system), others, strict=True) if is_other]
        bounds = probe_round_off(system.bodies, excitation.forces(system.input_names), excitation.stepping.end)
        round_off = dict(zip(names, bounds.tolist(), strict=True))
        return cls(np.array(frequencies), np.array(motions), response, round_off=round_off)

    def lowest_frequencies(self, directions: Array) -> Array:
        """Lowest frequencies (P, `FREQUENCIES`) in Hz at P positions, of modes that move mainly in some of x, y, z.

        `directions` (3,) is the mask of these directions.  A mode counts if two conditions hold:

        - these directions have at least the share `KNOWN` of the mode's motion,
        - the mode moves in them by more than the share `NO_MOTION` of the largest such motion of a mode there.

        If fewer than `FREQUENCIES` modes count, the remaining entries are NaN.  If the model moves in no other
        direction, all modes count, torsion too.
        """
        every, share = self.mode_motions.sum(axis=1), self.mode_motions[:, directions].sum(axis=1)
        mine = (share >= KNOWN * every) & (share > NO_MOTION * share.max(axis=1, keepdims=True))
        if not self.mode_motions[:, ~directions].any():
            mine[:] = True  # all modes, including torsion, which moves no output
        lowest_of_places = np.full((len(mine), FREQUENCIES), np.nan)
        for k, of_place in enumerate(mine):
            those = self.frequencies[k, of_place][:FREQUENCIES]
            lowest_of_places[k, : len(those)] = those
        return lowest_of_places

    def histories(self, kind: str) -> dict[str, Array]:
        """Histories (T,) of all outputs of a kind (`pmr.results.response.KINDS`), by their names."""
        numbers = {output.name: k for k, output in enumerate(self.response.outputs) if output.kind == kind}
        return {name: self.response.column(k) for name, k in numbers.items()}

    @property
    def forces(self) -> ForceHistories:
        """Forces by kind and unit, then by name; forces of pads that only push are the peaks within each step."""
        response = self.response
        peaks = response.slider_force if response.force_peaks is None else response.force_peaks
        return force_histories(replace(response, slider_force=peaks))

    def displacements_at(self, other: Motion) -> dict[str, Array]:
        """Displacements (T,) of this motion at the places of another motion's outputs, by the names of these outputs.

        Only outputs along a body count, not those of its tip.  The displacements are interpolated between this motion's
        own positions on the same body, in the same direction: by cubic splines, or linearly between fewer than four
        positions.  Outputs beyond these positions are left out.
        """
        places, displacements = dict[tuple[str, str], dict[float, Array]](), dict[str, Array]()
        for k, output in enumerate(self.response.outputs):
            if output.kind == "beam" and output.place is not None:
                places.setdefault((output.body, output.direction), {})[output.place] = self.response.column(k)
        splines = {
            key: make_interp_spline(x := sorted(at), np.array([at[place] for place in x]), k=3 if len(x) > 3 else 1)
            for key, at in places.items()
            if len(at) > 1
        }
        for output in other.response.outputs:
            key = output.body, output.direction
            if output.kind != "beam" or output.place is None or key not in places:
                continue
            if output.place in places[key]:
                displacements[output.name] = places[key][output.place]
            elif key in splines and min(places[key]) <= output.place <= max(places[key]):
                displacements[output.name] = splines[key](output.place)
        return displacements


def evenly_spaced_steps(excitation: Excitation) -> list[int]:
    """Numbers of the steps at which the sum of all path coordinates is closest to evenly spaced values, each once.

    There are `PLACES` values, from the smallest sum to the largest.  The steps are in the order of the values, which
    may differ from the order of time.  If nothing moves, the list has the first step alone.
    """
    reach = excitation.s.reshape(len(excitation.times), -1).sum(axis=1)
    at = np.linspace(reach.min(), reach.max(), PLACES)
    return list(dict.fromkeys(int(np.argmin(np.abs(reach - place))) for place in at))


def model_budget(scene: Scene, motion: Motion, richer: Motion, richer_name: str) -> dict[str, Any]:
    """Entry ``budget.model`` of summary.json: differences of `motion` to the motion `richer` of a richer model.

    `richer_name` is the name of the richer model.  The differences are fractions by kind of output; kinds that only one
    of the two models has are missing.  The difference in a kind of displacements is None if the richer model's
    displacements are round-off.  ``largest`` is None if the richer model does not move.  ``frequency`` includes the
    error of the frequencies of `motion`; it is None if both models have rigid motions alone.  ``frequencies`` are the
    lowest frequencies of both models in Hz.  ``not_covered`` names the kinds of outputs about which the entry says
    nothing.
    """
    shares, displacements = dict[str, float | None](), list[Array]()
    still = max(motion.response.round_off, richer.response.round_off)
    moved = clear_round_off(richer.response.displacement, still)
    for kind in ("beam", "tip"):
        histories = motion.histories(kind), richer.histories(kind)
        if kind == "beam":
            histories = histories[0] | motion.displacements_at(richer), histories[1]
        names = [name for name in histories[0] if name in histories[1]]
        if names:
            y, reference = (np.array([of[name] for name in names]).T for of in histories)
            y, reference = zero_round_off(y, reference, still)
            shares[kind] = _relative_difference(y, reference)
            displacements.append(y)
    shares |= force_errors(motion.forces, richer.forces)
    probes = _probe_errors(motion, richer)
    directions = motion.mode_motions.any(axis=(0, 2))
    f = {"own": motion.lowest_frequencies(directions), "richer": richer.lowest_frequencies(directions)}
    apart = frequency_error(f["own"], f["richer"])
    pushing = any(ring.unilateral for part in scene.sections for ring in part.rings)
    return {
        "beside": richer_name,
        **shares,
        **({"probe": max(probes.values()), "probes": probes} if probes else {}),
        "largest": _relative_difference(_largest(*displacements), _largest(moved)),
        "frequency": None if apart is None else apart + motion.frequency_error,
        "frequencies": {name: values.tolist() for name, values in f.items()},
        "not_covered": [STRESS, *[IMPACTS] * pushing],
    }


def _probe_errors(motion: Motion, richer: Motion) -> dict[str, float]:
    """Error of each probe that both models have, by its name, as a fraction (`pmr.compare.outputs.probe_errors`).

    The error is that of `motion` against the motion `richer`.  A history that is round-off counts as zero.
    """
    mine, theirs = motion.histories("probe"), richer.histories("probe")
    names = [name for name in mine if name in theirs]
    units = {output.name: output.unit for output in motion.response.outputs}
    y, r = (np.array([of[name] for name in names]).T for of in (mine, theirs))
    bounds = [max(of.round_off.get(name, 0.0) for of in (motion, richer)) for name in names]
    y, r = zero_round_off(y, r, np.array(bounds)) if names else (y, r)
    return dict(zip(names, probe_errors(y, r, [units[name] for name in names]).tolist(), strict=True)) if names else {}


def frequency_error(f: Array, reference: Array) -> float | None:
    """Largest :math:`|f / f_r - 1|` of frequencies f (..., n) in Hz against f_r; None if none can be compared.

    f_r is `reference`, of the shape of f.  Left out are NaN entries of either, and those that belong to rigid motions
    in the reference.
    """
    vibrates = reference > RIGID * np.nanmax(reference, initial=0.0)
    apart = np.abs(f[vibrates] / reference[vibrates] - 1.0)
    return None if np.isnan(apart).all() else float(np.nanmax(apart))


def largest_model_error(part: Summary) -> float:
    """The largest error, a fraction, in `part`, the contents of ``budget.model``; 0 if `part` has no errors."""
    return float(
        max((part[kind] for kind in (*COMPARED, "largest", "probe") if part.get(kind) is not None), default=0.0)
    )


def _largest(*values: Array) -> Array:
    """Largest absolute value in all `values` (any shape), as an array of shape (); 0 without values."""
    return np.array(max((float(np.abs(of).max()) for of in values), default=0.0))


def _relative_difference(y: Array, reference: Array) -> float | None:
    """Norm of y - reference divided by the norm of `reference`, an array of y's shape; None if the reference is zero.

    Both are divided by the largest absolute value of the reference first, so that squares don't overflow.
    """
    unit = float(np.abs(reference).max())
    return float(np.linalg.norm((y - reference) / unit) / np.linalg.norm(reference / unit)) if unit > 0.0 else None
