"""The only module that imports FEniCSx: all that differs between dolfinx 0.5 and 0.11 is here.

Every other module takes MPI, PETSc and SLEPc from here, which also keeps the import order right: the wheel
``dolfinx_solver`` (where it is the one installed) has to come before dolfinx, petsc4py and slepc4py.

=================  ============================  =============================  ==========================
                   0.5 (Debian 12)               0.9 (Debian 13)                0.10 and later
=================  ============================  =============================  ==========================
elements           basix.ufl_wrapper, ufl        basix.ufl                      basix.ufl
function space     FunctionSpace(mesh, element)  functionspace(mesh, element)   functionspace(mesh, element)
create_mesh        comm, cells, x, domain        comm, cells, x, element        comm, cells, element, x
=================  ============================  =============================  ==========================
"""

from __future__ import annotations

import contextlib
import hashlib
import inspect
import logging
import sysconfig
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

from pmr.errors.environment import check_current_folder, check_temporary, launched_process_count, mpi_without_launcher
from pmr.files.arrays import Array, Indices

with contextlib.suppress(ImportError):
    import dolfinx_solver  # noqa: F401  (sets up the wheel's libraries)

#: Whether PETSc, SLEPc and MPI are installed; given matrices need none of them on one rank.
HAS_PETSC = all(find_spec(name) is not None for name in ("petsc4py", "slepc4py", "mpi4py"))

if HAS_PETSC:
    check_temporary()  # Open MPI prints pages of messages if the folder has no room
    check_current_folder()
    import petsc4py

    # PETSc's handlers turn a closed pipe (`pmr info | head`) into a page of advice on debuggers.
    with mpi_without_launcher():
        petsc4py.init(["pmr", "-no_signal_handler"])


try:
    if not HAS_PETSC:
        raise ImportError("it needs PETSc, SLEPc and mpi4py")
    import basix
    import dolfinx
    import dolfinx.fem.petsc
    import dolfinx.jit
    import ffcx
    import ffcx.codegeneration
    import ffcx.naming
    import ufl
except ImportError as error:  # given matrices need no FEniCSx
    _MISSING: ImportError | None = error
else:
    _MISSING = None

import numpy as np
import scipy

if HAS_PETSC:
    import slepc4py
    from mpi4py import MPI
    from petsc4py import PETSc

    slepc4py.init()
    from slepc4py import SLEPc
else:
    from pmr.fem.serial import MPI, PETSc

    SLEPc = None

from pmr.errors import InputError
from pmr.files.whole import FULL, complete_folder

if TYPE_CHECKING:
    from basix import CellType
    from dolfinx.fem import Constant, DofMap
    from dolfinx.fem import Form as CompiledForm
    from dolfinx.fem import Function as Function
    from dolfinx.fem import FunctionSpace as FunctionSpace
    from dolfinx.mesh import Mesh as Mesh
    from ufl import FiniteElementBase as Element
    from ufl import Form as Form
    from ufl.core.expr import Expr as Expr

__all__ = [
    "HAS_PETSC", "MPI", "PETSc", "SLEPc", "assemble", "cell_dofs", "cell_topology", "cellwise",
    "check_fenicsx", "comm_of", "compiled_form", "constant", "create_mesh", "hermite_space", "integration_measure",
    "lagrange_rule", "lagrange_space", "original_cells", "rule_points", "shell_space", "tabulate", "tabulation_space",
    "unrolled_cell_dofs", "versions",
]  # fmt: skip

if not HAS_PETSC and launched_process_count() > 1:  # each process would act as the only one
    raise InputError(
        "installation", "mpi4py", None, "with petsc4py and slepc4py it is needed for more than one process"
    )

Compiled = TypeVar("Compiled")
VERSION = () if _MISSING else tuple(int(part) for part in dolfinx.__version__.split(".")[:2])
_WRAPPED = VERSION < (0, 7)  # elements before basix.ufl
#: Where a mesh keeps the space of `cellwise`.
_CELLWISE = "_pmr_cellwise"

