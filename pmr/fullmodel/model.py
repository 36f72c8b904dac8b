"""The full model: mass, stiffness, damping, inputs, outputs and constraint rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Rows, SharedCarriers
from pmr.fem.compat import PETSc
from pmr.fem.matrices import gather
from pmr.fullmodel.masses import Masses
from pmr.reduced.matrices import Rayleigh
from pmr.system.body import FullBody, WithRows

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigidMotions:
    """Rigid motions of a body, known from its geometry alone, and what of them is held by more than constraint rows."""

    # (n_local, k): this rank's rows under each of k motions, translations first; clamped ones are missing
    coordinates: Array
    held: Array  # (h, k) m or rad: what clamps and springs measure of each; it is free of them where all is zero
    whole: bool = True  # whether no coordinate is clamped, whose mass and loads the model does not know


@dataclass(frozen=True)
class FullModel(WithRows):
    r"""M q'' + D q' + K q + C(s)^T lambda = B f,  C(s) q = 0,  y = O q, distributed over `comm`, in SI units.

    All coordinates are in the model's own order, so that serial and parallel runs number them alike.
    """

    M: PETSc.Mat  # (n, n) as K, free of boundary conditions; each rank owns consecutive rows
    damping: PETSc.Mat | Rayleigh  # D (n, n), or what it is made of when somebody asks for it
    K: PETSc.Mat  # where M has an entry K has a place
    inputs: PETSc.Mat  # (n, i): one column a load
    outputs: PETSc.Mat  # O^T (n, o): one column an output
    rows: Rows  # supports first, then the sliders; the same on every rank
    input_names: tuple[str, ...]
    output_positions: Array  # (o,) m along the axis
    reference_frequency: float  # rad/s: scale of the lowest frequencies, by which eigensolvers shift
    output_names: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    output_kinds: tuple[str, ...] = ()
    # in closed form; a model without can be simulated, but not be reduced to free modes
    rigid: RigidMotions | None = None
    node_stations: Array | None = None  # (N,) m: places of a beam's nodes along its axis
    # (n, n): planes of symmetry (`pmr.fullmodel.symmetry`), the same on every rank
    mirrors: tuple[sp.csr_matrix, ...] = ()
    # rows (1, n) by place and direction, the same on every rank: what moves where something may be attached
    ports: Mapping[str, sp.csr_matrix] = field(default_factory=dict)
    # (n, n) as M, by the names of `pmr.reduced.matrices`: of a moving frame and of axial forces; those that vanish are
    # left out
    matrices: Mapping[str, PETSc.Mat] = field(default_factory=dict)
    masses: Masses | None = None  # None of matrices that were given

    @property
    def rayleigh(self) -> Rayleigh | None:
        """Factors of Rayleigh's damping; None of another one."""
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
        matrices = {name: gather(A) for name, A in self.matrices.items()}
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
            self.output_kinds,
            {name: A for name, A in matrices.items() if A is not None},
            self.ports,
        )
