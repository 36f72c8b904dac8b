"""A reduced body by its tables over one path, without pmr: the source text of these is copied into scripts."""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.interpolate import PPoly


def read_model(path):
    """M, D, K (n, n), B (n, i), outputs (o, n), W (o, i), and rows(s): C, F, H and X where the slider is at s[0] m."""
    with np.load(path) as data:
        prefix = "" if "M" in data else "bodies.0."
        arrays = {name.removeprefix(prefix): data[name] for name in data if name.startswith(prefix)}
    i, o, m = arrays["B"].shape[1], len(arrays["outputs"]), arrays["rows.coefficients"].shape[2]

    def polynomial(name, shape):
        if f"{name}.breaks" in arrays:
            return PPoly(arrays[f"{name}.coefficients"], arrays[f"{name}.breaks"])
        return lambda s: np.zeros(shape)

    C, G, H, X = (
        polynomial(name, shape)
        for name, shape in (
            ("rows", ()),
            ("flexibility.rows", (m, m)),
            ("flexibility.inputs", (m, i)),
            ("flexibility.outputs", (o, m)),
        )
    )
    pads = np.diag(arrays.get("pads", np.zeros(m)))
    return SimpleNamespace(
        **{name: arrays[name] for name in ("M", "D", "K", "B", "outputs", "output_positions")},
        W=arrays.get("flexibility.direct", np.zeros((o, i))),
        bodies=[slice(0, len(arrays["M"]))],
        clearance=arrays.get("clearance", np.full(m, np.nan)),
        rows=lambda s: SimpleNamespace(C=C(s[0]), F=G(s[0]) + pads, H=H(s[0]), X=X(s[0])),
    )
