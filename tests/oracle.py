"""Beam, snapshots, basis and error measure of the paper, and an integrator, in NumPy alone."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.interpolate import PPoly
from textbook import LENGTH, beam_matrices

from pmr import ReducedModel, System
from pmr.files.arrays import Array
from pmr.scene.signals import Chirp, Constant, Ramp, SignalBase
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.modal import ModalForm
from pmr.simulation.start import consistent_start
from pmr.system.assembly import Assembly
from pmr.system.body import FullBody, SlidingBody
from pmr.system.body_matrices import Rayleigh
from pmr.system.carriers import CarrierFlexibility, CarrierRows, EnrichmentModes, Flexibility
from pmr.system.contacts import ALONE, SLIDER
from pmr.system.polynomials import stack_tables
from pmr.system.reduced_model import satisfied_rows
from pmr.system.rows import Row, Rows, SharedCarriers, fixed_row, row_on_coordinates, sparse_row

TIP_LOAD = "F"


@dataclass(frozen=True)
class Case:
    """Test case of the paper: slider path in m and tip load in N over 15 s."""

    path: SignalBase
    load: SignalBase


CASES = {
    "simple": Case(path=Ramp(times=(3.75, 11.25), values=(1.25, 3.75)), load=Constant(amount=-50.0)),
    "evolved": Case(path=Ramp(times=(3.75, 7.5, 11.25), values=(1.25, 3.75, 1.25)), load=Chirp(amplitude=50.0,
     times=(0.0, 7.5, 15.0), frequencies=(1.0, 10.0, 1.0))),
}  # fmt: skip


def slider_row(nodes: Array, offset: float = 0.0) -> Row:
    """Row w(s + offset) = 0, with w the cubic Hermite interpolation between nodes of equal distance."""
    h = nodes[1] - nodes[0]
    shapes = np.array(  # N2, N3, N5, N6 in powers x^3 ... x^0 of the local coordinate
        [
            [2.0 / h**3, -3.0 / h**2, 0.0, 1.0],
            [1.0 / h**2, -2.0 / h, 1.0, 0.0],
            [-2.0 / h**3, 3.0 / h**2, 0.0, 0.0],
            [1.0 / h**2, -1.0 / h, 0.0, 0.0],
        ]
    )
    elements = np.arange(len(nodes) - 1)
    dofs = 3 * elements[:, None] + np.array([1, 2, 4, 5])
    coefficients = np.repeat(shapes.T[:, None, :], len(elements), axis=1)
    return row_on_coordinates(f"slider {offset:g}", nodes - offset, dofs, coefficients, 3 * len(nodes))


def full_body(elements: int) -> FullBody:
    """Full model of the paper's beam: pinned, with one slider, a load at the tip, and w of all nodes as outputs."""
    nodes = np.linspace(0.0, LENGTH, elements + 1)
    M, K = beam_matrices(nodes)
    n, domain = len(M), (0.0, LENGTH)
    B = np.zeros((n, 1))
    B[n - 2, 0] = 1.0
    rows = (
        *(fixed_row(name, sparse_row(dof, 1.0, n), domain) for dof, name in enumerate(("pin x", "pin y"))),
        slider_row(nodes),
    )
    return FullBody(
        M=sp.csr_matrix(M),
        D=sp.csr_matrix((n, n)),
        K=sp.csr_matrix(K),
        B=B,
        outputs=sp.eye(n, format="csr")[1::3],
        rows=Rows(rows, n),
        input_names=(TIP_LOAD,),
        output_positions=nodes,
    )


def with_curvature(full: FullBody, element: int) -> FullBody:
    """Add the curvature in 1/m at the end of an element to the outputs, as a strain gauge there would measure it."""
    h, first = full.output_positions[1], 3 * element
    row = np.zeros((1, full.size))
    row[0, [first + 1, first + 2, first + 4, first + 5]] = [6.0 / h**2, 2.0 / h, -6.0 / h**2, 4.0 / h]
    places = full.output_positions
    return replace(
        full,
        outputs=sp.csr_matrix(sp.vstack([full.outputs, row])),
        output_positions=np.append(places, places[element + 1]),
        output_units=("m",) * len(places) + ("1/m",),
        output_names=(*(f"w{k}" for k in range(len(places))), "gauge"),
        output_kinds=(*("beam z",) * (len(places) - 1), "tip z", "probe"),
    )