# FFCx logs every compilation through the root logger.
logging.getLogger("FFCx").setLevel(logging.WARNING)
logging.getLogger("UFL").setLevel(logging.WARNING)


# setuptools and older versions of distutils log their compiler calls there too; newer ones have a logger of their own.
logging.getLogger().addFilter(lambda record: "distutils" not in record.pathname)
logging.getLogger("compilers").setLevel(logging.WARNING)


def versions() -> dict[str, str]:
    """Versions of the numerical libraries in use, by the libraries' names.

    The libraries are dolfinx, basix, PETSc, SLEPc, their Python packages and MPI.  A further entry is PETSc's scalar
    type.  If FEniCSx is not installed, dolfinx and basix are left out.  If PETSc is not installed, the only entry is
    ``sparse matrices``, the version of SciPy.
    """
    if not HAS_PETSC:
        return {"sparse matrices": f"SciPy {scipy.__version__}"}
    petsc, slepc = PETSc.Sys.getVersion(), SLEPc.Sys.getVersion()
    library = MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\x00 ")
    fenicsx = {} if _MISSING else {"dolfinx": dolfinx.__version__, "basix": basix.__version__}
    return {
        **fenicsx,
        "PETSc": ".".join(map(str, petsc)),
        "petsc4py": petsc4py.__version__,
        "SLEPc": ".".join(map(str, slepc)),
        "slepc4py": slepc4py.__version__,
        "MPI": " ".join(library.split())[:60],
        "scalar type": np.dtype(PETSc.ScalarType).name,
    }


def check_fenicsx(model: str) -> None:
    """Raise an `InputError` that says what is missing if FEniCSx, PETSc, SLEPc or mpi4py is not installed.

    They are needed to assemble a structural model; the message calls it `model`.
    """
    if _MISSING:
        allowed = f"matrices is allowed without FEniCSx ({_MISSING}); apt, conda or pip install '.[fenicsx]' has it"
        raise InputError("scene", "body.model", model, allowed)


def create_mesh(comm: MPI.Comm, cell: str, points: Array, cells: Indices) -> Mesh:
    """A dolfinx mesh of linear cells, distributed over `comm`; collective.

    Only the points and cells that rank 0 passes in are used.  The other ranks may pass any arrays, with the same d.

    Parameters
    ----------
    cell : ``"interval"``, ``"triangle"``, ``"tetrahedron"`` or ``"hexahedron"``
    points : (N, d) array, m
        d may exceed the cells' dimension: shells in space.
    cells : (C, k) integer array
        Vertices in dolfinx' order (hexahedra: as a tensor product).
    """
    d, first = points.shape[1], comm.rank == 0
    x = np.ascontiguousarray(points, float) if first else np.empty((0, d))
    mine = np.ascontiguousarray(cells if first else cells[:0], np.int64)
    if VERSION < (0, 7):
        # with the variant that FFCx sets while it compiles, so that a form has one signature before and after that
        plain = ufl.FiniteElement("Lagrange", ufl.Cell(cell, geometric_dimension=d), 1, variant="equispaced")
        vertices = ufl.VectorElement(plain, dim=d)
    else:
        vertices = basix.ufl.element("Lagrange", cell, 1, shape=(d,))
    described = (x, ufl.Mesh(vertices)) if VERSION < (0, 10) else (vertices, x)
    mesh = dolfinx.mesh.create_mesh(comm, mine, *described)
    _comm_of[mesh] = comm
    return mesh


def comm_of(mesh: Mesh) -> MPI.Comm:
    """The communicator that was passed to `create_mesh` for this mesh.

    dolfinx makes a communicator of its own for each mesh.  PETSc objects must not be created on dolfinx' communicator:
    an object that Python drops is freed only if all ranks of its communicator agree, and this is impossible once the
    mesh is gone.
    """
    return _comm_of[mesh]


