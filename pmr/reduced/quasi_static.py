r"""Modes without inertia, which follow loads at once: for terms that vary in time and act on what a basis leaves out.

The flexibility R that a basis leaves out answers contacts and loads, not the forces of terms, which it would have to
know of each motion.  With geometric stiffness these bend it: rigid motions of a section that is inclined and pressed
come with a bending of their own.  So its first modes stay with the model as coordinates whose inertia simulators leave
out,

.. math::
    2 \zeta \omega\, \dot\eta + \omega^2 \eta + \sum_k c_k\, \varphi^T A_k\, q = \varphi^T (B f - C^T \lambda)

which are determined by what presses on them, as R is, and have the damping that R has not.  To first order in c that is
:math:`R_A = R - c\, R A R` in place of R and :math:`V_A = V - c\, R A V` in place of V, in the space of these modes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmr.reduced.attachment import with_cylinder_modes
from pmr.reduced.model import ReducedModel
from pmr.reduced.truncation import extend

#: Modes of each body: its first bending either way (docs/moving_frame.md has what more of them give).
QUASI_STATIC = 2


def as_simulated(model: ReducedModel, stressed: bool) -> ReducedModel:
    """A model on its modes with those of its cylinder and, where terms act on it, with modes without inertia."""
    return with_cylinder_modes(with_quasi_static_modes(model) if stressed else model)


def with_quasi_static_modes(model: ReducedModel, count: int = QUASI_STATIC) -> ReducedModel:
    """Make up to `count` of a model's first enrichment modes coordinates without inertia, behind its own."""
    if model.enrichment is None or model.flexibility is None:
        return model
    with_modes = extend(model, min(count, model.enrichment.count))
    return replace(with_modes, quasi_static=np.arange(model.size, with_modes.size))
