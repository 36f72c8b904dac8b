"""Sixty bodies as other programs hand them over: right as the same body held by the scene, or refused with the reason.

Bricks, lattices and frames of random sizes come with nodes and rows in a random order.  Some have their supports and
springs to ground inside the matrices; the same body without them, held by the scene, is what they are measured by.
Others have directions in another order, nodes with axes of their own, exchanged nodes, or other units.  PMR_SWEEP=full
tries all, otherwise every tenth is.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from bricks import bricks, lumped
from frames3d import frame, lattice
from scipy.spatial.transform import Rotation

from pmr import InputError, from_matrices, pipeline
from pmr.files.matrices import GivenMatrices
from pmr.scene import Scene

COUNT = 60
NUMBERS = range(COUNT) if os.environ.get("PMR_SWEEP") == "full" else range(0, COUNT, 10)
Random = np.random.Generator
Raw = dict[str, Any]  # arguments of from_matrices
SAME = 1e-6


def body(rng: Random) -> GivenMatrices:
    """Some 3 to 8 m long, as long stations as wide, at least."""
    length, width, height = rng.uniform(3.0, 8.0), rng.uniform(0.2, 0.6), rng.uniform(0.2, 0.6)
    kind = rng.integers(3)
    if kind == 0:
        counts = int(rng.integers(8, 16)), int(rng.integers(1, 3)), int(rng.integers(1, 3))
        return bricks(counts, (length, width, height))
    return (lattice, frame)[kind - 1](int(rng.integers(7, 12)), length, width, height)


def raw(given: GivenMatrices) -> Raw:
    groups = {name: np.asarray(nodes) for name, nodes in given.groups.items()}
    return {"M": given.M, "K": given.K, "points": given.points, "groups": groups} | {
        "node": given.node,
        "direction": given.direction,
    }


def shuffled(one: Raw, rng: Random) -> Raw:
    """Nodes and rows in another order, everywhere alike."""
    place = rng.permutation(len(one["points"]))  # old number of each node
    number = np.argsort(place)
    rows = rng.permutation(len(one["node"]))
    return {
        "M": one["M"][rows][:, rows],
        "K": one["K"][rows][:, rows],
        "points": one["points"][place],
        "groups": {name: number[nodes] for name, nodes in one["groups"].items()},
        "node": number[one["node"][rows]],
        "direction": one["direction"][rows],
    }


def without(one: Raw, held: np.ndarray) -> Raw:
    rest = np.flatnonzero(~held)
    K, M = (one[name][rest][:, rest] for name in "KM")
    return one | {"K": K, "M": M, "node": one["node"][rest], "direction": one["direction"][rest]}


def held(one: Raw, rng: Random) -> tuple[Raw, list[dict[str, Any]], bool]:
    """The body with supports or springs in its matrices, the same of the scene, and whether x is held."""
    names, moves = ("x", "y", "z", "rx", "ry", "rz"), 6 if one["direction"].max() > 2 else 3
    kind = rng.integers(4)
    if kind < 2:  # a face, clamped or along some directions
        chosen = tuple(range(moves)) if kind == 0 else tuple(sorted(rng.choice(3, int(rng.integers(1, 3)), False)))
        gone = np.isin(one["node"], one["groups"]["tail"]) & np.isin(one["direction"], chosen)
        on = {"on": "tail", "points": "all", "directions": [names[k] for k in chosen]}
        return without(one, gone), [on], 0 in chosen
    K, supports, along_x = one["K"].tolil(), list[dict[str, Any]](), False
    for k in range(int(rng.integers(1, 4))):
        node, direction = int(rng.integers(len(one["points"]))), int(rng.integers(3))
        stiffness = float(10.0 ** rng.uniform(3.0, 9.0))
        one["groups"][f"spring{k}"] = np.array([node])
        at = np.flatnonzero((one["node"] == node) & (one["direction"] == direction)).item()
        K[at, at] += stiffness
        along_x |= direction == 0
        supports.append({"on": f"spring{k}", "directions": [names[direction]], "stiffness": stiffness})
    return one | {"K": K.tocsr()}, supports, along_x


def scene(file: Path, given: GivenMatrices, supports: list[dict[str, Any]], along_x: bool) -> Scene:
    x = given.points[:, 0]
    low, length = float(x.min()), float(np.ptp(x))
    across = 0.3 * float(np.ptp(given.points[:, 1]))
    faces = {"bottom": [-across, across], "top": [0.0], "left": [0.0], "right": [0.0]}
    ring = {"length": 0.1 * length, "stiffness": 1e7, "faces": faces}
    rings = [{"name": "rear", "at": low + 0.25 * length, **ring}, {"name": "mouth", "moving": True, **ring}]
    more = [] if along_x else [{"on": "tip", "directions": ["x"]}]
    path = {"kind": "smooth_ramp", "times": [0.0, 0.02], "values": [0.5 * length, 0.6 * length]}
    return Scene.model_validate(
        {
            "title": "A body of another program",
            "body": {"model": "matrices"},
            "mesh": {"file": str(file)},
            "pads": rings,
            "supports": [*supports, *more],
            "slider": {"path": path},
            "loads": [{"on": "tip", "direction": d, "signal": 1e3} for d in ("y", "z")],
            "observe": {"start": low + 0.1 * length, "end": low + 0.9 * length, "count": 5},
            "time": {"end": 0.02, "step": 1e-3},
            "reduction": {"coordinates": 14},
            "compare": {"against": ["full"]},
        }
    )


def responses(one: Raw, folder: Path, supports: list[dict[str, Any]], along_x: bool) -> dict[str, np.ndarray]:
    given = from_matrices(**one)
    file = given.save(folder / f"body{len(list(folder.iterdir()))}.npz")
    outcome = pipeline.run(scene(file, given, supports, along_x))
    assert outcome is not None
    return {name: response.displacement for name, response in outcome.result.responses.items()}


def called(one: Raw, order: tuple[int, ...]) -> Raw:
    turned = np.r_[order, 3 + np.array(order)]
    return one | {"direction": turned[one["direction"]]}


def turned(one: Raw, nodes: np.ndarray, rng: Random) -> Raw:
    """Some nodes have axes of their own."""
    R = Rotation.from_euler("xyz", rng.uniform(0.3, 1.2, 3)).as_matrix()
    T = sp.identity(len(one["node"]), format="lil")
    for node in nodes:
        for first in (0, 3):
            mine = (one["node"] == node) & (one["direction"] // 3 == first // 3)
            at = np.flatnonzero(mine)
            if len(at) == 3:
                T[np.ix_(at, at)] = R[np.ix_(one["direction"][at] % 3, one["direction"][at] % 3)]
    K, M = ((T.T @ one[name] @ T).tocsr() for name in "KM")
    return one | {"K": (K + K.T) / 2.0, "M": (M + M.T) / 2.0}


def far_nodes(one: Raw, rng: Random, count: int) -> np.ndarray:
    """Nodes of the half away from the tail, where no support is."""
    x = one["points"][:, 0]
    return rng.choice(np.flatnonzero(x > x.min() + 0.55 * np.ptp(x)), count, replace=False)


def exchanged(one: Raw, rng: Random) -> Raw:
    a, b = far_nodes(one, rng, 2)
    points = one["points"].copy()
    points[[a, b]] = points[[b, a]]
    return one | {"points": points}


ORDERS = [(2, 1, 0), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2)]
WRONG: list[tuple[Callable[[Raw, Random], Raw], str]] = [
    (lambda one, rng: called(one, ORDERS[rng.integers(len(ORDERS))]), "places that K was made for"),
    (lambda one, rng: turned(one, far_nodes(one, rng, 3), rng), "axes of their own"),
    (lambda one, rng: turned(one, np.arange(len(one["points"])), rng), "places that K was made for"),
    (exchanged, "places that K was made for"),
    (lambda one, rng: one | {"points": one["points"][rng.permutation(len(one["points"]))]}, "in another order"),
    (lambda one, rng: one | {"points": 1e3 * one["points"]}, "in mm"),
    (lambda one, rng: one | {"points": 1e3 * one["points"], "K": one["K"] / 1e3, "M": one["M"] / 1e3}, "in mm"),
    (lambda one, rng: one | {"M": one["M"] / 1e3}, "masses in t"),
]


@pytest.mark.slow
@pytest.mark.parametrize("number", NUMBERS)
def test_a_body_is_right_or_refused_with_the_reason(number: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([46, number])
    free = shuffled(raw(body(rng)), rng)
    if rng.random() < 0.5:
        inside, supports, along_x = held(free, rng)
        ours = responses(inside, tmp_path, [], along_x)
        theirs = responses(free, tmp_path, supports, along_x)
        for name in ("full", "reduced"):
            assert np.abs(ours[name] - theirs[name]).max() <= SAME * np.abs(theirs[name]).max()
        return
    change, says = WRONG[int(rng.integers(len(WRONG)))]
    one = free if rng.random() < 0.5 else held(free, rng)[0]
    with pytest.raises(InputError) as caught:
        from_matrices(**change(one, rng))
    assert re.search(says, str(caught.value)), str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("held_along", [("x", "y", "z"), ("z",)])
def test_lumped_masses_beside_a_clamp_are_those_of_the_scene(held_along: tuple[str, ...], tmp_path: Path) -> None:
    """Nodes that are clamped in the matrices have no mass there, so that the whole is lighter by their share."""
    given = lumped(bricks((6, 2, 2), (5.0, 0.3, 0.4)))
    free, axes = raw(given), [("x", "y", "z").index(axis) for axis in held_along]
    gone = np.isin(given.node, given.groups["tail"]) & np.isin(given.direction, axes)
    inside, support = without(free, gone), {"on": "tail", "points": "all", "directions": list(held_along)}
    assert from_matrices(**inside).mass < 0.99 * given.mass
    ours = responses(inside, tmp_path, [], "x" in held_along)
    theirs = responses(free, tmp_path, [support], "x" in held_along)
    for name in ("full", "reduced"):
        assert np.abs(ours[name] - theirs[name]).max() <= SAME * np.abs(theirs[name]).max()