_comm_of: WeakKeyDictionary[Mesh, MPI.Comm] = WeakKeyDictionary()


def cell_topology(cell: str) -> list[list[list[int]]]:
    """Vertex numbers of the reference cell's vertices, edges, faces and interior, one list for each dimension."""
    return [[list(entity) for entity in part] for part in basix.topology(getattr(basix.CellType, cell))]


class LagrangeRule(NamedTuple):
    """Weights of q quadrature points, and an element's functions and their derivatives at these points."""

    weights: Array  # (q,)
    functions: Array  # (q, k)
    derivatives: Array  # (d, q, k)


@lru_cache(maxsize=32)
def lagrange_rule(cell: str, order: int, degree: int, parts: int = 1) -> LagrangeRule:
    """Weights of a quadrature rule, and the k functions of a Lagrange element and their derivatives at its q points.

    The reference cell has d dimensions; a ``"point"`` has one function, which is 1.  `order` is the polynomial degree
    of the element.  The rule integrates polynomials up to `degree` exactly.  The rule is repeated in the `parts`^d
    equal pieces of the cell; all weights together add up to the size of the cell.  The result is cached and shared, so
    its arrays must not be changed.  Raises a `ValueError` for tetrahedra in several pieces.
    """
    if cell == "point":
        return LagrangeRule(np.ones(1), np.ones((1, 1)), np.zeros((0, 1, 1)))
    kind = getattr(basix.CellType, cell)
    points, weights = _quadrature(kind, degree)
    pieces = parts ** points.shape[1]
    points, weights = _repeat_points(cell, parts, points), np.tile(weights, pieces) / pieces
    element = basix.create_element(basix.ElementFamily.P, kind, order, basix.LagrangeVariant.gll_warped)
    table = np.asarray(element.tabulate(1, points))[..., 0]
    return LagrangeRule(np.asarray(weights), table[0], table[1:])


def rule_points(cell: str, degree: int) -> Array:
    """Quadrature points (q, d) on the reference cell of dimension d, in the order of the weights of `lagrange_rule`.

    The rule is the one that integrates polynomials of `degree` exactly.
    """
    return np.asarray(_quadrature(getattr(basix.CellType, cell), degree)[0])


def _repeat_points(cell: str, parts: int, points: Array) -> Array:
    """Points (k p, d) of a quadrature rule of k points, on all p = `parts`^d equal pieces of a reference cell.

    `points` (k, d) are those on the whole cell of dimension d, and are returned themselves if `parts` is 1.  The pieces
    of a triangle are upright and, between these, turned by 180 degrees.  Raises a `ValueError` for tetrahedra in
    several pieces.
    """
    d = points.shape[1]
    if parts == 1:
        return points
    if cell == "tetrahedron":
        raise ValueError("tetrahedra are not cut in pieces")
    corners = np.stack(np.meshgrid(*[np.arange(parts)] * d, indexing="ij"), axis=-1).reshape(-1, 1, d)
    if cell == "triangle":
        upright, turned = (corners[corners.sum(axis=(1, 2)) < parts - turn] for turn in (0, 1))
        places = np.concatenate([upright + points, turned + 1.0 - points])
    else:
        places = corners + points
    return places.reshape(-1, d) / parts


def _quadrature(kind: CellType, degree: int) -> tuple[Array, ...]:
    """Points (q, d) and weights (q,) of basix' rule of q points on a cell of `kind`, exact for this `degree`."""
    if _WRAPPED:
        return basix.make_quadrature(basix.QuadratureType.Default, kind, degree)
    return basix.make_quadrature(kind, degree)


def lagrange_space(mesh: Mesh, degree: int) -> FunctionSpace:
    """Function space of continuous vectors of polynomials of `degree`, with a component per coordinate of the mesh.

    Collective.
    """
    return _space(mesh, _element(mesh, "Lagrange", degree, mesh.geometry.dim))


