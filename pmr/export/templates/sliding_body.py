"""A reduced system in Exudyn.

    M q'' + D q' + K q + C(s)^T lambda = B f(t),    C(s) q + H(s) f - F(s) lambda = 0,
    y = outputs q + W f - X(s) lambda

with reduced coordinates q of all bodies, path coordinates s(t) and outputs y; SI units throughout.  A contact that only
pushes has a clearance c and obeys 0 <= lambda, 0 <= c + F lambda - C q - H f, one of them zero.

Written by pmr; needs numpy, scipy and exudyn, and the file of the same name that ends in .npz beside it.
"""

import warnings
from pathlib import Path
from types import SimpleNamespace

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from scipy.optimize import nnls

with np.load(Path(__file__).with_suffix(".npz")) as file:
    DATA = dict(file)
CLEARANCE = DATA["clearance"]  # (m,) m; NaN of a contact that holds both ways
RIGID = DATA["rigid"]  # (m,) which contacts do not give way


def piece(name, x, order=0):
    """Value of a piecewise polynomial at x, or its derivative (order 1).

    Beyond its ends it is constant; if it has no break at the upper end, the last piece extends to infinity.
    """
    breaks, c = DATA[f"{name}.breaks"], DATA[name]  # (powers, pieces, ...), the highest power first
    if len(breaks) > c.shape[1]:
        x = min(max(x, breaks[0]), breaks[-1])
    k = min(max(int(np.searchsorted(breaks, x, side="right")) - 1, 0), c.shape[1] - 1)
    c = c[:-1, k] * np.arange(len(c) - 1, 0, -1) if order else c[:, k]
    return np.polyval(c, x - breaks[k])


def strand(k, t, order=0):
    """Value of a part of a signal at t, p + a sin(q) with polynomials p and q of t, or its rate (order 1)."""
    p, q, a, h = f"strands.{k}", f"strands.{k}.angle", DATA["strands.amplitude"][k], DATA["strands.spread"][k]
    if h > 0.0 and not order:  # the acceleration of a path: by how much its rate grows within a step
        first, last = max(t - h / 2.0, 0.0), t + h / 2.0
        return (strand(k, last, 1) - strand(k, first, 1)) / (last - first)
    if order:
        return piece(p, t, 1) + a * np.cos(piece(q, t)) * piece(q, t, 1)
    return piece(p, t) + a * np.sin(piece(q, t))


def signals(names, first):
    """Functions of t in s by `names`, for the scene's signals from number `first` on."""
    of = [np.flatnonzero(DATA["strands.signal"] == first + k) for k in range(len(names))]
    return {
        str(name): lambda t, some=some: sum(strand(k, t) for k in some) for name, some in zip(names, of, strict=True)
    }


# --- What happens: change it here, as in LOADS["F"] = lambda t: -100.0 * t --------------------------

TITLE = str(DATA["title"])
PATHS = signals(DATA["paths"], 0)  # s(t) in m
LOADS = signals(DATA["inputs"], len(PATHS))  # each in the unit of its input, a column of B
END, STEP, RHO_INF = (float(x) for x in DATA["time"])  # s, s, spectral radius at infinite frequency
PARTS = int(DATA["parts"])  # of each step: more than one where contacts only push
START = DATA["start"]  # (n,) coordinates at t = 0

# --- The system in Exudyn ---------------------------------------------------------------------------


def rows_at(s):
    """Namespace of the contacts' matrices with the P paths at the positions in the list s in m.

    C (m, n) are displacements of the m contacts by the coordinates, H (m, i) by the inputs and F (m, m) by the
    contacts' own forces.  X (o, m) are displacements of the outputs by these forces.
    """
    if "C" in DATA:  # one body, by tables over its path, if it has one
        return SimpleNamespace(**{name: piece(name, s[0] if s else DATA["C.breaks"][0]) for name in "CFHX"})
    m, (o, n), i = len(CLEARANCE), DATA["outputs"].shape, DATA["B"].shape[1]
    rows = SimpleNamespace(C=np.zeros((m, n)), F=DATA["compliance"].copy(), H=np.zeros((m, i)), X=np.zeros((o, m)))
    for body in np.unique(DATA["sides.body"]):
        touched, shares = [], []  # carriers of the body, and how contacts act on them
        for k in np.flatnonzero(DATA["sides.body"] == body):
            path, x = DATA["sides.path"][k], DATA["sides.at"][k]
            x = x if path < 0 else x + DATA["sides.rate"][k] * s[path]
            touched.append(piece(f"sides.{k}.touched", x).astype(int))
            weights = piece(f"sides.{k}", x)
            shares.append(np.zeros((m, len(weights))))
            shares[-1][DATA["sides.contact"][k]] = weights
        at, b = np.concatenate(touched), np.hstack(shares)
        V, R, on_inputs, on_outputs = (DATA[f"bodies.{body}.{name}"] for name in ("V", "R", "H", "X"))
        rows.C += b @ V[at]
        rows.F += b @ R[np.ix_(at, at)] @ b.T
        rows.H += b @ on_inputs[at]
        rows.X += on_outputs[:, at] @ b.T
    return rows


