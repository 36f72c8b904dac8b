"""The one door to FEniCSx: everything that differs between dolfinx 0.5 and 0.11 stands here.

Every other module takes MPI, PETSc and SLEPc from here, which also keeps the import order right: the wheel
``dolfinx_solver`` (where it is the one installed) has to come before dolfinx, petsc4py and slepc4py.

=================  ============================  =============================  ==========================
                   0.5 (Debian 12)               0.9 (Debian 13)                0.10 and later
=================  ============================  =============================  ==========================
elements           basix.ufl_wrapper, ufl        basix.ufl                      basix.ufl
function space     FunctionSpace(mesh, element)  functionspace(mesh, element)   functionspace(mesh, element)
create_mesh        comm, cells, x, domain        comm, cells, x, element        comm, cells, element, x
geometry dofs      dofmap.links(cell)            dofmap (2D array)              dofmaps[0] (2D array)
=================  ============================  =============================  ==========================
"""

from __future__ import annotations

import contextlib
import logging
from typing import Any

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401  (sets up the wheel's libraries)

import petsc4py

# PETSc's handlers turn a closed pipe (`pmr info | head`) into a page of advice on debuggers.
petsc4py.init(["pmr", "-no_signal_handler"])

import basix
import dolfinx
import dolfinx.fem.petsc
import numpy as np
import slepc4py
import ufl
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

slepc4py.init()
from slepc4py import SLEPc

__all__ = ["MPI", "PETSc", "SLEPc", "assemble", "cell_tables", "constant", "hermite_space", "interval_mesh", "versions"]

Array = NDArray[np.float64]
VERSION = tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
_WRAPPED = VERSION < (0, 7)  # elements before basix.ufl

# FFCx tells of every compilation through the root logger.
logging.getLogger("FFCx").setLevel(logging.WARNING)
logging.getLogger("UFL").setLevel(logging.WARNING)


class _NoCompilerChatter(logging.Filter):
    def filter(self, record: logging.LogRecord) -> bool:
        return record.module not in {"dist", "build_ext", "ccompiler", "spawn", "_log", "cmd"}


logging.getLogger().addFilter(_NoCompilerChatter())


def versions() -> dict[str, str]:
    """Versions of the finite-element stack in use."""
    petsc, slepc = PETSc.Sys.getVersion(), SLEPc.Sys.getVersion()
    library = MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\x00 ")
    return {
        "dolfinx": dolfinx.__version__,
        "basix": basix.__version__,
        "PETSc": ".".join(map(str, petsc)),
        "petsc4py": petsc4py.__version__,
        "SLEPc": ".".join(map(str, slepc)),
        "slepc4py": slepc4py.__version__,
        "MPI": " ".join(library.split())[:60],
        "scalar type": np.dtype(PETSc.ScalarType).name,
    }


def interval_mesh(comm: MPI.Comm, nodes: Array) -> Any:
    """A dolfinx mesh of the x axis with the given increasing nodes (m), distributed over `comm`."""
    first = comm.rank == 0
    x = np.asarray(nodes, float)[:, None] if first else np.empty((0, 1))
    count = len(nodes) - 1 if first else 0
    cells = np.column_stack([np.arange(count), np.arange(1, count + 1)]).astype(np.int64).reshape(count, 2)
    if VERSION < (0, 7):
        cell = ufl.Cell("interval", geometric_dimension=1)
        return dolfinx.mesh.create_mesh(comm, cells, x, ufl.Mesh(ufl.VectorElement("Lagrange", cell, 1)))
    element = basix.ufl.element("Lagrange", "interval", 1, shape=(1,))
    if VERSION < (0, 10):
        return dolfinx.mesh.create_mesh(comm, cells, x, ufl.Mesh(element))
    return dolfinx.mesh.create_mesh(comm, cells, element, x)


def hermite_space(mesh: Any, axial: bool) -> Any:
    """Function space with components [u,] w_A, theta_B on an interval mesh.

    Cubic Hermite functions as two elements with one degree of freedom at each vertex: A spans the value functions
    N2 and N5, B the slope functions N3 and N6 of the unit interval.  With J = dx/dX the deflection is
    ``w = w_A + J theta_B``; it is C1 on graded meshes, and theta_B is the physical slope.  `axial` adds linear u.
    """
    # Complete degrees (A holds the constants, B does not) also keep the two apart for FFCx, which in 0.5 compares
    # custom elements by little else.
    value = _vertex_element((lambda X: 1 - 3 * X**2 + 2 * X**3, lambda X: 3 * X**2 - 2 * X**3), 0, 0)
    slope = _vertex_element((lambda X: X - 2 * X**2 + X**3, lambda X: -(X**2) + X**3), 1, -1)
    parts = [value, slope]
    if _WRAPPED:
        if axial:
            parts.insert(0, ufl.FiniteElement("Lagrange", "interval", 1))
        return dolfinx.fem.FunctionSpace(mesh, ufl.MixedElement(*parts))
    if axial:
        parts.insert(0, basix.ufl.element("Lagrange", "interval", 1))
    return dolfinx.fem.functionspace(mesh, basix.ufl.mixed_element(parts))


def _vertex_element(functions: Any, derivative: int, complete_degree: int) -> Any:
    """Custom cubic element on the unit interval with two functions and a value or slope dof at each vertex."""
    interval = basix.CellType.interval
    if _WRAPPED:
        points, weights = basix.make_quadrature(basix.QuadratureType.Default, interval, 6)
    else:
        points, weights = basix.make_quadrature(interval, 6)
    legendre = np.asarray(basix.tabulate_polynomials(basix.PolynomialType.legendre, interval, 3, points))
    coefficients = np.array([legendre @ (weights * f(points[:, 0])) for f in functions])
    nothing = np.zeros((0, 1))
    dof = np.zeros((1, 1, 1, 2))
    dof[0, 0, 0, derivative] = 1.0
    at = [[np.array([[0.0]]), np.array([[1.0]])], [nothing], [], []]
    duals = [[dof, dof.copy()], [np.zeros((0, 1, 0, 2))], [], []]
    if _WRAPPED:
        element = basix.create_custom_element(
            interval, [], coefficients, at, duals, 1, basix.MapType.identity, False, complete_degree, 3
        )
        return basix.ufl_wrapper.BasixElement(element)
    return basix.ufl.custom_element(
        interval, [], coefficients, at, duals, 1, basix.MapType.identity, basix.SobolevSpace.H1, False,
        complete_degree, 3,
    )  # fmt: skip


def constant(mesh: Any, value: float) -> Any:
    """A constant whose value is not compiled into the form, so that another value needs no compilation."""
    return dolfinx.fem.Constant(mesh, PETSc.ScalarType(value))


def assemble(form: Any) -> PETSc.Mat:
    """Bilinear form as a PETSc matrix, without boundary conditions."""
    matrix = dolfinx.fem.petsc.assemble_matrix(dolfinx.fem.form(form))
    matrix.assemble()
    return matrix


def cell_tables(space: Any) -> tuple[Array, list[NDArray[np.int64]]]:
    """Vertex coordinates x (cells, 2) of this rank's cells and, for each component, its global dofs (cells, 2)."""
    mesh = space.mesh
    mesh.topology.create_connectivity(1, 1)
    count = mesh.topology.index_map(1).size_local
    geometry = mesh.geometry
    if VERSION < (0, 7):
        at = np.array([geometry.dofmap.links(c) for c in range(count)], dtype=np.int64).reshape(count, 2)
    else:
        at = np.asarray(geometry.dofmap if VERSION < (0, 10) else geometry.dofmaps[0])[:count]
    index_map = space.dofmap.index_map
    components = []
    for i in range(space.num_sub_spaces):
        dofs = space.sub(i).dofmap
        local = np.array([dofs.cell_dofs(c) for c in range(count)], dtype=np.int32).reshape(count, 2)
        components.append(index_map.local_to_global(local.ravel()).astype(np.int64).reshape(count, 2))
    return geometry.x[:, 0][at], components