def shell_space(mesh: Mesh) -> FunctionSpace:
    """Function space on triangles: quadratic displacements and Crouzeix-Raviart rotations, three components each.

    Collective.
    """
    return _space(mesh, _mixed_element([_element(mesh, "Lagrange", 2, 3), _element(mesh, "CR", 1, 3)]))


def hermite_space(mesh: Mesh, linear: int, planes: int = 1) -> FunctionSpace:
    """Function space on an interval mesh: linear components u, then w_A and theta_B for each plane of bending.

    `linear` is the number of linear components, and `planes` the number of planes of bending.  The deflection in a
    plane is ``w = w_A + J theta_B`` with the element's length J = dx/dX and the coordinate X in [0, 1] on the element.
    w_A is a sum of the cubic Hermite functions N2 and N5, and its two degrees of freedom are the deflections at the
    vertices.  theta_B is a sum of N3 and N6, and its degrees of freedom are the slopes dw/dx at the vertices.  So w is
    C1 on graded meshes too.  Collective.
    """
    # Complete degrees (A holds the constants, B does not) also keep the two apart for FFCx, which in 0.5 compares
    # custom elements by little else.
    value = _vertex_element((lambda X: 1 - 3 * X**2 + 2 * X**3, lambda X: 3 * X**2 - 2 * X**3), 0, 0)
    slope = _vertex_element((lambda X: X - 2 * X**2 + X**3, lambda X: -(X**2) + X**3), 1, -1)
    return _space(mesh, _mixed_element([_element(mesh, "Lagrange", 1)] * linear + [value, slope] * planes))


def _element(mesh: Mesh, family: str, degree: int, components: int = 0) -> Element:
    """Element of a `family` and `degree`: of a scalar, or of a vector with `components` components if this is not 0."""
    if not _WRAPPED:
        shape = (components,) if components else None
        return basix.ufl.element(family, mesh.topology.cell_name(), degree, shape=shape)
    cell = mesh.ufl_cell()
    if components:
        return ufl.VectorElement(family, cell, degree, dim=components)
    return ufl.FiniteElement(family, cell, degree)


def _mixed_element(elements: list[Element]) -> Element:
    """Mixed element of the given elements."""
    return ufl.MixedElement(*elements) if _WRAPPED else basix.ufl.mixed_element(elements)


def _vertex_element(functions: Sequence[Callable[[Array], Array]], derivative: int, complete_degree: int) -> Element:
    """Custom cubic element on the unit interval with two functions, and one degree of freedom at each vertex.

    A function maps points (q,) in [0, 1] to values (q,).  `derivative` is 0 if the degree of freedom is a value and 1
    if it is a slope.  `complete_degree` is the highest degree up to which the functions span all polynomials, -1 if
    they do not span the constants.
    """
    interval = basix.CellType.interval
    points, weights = _quadrature(interval, 6)
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


def integration_measure(mesh: Mesh, degree: int) -> ufl.Measure:
    """UFL measure by which integrands of the polynomial `degree` are integrated over a mesh, exactly on simplices."""
    return ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": degree})


def constant(mesh: Mesh, value: float | Array) -> Constant:
    """UFL constant with a `value`, a number or an array (any shape); forms are not compiled again if it changes.

    Use at most one such constant in a form.  UFL sorts several constants by their numbers as text, so that 10 is before
    9, and their order is not reliable.
    """
    return dolfinx.fem.Constant(mesh, np.array(value, PETSc.ScalarType, order="C"))


def function(space: FunctionSpace, values: Array) -> Function:
    """Function on a space from the `values` (n,) of its n coordinates in PETSc's global order; collective.

    Every rank passes all values.
    """
    result = dolfinx.fem.Function(space)
    block, owned = space.dofmap.index_map_bs, space.dofmap.index_map.local_range
    result.x.array[: block * (owned[1] - owned[0])] = values[block * owned[0] : block * owned[1]]
    result.x.scatter_forward()
    return result


