"""Planar booms of two to four steel boxes that slide in each other, of the project's own beams.

Sections of 6 m, the first one clamped, each held in the next outer one by a pad at its own tail and one at the other's
mouth, 0.15 m from the ends; 250 kg at the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Rows, carrier, fixed_row
from pmr.fem.compat import MPI
from pmr.fem.matrices import columns
from pmr.fullmodel.assembly import assemble_model
from pmr.fullmodel.model import FullModel
from pmr.models.beam2d import Beam2D
from pmr.models.rigid import RigidMotions
from pmr.reduce.basis import modal_basis
from pmr.reduce.residual.model import section_model
from pmr.reduced.model import ReducedModel
from pmr.scene import Body
from pmr.simulate.modal import modal_form
from pmr.snapshots.free_modes import free_modes
from pmr.system.body import FullBody, SlidingBody
from pmr.system.system import Contact, Place, System

Array = NDArray[np.float64]

LENGTH, FROM_END = 6.0, 0.15  # m
#: Width and height between the walls' mid-surfaces, wall; m.
BOXES = (
    (0.30, 0.40, 8e-3),
    (0.26, 0.36, 7e-3),
    (0.22, 0.32, 6e-3),
    (0.18, 0.28, 5e-3),
)
E, RHO, TIP_MASS = 2.1e11, 7850.0, 250.0
DAMPING = 0.005  # of each section's modes
NAMES = ("0", "1", "2", "3")


@dataclass(frozen=True)
class Nested:
    """How a boom is built: sections, elements of each, and its pads in m/N and m."""

    count: int
    elements: int = 60
    compliance: float = 1.0 / 3e8
    clearance: float | None = None


def full(boom: Nested) -> System:
    """All sections in full order."""
    return joined(boom, [full_section(k, k == boom.count - 1, boom.elements) for k in range(boom.count)])


def reduced(boom: Nested, elastic: int) -> System:
    """Each on so many elastic modes, and all rigid-body modes, with residual flexibility."""
    return joined(boom, [reduced_section(k, k == boom.count - 1, boom.elements, elastic) for k in range(boom.count)])


def plain(boom: Nested, elastic: int) -> System:
    """The same without residual flexibility."""
    system = reduced(boom, elastic)
    bodies = [replace(body, flexibility=None, carriers=replace(body.carriers, flexibility=None))
              for body in system.bodies.values()]  # fmt: skip
    return joined(boom, bodies)


def joined(boom: Nested, bodies: Sequence[SlidingBody]) -> System:
    """Sections that extend by the paths "1" to "3"."""
    contacts = []
    for k in range(1, boom.count):
        inner, outer, path = NAMES[k], NAMES[k - 1], NAMES[k]
        pads = {
            f"tail {inner}": (Place(inner, "w", FROM_END), Place(outer, "w", FROM_END, path)),
            f"mouth {outer}": (Place(inner, "w", LENGTH - FROM_END, path, -1.0), Place(outer, "w", LENGTH - FROM_END)),
        }
        ways = {"": 1.0} if boom.clearance is None else {" top": 1.0, " bottom": -1.0}
        contacts += [
            Contact(name + way, *places, direction, boom.compliance, boom.clearance)
            for name, places in pads.items()
            for way, direction in ways.items()
        ]
    return System(dict(zip(NAMES, bodies, strict=False)), tuple(contacts))


@cache
def section(number: int, last: bool, elements: int) -> FullModel:
    """A section with the row "w", its deflection at x; the first one clamped, the last one with the mass."""
    width, height, wall = BOXES[number]
    body = Body(
        length=LENGTH,
        bending_stiffness=E * (_cube(width + wall, height + wall) - _cube(width - wall, height - wall)),
        mass_per_length=RHO * 2.0 * wall * (width + height),
        axial=False,
    )
    beam = Beam2D(body, np.linspace(0.0, LENGTH, elements + 1))
    operators = assemble_model(beam, beam.domain(MPI.COMM_SELF))
    M, tip = operators.M, beam.size - 2
    if last:
        M.setValue(tip, tip, M.getValue(tip, tip) + TIP_MASS)
        M.assemble()
    up = M.createVecRight()
    up.setArray(np.arange(beam.size) % 2 == 0)
    weight = np.arange(beam.size), -(M * up).getArray()
    clamps = {"clamp deflection": 0, "clamp rotation": 1} if number == 0 else {}
    held = [fixed_row(name, carrier(dof, 1.0, beam.size), (0.0, LENGTH)) for name, dof in clamps.items()]
    return FullModel(
        M,
        0.0 * M,
        operators.K,
        inputs=columns(M, [weight, *([beam.point(LENGTH, "y")] if last else [])]),
        outputs=columns(M, [beam.point(x, "y") for x in _observed(beam)]),
        rows=Rows((*held, beam.slider(0.0, "w")), beam.size),
        input_names=("gravity", "F") if last else ("gravity",),
        output_positions=_observed(beam),
        reference_frequency=beam.reference_frequency,
        rigid=RigidMotions.unheld(beam.rigid_motions()),
    )


def _cube(width: float, height: float) -> float:
    return width * height**3 / 12.0


def _observed(beam: Beam2D) -> Array:
    return np.linspace(0.0, LENGTH, 11)


@cache
def full_section(number: int, last: bool, elements: int) -> FullBody:
    """In full order."""
    body = section(number, last, elements).gather()
    assert body is not None
    form = modal_form(body)
    damping = form.inverse.T @ np.diag(2.0 * DAMPING * np.sqrt(np.maximum(form.omega2, 0.0))) @ form.inverse
    return replace(body, D=sp.csr_matrix(damping))


@cache
def reduced_section(number: int, last: bool, elements: int, elastic: int) -> ReducedModel:
    """On its lowest modes."""
    model, count = section(number, last, elements), elastic + (0 if number == 0 else 2)
    found = section_model(model, modal_basis(free_modes(model, count)), {}, count)
    return replace(found, D=2.0 * DAMPING * np.diag(np.sqrt(np.maximum(np.diagonal(found.K), 0.0))))
