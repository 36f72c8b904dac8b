"""What pads with play hold although a term tips it: a bar, a chain of masses; their equilibria, in NumPy alone."""

from itertools import product

import numpy as np
from scipy.interpolate import PPoly

from pmr import ReducedModel, System
from pmr.files.arrays import Array
from pmr.system.contacts import Contact, Place
from pmr.system.terms import Term

#: Stiffness of the bar's translation, turning and bending, each of unit mass; what each pad pushes against, pads above
#: and below; and the matrix of the term, of which the amplitude is taken from the stiffness of turning.
STIFFNESS = np.diag([1.0, 1.0, 50.0])
_ALONG = np.arange(4.0) - 1.5
_ABOVE = np.column_stack([np.ones(4), _ALONG, _ALONG**2 - 1.25])
ROWS = np.vstack([_ABOVE, -_ABOVE])
TURNING = np.diag([0.0, 1.0, 0.0])


def bar_between_pads(seed: int) -> System:
    """Pads of random stiffness and play, and a load of random direction; its term needs an amplitude."""
    random, one = np.random.default_rng(seed), np.eye(3)
    load, names = random.normal(size=(3, 1)), tuple(f"pad {k}" for k in range(len(ROWS)))
    rows = PPoly(ROWS.reshape(1, 1, len(ROWS), 3), [0.0, 1.0])
    body = ReducedModel(one, 0.0 * one, STIFFNESS, load, one[:1], rows, ("F",), names, np.zeros(1))
    compliance, clearance = random.uniform(5e-4, 2e-3, len(ROWS)), random.uniform(0.0, 0.02, len(ROWS))
    pads = tuple(
        Contact(name, Place("bar", name, 0.0), compliance=give, clearance=play)
        for name, give, play in zip(names, compliance, clearance, strict=True)
    )
    return System({"bar": body}, pads, terms=(Term("pressed", ("bar",), stiffness=TURNING),))


def stable_equilibria(system: System, load: float, amplitude: float) -> Array:
    """Coordinates (e, 3) of all stable equilibria: every set of closed pads is tried, each pad a spring."""
    springs, clearance = np.array([1.0 / pad.compliance for pad in system.contacts]), system.clearance
    push, equilibria = load * np.asarray(system.bodies["bar"].B)[:, 0], list[Array]()
    for closed in map(np.array, product([False, True], repeat=len(ROWS))):
        pressed = np.where(closed, springs, 0.0)
        K = STIFFNESS + amplitude * TURNING + ROWS.T @ (pressed[:, None] * ROWS)
        if np.linalg.eigvalsh(K)[0] > 0.0:
            q = np.linalg.solve(K, push + ROWS.T @ (pressed * clearance))
            if np.array_equal(ROWS @ q > clearance, closed):
                equilibria.append(q)
    return np.array(equilibria).reshape(-1, 3)


#: Play of the stop at the end of a chain.
PLAY = 0.5


def chain_on_a_stop(n: int) -> tuple[System, float, float]:
    """A chain of n unit masses on springs of unit stiffness, whose end a load moves to a rigid stop.

    Its term softens each mass alike.  Also, the lowest stiffness with a free end and with a fixed one.
    """
    K = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    K[-1, -1] = 1.0
    end = np.eye(n)[:, -1:]
    rows = PPoly(end.reshape(1, 1, 1, n), [0.0, 1.0])
    body = ReducedModel(np.eye(n), np.zeros((n, n)), K, end, end.T, rows, ("F",), ("stop",), np.zeros(1))
    stop = Contact("stop", Place("chain", "stop", 0.0), clearance=PLAY)
    system = System({"chain": body}, (stop,), terms=(Term("pressed", ("chain",), stiffness=np.eye(n)),))
    free, fixed = (float(np.linalg.eigvalsh(matrix)[0]) for matrix in (K, K[:-1, :-1]))
    return system, free, fixed


def bent_chain(system: System, softer: float) -> Array:
    """Coordinates (n,) of a chain whose end is on its stop, each mass that much softer."""
    K = np.asarray(system.bodies["chain"].K)
    K = K - softer * np.eye(len(K))
    return np.append(np.linalg.solve(K[:-1, :-1], -K[:-1, -1] * PLAY), PLAY)
