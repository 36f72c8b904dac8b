"""A reduced sliding body in Exudyn without pmr: the source text of these is copied into exported scripts."""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

from types import SimpleNamespace

import exudyn as exu
import numpy as np
from exudyn.itemInterface import MarkerNodeCoordinates, NodePointGround, ObjectConnectorCoordinateVector
from scipy.interpolate import PPoly

from pmr.export.exudyn.script_parts import add_body, solve


def read_model(path):
    """M, D, K (r, r), B (r, i), outputs (o, r) and C(s) (m, r), a piecewise polynomial in s."""
    with np.load(path) as data:
        arrays = {name: data[name] for name in ("M", "D", "K", "B", "outputs", "output_positions")}
        return SimpleNamespace(**arrays, C=PPoly(data["rows.coefficients"], data["rows.breaks"]))


def add_sliding_body(mbs, model, slider_position, loads):
    """Add the body to an mbs; returns its node, object and constraint numbers."""

    def force(t):
        return model.B @ [load(t) for load in loads]

    nBody, oBody = add_body(mbs, model, model.K, force(0.0))
    nGround = mbs.AddNode(NodePointGround())
    mGround = mbs.AddMarker(MarkerNodeCoordinates(nodeNumber=nGround))
    mBody = mbs.AddMarker(MarkerNodeCoordinates(nodeNumber=nBody))
    oSlider = mbs.AddObject(
        ObjectConnectorCoordinateVector(markerNumbers=[mGround, mBody], scalingMarker1=model.C(slider_position(0.0)))
    )

    def update(mbs, t):
        # Called once before each step, with the time at its end: there the equations have to hold.
        mbs.SetObjectParameter(oSlider, "scalingMarker1", model.C(slider_position(t)))
        mbs.SetObjectParameter(oBody, "forceVector", force(t))
        mbs.variables[int(oBody)] = t
        return True

    mbs.SetPreStepUserFunction(update)
    return SimpleNamespace(update=update, nBody=nBody, oBody=oBody, oSlider=oSlider)


def simulate(model, slider_position, loads, end, step, rho_inf):
    """Times (T,) in s and transverse displacements (T, o) in m at `model.output_positions`."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items = add_sliding_body(mbs, model, slider_position, loads)
    t, p = solve(mbs, items.nBody, end, step, rho_inf)
    return t, p @ model.outputs.T
