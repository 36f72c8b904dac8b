r"""Simulation of full models in PETSc: the reference for bodies that are too large to be diagonalised.

.. math::
    M \ddot q + D \dot q + K q + C^T \lambda = B f, \qquad C q - \lambda / k = 0

are the equations of one body with rows C of contacts on a path, or of several bodies that contacts join
(`pmr.system.contacts`).  Some contacts may only push.

Time integration, initial state and sign of the multipliers :math:`\lambda` are those of `pmr.simulation.native.systems`
and of Exudyn, so the motions agree.  Models are distributed over the ranks of their communicator: every function here
is collective, that is, all ranks have to call it.
"""

from pmr.simulation.petsc.recorder import History, States
from pmr.simulation.petsc.simulator import Checkpoint, observe
from pmr.simulation.petsc.start import static_start

__all__ = ["Checkpoint", "History", "States", "observe", "static_start"]