def compiled_form(form: Form) -> CompiledForm:
    """Compile a bilinear form, so that it can be assembled for any values of its constants; collective.

    Raises an `InputError` if the folder for compiled code can't be written to.
    """
    domain = next(iter(form.subdomain_data())).ufl_cargo()
    return _compile_once(domain.comm, f"form {form.signature()}", partial(dolfinx.fem.form, form))


def assemble(form: CompiledForm) -> PETSc.Mat:
    """Assemble a compiled form to a PETSc matrix, without boundary conditions; collective."""
    matrix = dolfinx.fem.petsc.assemble_matrix(form)
    matrix.assemble()
    return matrix


def tabulation_space(space: FunctionSpace) -> FunctionSpace:
    """Space on which `tabulate` works for expressions in functions of `space`: `space` itself or an equivalent one.

    In dolfinx 0.5 an expression writes beyond its memory if the components of the space share the numbers of their
    degrees of freedom; a mixed space is then the equivalent.
    """
    if not _WRAPPED or space.dofmap.index_map_bs == 1:
        return space
    return _space(space.mesh, ufl.MixedElement(*space.ufl_element().sub_elements()))


def tabulate(expression: Expr, points: Array, space: FunctionSpace) -> Array:
    """Values (C, q, v, d) of an expression of v components that is linear in a trial function of `space`; collective.

    The q `points` (q, tdim) are on the reference cell of dimension tdim.  C is the number of cells that this rank
    knows, and d the number of degrees of freedom of a cell, in the order of `unrolled_cell_dofs`.  Raises an
    `InputError` if the folder for compiled code can't be written to.
    """
    mesh = space.mesh
    name = ffcx.naming.compute_signature([(expression, points)], "")
    compiled = _compile_once(mesh.comm, f"expression {name}", partial(dolfinx.fem.Expression, expression, points))
    cells = np.arange(len(original_cells(mesh)), dtype=np.int32)
    values = compiled.eval(cells) if VERSION < (0, 7) else compiled.eval(mesh, cells)
    return np.asarray(values).reshape(len(cells), len(points), ufl.product(expression.ufl_shape), -1)


def _space(mesh: Mesh, element: Element) -> FunctionSpace:
    """Function space of an element on a mesh; collective.

    Raises the errors of `_compile_once`.
    """
    create = dolfinx.fem.FunctionSpace if VERSION < (0, 7) else dolfinx.fem.functionspace
    return _compile_once(mesh.comm, f"element {element!r}", partial(create, mesh, element))


def _compile_once(comm: MPI.Comm, signature: str, create: Callable[..., Compiled]) -> Compiled:
    """Call `create` with a folder in dolfinx' cache for the compiled code, named by `signature`; collective.

    FFCx writes a file when it begins to compile.  If its process is killed, this file stays.  From then on each run
    that needs the same code waits for the rest and fails.  Therefore `create` compiles in a new folder, and other runs
    use the folder only when it is complete.

    Raises, on rank 0 alone, an `InputError` if the folder can't be written to, and an `OSError` if its disk is full.
    """
    keyword = "jit_params" if VERSION < (0, 6) else "jit_options"
    if keyword not in inspect.signature(create).parameters:
        return create()  # from 0.8 on elements are not compiled
    place, options, decides = _compiler()
    name = hashlib.sha256(repr((signature, options, *decides)).encode()).hexdigest()[:32]

    def compile_in(folder: Path) -> Compiled:
        return create(**{keyword: options | {"cache_dir": folder}})

    try:
        return complete_folder(place / name, _is_whole, compile_in, comm)
    except OSError as error:
        if error.errno in FULL:
            raise
        allowed = f"a folder for compiled forms is needed that can be written to ({error.strerror or error})"
        raise InputError("environment", "XDG_CACHE_HOME", str(place), allowed) from None


