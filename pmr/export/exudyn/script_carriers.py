"""Reduced bodies and the contacts between them, without pmr: the source text of these is copied into scripts."""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
from scipy.linalg import block_diag


def read_model(path):
    """M, D, K (n, n), B (n, i), outputs (o, n), W (o, i), and rows(s): C, F, H and X with the paths at s m."""
    with np.load(path) as data:
        header, arrays = json.loads(str(data["header"])), dict(data)
    count = range(len(header["bodies"]))
    prefixes = [f"bodies.{k}." for k in count]
    parts = {name: [arrays[p + name] for p in prefixes] for name in ("M", "D", "K", "B", "outputs", "output_positions")}
    whole = {name: block_diag(*blocks) for name, blocks in parts.items() if name != "output_positions"}
    R = [flexibility(arrays, p, parts["B"][k].shape[1], len(parts["outputs"][k])) for k, p in enumerate(prefixes)]
    n, i, o = (slices([A.shape[axis] for A in parts[name]]) for name, axis in (("M", 0), ("B", 1), ("outputs", 0)))
    sides, paths = [], dict[str, int]()
    for number, contact in enumerate(header["contacts"]):
        for place, sign in ((contact["inner"], contact["direction"]), (contact["outer"], -contact["direction"])):
            if place is not None:
                k = header["bodies"].index(place["body"])
                row = arrays[f"{prefixes[k]}row_names"].tolist().index(place["row"])
                weights = row_weights(arrays, prefixes[k], row, len(R[k].rows))
                path = None if place["path"] is None else paths.setdefault(place["path"], len(paths))
                sides.append((number, k, sign, weights, place["at"], place["rate"], path))
    names, S = [contact["name"] for contact in header["contacts"]], np.eye(len(header["contacts"]))
    for k, contact in enumerate(header["contacts"]):
        for name, share in contact.get("bears", ()):
            S[k, names.index(name)] += share
    compliance = S.T @ (np.array([contact["compliance"] for contact in header["contacts"]])[:, None] * S)
    clearance = np.array([contact["clearance"] for contact in header["contacts"]], float)  # NaN: it holds both ways

    def rows(s):
        m = len(compliance)
        C, H = np.zeros((m, len(whole["M"]))), np.zeros((m, whole["B"].shape[1]))
        F, X = compliance.copy(), np.zeros((len(whole["outputs"]), m))
        placed = []
        for number, k, sign, weights, at, rate, path in sides:
            b = sign * weights(at if path is None else at + rate * s[path])
            placed.append((number, k, b))
            C[number, n[k]] += b @ arrays[f"{prefixes[k]}carriers.values"]
            H[number, i[k]] += b @ R[k].inputs
            X[o[k], number] += R[k].outputs @ b
        for number, k, b in placed:
            for other, of_other, c in placed:
                if k == of_other:
                    F[number, other] += b @ R[k].rows @ c
        return SimpleNamespace(C=C, F=F, H=H, X=X)

    W = block_diag(*(one.direct for one in R))
    positions = np.concatenate(parts["output_positions"])
    return SimpleNamespace(**whole, W=W, output_positions=positions, bodies=n, clearance=clearance, rows=rows)


def flexibility(arrays, prefix, i, o):
    """Of a body between its K carriers, its i inputs and its o outputs; zeros where it has none."""
    K = len(arrays[f"{prefix}carriers.values"])
    shapes = {"rows": (K, K), "inputs": (K, i), "outputs": (o, K), "direct": (o, i)}
    known = {name: arrays.get(f"{prefix}carriers.flexibility.{name}") for name in shapes}
    return SimpleNamespace(**{name: np.zeros(shapes[name]) if A is None else A for name, A in known.items()})


def row_weights(arrays, prefix, row, K):
    """b(x), (K,), of a row on its body's carriers."""
    breaks, touched, c = (arrays[f"{prefix}carriers.{name}.{row}"] for name in ("breaks", "touched", "coefficients"))

    def weights(x):
        x = np.clip(x, breaks[0], breaks[-1])
        j = min(int(np.searchsorted(breaks, x, side="right")) - 1, len(touched) - 1)
        b = np.zeros(K)
        np.add.at(b, touched[j], np.polyval(c[:, j], x - breaks[j]))
        return b

    return weights


def slices(sizes):
    """Where blocks of these sizes stand, one behind the other."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
