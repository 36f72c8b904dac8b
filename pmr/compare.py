r"""What simulators say of the same beam, in common quantities, and how far they are apart.

.. math::
    e_{NRMS}(s, r) = \min\Big( \frac{1}{|N|} \sum_{i \in N}
        \frac{\sqrt{\frac{1}{J} \sum_j (s_{ij} - r_{ij})^2}}{\sqrt{\frac{1}{J} \sum_j r_{ij}^2}},\; 1 \Big), \qquad
    e_{abs}(s, r) = \lVert s - r \rVert

N holds the components whose reference has an RMS above 1e-10 (Weyrer et al., section "Experiments").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from pmr.body import SlidingBody, Trajectory, displacement, force_outputs, released_rows
from pmr.results import Energy, Response
from pmr.simulate import ancf

Array = NDArray[np.float64]
#: Error of a signal against a reference of the same shape.
Measure = Callable[[Array, Array], float]
Quantity = Callable[[Response], Array]

#: Components whose reference RMS (m) does not exceed this are left out of e_NRMS.
RMS_FLOOR = 1e-10
#: Likewise, relative to the component that moves most: a direction in which nothing happens holds round-off only.
RELATIVE_FLOOR = 1e-6


def nrms(signal: Array, reference: Array) -> float:
    """e_NRMS of a signal (T,) or (T, M) against a reference of the same shape, as a fraction in [0, 1].

    Where no component of the reference exceeds the floor: 0 if none of the signal does either, 1 otherwise.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    if signal.shape != reference.shape:
        raise ValueError(f"shapes {signal.shape} and {reference.shape} differ")
    scale = np.sqrt(np.mean(reference**2, axis=0))
    floor = max(RMS_FLOOR, RELATIVE_FLOOR * float(scale.max(initial=0.0)))
    error = np.sqrt(np.mean((signal - reference) ** 2, axis=0))
    counted = scale > floor
    if not np.any(counted):
        return 1.0 if np.any(error > floor) else 0.0
    return float(min(np.mean(error[counted] / scale[counted]), 1.0))


def absolute_error(signal: Array, reference: Array) -> float:
    """e_abs, the euclidean norm of the difference over all steps (and components), in the signals' unit."""
    return float(np.linalg.norm(np.asarray(signal) - np.asarray(reference)))


#: What is compared of planar beams.
PLANAR: Mapping[str, Quantity] = {
    "tip": lambda response: response.tip,
    "beam": lambda response: response.displacement,
    "slider_force": lambda response: response.slider_force,
}
#: What is compared in space, where the tip's columns, one a direction, are the last ones.
IN_SPACE: Mapping[int, Mapping[str, Quantity]] = {
    1: {
        "tip": lambda response: response.displacement[:, -1:],
        "beam": lambda response: response.displacement[:, :-1],
        "pad_force": lambda response: response.slider_force,
    },
    2: {
        "tip": lambda response: response.displacement[:, -2:],
        "beam": lambda response: response.displacement[:, :-2],
        "pad_force": lambda response: response.slider_force,
    },
}


def errors(
    responses: Mapping[str, Response],
    measure: Measure = nrms,
    order: tuple[str, ...] = ("reduced", "full", "ancf"),
    quantities: Mapping[str, Quantity] = PLANAR,
) -> dict[str, dict[str, float]]:
    """Errors of all pairs: ``{"reduced_vs_full": {"tip": ..., "beam": ..., "slider_force": ...}, ...}``.

    `measure` is `nrms` (fractions) or `absolute_error` (m, and N for the force).  The later one in `order` is the
    reference.  The pinned node, which does not move, counts in no pair.

    A kink of the path strikes the beam, and what of the blow a reduced model can't follow rings on at frequencies
    above its own; the force sees that, displacements hardly do.  Evolved case of the paper with residual flexibility,
    six free modes: force 18 % (below 50 Hz 1.5 %) and beam 0.21 %; twenty: 8 % (0.002 %) and 0.002 %.
    """
    present = [name for name in order if name in responses]
    return {
        f"{a}_vs_{b}": {
            name: measure(quantity(responses[a]), quantity(responses[b])) for name, quantity in quantities.items()
        }
        for a, b in combinations(present, 2)
    }


def respond(body: SlidingBody, trajectory: Trajectory, path_rate: Array, loads: Array) -> Response:
    """Outputs, energies and constraint residuals of a trajectory.

    Parameters
    ----------
    body : SlidingBody
        Reduced or full.
    trajectory : Trajectory
    path_rate : (T,) array, m/s
        s'(t), for the residual at velocity level.
    loads : (T, i) array, N
    """
    q, v, s, multipliers = trajectory.q, trajectory.v, trajectory.s, trajectory.deforming
    violation = body.apply_rows(s, q) - body.row_compliance * multipliers
    drift = body.apply_rows(s, v) + path_rate[:, None] * body.apply_rows(s, q, derivative=1)
    if body.flexibility is not None:
        violation = violation + body.flexibility.row_motion(s, multipliers, loads)
    violation = np.where(np.isnan(body.row_clearance), violation, _overlap(violation - body.row_clearance, multipliers))
    if body.flexibility is not None or np.any(body.row_compliance):
        drift = np.full_like(drift, np.nan)  # rows that give way have no equation at velocity level
    outputs, force = displacement(body, q, s, multipliers, loads), force_outputs(body)
    return Response(
        t=trajectory.t,
        x=body.output_positions[~force],
        displacement=outputs[:, ~force],
        energy=energy(body, trajectory, loads),
        slider_force=np.hstack([outputs[:, force], trajectory.multipliers[:, released_rows(body)]]),
        residual_position=np.abs(violation).max(axis=1),
        residual_velocity=np.abs(drift).max(axis=1),
        seconds=trajectory.seconds,
    )


def _overlap(excess: Array, multipliers: Array) -> Array:
    """What rows that only push violate, (T, m) in m: where they push any gap, elsewhere a negative one."""
    return np.where(multipliers > 0.0, excess, np.maximum(excess, 0.0))


def respond_cable(cable: ancf.Cable, motion: ancf.CableMotion) -> Response:
    """Response of the ANCF reference; its joint holds a point in space, so the rows' residuals do not apply: NaN."""
    unknown = np.full(len(motion.t), np.nan)
    return Response(
        t=motion.t,
        x=motion.x,
        displacement=motion.displacement,
        energy=ancf.energy(cable, motion),
        slider_force=motion.slider_force[:, None],
        residual_position=unknown,
        residual_velocity=unknown,
        seconds=motion.seconds,
    )


def energy(body: SlidingBody, trajectory: Trajectory, loads: Array) -> Energy:
    """v^T M v / 2, q^T K q / 2 and -q^T B f, each (T,) in J (Weyrer et al., equation for H(t)).

    Strain energy includes that of the pads, lambda^2 / (2 k), and of the residual flexibility; the residual part's
    kinetic energy is left out (`pmr.rates.kinetic_energy` has it).
    """
    q, v, s, multipliers = trajectory.q, trajectory.v, trajectory.s, trajectory.deforming

    def half_form(A: Array, x: Array) -> Array:
        return np.einsum("tn,nt->t", x, np.asarray(A @ x.T)) / 2.0

    strain, motion = half_form(body.K, q) + multipliers**2 @ body.row_compliance / 2.0, q @ body.B
    if body.flexibility is not None:
        strain = strain + body.flexibility.strain_energy(s, multipliers, loads)
        motion = motion + body.flexibility.input_motion(s, multipliers, loads)
    return Energy(half_form(body.M, v), strain, -np.einsum("ti,ti->t", motion, loads))
