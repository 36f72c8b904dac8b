"""Compare POD and Galerkin projection by pmr, pyMOR and LAPACK on the paper's snapshots."""

from __future__ import annotations

from importlib import metadata
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from benchmarks import beams
from benchmarks.timing import side_by_side
from pmr.fullmodel.build import full_model
from pmr.reduction.basis import pod, reduced_model
from pmr.reduction.snapshots import eigenmode_snapshots

Array = NDArray[np.float64]

COORDINATES = 20


def version() -> dict[str, str]:
    """Version of pyMOR; empty if it is not installed."""
    try:
        return {"pymor": metadata.version("pymor")}
    except metadata.PackageNotFoundError:
        return {}


def measure(elements: int, repeats: int) -> dict[str, Any]:
    """Seconds by step and package, and differences between the results; only ``installed: False`` without pyMOR."""
    if not version():
        return {"installed": False}
    from pymor.algorithms import pod as theirs
    from pymor.algorithms.projection import project
    from pymor.core.logger import set_log_levels
    from pymor.operators.numpy import NumpyMatrixOperator
    from pymor.vectorarrays.numpy import NumpyVectorSpace

    set_log_levels({"pymor": "ERROR"})
    scene = beams.scene(beams.CASES["evolved"], f"mesh.elements={elements}")
    model = full_model(scene)
    snapshots = eigenmode_snapshots(model, scene)
    body = model.gather()
    assert body is not None
    S = np.array(snapshots.S.getDenseArray())
    operators = {name: NumpyMatrixOperator(getattr(body, name)) for name in ("M", "K")}
    space = NumpyVectorSpace(len(S))
    pool = space.make_array(S)
    found: dict[str, Any] = {}

    def keep(name: str, value: Any) -> None:
        """Store the result of a package."""
        found[name] = value

    def by_pymor(method: str) -> None:
        """Compute POD by a method of pyMOR and store it."""
        keep(method, theirs.pod(pool.copy(), modes=COORDINATES, rtol=0.0, method=method)[:2])

    ways = {
        "pod": {
            "pmr, TSQR": lambda: keep("ours", pod(model, snapshots, COORDINATES, "euclidean", "slepc")),
            "pmr, LAPACK": lambda: keep("lapack", pod(model, snapshots, COORDINATES, "euclidean", "dense")),
            "pyMOR, QR": lambda: by_pymor("qr_svd"),
            "pyMOR, snapshots": lambda: by_pymor("method_of_snapshots"),
            "SciPy": lambda: keep("scipy", scipy.linalg.svd(S, full_matrices=False)),
        },
        "project": {
            "pmr": lambda: keep("model", reduced_model(model, found["ours"], {})),
            "pyMOR": lambda: keep(
                "projected", {n: project(A, found["qr_svd"][0], found["qr_svd"][0]) for n, A in operators.items()}
            ),
        },
    }
    seconds = {step: side_by_side(choices, repeats) for step, choices in ways.items()}
    ours, sigma = np.array(found["ours"].V.getDenseArray()), np.asarray(found["ours"].sigma)
    agreement = {}
    for method in ("qr_svd", "method_of_snapshots"):
        modes, values = found[method]
        V, count = modes.to_numpy(), min(len(values), COORDINATES)
        V = V if V.shape[0] == len(S) else V.T
        agreement[method] = {
            "modes": len(values),
            "sigma": float(np.abs(values[:count] - sigma[:count]).max() / sigma[0]),
            "sigma_last": float(abs(values[count - 1] - sigma[count - 1]) / sigma[count - 1]),
            "angle": _largest_angle(ours[:, :count], V[:, :count]),
        }
    V = found["qr_svd"][0].to_numpy()
    V = V if V.shape[0] == len(S) else V.T
    T = ours.T @ V  # both bases are orthonormal: theirs in terms of ours
    matrices = {}
    for name, projected in found["projected"].items():
        A = getattr(found["model"], name)
        difference = np.abs(T.T @ A @ T - projected.matrix).max()
        matrices[name] = float(difference / np.abs(A).max())
    return {
        "installed": True,
        "size": body.size,
        "snapshots": S.shape[1],
        "coordinates": COORDINATES,
        "seconds": {step: {way: t.summary() for way, t in times.items()} for step, times in seconds.items()},
        "agreement": agreement,
        "matrices": matrices,
    }


def _largest_angle(A: Array, B: Array) -> float:
    """Largest angle in rad between the ranges of two orthonormal bases (n, k), exact for small angles too."""
    return float(np.arcsin(min(1.0, float(np.linalg.norm(B - A @ (A.T @ B), 2)))))
