"""Eigenmodes with the slider held at several positions: the paper's snapshots.

Weyrer, Gerstmayr, Mikkola, Orzechowski: Model Order Reduction of a Sliding Beam using a Global Basis, section
"Snapshot Selection".
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.elimination import DependentRowsError
from pmr.fullmodel.model import FullModel
from pmr.reduction.snapshots import Snapshots
from pmr.scene import Scene

Array = NDArray[np.float64]


def node_set(nodes: int, snapshots: int) -> NDArray[np.int64]:
    """Node numbers, counted from 1, at which the paper holds the slider: never the first node.

    floor(nodes / 2) for one snapshot, floor(2 + (nodes - 2) k / (snapshots - 1)), k = 0 ... snapshots - 1, for more.
    """
    if snapshots == 1:
        return np.array([nodes // 2])
    return 2 + (nodes - 2) * np.arange(snapshots) // (snapshots - 1)


def positions(scene: Scene, model: FullModel) -> Array:
    """Path coordinates (snapshots,) in m at which the scene asks for snapshots.

    ``nodes``: the paper's node set, with the first slider on nodes that leave all sliders on the beam; ``path``: evenly
    over the stretch that the path visits; or as listed.  Raises InputError if two snapshots fall on one node.
    """
    choice, count = scene.reduction.positions, scene.reduction.snapshots
    if choice == "nodes":
        assert model.node_stations is not None  # the scene's check
        low, high = model.rows.domain
        slack = 1e-9 * (high - low)
        nodes = model.node_stations - next(iter(scene.points), 0.0)
        nodes = nodes[(nodes >= low - slack) & (nodes <= high + slack)]
        numbers = node_set(len(nodes), count)
        if len(set(numbers)) != count:
            raise InputError("scene", "reduction.snapshots", count, f"at most {len(nodes) - 1} fit on the mesh's nodes")
        return nodes[numbers - 1]
    if choice == "path":
        low, high = scene.travel
        return np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2.0])
    return np.array(choice)


def eigenmode_snapshots(model: FullModel, scene: Scene) -> Snapshots:
    """The scene's snapshots: `modes` mass-normalised eigenmodes at each of the positions.

    Raises InputError if the slider can't be held at one of the positions; ConvergenceError if too few modes exist or
    converge.
    """
    solver, free = eigensolver(model, scene.reduction.solver), model.size - len(model.rows.names)
    if scene.reduction.modes > free:
        allowed = f"the mesh leaves {free} free coordinates; ask for fewer modes or refine it"
        raise InputError("scene", "reduction.modes", scene.reduction.modes, allowed)
    at = positions(scene, model)
    modes = []
    for s in at:
        try:
            modes.append(solver.lowest(float(s), scene.reduction.modes))
        except DependentRowsError as error:
            raise InputError("scene", "reduction.positions", float(s), error.allowed) from None
    return Snapshots.of(
        np.concatenate([m.phi for m in modes], axis=1),
        model,
        omega=np.concatenate([m.omega for m in modes]),
        s=np.repeat(at, scene.reduction.modes),
        residuals=np.concatenate([m.residuals for m in modes]),
        source=f"eigenmodes, {type(solver).__name__}",
    )
