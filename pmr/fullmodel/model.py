"""The full model: mass, stiffness, damping, inputs, outputs and constraint rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Rows, SharedCarriers
from pmr.fem.compat import PETSc
from pmr.fem.matrices import gather
from pmr.reduced.damping import Rayleigh
from pmr.system.body import FullBody, WithRows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMotions:
    """Rigid motions of a body, known from its geometry alone, and what of them is held by more than constraint rows.

    Attributes
    ----------
    coordinates : (n_local, k) array
        This rank's rows of the coordinates under each of k motions: translations, then rotations (`directions` of the
        model).  Coordinates that are clamped are missing.
    held : (h, k) array
        What clamps and springs measure of each motion, in m or rad: a motion is free of them where all of it is zero.
    """

    coordinates: Array
    held: Array


@dataclass(frozen=True)
class FullModel(WithRows):
    r"""M q'' + D q' + K q + C(s)^T lambda = B f,  C(s) q = 0,  y = O q, distributed over `comm`.

    Attributes
    ----------
    M, K : PETSc.Mat (n, n)
        Free of boundary conditions; SI units.  All coordinates in the model's own order, so that serial and parallel
        runs number them alike; each rank owns consecutive ones.  Where M has an entry K has a place.
    damping : PETSc.Mat (n, n) or Rayleigh
        D, or what it is made of when somebody asks for it.
    inputs : PETSc.Mat (n, i)
        One column a load.
    outputs : PETSc.Mat (n, o)
        O^T: one column an output, the transverse displacement at `output_positions` (o,) m.
    rows : Rows
        Supports first, then the sliders; the same on every rank.
    reference_frequency : float, rad/s
        Scale of the lowest frequencies; eigensolvers shift by it.
    output_names, output_units : tuples of str
        What each output is, and its unit.
    rigid : RigidMotions, optional
        In closed form.  A model without can be simulated, but not be reduced to free modes.
    node_stations : (N,) array, m, optional
        Places of a beam's nodes along its axis.
    mirrors : tuple of (n, n) sparse matrices
        Planes of symmetry (`pmr.fullmodel.symmetry`); the same on every rank.
    """

    M: PETSc.Mat
    damping: PETSc.Mat | Rayleigh
    K: PETSc.Mat
    inputs: PETSc.Mat
    outputs: PETSc.Mat
    rows: Rows
    input_names: tuple[str, ...]
    output_positions: Array
    reference_frequency: float
    output_names: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    rigid: RigidMotions | None = None
    node_stations: Array | None = None
    mirrors: tuple[sp.csr_matrix, ...] = ()

    @property
    def rayleigh(self) -> Rayleigh | None:
        """What D is made of, where it is Rayleigh's."""
        return self.damping if isinstance(self.damping, Rayleigh) else None

    @cached_property
    def D(self) -> PETSc.Mat:
        """The damping matrix (n, n), as large as K: what can do without leaves it alone; collective."""
        if self.rayleigh is None:
            return self.damping
        D = self.K.duplicate(copy=True)
        D.scale(self.rayleigh.beta)
        D.axpy(self.rayleigh.alpha, self.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        return D

    @property
    def comm(self) -> Any:
        return self.M.comm.tompi4py()

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return int(self.M.getSize()[0])

    @property
    def carriers(self) -> SharedCarriers:
        """The rows on common carriers."""
        return self.rows.shared

    @property
    def share(self) -> slice:
        """This rank's coordinates."""
        return slice(*self.M.getOwnershipRange())

    def gather(self) -> FullBody | None:
        """The model as SciPy matrices on rank 0; None elsewhere.  Collective."""
        parts = [gather(A) for A in (self.M, self.D, self.K, self.inputs, self.outputs)]
        if self.comm.rank != 0:
            return None
        M, D, K, inputs, outputs = parts
        assert M is not None and D is not None and K is not None and inputs is not None and outputs is not None
        return FullBody(
            M,
            D,
            K,
            inputs.toarray(),
            outputs.T.tocsr(),
            self.rows,
            self.input_names,
            self.output_positions,
            self.output_units,
            self.output_names,
            self.rayleigh,
        )
