r"""Constant parameters of a model, such as Young's modulus, by observers of several models that differ in them.

The log-likelihood of all measurements so far is a polynomial of second degree in the parameters, through those of the
models; so are means of estimates.  Measurements of a sensor that any model's observer excludes do not count.  With
parameters u over their standard deviations, the innovations :math:`\nu_i` of model i over theirs, and the `temper`
:math:`\beta`,

.. math::
    L(u) \approx -\tfrac{\beta}{2} \sum \nu_i^2, \qquad P^{-1} = 1 - \nabla^2 L, \qquad u = P\, \nabla L(0)

(multiple models: Magill, IEEE Transactions on Automatic Control 10, 1965).  The variances of innovations count as the
same in all models.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.observe.observer import GATE, Estimates, Observer


@dataclass(frozen=True)
class ParameterObserver:
    """Observer of p constant parameters, by observers of k models with different values of them.

    Attributes
    ----------
    names : sequence of str, (p,)
        Names of the parameters.
    mean, deviation : (p,) arrays
        Expected values of the parameters and standard deviations, before the motion.
    values : (k, p) array
        Values of the parameters in each model.  An estimate of a parameter stays within the range of its values.
    observers : tuple of Observer, (k,)
        Observer of each model; all have the same sensors and unknowns.  Innovations and alarms of the estimates are
        those of the first one.
    temper : float
        Exponent of likelihoods, 0 to 1: errors of models are correlated in time.

    Raises
    ------
    InputError
        If an array has another shape, a standard deviation is not above 0 or `temper` is out of its range; if observers
        have different outputs, sensors or unknowns; or if there are too few values for a polynomial of second degree,
        which has 1 + p + p (p + 1) / 2 terms.
    """

    names: Sequence[str]
    mean: Array
    deviation: Array
    values: Array
    observers: Sequence[Observer]
    temper: float = 0.02

    def __post_init__(self) -> None:
        self._check_numbers()
        first, terms = self.observers[0], self._terms((self.values - self.mean) / self.deviation)
        for each in self.observers:
            same = each.units == first.units and len(each.model.t) == len(first.model.t)
            if not same or [s.output for s in each.sensors] != [s.output for s in first.sensors]:
                allowed = "the same steps, outputs, sensors and unknowns are allowed"
                raise InputError("observe", "observers", None, allowed)
        if repeated := next((name for name in self.names if name in first.units), None):
            raise InputError("observe", "names", repeated, "a name that no unknown and no output has is allowed")
        if len(self.observers) != len(terms) or np.linalg.matrix_rank(terms) < terms.shape[1]:
            allowed = f"{terms.shape[1]} models or more are needed, for a polynomial of second degree"
            raise InputError("observe", "values", len(self.values), allowed)

    def _check_numbers(self) -> None:
        """Raise InputError for names that are missing or repeated, and for wrong shapes or numbers."""
        p, numbers = len(self.names), {"mean": self.mean, "deviation": self.deviation, "values": self.values}
        if not p or len(set(self.names)) < p:
            raise InputError("observe", "names", tuple(self.names), "a name of its own is needed for each parameter")
        if not self.observers:
            raise InputError("observe", "observers", None, "an observer is needed for each model")
        for key, array in numbers.items():
            shape = (len(self.observers), p) if key == "values" else (p,)
            if np.shape(array) != shape:
                allowed = (
                    f"an array of the shape {shape} is allowed, for {p} parameters and {len(self.observers)} models"
                )
                raise InputError("observe", key, f"array of the shape {np.shape(array)}", allowed)
            if not np.all(np.isfinite(array)) or key == "deviation" and np.min(array) <= 0.0:
                allowed = f"finite numbers{' above 0' if key == 'deviation' else ''} are allowed"
                raise InputError("observe", key, np.asarray(array).tolist(), allowed)
        if not 0.0 <= self.temper <= 1.0:
            raise InputError("observe", "temper", self.temper, "0 to 1 is allowed")

    @staticmethod
    def _terms(u: Array) -> Array:
        """Terms (..., 1 + p + p (p + 1) / 2) of a polynomial of second degree at the p parameters u (..., p)."""
        i, j = np.triu_indices(u.shape[-1])
        return np.concatenate([np.ones((*u.shape[:-1], 1)), u, u[..., i] * u[..., j]], axis=-1)

    def run(self, measured: Mapping[str, tuple[Array, Array]]) -> Estimates:
        """Estimate outputs, unknowns and the p parameters at the time steps of the observers' models.

        In the result the parameters follow the other unknowns.  `measured` has times (n,) in s and values (n,) by the
        name of the output that a sensor measures, as for `Observer.run`; errors as there.
        """
        every, p = [observer.run(measured) for observer in self.observers], len(self.names)
        first, models = every[0], (self.values - self.mean) / self.deviation
        fit = np.linalg.pinv(self._terms(models))
        used = ~np.any([each.excluded for each in every], axis=0)
        squares = [np.nansum(used * np.minimum(each.innovations**2, GATE**2), axis=1) for each in every]
        likelihood = -0.5 * self.temper * np.cumsum(squares, axis=1).T @ fit.T
        (i, j), slope = np.triu_indices(p), likelihood[:, 1 : 1 + p]
        curvature = np.zeros((len(slope), p, p))
        curvature[:, i, j] -= likelihood[:, 1 + p :]
        sizes, directions = np.linalg.eigh(curvature + np.swapaxes(curvature, 1, 2))
        P = (directions / (1.0 + np.maximum(sizes, 0.0))[:, None, :]) @ np.swapaxes(directions, 1, 2)
        u = np.clip(np.einsum("tij,tj->ti", P, slope), models.min(axis=0), models.max(axis=0))
        course = np.einsum("mk,ktq->tmq", fit, [each.means for each in every])
        means, small = np.einsum("tm,tmq->tq", self._terms(u), course), 1e-3
        gradient = [
            np.einsum("tm,tmq->tq", self._terms(u + small * e) - self._terms(u - small * e), course) / (2.0 * small)
            for e in np.eye(p)
        ]
        variance = first.deviations**2 + np.einsum("itq,tij,jtq->tq", gradient, P, gradient)
        return replace(
            first,
            unknowns=(*first.unknowns, *self.names),
            means=np.hstack([means, self.mean + self.deviation * u]),
            deviations=np.hstack([np.sqrt(variance), self.deviation * np.sqrt(np.diagonal(P, axis1=1, axis2=2))]),
        )
