r"""The full model over time, in PETSc: the reference for bodies too large to be diagonalised or for a general solver.

.. math::
    M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s) q - \lambda / k = 0

Scheme, start and sign of the multipliers are those of `pmr.simulate.march` and of Exudyn, so the motions agree.
Distributed over the model's communicator: every function here is collective.
"""

from pmr.fullorder.checkpoint import Checkpoint
from pmr.fullorder.history import History, States, Watch, respond
from pmr.fullorder.integrate import observe

__all__ = ["Checkpoint", "History", "States", "Watch", "observe", "respond"]
