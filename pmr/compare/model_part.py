r"""How far a structural model is off, beside a richer one of the same bodies, pads and loads: a part of the budget.

Both are reduced alike and simulated under the scene's paths and loads.  With :math:`y_o(t)` the histories of a kind of
outputs (displacements, forces of pads) the model is off by

.. math::
    e = \frac{\lVert y^{richer}_o(t_j) - y_o(t_j) \rVert}{\lVert y^{richer}_o(t_j) \rVert}

over all outputs of the kind that both models have, and all steps (forces: `force_errors`); and in a frequency, one of
the two lowest at places all along the path, by the largest :math:`|f / f^{richer} - 1|`.  Of the richer model those
modes count that move most in directions which the poorer one knows: a planar beam has no lateral modes.  With
second order both are stressed as they are when the run is there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import ForceHistories, force_errors, force_histories
from pmr.compare.moving_frame import as_made
from pmr.compare.responses import march_once, refused_growth
from pmr.results import Response
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.excitation import places
from pmr.system.assembly import Assembly
from pmr.system.system import System

Array = NDArray[np.float64]

#: Frequencies that are compared, modes among which they are, and places along the path: beams with walls that give way
#: are off most over an eighth of it, which nine places missed in two of twenty booms (`benchmarks.walls`).
FREQUENCIES, MODES, PLACES = 2, 12, 33
#: Share of a mode's motion that a poorer model knows, for the mode to be one that it should have.
KNOWN = 0.5
#: Of the largest motion of any mode: less is round-off.
NO_MOTION = 1e-9
#: Kinds of outputs that are compared, as a summary calls them; forces as `force_errors` compares them.
MODEL_KINDS = ("beam", "tip", "pad_force", "cylinder_force", "support_force", "reaction")
#: Share of the largest frequency below which one is that of a rigid-body motion.
RIGID = 1e-3
DIRECTIONS = ("x", "y", "z")
STRESS = "stress, which depends on how walls bend at pads, loads and corners"
IMPACTS = "impacts of pads that lift off and close again, which differ from model to model"


@dataclass(frozen=True)
class Motion:
    """Motion of one model in a run."""

    frequencies: Array  # (P, f) Hz
    moved: Array  # (P, 3, f): squares of what the outputs of each mode move along x, y, z
    response: Response

    @classmethod
    def of(cls, scene: Scene, system: System, response: Response | None = None) -> Motion:
        """Frequencies at `PLACES` places, and a `response` where there is one.

        Else an `InputError` is raised where the motion grows without bound.
        """
        scene = as_made(scene, system.terms)
        excitation = Excitation.of(scene)
        steps = steps_of(excitation)
        x, c = places(system, excitation)[steps], excitation.amplitudes(system.term_names)[steps]
        if response is None:
            with refused_growth(scene):
                response = march_once(scene, system, excitation)
        assembly, kinds = Assembly(system), [kind for body in system.bodies.values() for kind in body.output_kinds]
        frequencies, motions, along = list[Array](), list[Array](), assembly.along(x)
        for k, amplitudes in enumerate(c):
            omega, phi = assembly.modes(along.at(k), MODES, amplitudes)
            frequencies.append(omega / (2.0 * np.pi))
            shapes = assembly.outputs @ phi
            rows = ([kind in (f"beam {d}", f"tip {d}") for kind in kinds] for d in DIRECTIONS)
            motions.append(np.array([(shapes[which] ** 2).sum(axis=0) for which in rows]))
        return cls(np.array(frequencies), np.array(motions), response)

    def lowest(self, directions: Array) -> Array:
        """The lowest frequencies (P, 2) Hz of modes that move most in `directions`, (3,) of True or False."""
        every, share = self.moved.sum(axis=1), self.moved[:, directions].sum(axis=1)
        mine = (share >= KNOWN * every) & (share > NO_MOTION * share.max(axis=1, keepdims=True))
        if not self.moved[:, ~directions].any():
            mine[:] = True  # torsion, too, which moves no output
        lowest_of_places = np.full((len(mine), FREQUENCIES), np.nan)
        for k, of_place in enumerate(mine):
            those = self.frequencies[k, of_place][:FREQUENCIES]
            lowest_of_places[k, : len(those)] = those
        return lowest_of_places

    def histories(self, kind: str) -> dict[str, Array]:
        """Histories of all outputs of a kind by their names, each (T,)."""
        numbers = {output.name: k for k, output in enumerate(self.response.outputs) if output.kind == kind}
        return {name: self.response.column(k) for name, k in numbers.items()}

    @property
    def forces(self) -> ForceHistories:
        """Forces by kind and unit, of pads that only push the peaks within each step."""
        response = self.response
        peaks = response.slider_force if response.force_peaks is None else response.force_peaks
        return force_histories(replace(response, slider_force=peaks))

    def at_places_of(self, other: Motion) -> dict[str, Array]:
        """Displacements along bodies where another one has them, by its names; between places linear."""
        places, displacements = dict[tuple[str, str], list[tuple[float, Array]]](), dict[str, Array]()
        for k, output in enumerate(self.response.outputs):
            if output.kind == "beam" and output.place is not None:
                places.setdefault((output.body, output.direction), []).append((output.place, self.response.column(k)))
        for output in other.response.outputs:
            mine = sorted(places.get((output.body, output.direction), ()), key=lambda at: at[0])
            if (
                output.kind == "beam"
                and output.place is not None
                and mine
                and mine[0][0] <= output.place <= mine[-1][0]
            ):
                x = np.array([at for at, _ in mine])
                k = int(np.clip(np.searchsorted(x, output.place), 1, max(1, len(x) - 1)))
                before, after = mine[k - 1], mine[min(k, len(x) - 1)]
                share = (output.place - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 0.0
                displacements[output.name] = (1.0 - share) * before[1] + share * after[1]
        return displacements


def steps_of(excitation: Excitation) -> list[int]:
    """Steps at which all paths together are nearest to `PLACES` places from shortest to longest."""
    reach = excitation.s.reshape(len(excitation.times), -1).sum(axis=1)
    at = np.linspace(reach.min(), reach.max(), PLACES)
    return list(dict.fromkeys(int(np.argmin(np.abs(reach - place))) for place in at))


def model_budget(scene: Scene, of_scene: Motion, richer: Motion, called: str) -> dict[str, Any]:
    """``budget.model`` of summary.json; what moves in neither model is off by None."""
    shares: dict[str, float | None] = {}
    for kind in ("beam", "tip"):
        histories = of_scene.histories(kind), richer.histories(kind)
        if kind == "beam":
            histories = histories[0] | of_scene.at_places_of(richer), histories[1]
        names = [name for name in histories[0] if name in histories[1]]
        if names:
            y, reference = (np.array([of[name] for name in names]) for of in histories)
            shares[kind] = _off(y, reference)
    shares |= force_errors(of_scene.forces, richer.forces)
    directions = of_scene.moved.any(axis=(0, 2))
    f = {"own": of_scene.lowest(directions), "richer": richer.lowest(directions)}
    pushing = any(ring.unilateral for part in scene.sections for ring in part.pads)
    pushing |= any(ring.unilateral for part in scene.sections if part.joint for ring in part.joint.rings)
    return {
        "beside": called,
        **shares,
        "largest": _off(np.array(_largest(of_scene)), np.array(_largest(richer))),
        "frequency": frequency_error(f["own"], f["richer"]),
        "frequencies": {name: values.tolist() for name, values in f.items()},
        "not_covered": [STRESS, *[IMPACTS] * pushing],
    }


def frequency_error(f: Array, reference: Array) -> float | None:
    r"""The largest :math:`|f / f_r - 1|` of frequencies (..., f) in Hz; None where all are those of rigid bodies."""
    vibrates = reference > RIGID * np.nanmax(reference, initial=0.0)
    return float(np.nanmax(np.abs(f[vibrates] / reference[vibrates] - 1.0))) if vibrates.any() else None


def largest_model_error(part: Mapping[str, Any]) -> float:
    """The largest one that a part states, a fraction."""
    return float(max(part[kind] for kind in (*MODEL_KINDS, "largest", "frequency") if part.get(kind) is not None))


def _largest(motion: Motion) -> float:
    return float(np.abs(motion.response.displacement).max())


def _off(y: Array, reference: Array) -> float | None:
    """Difference over the reference's norm; in units of its largest value, which squares can't overflow."""
    unit = float(np.abs(reference).max())
    return float(np.linalg.norm((y - reference) / unit) / np.linalg.norm(reference / unit)) if unit > 0.0 else None
