"""From a scene to the full model: mass, stiffness, damping, inputs, outputs and constraint rows."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.rows import Row, Rows, carrier, fixed_row
from pmr.fem.compat import MPI, PETSc
from pmr.fem.matrices import columns, gather
from pmr.fullmodel.assembly import assemble_model, rayleigh
from pmr.mesh import BeamMesh, beam_mesh
from pmr.models.beam2d import Beam2D
from pmr.models.rigid import RigidMotions
from pmr.reduced.damping import Rayleigh
from pmr.scene import SUPPORT_ROWS, Scene
from pmr.system.body import FullBody

Array = NDArray[np.float64]
logger = logging.getLogger(__name__)

#: Relative error of the lowest frequency from which on a mesh is called too fine.
NOTICED_ROUND_OFF = 1e-4


@dataclass(frozen=True)
class FullModel:
    r"""M q'' + D q' + K q + C(s)^T lambda = B f,  C(s) q = 0,  y = O q, distributed over `comm`.

    Attributes
    ----------
    M, D, K : PETSc.Mat (n, n)
        Free of boundary conditions; SI units.  All coordinates in the model's own order, so that serial and parallel
        runs number them alike; each rank owns consecutive ones.
    inputs : PETSc.Mat (n, i)
        One column a load.
    outputs : PETSc.Mat (n, o)
        O^T: one column an output, the transverse displacement at `output_positions` (o,) m.
    rows : Rows
        Supports first, then the sliders; the same on every rank.
    reference_frequency : float, rad/s
        Scale of the lowest frequencies; eigensolvers shift by it.
    output_names, output_units : tuples of str
        What each output is, and whether it is in m, rad or N.
    rayleigh : Rayleigh, optional
        What D is made of, where it is Rayleigh's.
    rigid : RigidMotions, optional
        In closed form.  A model without can be simulated, but not be reduced to free modes.
    """

    M: PETSc.Mat
    D: PETSc.Mat
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
    rayleigh: Rayleigh | None = None

    @property
    def comm(self) -> Any:
        return self.M.comm.tompi4py()

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return int(self.M.getSize()[0])

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


def full_model(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """Assemble the scene's full model on `comm`.

    Raises
    ------
    InputError
        If the scene's mesh file does not fit the beam.
    """
    return beam_model(scene, beam_mesh(scene, comm))


def beam_model(scene: Scene, mesh: BeamMesh) -> FullModel:
    """The full model of the scene's beam on a given mesh."""
    model = Beam2D(scene.body, mesh.nodes)
    if model.round_off > NOTICED_ROUND_OFF and mesh.domain.comm.rank == 0:
        logger.warning(
            "round-off in the stiffness of so short elements changes the lowest frequency by about %.0e of its value; "
            "fewer elements are more accurate",
            model.round_off,
        )
    operators = assemble_model(model, mesh.domain)
    M, K = operators.M, operators.K
    return FullModel(
        M,
        operators.damping(scene.damping),
        K,
        inputs=columns(M, [model.point(load.at, load.direction) for load in scene.loads]),
        outputs=columns(M, [model.point(x, "y") for x in mesh.nodes]),
        rows=Rows((*_support_rows(scene, model), *_slider_rows(scene, model)), model.size),
        input_names=tuple(load.name for load in scene.loads),
        output_positions=mesh.nodes,
        reference_frequency=model.reference_frequency,
        output_names=tuple(f"y at {x:g} m" for x in mesh.nodes),
        output_units=("m",) * len(mesh.nodes),
        rayleigh=rayleigh(scene.damping),
        rigid=RigidMotions.unheld(model.rigid_motions()[slice(*M.getOwnershipRange())]),
    )


def _support_rows(scene: Scene, model: Beam2D) -> list[Row]:
    domain = _path_domain(scene)
    return [
        fixed_row(
            f"support {direction} at {support.at:g} m", carrier(*model.point(support.at, direction), model.size), domain
        )
        for support in scene.supports
        for direction in SUPPORT_ROWS[support.kind]
        if direction in scene.body.directions
    ]


def _slider_rows(scene: Scene, model: Beam2D) -> list[Row]:
    offsets = scene.slider.offsets
    names = [f"slider at s{offset:+g} m" if offset else "slider at s" for offset in offsets]
    if offsets == (0.0,):
        names = ["slider"]
    return [model.slider(offset, name) for offset, name in zip(offsets, names, strict=True)]


def _path_domain(scene: Scene) -> tuple[float, float]:
    offsets = scene.slider.offsets
    return 0.0 - min(offsets), scene.body.length - max(offsets)
