r"""Full models over time, in PETSc: the reference for bodies too large to be diagonalised or for a general solver.

.. math::
    M \ddot q + D \dot q + K q + C^T \lambda = B f, \qquad C q - \lambda / k = 0

of one body with C(s), or of several that contacts join (`pmr.system.contacts`), some of which may only push.

Scheme, start and sign of the multipliers are those of `pmr.simulation.native.systems` and of Exudyn, so the motions
agree.  Models are distributed over the ranks of their communicator: every function here is collective, that is, all
ranks have to call it.
"""

from pmr.simulation.petsc.checkpoint import Checkpoint
from pmr.simulation.petsc.observe import observe
from pmr.simulation.petsc.recorder import History, Recording, States
from pmr.simulation.petsc.start import static_start

__all__ = [
    "Checkpoint",
    "History",
    "Recording",
    "States",
    "observe",
    "static_start",
]
