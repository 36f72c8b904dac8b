"""Small systems with terms that vary in time, and references for them: merged matrices, closed forms."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.interpolate import PPoly

from pmr import ReducedModel, System
from pmr.files.arrays import Array
from pmr.scene.signals import Constant, SmoothRamp
from pmr.scene.signals.base import SignalBase
from pmr.simulation import Excitation, TimeStepping
from pmr.system.terms import Term


def axial(system: System, share: float = 0.3) -> tuple[Term, ...]:
    """Terms like those of an axial force: a share of K on each body, and a matrix between the first two."""
    rng, names = np.random.default_rng(5), list(system.bodies)
    found = []
    for name in (*((one,) for one in names), tuple(names[:2])):
        sizes = [system.bodies[one].size for one in name]
        n = sum(sizes)
        K = np.zeros((n, n))
        for one, at in zip(name, np.cumsum([0, *sizes]), strict=False):
            A = system.bodies[one].K
            own = slice(at, at + system.bodies[one].size)
            K[own, own] = A.toarray() if hasattr(A, "toarray") else A
        if len(name) == 2:
            p = rng.normal(size=n) * np.sqrt(np.diagonal(K))
            K = np.outer(p, p) / n
        found.append(Term(f"N {' '.join(name)}", name, stiffness=share * K))
    return tuple(found)


def merged(system: System, c: Mapping[str, float]) -> System:
    """Add terms that are on one body each, at constant amplitudes c, to K and D of their bodies."""
    bodies = dict(system.bodies)
    for term in system.terms:
        (name,) = term.bodies
        for key, field in {"stiffness": "K", "damping": "D"}.items():
            if (A := getattr(term, key)) is not None:
                bodies[name] = replace(bodies[name], **{field: getattr(bodies[name], field) + c[term.name] * A})
    return replace(system, bodies=bodies, terms=())


def excitation(system: System, stepping: TimeStepping, terms: Mapping[str, SignalBase]) -> Excitation:
    """Excitation by paths that extend smoothly, constant loads, and amplitudes of terms."""
    paths = {
        name: SmoothRamp(times=(0.1, 0.6), values=(high - 0.3 * (high - low), high - 0.5 * (high - low)))
        for name, (low, high) in system.ranges.items()
    }
    loads = {name: Constant(amount=5.0 if "gravity" in name else 300.0) for name in system.input_names}
    return Excitation(paths, loads, stepping, terms=terms)


def geometric_stiffness(x: Array, force: Array) -> Array:
    """Geometric stiffness of a planar beam with nodes at x (n,) in m, under tensions (n - 1,) in N of its elements.

    Coordinates are deflection and slope of each node, so the matrix is (2 n, 2 n).
    """
    found = np.zeros((2 * len(x),) * 2)
    for k, (L, N) in enumerate(zip(np.diff(x), force, strict=True)):
        element = np.array(
            [
                [36.0, 3 * L, -36.0, 3 * L],
                [3 * L, 4 * L**2, -3 * L, -(L**2)],
                [-36.0, -3 * L, 36.0, -3 * L],
                [3 * L, -(L**2), -3 * L, 4 * L**2],
            ]
        )
        found[2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += N / (30.0 * L) * element
    return found


def masses(M: Array, K: Array) -> ReducedModel:
    """Reduced model of masses M (n, n) on springs K (n, n), with a force on the first coordinate."""
    n, eye = len(M), np.eye(len(M))
    rows, zero = PPoly(np.zeros((1, 1, 0, n)), [0.0, 1.0]), np.zeros((n, n))
    return ReducedModel(M, zero, K, eye[:, :1], eye, rows, ("F",), (), np.zeros(n))


#: What a frame turns: J of an angular velocity, about the axis across the plane.
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def turning(m: float, k: tuple[float, float]) -> System:
    """Mass m in kg on two springs k in N/m in a frame that turns at W rad/s: M q'' + 2 W M J q' + (K - W^2 M) q = 0.

    Its terms have the amplitudes W and W^2.
    """
    M = m * np.eye(2)
    body = masses(M, np.diag(k))
    terms = (Term("turning", ("mass",), damping=2.0 * m * TURN), Term("spin", ("mass",), stiffness=-M))
    return System({"mass": body}, (), terms=terms)


def turning_frequencies(m: float, k: tuple[float, float], W: float) -> Array:
    """Frequencies (2,) in Hz, ascending, of the mass that `turning` describes.

    They solve s^4 + (a + b + 4 W^2) s^2 + a b = 0 with a, b = k / m - W^2.
    """
    a, b = (one / m - W**2 for one in k)
    return np.sqrt(np.sort(-np.roots([1.0, a + b + 4.0 * W**2, a * b]).real)) / (2.0 * np.pi)
