r"""The full model over time, in PETSc: the reference for bodies too large to be diagonalised or for a general solver.

.. math::
    M \ddot q + D \dot q + K q + C(s)^T \lambda = B f, \qquad C(s) q - \lambda / k = 0

Scheme, start and sign of the multipliers are those of `pmr.simulate.native.simulator` and of Exudyn, so the motions
agree. Distributed over the model's communicator: every function here is collective.
"""

from pmr.simulate.petsc.checkpoint import Checkpoint
from pmr.simulate.petsc.history import History, Recording, States, respond
from pmr.simulate.petsc.integrate import observe

__all__ = ["Checkpoint", "History", "States", "Recording", "observe", "respond"]
