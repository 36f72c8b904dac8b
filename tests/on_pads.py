"""Planar beam between pads that only push: two below it and two above, in NumPy alone."""

from dataclasses import replace
from functools import partial

import driving
import numpy as np
from oracle import flexible, free_modes, full_body, project, slider_row
from textbook import LENGTH, RHO_A

from pmr import ReducedModel
from pmr.system.body import FullBody
from pmr.system.rows import Row, Rows, fixed_row

TAIL = 0.5  # m, where two of the pads stay; the others sit at s
WEIGHT = RHO_A * LENGTH  # N under one m/s^2
INPUTS = ("gravity", "F")  # m/s^2 and N
driven = partial(driving.driven, names=INPUTS)
NAMES = ("tail bottom", "tail top", "mouth bottom", "mouth top")


def beam_on_pads(clearance: float | None, stiffness: float = 1e6, elements: int = 10) -> FullBody:
    """Full model of the beam, with its axial coordinate held; a clearance of None makes the pads bilateral.

    Its inputs are gravity in m/s^2, positive downwards, and a force in N at the tip; `stiffness` in N/m is that of a
    pad.
    """
    plain = full_body(elements)
    mouth, nodes = slider_row(plain.output_positions), plain.output_positions
    tail = fixed_row("tail", mouth.at(TAIL), (nodes[0], nodes[-1]))
    pads = [_pad(row, sign, name, clearance, 1.0 / stiffness) for (row, sign), name in zip(
        [(tail, -1.0), (tail, 1.0), (mouth, -1.0), (mouth, 1.0)], NAMES, strict=True
    )]  # fmt: skip
    upwards = np.zeros(plain.size)
    upwards[1::3] = 1.0
    tip = np.zeros(plain.size)
    tip[-2] = 1.0
    return replace(
        plain,
        B=np.stack([-(plain.M @ upwards), tip], axis=1),
        rows=Rows((plain.rows.rows[0], *pads), plain.size),
        input_names=INPUTS,
    )


def modes_on_pads(body: FullBody, count: int) -> ReducedModel:
    """Reduce the beam to its lowest modes without pads, two rigid ones among them, without residual flexibility."""
    return replace(
        project(body, free_modes(body, count)[0]), pads=body.row_compliance[1:], clearance=body.row_clearance[1:]
    )


def flexible_on_pads(body: FullBody, count: int) -> ReducedModel:
    """Reduce the beam to its lowest modes, with residual flexibility."""
    return replace(flexible(body, count), clearance=body.row_clearance[1:])


def _pad(row: Row, sign: float, name: str, clearance: float | None, compliance: float) -> Row:
    """Row of a pad: a displacement row with another sign, name, clearance and compliance."""
    return replace(row, name=name, coefficients=sign * row.coefficients, compliance=compliance, clearance=clearance)
