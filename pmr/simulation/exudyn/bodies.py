r"""Three ways of having Exudyn know the rows and loads of a sliding body.

Updated: rows and loads are set once a step; rows that give way are no constraints but springs that travel,
``K(s) = K + C^T F^-1 C`` (`pmr.system.compliant_rows`).  With multipliers: rows that give way keep theirs,
for comparison.  Called: as in the paper, Python is called for rows, their Jacobian and loads in every iteration, for
comparison.
"""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
import scipy.sparse as sp
from exudyn.itemInterface import MarkerNodeCoordinates, ObjectGenericODE2
from numpy.typing import NDArray

from pmr.simulation.exudyn.inputs import Inputs, moving_rows
from pmr.simulation.exudyn.items import SlidingBodyItems, Steps, add_body, add_coordinates, matrix, with_rows
from pmr.simulation.start import InitialState
from pmr.system.body import SlidingBody
from pmr.system.compliant_rows import CompliantRows

Array = NDArray[np.float64]


def add_updated_body(mbs: Any, body: SlidingBody, inputs: Inputs, start: InitialState) -> SlidingBodyItems:
    """Items of a body whose rows, travelling springs and loads are set once a step.

    A sparse body with rows that give way is handed on to `add_body_with_multipliers`: springs would fill its
    stiffness anew in every step.
    """
    n, compliant = body.size, CompliantRows(body)
    if compliant.numbers and sp.issparse(body.K):
        return add_body_with_multipliers(mbs, body, inputs, start)
    firm = [i for i in moving_rows(body) if i not in compliant.numbers]
    rows = inputs.along(lambda s: body.dense_rows(s)[:, firm], n * len(firm))
    system = inputs.along(compliant.system, n * (n + len(body.input_names)))

    def force(t: float) -> Array:
        B = system(t)[:, n:] if compliant.numbers else body.B
        return np.asarray(B @ np.array(inputs.loads(t)))

    stiffness = {"stiffnessMatrix": matrix(system(0.0)[:, :n])} if compliant.numbers else {}
    steps = Steps(held=bool(firm))
    jacobian = _nothing_beyond_matrices(body, steps)
    items = add_body(mbs, body, start, forceVector=force(0.0), jacobianUserFunction=jacobian, **stiffness)
    items = with_rows(mbs, items, firm, scalingMarker1=rows(0.0))
    s_set, loads_set = inputs.position(0.0), inputs.loads(0.0)

    def update(mbs: Any, t: float) -> bool:
        nonlocal s_set, loads_set
        s, loads = inputs.position(t), inputs.loads(t)
        if s != s_set and firm:
            mbs.SetObjectParameter(items.oSlider, "scalingMarker1", rows(t))
        if s != s_set and compliant.numbers:
            mbs.SetObjectParameter(items.oBody, "stiffnessMatrix", system(t)[:, :n])
        if loads != loads_set or (s != s_set and compliant.numbers):
            mbs.SetObjectParameter(items.oBody, "forceVector", force(t))
        s_set, loads_set = s, loads
        return True

    return steps.updated(mbs, items, update)