def forces_of(rows, motion):
    """Forces (m,) in N of contacts that give way, by their motion C q + H f (m,) in m; mask (m,) of closed ones.

    The forces of rigid contacts are zero.
    """
    F, gives = rows.F, ~RIGID
    pushes, b = gives & ~np.isnan(CLEARANCE), motion - np.nan_to_num(CLEARANCE)
    bilateral, closed = gives & ~pushes, gives.copy()
    if pushes.any():  # F = L L^T of those that push: least squares |L^T lambda - L^-1 b| with lambda >= 0
        held = np.linalg.solve(F[bilateral][:, bilateral], np.column_stack([F[bilateral][:, pushes], b[bilateral]]))
        compliance = np.column_stack([F[pushes][:, pushes], b[pushes]]) - F[pushes][:, bilateral] @ held
        L = np.linalg.cholesky(compliance[:, :-1])
        closed[pushes] = nnls(L.T, np.linalg.solve(L, compliance[:, -1]))[0] > 0.0
    forces = np.zeros(len(b))
    forces[closed] = np.linalg.solve(F[closed][:, closed], b[closed])
    return forces, closed


def add_system(mbs, paths, loads, start):
    """Add the bodies to an mbs: return `update`, nodes of the bodies, their common object, connector of rigid contacts.

    Contacts that give way are springs that travel, K + C^T F^-1 C; rigid ones have multipliers.  If some only push,
    their forces are computed in every iteration.
    """
    M, D, K, B, n = DATA["M"], DATA["D"], DATA["K"], DATA["B"], len(start)
    pushing, last = not np.isnan(CLEARANCE).all(), SimpleNamespace(t=None)

    def at(t):
        """Rows of the contacts, stiffness and forces at t = 0 or at the end of a step; computed once for each t."""
        if last.t != t:
            rows, f = rows_at([path(t) for path in paths.values()]), np.array([load(t) for load in loads.values()])
            last.t, last.f, last.rows, last.K, last.force = t, f, rows, K, B @ f
            if not pushing:
                C, F, H = rows.C[~RIGID], rows.F[~RIGID][:, ~RIGID], rows.H[~RIGID]
                springs = C.T @ np.linalg.solve(F, np.hstack([C, H]))
                last.K, last.force = K + springs[:, :n], B @ f - springs[:, n:] @ f
        return last

    def push(mbs, t, item, q, q_t):
        """User function: forces of the contacts on the coordinates, where some only push."""
        now = at(t)
        return -now.rows.C.T @ forces_of(now.rows, now.rows.C @ q + now.rows.H @ now.f)[0]

    def beyond_matrices(mbs, t, item, q, q_t, factor, factor_t):
        """User function: stiffness of the contacts, where some only push; else zero."""
        # Exudyn adds K and D to the Jacobian itself; given the rest, it needs no differences.
        if t > mbs.variables.get(item, 0.0):
            raise ValueError("another SetPreStepUserFunction took the place of `update`: call both from one function")
        if not pushing:
            return exu.MatrixContainer(np.zeros((n, n)))
        rows, f = at(t).rows, at(t).f
        closed = forces_of(rows, rows.C @ q + rows.H @ f)[1]
        C = rows.C[closed]
        return exu.MatrixContainer(factor * C.T @ np.linalg.solve(rows.F[closed][:, closed], C))

    nBodies = []
    for q in np.split(np.asarray(start), DATA["ends"][:-1]):
        zeros = np.zeros(len(q))
        coordinates = dict(referenceCoordinates=zeros, initialCoordinates=q, initialCoordinates_t=zeros)
        nBodies.append(mbs.AddNode(eii.NodeGenericODE2(numberOfODE2Coordinates=len(q), **coordinates)))
    functions = {"jacobianUserFunction": beyond_matrices} | ({"forceUserFunction": push} if pushing else {})
    matrices = dict(massMatrix=M, dampingMatrix=D, stiffnessMatrix=at(0.0).K, forceVector=at(0.0).force)
    oSystem, oRigid = mbs.AddObject(eii.ObjectGenericODE2(nodeNumbers=nBodies, **matrices, **functions)), None
    if RIGID.any():
        ground = mbs.AddMarker(eii.MarkerNodeCoordinates(nodeNumber=mbs.AddNode(eii.NodePointGround())))
        bodies = mbs.AddMarker(eii.MarkerObjectODE2Coordinates(objectNumber=oSystem))
        connector = dict(markerNumbers=[ground, bodies], scalingMarker1=at(0.0).rows.C[RIGID])
        oRigid = mbs.AddObject(eii.ObjectConnectorCoordinateVector(**connector))

    def update(mbs, t):
        """Pre-step function: set stiffness, forces and rows to those at t."""
        # Called once before each step, with the time at its end: there the equations have to hold.
        now = at(t)
        mbs.SetObjectParameter(oSystem, "stiffnessMatrix", now.K)
        mbs.SetObjectParameter(oSystem, "forceVector", now.force)
        if oRigid is not None:
            mbs.SetObjectParameter(oRigid, "scalingMarker1", now.rows.C[RIGID])
        mbs.variables[int(oSystem)] = t
        return True

    mbs.SetPreStepUserFunction(update)
    return SimpleNamespace(update=update, nBodies=nBodies, oSystem=oSystem, oRigid=oRigid)


