r"""A reduced system with its paths held: state space on a grid of path coordinates.

.. math::
    \dot x = A(s)\, x + B(s)\, f, \qquad y = C(s)\, x + D(s)\, f, \qquad x = (z, \dot z), \qquad
    A = \begin{bmatrix} 0 & I \\ -(\Omega^2 + C_e^T F^{-1} C_e) & -D_m \end{bmatrix}

with loads f, outputs y and modal coordinates z, with the natural frequencies in :math:`\Omega` and modal damping
:math:`D_m`.  The modes X, q = X z, are the same at every s.  Mass and damping do not depend on s, so matrices may be
interpolated between two grid points and scheduled by s, the more accurately the closer the points are together
(`pmr.export.control.interpolation_error`).  F = G(s) + 1/k is the flexibility of contacts that give way, with rows
:math:`C_e`, residual flexibility G and stiffness k; rigid contacts, with rows :math:`C_r`, restrict the modes by
:math:`C_r X = 0`.

A state space is that of a saved system, or of one of its sections without joints.  They are also written as matrices of
Nastran: DMIG entries, or OUTPUT4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from pmr.errors import BEYOND_ENDS, InputError
from pmr.export.formats import Options
from pmr.files.arrays import Array, Mask
from pmr.files.whole import write_text
from pmr.scene.built import force_name
from pmr.scene.keys import ALONE, LUFFING_CYLINDER, SLIDER, path_unit
from pmr.simulation.modal import Modes, diagonalise, modal_damping
from pmr.simulation.moving import path_ranges
from pmr.system.assembly import Assembly
from pmr.system.body_matrices import symmetric_part
from pmr.system.reduced_model import ReducedModel
from pmr.system.saved import read
from pmr.system.states import ContactRows, check_determined
from pmr.system.system import System

#: Share of their largest entry by which rigid rows may differ between grid points and still be the same.
SAME = 1e-12


@dataclass(frozen=True)
class StateSpace:
    """Matrices A(s), B(s), C(s), D(s) at S grid points of P paths, for 2 r states, i inputs and q outputs."""

    paths: tuple[str, ...]
    s: Array  # (S, P): coordinate on each path in m, of the luffing angle in rad
    # (S, 2 r, 2 r), (S, 2 r, i), (S, q, 2 r) and (S, q, i)
    A: Array
    B: Array
    C: Array
    D: Array
    # names; outputs, with their `units`, are first those of bodies, then the forces of contacts
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    states: tuple[str, ...]

    @property
    def grid(self) -> Array:
        """Path coordinates `s` in the form of files: (S,) for one path or none, (S, P) for several."""
        return self.s if len(self.paths) > 1 else self.s.sum(axis=1)

    def place(self, k: int) -> str:
        """Text of the path coordinates of the k-th grid point, with all digits."""
        names = {path: "s" if self.paths == (SLIDER,) else path for path in self.paths}
        places = zip(self.paths, self.s[k].tolist(), strict=True)
        return ", ".join(f"{names[path]} = {at!r} {path_unit(path)}" for path, at in places) or "at rest"

    @property
    def natural(self) -> Array:
        """Natural circular frequencies (S, r) in rad/s of the undamped system, ascending."""
        r = self.A.shape[1] // 2
        frequencies: Array = np.sqrt(np.abs(np.linalg.eigvals(-self.A[:, r:, :r]).real))
        return np.sort(frequencies, axis=1)


def state_space(system: System, s: Mapping[str, ArrayLike], source: str) -> StateSpace:
    """State space of reduced bodies with their paths held at S grid points.

    `s` has the coordinates of each path, by its name, as an array (S,) or as one number for all points.  They are in m,
    those of a luffing angle in rad.  Without paths, S is 1.  `source` is the file that errors name.

    Raises InputError if a contact only pushes, or if the rows of a rigid contact differ between the points.  Raises
    SimulationError if contact forces at one of the points are not determined.
    """
    if pushing := [contact.name for contact in system.contacts if contact.clearance is not None]:
        raise InputError(source, "rows", None, f"rows that hold both ways are allowed: {', '.join(pushing)} only push")
    assembly = Assembly(system)
    rows = assembly.contact_rows_over_time(np.atleast_2d(system.side_coordinates(s)))
    firm = np.all(rows.F == 0.0, axis=(0, 2))
    omega2, X = _modes(system, assembly, rows.C[:, firm], firm, source)
    places = np.column_stack([np.empty((len(rows.C), 0)), *(np.broadcast_to(s[p], len(rows.C)) for p in system.paths)])
    spaces = [_HeldSystem.build(assembly, rows.at_time(k), firm, X, omega2, p) for k, p in enumerate(places)]
    r = len(omega2)
    A = np.zeros((len(spaces), 2 * r, 2 * r))
    A[:, :r, r:], A[:, r:, r:] = np.eye(r), -_damping(system, assembly, X, omega2)
    A[:, r:, :r] = [-space.stiffness for space in spaces]
    B = np.zeros((len(spaces), 2 * r, assembly.B.shape[1]))
    B[:, r:] = [space.inputs for space in spaces]
    return StateSpace(
        paths=system.paths,
        s=places,
        A=A,
        B=B,
        C=np.array([space.measured for space in spaces]),
        D=np.array([space.direct for space in spaces]),
        inputs=system.input_names,
        outputs=(*system.output_names, *map(force_name, system.contact_names)),
        units=(*system.output_units, *("N",) * len(system.contacts)),
        states=(*(f"mode {k + 1}" for k in range(r)), *(f"rate of mode {k + 1}" for k in range(r))),
    )


def _modes(system: System, assembly: Assembly, C: Array, firm: Mask, source: str) -> Modes:
    """Modes X (n, r) of an assembly that obey its m_r rigid contacts, and their omega^2 (r,), ascending.

    X^T M X = 1 and C X = 0 hold, where C (S, m_r, n) are the rows of the rigid contacts at S grid points.  The mask
    `firm` (m,) has all contacts, and is true for the rigid ones.  Raises InputError, which names the file `source`, if
    C depends on the grid point.
    """
    travelling = np.abs(C - C[0]).max(axis=(0, 2)) > SAME * np.abs(C).max(initial=0.0)
    if travelling.any():
        names = [name for name, rigid in zip(system.contact_names, firm, strict=True) if rigid]
        rigid_rows = ", ".join(name for name, moves in zip(names, travelling, strict=True) if moves)
        allowed = (
            f"rows that give way are allowed in a state space at several places, {rigid_rows} are rigid: one place, or "
            "reduction.flexibility"
        )
        raise InputError(source, "rows", None, allowed)
    N = scipy.linalg.null_space(C[0]) if len(C[0]) else np.eye(assembly.size)
    omega2, Y = diagonalise(N.T @ (assembly.M @ N), N.T @ (assembly.K @ N))
    return Modes(omega2, N @ Y)


def _damping(system: System, assembly: Assembly, X: Array, omega2: Array) -> Array:
    """Modal damping X^T D X (r, r), exactly diagonal if all bodies have the same Rayleigh damping.

    X (n, r) are the modes, and `omega2` (r,) the squares of their circular frequencies.
    """
    laws = {body.rayleigh for body in system.bodies.values()}
    common = laws.pop() if len(laws) == 1 else None
    M, D, K = (A.toarray() for A in (assembly.M, assembly.D, assembly.K))
    return symmetric_part(
        modal_damping(D, D if common is None else D - common.alpha * M - common.beta * K, omega2, X, common)
    )


@dataclass(frozen=True)
class _HeldSystem:
    """A system with its paths held at one grid point, on r modes: stiffness and input matrix, and output matrices.

    With modal coordinates z and loads f, the q outputs and contact forces are `measured` (z, z') + `direct` f.
    """

    stiffness: Array  # (r, r)
    inputs: Array  # (r, i)
    measured: Array  # (q, 2 r)
    direct: Array  # (q, i)

    @classmethod
    def build(cls, assembly: Assembly, rows: ContactRows, firm: Mask, X: Array, omega2: Array, s: Array) -> _HeldSystem:
        """Build the system held at one grid point from the contact rows at this point.

        The mask `firm` (m,) is true for rigid contacts.  X (n, r) are the modes of the system and `omega2` (r,) their
        squared circular frequencies.  The coordinates s (P,) of P paths at this point are for messages.
        """
        soft, r, B = rows.select(~firm), len(omega2), assembly.B.toarray()
        names = [name for name, rigid in zip(assembly.system.contact_names, firm, strict=True) if not rigid]
        where = ", ".join(
            f"{path} at {at:g} {path_unit(path)}" for path, at in zip(assembly.system.paths, s, strict=True)
        )
        check_determined(soft.F[None], names, lambda _: where)
        C = soft.C @ X
        answers = np.linalg.solve(soft.F, np.hstack([C, soft.H]))
        forces, of_rates = np.zeros((len(firm), r + B.shape[1])), np.zeros((len(firm), r))
        forces[~firm] = answers
        if firm.any():  # forces of rigid contacts follow from C_r q'' = 0
            mobile = rows.C[firm] @ np.linalg.inv(assembly.M.toarray())
            mobility = np.linalg.pinv(mobile @ rows.C[firm].T, hermitian=True) @ mobile
            forces[firm] = mobility @ (np.hstack([-(assembly.K @ X), B]) - soft.C.T @ answers)
            of_rates[firm] = -mobility @ (assembly.D @ X)
        shapes = np.hstack([assembly.outputs @ X, assembly.direct]) - rows.X @ forces
        outputs = np.hstack([shapes[:, :r], -rows.X @ of_rates])
        return cls(
            stiffness=np.diag(omega2) + C.T @ answers[:, :r],
            inputs=X.T @ B - C.T @ answers[:, r:],
            measured=np.vstack([outputs, np.hstack([forces[:, :r], of_rates])]),
            direct=np.vstack([shapes[:, r:], forces[:, r:]]),
        )


#: Default number of grid points.
PLACES = 21


def saved_system(npz_path: Path, options: Options) -> System:
    """System in the file `npz_path` or, if `options` name one, a section of it alone.

    Raises InputError as `section_alone`, if places are chosen together with a section, and for a system with friction,
    a hoist or matrices that change in time.
    """
    if options.section is None:
        return System.load(npz_path).ensure_constant(npz_path.name)
    if options.at is not None:
        allowed = "none is allowed with --section: without its joints nothing of a section depends on a place"
        raise InputError("command line", "--at", options.at, allowed)
    return section_alone(npz_path, options.section)


def section_alone(npz_path: Path, name: str) -> System:
    """System of the section `name` without joints, from `npz_path`, the file of a boom or a section.

    The section stands on its own supports, or is free.  Raises InputError if the file has no such section, or a luffing
    cylinder holds it.
    """
    saved = read(npz_path)
    bodies = {saved.section.name if saved.section else "": saved} if isinstance(saved, ReducedModel) else saved.bodies
    sections = [body for body, model in bodies.items() if model.section is not None]
    if name not in sections:
        allowed = f"{', '.join(map(repr, sections))} is allowed, of which {npz_path.name} has the model"
        if not sections:
            allowed = "none is allowed: this is the model of a whole body"
        raise InputError("command line", "--section", name, allowed)
    if LUFFING_CYLINDER in bodies[name].row_names:
        allowed = "a section that no luffing cylinder holds is allowed: its direction follows the angle of the boom"
        raise InputError("command line", "--section", name, allowed)
    alone = System.of(bodies[name].without_joints())
    held = tuple(replace(contact, inner=replace(contact.inner, body=name)) for contact in alone.contacts)
    return System({name: alone.bodies[ALONE]}, held)


def path_positions(system: System, text: str | None) -> Mapping[str, Array]:
    """Coordinates (S,) of each path, by its name: those in `text`, or a grid of `PLACES` points if `text` is None.

    Coordinates are in m, those of a luffing angle in rad.  The grid has a single point if nothing travels.  `text` has
    one of two forms:

    - ``1.5,2,4`` for one path; the places are returned in ascending order, each once.
    - ``mid=2,fly=3; mid=2.5,fly=3`` for several paths; the places are returned in the order of `text`.

    A place beyond an end of a path, by at most the share `BEYOND_ENDS` of the path's length, is moved to the end.
    Raises InputError for places farther off, and for any other text.
    """
    ranges = system.ranges
    if text is None:
        ends = path_ranges(system)
        count = PLACES if any(high > low for low, high in ends.values()) else 1
        return {path: np.linspace(low, high, count) for path, (low, high) in ends.items()}
    if not ranges:
        raise InputError("command line", "--at", text, "none is allowed: nothing travels")
    limits = ", ".join(f"{path} from {low:g} to {high:g} {path_unit(path)}" for path, (low, high) in ranges.items())
    of_each = ",".join(f"{path}={low:g}" for path, (low, _) in ranges.items())
    allowed = f"each path by its name, places separated by ;, is allowed, such as {of_each!r}: {limits}"
    alone, points = next(iter(ranges)) if len(ranges) == 1 and "=" not in text else "", list[dict[str, float]]()
    if alone:
        allowed = f"places {limits.removeprefix(alone).strip()}, separated by commas, are allowed"
    with suppress(ValueError):
        if alone:
            points = [{alone: at} for at in sorted({float(part) for part in text.split(",")})]
        else:
            pairs = ([part.split("=") for part in place.split(",")] for place in text.split(";"))
            points = [{name.strip(): float(value) for name, value in of_place} for of_place in pairs]
    is_named = [set(point) == set(ranges) for point in points]
    if not points or not all(is_named):
        raise InputError("command line", "--at", text, allowed)
    places = dict[str, Array]()
    for path, (low, high) in ranges.items():
        at, slack = np.array([point[path] for point in points]), BEYOND_ENDS * (high - low)
        if not np.all((at >= low - slack) & (at <= high + slack)):
            raise InputError("command line", "--at", text, allowed)
        places[path] = np.clip(at, low, high)
    return places


#: Number of characters of a wide field, which holds 10 to 12 digits.
FIELD = 16
_SQUARE, _RECTANGULAR, _SYMMETRIC = 1, 2, 6
_RECTANGULAR_DMIG, _DOUBLE = 9, 2


@dataclass(frozen=True)
class _NastranMatrix:
    """Matrix `A` for Nastran, with what its cards state.

    The name of the matrix is `letter` and `number`, which is that of a grid point, or ``""`` for a matrix of all
    points.  `form` is the number of the matrix's form, as OUTPUT4 numbers the forms.
    """

    letter: str
    number: str
    A: Array
    form: int


def write_dmig(npz_path: Path, target: Path, options: Options) -> Path:
    """Write M, D and, for each grid point, K and loads as DMIG, in modal coordinates on scalar points 1 to r.

    A field of DMIG has room for nine to twelve digits, not for all digits of a double.  So each matrix is written as
    two: the rounded matrix and the remainder.  Nastran adds both (``K2GG = K1, KL1``), and the sum has all digits.  The
    path `target` is returned.  Raises InputError as `state_space`.
    """
    return _write(npz_path, target, options, _dmig_deck)


def write_output4(npz_path: Path, target: Path, options: Options) -> Path:
    """Write the matrices of `write_dmig` with all digits as text of OUTPUT4, and return the file's path.

    Raises InputError as `write_dmig`.
    """
    return _write(npz_path, target, options, _output4_deck)


def _write(npz_path: Path, target: Path, options: Options, lines: Callable[[StateSpace], Iterator[str]]) -> Path:
    """Write the lines that `lines` yields from the state space of the system in `npz_path`, and return `target`."""
    system = saved_system(npz_path, options)
    space = state_space(system, path_positions(system, options.at), npz_path.name)
    write_text(target, "\n".join([*lines(space), ""]))
    return target


def _matrices(space: StateSpace) -> Iterator[_NastranMatrix]:
    """Yield M, the unit matrix, and D, which hold at all grid points, and for each grid point K and the loads F."""
    r = space.A.shape[1] // 2
    yield _NastranMatrix("M", "", np.eye(r), _SYMMETRIC)
    damping = -space.A[0, r:, r:]
    yield _NastranMatrix("D", "", damping, _SYMMETRIC if np.array_equal(damping, damping.T) else _SQUARE)
    for k in range(len(space.s)):
        stiffness = -space.A[k, r:, :r]
        yield _NastranMatrix("K", str(k + 1), (stiffness + stiffness.T) / 2.0, _SYMMETRIC)
        yield _NastranMatrix("F", str(k + 1), space.B[k, r:], _RECTANGULAR)


def _dmig_deck(space: StateSpace) -> Iterator[str]:
    """Yield the lines of a file with DMIG entries."""
    r = space.A.shape[1] // 2
    yield "$ A reduced model in modal coordinates (modal mass 1 kg), SI units; each matrix is the sum of two."
    yield "$ M2GG = M, ML    B2GG = D, DL    K2GG = K1, KL1 at the first place, and so on; F1, FL1: loads."
    yield from (f"$ Load {k}: {name}".encode("ascii", "replace").decode() for k, name in enumerate(space.inputs, 1))
    for k in range(len(space.s)):
        yield f"$ Place {k + 1}: {space.place(k)}".encode("ascii", "replace").decode()
    yield f"SPOINT  {1:<8d}THRU    {r:<8d}"
    for matrix in _matrices(space):
        form = _RECTANGULAR_DMIG if matrix.form == _RECTANGULAR else matrix.form
        rounded = np.vectorize(lambda x: float(_field(x).replace("D", "e")), otypes=[float])(matrix.A)
        yield from _dmig_lines(f"{matrix.letter}{matrix.number}", matrix.A, form)
        yield from _dmig_lines(f"{matrix.letter}L{matrix.number}", matrix.A - rounded, form)


def _output4_deck(space: StateSpace) -> Iterator[str]:
    """Yield the lines of an OUTPUT4 file; columns of zeros are left out."""
    for matrix in _matrices(space):
        rows, columns = matrix.A.shape
        yield f"{columns:8d}{rows:8d}{matrix.form:8d}{_DOUBLE:8d}{matrix.letter + matrix.number:<8}1P,3E24.16"
        for j in range(columns):
            nonzero = np.flatnonzero(matrix.A[:, j])
            if nonzero.size:
                values = matrix.A[nonzero[0] : nonzero[-1] + 1, j]
                yield f"{j + 1:8d}{nonzero[0] + 1:8d}{len(values):8d}"
                yield from ("".join(f"{x:24.16E}" for x in values[k : k + 3]) for k in range(0, len(values), 3))
        yield f"{columns + 1:8d}{1:8d}{1:8d}"
        yield f"{1.0:24.16E}"


def _dmig_lines(name: str, A: Array, form: int) -> Iterator[str]:
    """Yield the DMIG lines of the matrix A (n, m), called `name`, of the form with the number `form`.

    Zeros off the diagonal are left out.  Of a symmetric matrix, the upper triangle is left out.
    """
    columns = f"{A.shape[1]:<8d}" if form == _RECTANGULAR_DMIG else ""
    yield f"DMIG    {name:<8}{0:<8d}{form:<8d}{_DOUBLE:<8d}{_DOUBLE:<8d}{'':<16}{columns}".rstrip()
    for j in range(A.shape[1]):
        rows = [i for i in range(j if form == _SYMMETRIC else 0, len(A)) if A[i, j] != 0.0 or (i == j)]
        if rows:
            yield f"{'DMIG*':<8}{name:<16}{j + 1:<16d}{0:<16d}"
        for i in rows:
            yield f"{'*':<8}{i + 1:<16d}{0:<16d}{_field(A[i, j]):<16}"


def _field(x: float) -> str:
    """Text of a finite number x with the most digits that fit into `FIELD` characters, such as ``1.50000000000D+0``.

    The exponent begins with D, Fortran's letter for double precision.  Every finite number fits; infinity and NaN raise
    ValueError.
    """
    for digits in range(FIELD, 0, -1):
        mantissa, exponent = f"{x:.{digits}e}".split("e")
        text = f"{mantissa}D{int(exponent):+d}"
        if len(text) <= FIELD:
            return text
    raise AssertionError("every double fits")