def rich_body() -> FullBody:
    """Full model with damping, two sliders 0.8 m apart, a tip force and a moment, in 21 coordinates."""
    plain = full_body(elements=6)
    B = np.zeros((plain.size, 2))
    B[-2, 0] = B[11, 1] = 1.0  # force at the tip, moment in the middle
    rows = (*plain.rows.rows, slider_row(plain.output_positions, offset=0.8))
    return replace(
        plain,
        D=(0.4 * plain.M + 2e-4 * plain.K).tocsr(),
        rayleigh=Rayleigh(0.4, 2e-4),
        B=B,
        rows=Rows(rows, plain.size),
        input_names=(TIP_LOAD, "T"),
    )


def paper_basis(full: FullBody, snapshots: int, modes: int, coordinates: int) -> Array:
    """POD basis (n, r) by SVD of mass-normalised eigenmodes with the slider at nodes spread over the beam.

    The pinned coordinates are left out of the SVD, which would else give them entries of 1e-10 (see
    `test_paper_figures_need_noise`).
    """
    M, K = full.M.toarray(), full.K.toarray()
    nodes = len(M) // 3
    pool = []
    for k in range(snapshots):
        node = int(2 + (nodes - 2) * k / (snapshots - 1))  # counted from 1, as in the paper
        free = np.setdiff1d(np.arange(len(M)), [0, 1, 3 * node - 2])
        _, shapes = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)])
        modal = np.zeros((len(M), modes))
        modal[free] = shapes[:, :modes]
        pool.append(modal)
    V = np.zeros((len(M), coordinates))
    V[2:] = np.linalg.svd(np.hstack(pool)[2:], full_matrices=False)[0][:, :coordinates]
    return V


def project(full: FullBody, V: Array, tolerance: float = 1e-12) -> ReducedModel:
    """Project a model on the columns of V (n, r) by Galerkin, without the rows that V satisfies to `tolerance`."""
    rows = stack_tables([row.project(V) for row in full.rows.rows], full.domain)
    left_out = satisfied_rows(rows, tolerance)
    kept = [i for i in range(len(full.row_names)) if i not in left_out]
    return ReducedModel(
        M=V.T @ (full.M @ V),
        D=V.T @ (full.D @ V),
        rayleigh=full.rayleigh,
        K=V.T @ (full.K @ V),
        B=V.T @ full.B,
        outputs=full.outputs @ V,
        rows=type(rows)(rows.c[:, :, kept], rows.x),
        input_names=full.input_names,
        row_names=tuple(full.row_names[i] for i in kept),
        output_positions=full.output_positions,
        output_units=full.output_units,
        output_names=full.output_names,
        output_kinds=full.output_kinds,
        left_out=tuple(full.row_names[i] for i in left_out),
    )


def free_modes(full: FullBody, count: int) -> tuple[Array, Array]:
    """Lowest modes (n, count) with sliders released, and R (n, n), the flexibility of all other modes."""
    M, K = full.M.toarray(), full.K.toarray()
    free = np.setdiff1d(np.arange(full.size), list(full.held.values()))
    omega2, shapes = scipy.linalg.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)])
    phi = np.zeros((full.size, len(free)))
    phi[free] = shapes
    rest = phi[:, count:] / np.sqrt(omega2[count:])
    return phi[:, :count], rest @ rest.T


