"""The kernel's Kalman filter on linear models of steps (src/filter.c), and these models themselves (src/chosen.c)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import pointer, structure
from pmr.kernel.state import State

#: How a measurement is used (`pmr_filter_update` in src/pmr_kernel.h).
IF_POSSIBLE, IF_NEAR = lib.PMR_IF_POSSIBLE, lib.PMR_IF_NEAR
AS_EXPECTED, NOT_USED = lib.PMR_AS_EXPECTED, lib.PMR_NOT_USED
#: Most that a normalised innovation counts in the running mean square.
MOST_SQUARE = float(lib.PMR_MOST_SQUARE)


@dataclass(frozen=True)
class FilterData:
    """Data of a Kalman filter by their names in `pmr_filter` (src/pmr_kernel.h), and its initial estimates."""

    sizes: Mapping[str, int]
    numbers: Mapping[str, float]
    indices: Mapping[str, NDArray[np.int32]]
    arrays: Mapping[str, Array]
    x: Array  # (N,)
    P: Array  # (N, N)
    square: Array  # (q,): mean squares of the outputs


class Transitions(NamedTuple):
    """Matrices of T steps from states x (n,) and loads f (i,) to the next states, A x + B f."""

    A: Array  # (T, n, n)
    B: Array  # (T, n, i)


@dataclass(frozen=True)
class StepMatrices:
    """Factors and matrices of T steps of r modes, from which the transition matrices of 3 r states follow.

    A step's acceleration is R (z*, v*) + G f.  Each mode's next prediction (z*, v*, a*) is a sum of its prediction and
    its acceleration, and so are z and its rate at the end of the step: `courses` has the factors.
    """

    courses: Array  # (5, 4, r)
    R: Array  # (T, r, 2 r)
    G: Array  # (T, r, i)
    C: Array  # (T, q, 2 r): of outputs
    D: Array  # (T, q, i)

    @property
    def modes(self) -> int:
        """Number r of modes."""
        return self.courses.shape[2]

    def transitions(self, steps: slice = slice(None)) -> Transitions:
        """Transition matrices A and B of the steps in a slice `steps`, by default of all."""
        by_acceleration, r = self.courses[:3, 3], self.modes
        R, G = np.pad(self.R[steps], [(0, 0), (0, 0), (0, r)]), self.G[steps]
        A, B = (np.einsum("pj,tjc->tpjc", by_acceleration, by).reshape(len(by), 3 * r, by.shape[2]) for by in (R, G))
        return Transitions(A + np.block([[np.diag(factors) for factors in part[:3]] for part in self.courses[:3]]), B)


@dataclass(frozen=True)
class FilterSteps:
    """Linear models of T steps, and how their q outputs change with unknown parameters of the machine.

    The outputs change by `sensitivity` per unit of a parameter.  The sensitivity grows by `per_kilogram` for each kg of
    an estimated payload.
    """

    reference: Array  # (T, q)
    matrices: StepMatrices
    sensitivity: Array  # (T, q, parameters)
    per_kilogram: Array  # (T, q, parameters)


class KalmanFilter:
    """A Kalman filter and its state: the estimates x of N quantities with their covariance P.

    `x` (N,), `P` (N, N) and `level` (p,), running mean squares of the p sensors' normalised innovations, are views of
    the filter's memory.  So is `lasting`: all numbers that an update begins with.
    """

    def __init__(self, data: FilterData, steps: FilterSteps) -> None:
        """Make the kernel's filter from `data` and the linear models in `steps`, and set its initial state."""
        self._filter = structure("pmr_filter", {**data.sizes, **data.numbers, **data.indices, **data.arrays})
        counts = ffi.new("pmr_filter_counts *")
        lib.pmr_filter_sizes(self._filter, counts)
        N, stride, self.outputs_count = counts.states, counts.stride, data.sizes["outputs"]
        self.memory = np.zeros(counts.memory)
        start = [np.ascontiguousarray(array, float) for array in (data.x, data.P, data.square)]
        lib.pmr_filter_start(self._filter, pointer(self.memory), *map(pointer, start))
        self.x = self.memory[:N]
        self.P = self.memory[stride : stride + N * stride].reshape(N, stride)[:, :N]
        self.lasting = self.memory[: counts.kept]
        self.level = self.memory[counts.kept - data.sizes["sensors"] : counts.kept]
        arrays = {name: getattr(steps, name) for name in ("reference", "sensitivity", "per_kilogram")}
        arrays |= {name: getattr(steps.matrices, name) for name in "RGCD"}
        self._steps = {name: np.ascontiguousarray(array, float) for name, array in arrays.items()}
        self._places = {name: (pointer(array), array[0].size) for name, array in self._steps.items()}
        self._step = ffi.new("pmr_filter_step *")

    def _step_data(self, k: int) -> Any:
        """Addresses of the linear model of step k, as the kernel's structure ``pmr_filter_step``."""
        for name, (first, size) in self._places.items():
            setattr(self._step, name, first + k * size)
        return self._step

    def update(self, k: int, measured: Array, use: NDArray[np.int64]) -> Array:
        """Correct the state at step k by `measured` (p,); return innovations (p,) divided by their standard deviations.

        Measurements that are not finite are missing.  `use` (p,) has a constant of the kernel for each sensor:
        ``PMR_NOT_USED``, ``PMR_IF_POSSIBLE``, ``PMR_IF_NEAR`` (only if the measurement is near the estimate), or
        ``PMR_AS_EXPECTED`` (as if the estimate had been measured).  The innovation of a missing measurement is NaN,
        except for the last of these.  Raises a SimulationError if the covariance of the measurements is not positive
        definite.
        """
        measured, innovations = np.ascontiguousarray(measured, float), np.zeros(len(measured))
        used = np.ascontiguousarray(use, np.int32)
        arguments = (pointer(measured), pointer(used), pointer(innovations))
        if lib.pmr_filter_update(self._filter, pointer(self.memory), self._step_data(k), *arguments) != lib.PMR_DONE:
            raise SimulationError(f"step {k}: the covariance of the measurements is not finite, or has no inverse")
        return innovations

    def outputs(self, k: int) -> Array:
        """Mean and variance, (2, q), of the q outputs at step k after `update`.

        The variance includes errors of the model.
        """
        values = np.zeros((2, self.outputs_count))
        lib.pmr_filter_outputs(self._filter, pointer(self.memory), self._step_data(k), *map(pointer, values))
        return values

    def predict(self, k: int) -> None:
        """Advance the state and its covariance from step k to step k + 1."""
        lib.pmr_filter_predict(self._filter, pointer(self.memory), self._step_data(k))