@cache
def _compiler() -> tuple[Path, dict[str, object], tuple[object, ...]]:
    """Folder for compiled code, options of dolfinx' compiler, and all else that determines this code.

    The result is cached.  Unless the user chose flags, code is compiled with -O1.  Compared with -O2, compiling takes a
    third less time, and assembly takes the same time.
    """
    old = VERSION < (0, 6)
    options = dict(dolfinx.jit.get_parameters() if old else dolfinx.jit.get_options())
    of_forms = sorted((ffcx.get_parameters() if old else ffcx.get_options()).items(), key=str)
    place = Path(options.pop("cache_dir")) / "pmr"
    built_for = [np.dtype(PETSc.ScalarType).name, *(sysconfig.get_config_var(name) for name in ("SOABI", "CFLAGS"))]
    flags = "cffi_extra_compile_args"
    if options[flags] == ["-O2", "-g0"]:  # dolfinx' own
        options[flags] = ["-O1", "-g0"]
    return place, options, (ffcx.codegeneration.get_signature(), repr(of_forms), built_for)


def _is_whole(folder: Path) -> bool:
    """Whether FFCx has finished all code in `folder`; False if the folder holds no code."""
    begun = list(folder.glob("*.c"))
    return bool(begun) and all(file.with_suffix(".c.cached").is_file() for file in begun)


def cellwise(mesh: Mesh, values: Array) -> Function:
    """Function that is constant in each cell, from `values` (C,) for the C cells in the order passed to `create_mesh`.

    Every rank passes all values.  The space of such functions is made once for a mesh, because forms take dozens of
    these functions and making the space takes most of their time.  Collective.
    """
    attributes = vars(mesh)
    if _CELLWISE not in attributes:
        attributes[_CELLWISE] = _space(mesh, _element(mesh, "DG", 0))
    function = dolfinx.fem.Function(attributes[_CELLWISE])
    function.x.array[_table(function.function_space.dofmap).ravel()] = values[original_cells(mesh)]
    return function


def original_cells(mesh: Mesh) -> Indices:
    """Numbers (c,), in the input of `create_mesh`, of the c cells that this rank knows: its own, then ghosts."""
    return np.asarray(mesh.topology.original_cell_index, np.int64)


def cell_dofs(space: FunctionSpace) -> list[Indices]:
    """Global degrees of freedom of the cells that this rank knows: an array (cells, d) for each scalar component.

    The cells are in the order of `original_cells`.
    """
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    tables = []
    for part in _scalar_parts(space):
        local = _table(part.dofmap)
        ids = index_map.local_to_global((local // block).ravel().astype(np.int32)).astype(np.int64)
        tables.append(ids.reshape(local.shape) * block + local % block)
    return tables


def unrolled_cell_dofs(space: FunctionSpace) -> Indices:
    """Local degrees of freedom (cells, d) of each cell that this rank knows, in the order of element matrices.

    Each component of a block has a number of its own.
    """
    table, block = _table(space.dofmap), space.dofmap.index_map_bs
    return (table[..., None] * block + np.arange(block)).reshape(len(table), -1)


def _scalar_parts(space: FunctionSpace) -> list[FunctionSpace]:
    """Scalar subspaces of a function space at any depth; the space itself if it has no subspaces."""
    if space.num_sub_spaces == 0:
        return [space]
    return [part for i in range(space.num_sub_spaces) for part in _scalar_parts(space.sub(i))]


def _table(dofmap: DofMap) -> Indices:
    """Local degrees of freedom (cells, d) of each cell that this rank knows, from a `dofmap`.

    The components of a block have one common number, unless `dofmap` belongs to a single component.
    """
    table = dofmap.list
    if VERSION < (0, 7):
        return np.asarray(table.array, np.int64).reshape(table.num_nodes, -1)
    return np.asarray(table, np.int64)