def polynomial(values: Callable[[float], Array], breaks: Array, degree: int) -> PPoly:
    """Fit a function that is a polynomial of this degree between any two breaks, through points inside."""
    x = (1.0 - np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))) / 2.0
    c = []
    for low, size in zip(breaks[:-1], np.diff(breaks), strict=True):
        found = np.array([values(low + size * point) for point in x])
        fit = np.linalg.solve(np.vander(x), found.reshape(len(x), -1))
        c.append(fit.reshape(found.shape) / size ** np.arange(degree, -1, -1).reshape(-1, *[1] * (found.ndim - 1)))
    return PPoly(np.stack(c, axis=1), breaks)


def rows_of(full: FullBody, model: ReducedModel) -> PPoly:
    """Rows C(s) (m, n) of a reduced model, on all n coordinates of the full one."""
    rows = stack_tables([row.project(np.eye(full.size)) for row in full.rows.rows], full.domain)
    return PPoly(rows.c[:, :, [full.row_names.index(name) for name in model.row_names]], rows.x)


def flexible(full: FullBody, count: int) -> ReducedModel:
    """Reduce a model to `count` free modes, with the residual flexibility of the others."""
    V, R = free_modes(full, count)
    plain = project(full, V)
    C = rows_of(full, plain)
    O, B = full.outputs.toarray(), full.B
    return replace(
        plain,
        pads=full.row_compliance[[full.row_names.index(name) for name in plain.row_names]],
        flexibility=Flexibility(
            rows=polynomial(lambda s: C(s) @ R @ C(s).T, plain.rows.x, 6),
            inputs=polynomial(lambda s: C(s) @ R @ B, plain.rows.x, 3),
            outputs=polynomial(lambda s: O @ R @ C(s).T, plain.rows.x, 3),
            direct=O @ R @ B,
            energy=B.T @ R @ B,
        ),
    )


def enriched(full: FullBody, count: int, enrichment: int = 0) -> ReducedModel:
    """Reduce a model as `flexible` does, with the next modes as enrichment and the inertia of what is truncated."""
    model = flexible(full, count)
    more = free_modes(full, count + enrichment)[0][:, count:]
    beside = EnrichmentModes(
        stiffness=np.diagonal(more.T @ full.K @ more),
        damping=np.diagonal(more.T @ full.D @ more),
        B=more.T @ full.B,
        outputs=full.outputs @ more,
    )
    carriers = replace(carried_rows(full, count), enrichment=_shared(full).carriers @ more)
    return replace(model, enrichment=beside if enrichment else None, carriers=carriers)


def carried_rows(full: FullBody, count: int) -> CarrierRows:
    """Rows that hold no coordinate on their carriers, with flexibility and inertia that `count` modes leave out."""
    V, R = free_modes(full, count)
    shared = _shared(full)
    U, O, B = shared.carriers.toarray(), full.outputs, full.B

    def between(A: Array) -> CarrierFlexibility:
        """Values of a matrix A (n, n) between carriers, inputs and outputs."""
        return CarrierFlexibility(U @ A @ U.T, U @ A @ B, O @ A @ U.T, O @ A @ B, B.T @ A @ B)

    carried = CarrierRows.from_rows(shared.rows, U @ V, between(R))
    return replace(carried, inertia=between(R @ full.M @ R))


def _shared(full: FullBody) -> SharedCarriers:
    """Carriers that the rows which hold no coordinate share."""
    return Rows(tuple(row for row in full.rows.rows if row.held_coordinate is None), full.size).shared_carriers