def solve(mbs, end, step, rho_inf, parts=1):
    """Assemble and integrate to `end` (s), each `step` (s) divided into equal parts."""
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = step
    settings.linearSolver.solverType = exu.LinearSolverType.EigenDense
    settings.timeIntegration.endTime = end
    settings.timeIntegration.numberOfSteps = round(end / step) * parts
    settings.timeIntegration.adaptiveStep = settings.timeIntegration.automaticStepSize = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = rho_inf
    settings.timeIntegration.newton.useModifiedNewton = False
    mbs.SolveDynamic(settings)


def simulate(paths=PATHS, loads=LOADS, end=END, step=STEP, rho_inf=RHO_INF, start=START, parts=PARTS):
    """Times (T,) in s and the outputs (T, o) of all bodies, in m except for forces and rotations."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items, kind = add_system(mbs, paths, loads, start), exu.OutputVariableType
    nodes = [dict(nodeNumber=node, outputVariableType=kind.Coordinates, storeInternal=True) for node in items.nBodies]
    sensors = [mbs.AddSensor(eii.SensorNode(**node)) for node in nodes]
    if items.oRigid is not None:
        of_rigid = eii.SensorObject(objectNumber=items.oRigid, outputVariableType=kind.Force, storeInternal=True)
        sensors.append(mbs.AddSensor(of_rigid))
    solve(mbs, end, step, rho_inf, parts)
    stored = [mbs.GetSensorStoredData(sensor) for sensor in sensors]
    t, q = stored[0][:, 0], np.hstack([values[:, 1:] for values in stored[: len(items.nBodies)]])
    alternating = np.diff(q, 8, axis=0) / 2.0**8  # what changes its sign with every step
    if not (alternating**2).sum() <= 1e-6 * (q**2).sum():
        warnings.warn(
            "The motion changes its sign with every step: a constraint that moves (index 3) grows where RHO_INF is "
            "near 1, or STEP is too long for the motion. These results can't be trusted.",
            stacklevel=2,
        )
    y = np.empty((len(t), len(DATA["outputs"])))
    for k, time in enumerate(t):
        rows, f = rows_at([path(time) for path in paths.values()]), np.array([load(time) for load in loads.values()])
        forces = forces_of(rows, rows.C @ q[k] + rows.H @ f)[0]
        if items.oRigid is not None:
            forces[RIGID] = stored[-1][k, 1:]
        y[k] = DATA["outputs"] @ q[k] + DATA["W"] @ f - rows.X @ forces
    return t, y


def main():
    """Simulate, and print how the tip moves."""
    t, y = simulate()
    tip = y[:, DATA["tip"]]
    print(f"Displacement{DATA['tip_of']} at x = {DATA['tip_position']:g} m over {t[-1]:g} s:")
    for name, value in (("smallest", tip.min()), ("largest", tip.max()), ("last", tip[-1])):
        print(f"  {name}: {1e3 * value:.4f} mm")


if __name__ == "__main__":
    main()