def add_body_with_multipliers(mbs: Any, body: SlidingBody, inputs: Inputs, start: InitialState) -> SlidingBodyItems:
    r"""Items of a body with constraints for all rows, also for those that give way.

    Coordinates w without mass, one a row, carry what gives way:

    .. math:: C q + H f - F w = 0 \quad (\lambda), \qquad F w - F \lambda = 0

    so that w = lambda in N.  Rows that hold firm have w = 0.
    """
    n, numbers, compliant = body.size, moving_rows(body), CompliantRows(body)
    m, gives = len(numbers), np.array([numbers.index(i) for i in compliant.numbers], int)
    firm = np.diag([float(a not in gives) for a in range(m)])

    def rows(s: Array) -> Array:
        """C, F and H side by side."""
        F, H = np.zeros((len(s), m, m)), np.zeros((len(s), m, len(body.input_names)))
        F[:, gives[:, None], gives] = compliant.flexibility(s)
        H[:, gives] = compliant.inputs(s)
        return np.concatenate([body.dense_rows(s)[:, numbers], F, H], axis=2)

    table = inputs.along(rows, m * (n + m + len(body.input_names)))

    def parts(t: float) -> tuple[Array, Array, Array]:
        C, F, H = np.split(table(t), [n, n + m], axis=1)
        return C, F, -H @ np.array(inputs.loads(t))

    C, F, offset = parts(0.0)
    forces = np.zeros(m)
    forces[gives] = np.linalg.solve(F[np.ix_(gives, gives)], (C @ start.q - offset)[gives])
    steps = Steps(held=bool(numbers))
    jacobian, force = _nothing_beyond_matrices(body, steps), body.B @ np.array(inputs.loads(0.0))
    items = add_body(mbs, body, start, forceVector=force, jacobianUserFunction=jacobian)
    name = f"{mbs.GetMarker(items.mBody)['name']}Rows"
    nRows = add_coordinates(mbs, name, InitialState(forces, np.zeros(m)))
    nothing = exu.MatrixContainer(np.zeros((m, m)))
    oRows = mbs.AddObject(
        ObjectGenericODE2(
            name=name,
            nodeNumbers=[nRows],
            massMatrix=firm,
            stiffnessMatrix=F + firm,
            jacobianUserFunction=lambda *arguments: nothing,
        )
    )
    mRows = mbs.AddMarker(MarkerNodeCoordinates(name=name, nodeNumber=nRows))
    items = with_rows(mbs, items, numbers, mRows, scalingMarker0=F, scalingMarker1=C, offset=offset)

    def update(mbs: Any, t: float) -> bool:
        C, F, offset = parts(t)
        mbs.SetObjectParameter(items.oSlider, "scalingMarker0", F)
        mbs.SetObjectParameter(items.oSlider, "scalingMarker1", C)
        mbs.SetObjectParameter(items.oSlider, "offset", offset)
        mbs.SetObjectParameter(oRows, "stiffnessMatrix", F + firm)
        mbs.SetObjectParameter(items.oBody, "forceVector", body.B @ np.array(inputs.loads(t)))
        return True

    return steps.updated(mbs, items, update)


def add_called_body(mbs: Any, body: SlidingBody, inputs: Inputs, start: InitialState) -> SlidingBodyItems:
    """Items of a body whose rows and loads Exudyn asks for in every iteration: the paper's way, for firm rows alone."""
    numbers = moving_rows(body)
    rows = inputs.along(lambda s: body.dense_rows(s)[:, numbers], body.size * len(numbers))

    def force(mbs: Any, t: float, item: int, q: Any, q_t: Any) -> Any:
        return body.B @ np.array(inputs.loads(t))

    def constraint(mbs: Any, t: float, item: int, q: Any, q_t: Any, velocity_level: bool) -> Any:
        return rows(t) @ q

    def jacobian(mbs: Any, t: float, item: int, q: Any, q_t: Any, velocity_level: bool) -> Any:
        return rows(t)

    return with_rows(
        mbs,
        add_body(mbs, body, start, forceUserFunction=force),
        numbers,
        scalingMarker0=np.zeros((len(numbers), 1)),  # its height is the number of rows
        constraintUserFunction=constraint,
        jacobianUserFunction=jacobian,
    )


def _nothing_beyond_matrices(body: SlidingBody, steps: Steps) -> Any:
    """Jacobian of the body's forces beyond K and D, which Exudyn adds itself; without it, it would difference K q."""
    no_more = matrix(sp.csr_matrix(body.K.shape) if sp.issparse(body.K) else np.zeros_like(body.K))

    def jacobian(mbs: Any, t: float, item: int, q: Any, q_t: Any, factor: float, factor_t: float) -> Any:
        steps.check(t)
        return no_more

    return jacobian
