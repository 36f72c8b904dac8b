"""A reduced body whose rows give way, in Exudyn without pmr: the source text of these is copied into scripts."""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

from types import SimpleNamespace

import exudyn as exu
import numpy as np
from scipy.interpolate import PPoly

from pmr.export.exudyn.script_parts import add_body, solve


def read_model(path):
    """M, D, K (r, r), B (r, i), outputs (o, r); C (m, r), G (m, m), H (m, i), X (o, m), piecewise polynomials in s."""
    with np.load(path) as data:
        arrays = {name: data[name] for name in ("M", "D", "K", "B", "outputs", "output_positions")}
        m, i, o = data["rows.coefficients"].shape[2], data["B"].shape[1], len(data["outputs"])

        def table(name, shape):
            if f"{name}.breaks" in data:
                return PPoly(data[f"{name}.coefficients"], data[f"{name}.breaks"])
            return lambda s: np.zeros((*np.shape(s), *shape))

        return SimpleNamespace(
            **arrays,
            pads=data["pads"] if "pads" in data else np.zeros(m),
            C=PPoly(data["rows.coefficients"], data["rows.breaks"]),
            G=table("flexibility.rows", (m, m)),
            H=table("flexibility.inputs", (m, i)),
            X=table("flexibility.outputs", (o, m)),
            W=data["flexibility.direct"] if "flexibility.direct" in data else np.zeros((o, i)),
        )


def multipliers(model, s, p, f):
    """Forces (m,) in N at the rows: (G + 1/k)^-1 (C p + H f)."""
    return np.linalg.solve(model.G(s) + np.diag(model.pads), model.C(s) @ p + model.H(s) @ f)


def system(model, s):
    """Stiffness (r, r) with the rows as springs, K + C^T (G + 1/k)^-1 C, and the inputs (r, i) beside them."""
    C = model.C(s)
    springs = np.linalg.solve(model.G(s) + np.diag(model.pads), np.hstack([C, model.H(s)]))
    r = len(model.M)
    return model.K + C.T @ springs[:, :r], model.B - C.T @ springs[:, r:]


def add_sliding_body(mbs, model, slider_position, loads):
    """Add the body to an mbs; returns its node and object numbers.  There is no constraint: the rows give way."""
    stiffness, inputs = system(model, slider_position(0.0))
    nBody, oBody = add_body(mbs, model, stiffness, inputs @ [load(0.0) for load in loads])

    def update(mbs, t):
        # Called once before each step, with the time at its end: there the equations have to hold.
        stiffness, inputs = system(model, slider_position(t))
        mbs.SetObjectParameter(oBody, "stiffnessMatrix", stiffness)
        mbs.SetObjectParameter(oBody, "forceVector", inputs @ [load(t) for load in loads])
        mbs.variables[int(oBody)] = t
        return True

    mbs.SetPreStepUserFunction(update)
    return SimpleNamespace(update=update, nBody=nBody, oBody=oBody)


def simulate(model, slider_position, loads, end, step, rho_inf):
    """Times (T,) in s and transverse displacements (T, o) in m at `model.output_positions`."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items = add_sliding_body(mbs, model, slider_position, loads)
    t, p = solve(mbs, items.nBody, end, step, rho_inf)
    displacement = np.empty((len(t), len(model.outputs)))
    for k, time in enumerate(t):
        s, f = slider_position(time), np.array([load(time) for load in loads])
        displacement[k] = model.outputs @ p[k] + model.W @ f - model.X(s) @ multipliers(model, s, p[k], f)
    return t, displacement
