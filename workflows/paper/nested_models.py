"""Reduced models of every size on the POD of eigenmodes: the bases are nested, so one decomposition serves all sizes.

Eigenmodes vanish at the pin, and so do their POD vectors: the two rows of the pin hold nothing but round-off. They can
be treated in three ways:

dropped
    The rows are left out, and r coordinates move.
last
    Each row holds one of the last coordinates, and r - 2 move.
round_off
    The rows stay as the singular value decomposition of the pool leaves them, as in the paper. Their entries are
    round-off, but a row constrains by its entries, however small: *some* combination of the coordinates is held.  Where
    the singular values fall quickly it is one of the last coordinates, where they fall slowly it may be any.  Another
    LAPACK, or another order of the snapshots, holds another combination.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from experiment import full_body

import pmr
from pmr.compare.errors import nrms
from pmr.system.body import FullBody

TREATMENTS = ("round_off", "last", "dropped")
#: What an experiment changes in the scene that it is given.
PLAIN = ["compare.against=[]", "reduction.basis=eigenmodes", "simulation.simulators=['march']", "simulation.repeats=1"]


@dataclass(frozen=True)
class NestedModels:
    """Models on the first vectors of a basis, for every number of coordinates."""

    longest: pmr.ReducedModel  # on all vectors
    spent: int = 0  # coordinates that the pin's rows hold, which never move

    def of(self, coordinates: int) -> pmr.ReducedModel | None:
        """Return the model with this number of coordinates; None if all of them are held, so that nothing moves."""
        free = min(coordinates - self.spent, self.longest.size)
        return self.longest.leading(free) if free > 0 else None

    def has(self, coordinates: int) -> bool:
        """Return whether the pool spans so many dimensions that these coordinates are not round-off."""
        return coordinates - self.spent <= self.longest.size


@dataclass(frozen=True)
class Combination:
    """Models on the basis from a number of snapshots with a number of modes each, and its singular values."""

    models: Mapping[str, NestedModels]  # by treatment
    singular_values: np.ndarray  # (k,)
    rank: int


@lru_cache
def full_motion(scene: str) -> tuple[FullBody, pmr.Response]:
    """Return the operators of a scene's full model and its motion."""
    loaded = pmr.load_scene(scene, PLAIN)
    full = full_body(loaded)
    return full, pmr.simulate(loaded, pmr.project(full, np.eye(full.size)))


def combination(scene: str, snapshots: int, modes: int, most_modes: int) -> Combination:
    """Return models on the POD of the lowest `modes` eigenmodes, with the slider held at `snapshots` positions.

    At each of them `most_modes` are computed, as many as any combination has: the round-off of a mode, which decides
    what the pin's rows hold, depends on how many LAPACK computes together.
    """
    counts = [f"reduction.snapshots={snapshots}", f"reduction.modes={most_modes}", "reduction.coordinates=3"]
    every, full = pmr.reduce(pmr.load_scene(scene, [*PLAIN, *counts])).snapshots, full_motion(scene)[0]
    assert isinstance(every, np.ndarray)  # as of a single body
    pool = np.ascontiguousarray(every.reshape(len(every), snapshots, most_modes)[:, :, :modes].reshape(len(every), -1))
    moving = pool.any(axis=1)  # coordinates at the pin vanish in all snapshots, and do so in the basis
    U, sigma, _ = np.linalg.svd(pool[moving], full_matrices=False)
    rank = int(np.sum(sigma > sigma[0] * np.finfo(float).eps * max(pool.shape)))
    V = np.zeros((len(pool), rank))
    V[moving] = U[:, :rank]
    whole = pmr.project(full, V)
    free = [number for number, row in enumerate(whole.rows.c.any(axis=(0, 1, 3))) if row]
    dropped = whole.with_rows(free)
    left_in = pmr.project(full, np.linalg.svd(pool, full_matrices=False)[0])
    held = len(whole.row_names) - len(free)
    models = {
        "round_off": NestedModels(left_in),
        "last": NestedModels(dropped, spent=held),
        "dropped": NestedModels(dropped),
    }
    return Combination(models, sigma, rank)


def errors(scene: str, model: pmr.ReducedModel | None) -> tuple[float, float]:
    """Return a model's e_NRMS along the beam and the error in J of its strain energy, summed over all steps.

    NaN if the model can't be simulated. `model` is None for one without coordinates, which stays at rest.
    """
    reference = full_motion(scene)[1]
    strain = float(reference.energy.strain.sum())
    if model is None:
        return nrms(0.0 * reference.displacement, reference.displacement), strain
    try:
        response = pmr.simulate(pmr.load_scene(scene, PLAIN), model)
    except (pmr.SimulationError, pmr.InputError):
        return np.nan, np.nan
    error = nrms(response.displacement, reference.displacement)
    return error, abs(float(response.energy.strain.sum()) - strain)
