r"""Attachment modes of ports: places at which a user hangs something on a reduced body.

A force b at a port moves, beside the modes of the basis, what they leave out: X = R b with the residual flexibility R
(`pmr.reduction.residual.operator`).  With X among the coordinates, R b = 0 is left, so that coordinates alone answer a
force there exactly, at rest and wherever the sliders are; and since R K R = R

.. math:: X^T K X = b^T R b, \qquad X^T M V = X^T K V = 0

they are combined to M-orthonormal ones with a diagonal stiffness.  Craig and Chang: On the use of attachment modes in
substructure coupling for dynamic analysis, AIAA paper 77-405, 1977.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.distributed import inner, tall, times
from pmr.reduced.soundness import symmetric
from pmr.reduction.basis import Basis
from pmr.reduction.residual.operator import ResidualFlexibility
from pmr.reduction.snapshots.free_body import FreeBody

Array = NDArray[np.float64]

#: What a force at a port moves less than this share of the most, in energy, it does not move: a support holds it there.
HELD = 1e-12
#: Answers of unit energy, an eigenvalue of whose products is smaller, depend on each other.
INDEPENDENT = 1e-9


def with_ports(body: FreeBody, modes: Basis) -> Basis:
    """Free modes, and the attachment modes of the model's ports behind them, M-orthonormal; collective."""
    model = body.model
    V = np.array(modes.V.getDenseArray())
    loads = sp.vstack(list(model.ports.values()), format="csr")[:, model.share].T.toarray()
    X = ResidualFlexibility(body, V).apply(loads.copy(order="F"))
    K = symmetric(inner(X, loads, model.comm))
    turns = np.array([name.split(" ")[-1].startswith("r") for name in model.ports])
    scale = np.sqrt(np.maximum(np.diagonal(K), 0.0))
    largest = np.where(turns, scale.max(where=turns, initial=0.0), scale.max(where=~turns, initial=0.0))
    moving = np.flatnonzero(scale > np.sqrt(HELD) * largest)
    energy, Q = np.linalg.eigh(K[np.ix_(moving, moving)] / np.outer(scale[moving], scale[moving]))
    Y = Q[:, energy > INDEPENDENT] / np.sqrt(energy[energy > INDEPENDENT]) / scale[moving, None]
    X = X[:, moving] @ Y
    theta, Q = scipy.linalg.eigh(symmetric(inner(X, times(model.M, X), model.comm)))  # 1/omega^2
    X = X @ (Q / np.sqrt(theta))[:, ::-1]
    sigma = np.append(modes.sigma, np.ones(X.shape[1]))
    return Basis(tall(np.ascontiguousarray(np.hstack([V, X])), model.M), sigma, modes.product)