@dataclass(frozen=True)
class ChosenOutputs:
    """Chosen outputs and loads of a linear model, by their numbers, as the kernel's `pmr_chosen` (src/pmr_kernel.h)."""

    columns: NDArray[np.int32]  # (q,) among outputs of the bodies, then forces of all contacts
    orders: NDArray[np.int32]  # (q,): of rates with respect to time
    loads: NDArray[np.int32]  # (i,) among the drivers
    at_modes: NDArray[np.int32]  # (r,): modes without padding


class LinearSteps:
    """Linear models of T steps for chosen outputs and loads.

    The arrays (T, ...) have their names in `pmr_linear_step` (src/pmr_kernel.h).
    """

    def __init__(self, chosen: ChosenOutputs, T: int) -> None:
        """Make arrays of zeros for the models of T steps, with the outputs, loads and modes in `chosen`."""
        q, i, r = len(chosen.columns), len(chosen.loads), len(chosen.at_modes)
        shapes = ((5, 4, r), (T, r, 2 * r), (T, r, i), (T, q, 2 * r), (T, q, i))
        self.reference, self.matrices = np.zeros((T, q)), StepMatrices(*map(np.zeros, shapes))
        self._chosen, stored = chosen, T if chosen.orders.any() else 1  # without rates nothing is stored for them
        self._arrays = {
            "reference": self.reference, **{name: getattr(self.matrices, name) for name in "RGCD"},
            "shapes": np.zeros((stored, q, r)), "loaded": np.zeros((stored, q)), "motion": np.zeros((stored, 3 * r)),
        }  # fmt: skip
        self._data = structure("pmr_chosen", {"outputs": q, "inputs": i, "modes": r} | vars(chosen))

    def take(self, state: State, k: int, u: Array) -> None:
        """Take a step of `state` to the drivers u (N,), and store its linear model as that of step k.

        Raises StepError if the step fails.
        """
        u, where = np.ascontiguousarray(u, float), f"step {state.step_number + 1}"
        arguments = (state.pointer, self._data, pointer(u), self._step_data(k))
        lib.pmr_linear_courses(state.pointer, self._data, pointer(self.matrices.courses))
        state.raise_unless_done(lib.pmr_linear_matrices(*arguments), where)
        state.step(u)
        state.raise_unless_done(lib.pmr_linear_outputs(*arguments), where)

    def follow_rates(self, h: float) -> None:
        """Turn outputs that are rates into derivatives with respect to time, from the models of neighbouring steps.

        The matrices and the reference of all steps, which are h s apart, are changed in place.  Call it after all steps
        are taken.
        """
        if self._chosen.orders.any():
            steps = [ffi.NULL, *(self._step_data(k) for k in range(len(self.reference))), ffi.NULL]
            for before, now, after in zip(steps[:-2], steps[1:-1], steps[2:], strict=True):
                lib.pmr_output_rates(self._data, pointer(self.matrices.courses), h, before, now, after)

    def _step_data(self, k: int) -> Any:
        """Addresses of the arrays of step k, as the kernel's structure ``pmr_linear_step``."""
        at = {name: array[min(k, len(array) - 1)] for name, array in self._arrays.items()}
        return structure("pmr_linear_step", at)