def generalized_alpha(
    body: SlidingBody, s: Array, f: Array, stepping: TimeStepping, start: InitialState
) -> tuple[Array, Array, Array]:
    """Coordinates q and rates v (T, n) and multipliers lambda (T, m) after Arnold, Bruels 2007; dense and slow.

    The path is s (T,) in m, the loads are f (T, i).  The initial acceleration leaves out the rows' own motion, as
    Exudyn does.
    """
    M, D, K = (A.toarray() if sp.issparse(A) else A for A in (body.M, body.D, body.K))
    h, rho = stepping.step, stepping.rho_inf
    a_m, a_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 + a_f - a_m
    beta = (gamma + 0.5) ** 2 / 4.0
    to_v, to_q = gamma * h * (1.0 - a_f) / (1.0 - a_m), beta * h**2 * (1.0 - a_f) / (1.0 - a_m)

    def rows(s_k: float, f_k: Array) -> tuple[Array, Array, Array]:
        """C (m, n), F = G + 1/k (m, m) and H f (m,) at a path coordinate and loads."""
        C, F = body.C(s_k).toarray() if sp.issparse(body.K) else body.C(s_k), np.diag(body.row_compliance)
        if body.flexibility is None:
            return C, F, np.zeros(len(C))
        return C, F + body.flexibility.rows(s_k), body.flexibility.inputs(s_k) @ f_k

    def solve(A: Array, C: Array, F: Array, right: Array, g: Array) -> tuple[Array, Array]:
        """Solve A x + C^T y = right and C x - F y = g for x and y."""
        x = np.linalg.solve(np.block([[A, C.T], [C, -F]]), np.concatenate([right, g]))
        return x[: len(A)], x[len(A) :]

    q, v = start.q, start.v
    C, F, Hf = rows(s[0], f[0])
    multiplier = np.linalg.lstsq(F, C @ q + Hf, rcond=1e-14)[0]  # of the rows that give way
    firm = np.all(F == 0.0, axis=1)
    right = body.B @ f[0] - K @ q - D @ v - C.T @ multiplier
    acceleration, multiplier[firm] = solve(M, C[firm], F[np.ix_(firm, firm)], right, np.zeros(firm.sum()))
    a = acceleration
    kept = [(q, v, multiplier)]
    for s_k, f_k in zip(s[1:], f[1:], strict=True):
        C, F, Hf = rows(s_k, f_k)
        a_next = (a_f * acceleration - a_m * a) / (1.0 - a_m)
        q = q + h * v + h**2 * ((0.5 - beta) * a + beta * a_next)
        v = v + h * ((1.0 - gamma) * a + gamma * a_next)
        effective, right = M + to_v * D + to_q * K, body.B @ f_k - K @ q - D @ v
        # C (q + to_q acceleration) + H f - F lambda = 0
        acceleration, multiplier = solve(effective, C, F / to_q, right, -(C @ q + Hf) / to_q)
        q, v, a = (q + to_q * acceleration, v + to_v * acceleration, a_next + (1.0 - a_f) / (1.0 - a_m) * acceleration)
        kept.append((q, v, multiplier))
    return tuple(np.array(values) for values in zip(*kept, strict=True))  # type: ignore[return-value]


def nrms_error(signal: Array, reference: Array) -> float:
    """Error e_NRMS of the paper for signals (T, M): RMS error over RMS of the reference, mean over M, at most 1.

    Signals whose reference is zero are left out of the mean.
    """
    rms = np.sqrt(np.mean(reference**2, axis=0))
    counted = rms > 1e-10
    error = np.sqrt(np.mean((signal - reference) ** 2, axis=0))
    return min(float(np.mean(error[counted] / rms[counted])), 1.0)


def started(body: SlidingBody, s: float, s_rate: float, initial: InitialState | None) -> InitialState:
    """Consistent start of a body alone with its slider at s m, which moves by s_rate m/s."""
    system = System.of(body)
    x = system.side_coordinates({SLIDER: s})
    x_rate = np.array([s_rate if side.place.path else 0.0 for side in system.sides])
    return consistent_start(Assembly(system), x, x_rate, {} if initial is None else {ALONE: initial})[ALONE]


def with_pads(body: Any, *compliances: float) -> Any:
    """Full body or model whose rows are on pads with these compliances in m/N; 0 stands for a rigid row."""
    rows = [replace(row, compliance=c) for row, c in zip(body.rows.rows, compliances, strict=True)]
    return replace(body, rows=Rows(tuple(rows), body.size))


def couples_modes(form: ModalForm) -> bool:
    """Whether the damping couples modes."""
    return bool(np.any(form.body.D - np.diag(np.diagonal(form.body.D))))
