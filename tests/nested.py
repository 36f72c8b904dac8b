"""Planar booms of two to four steel boxes that slide in each other, of the project's own beams.

Sections are 6 m long.  The first one is clamped; each other one is held in the next outer one by a pad at its own tail
and a pad at the outer one's mouth, both 0.15 m from the end.  The tip carries 250 kg.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
import scipy.sparse as sp

from pmr import ReducedModel, System
from pmr.fem.compat import MPI
from pmr.fem.distributed import from_transpose
from pmr.fullmodel.model import FullModel, RigidMotions, assemble_model
from pmr.fullmodel.pads import slider_row
from pmr.models.beam2d import Beam2D
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.snapshots import free_modes
from pmr.scene.structures import Profile
from pmr.simulation.modal import modal_form
from pmr.system.body import FullBody, SlidingBody
from pmr.system.contacts import Contact, Place, pad_at_mouth, pad_at_tail
from pmr.system.rows import Rows, fixed_row, sparse_row

LENGTH, FROM_END = 6.0, 0.15  # m
#: Width and height between the walls' mid-surfaces, wall; m.
BOXES = ((0.30, 0.40, 8e-3), (0.26, 0.36, 7e-3), (0.22, 0.32, 6e-3), (0.18, 0.28, 5e-3))
E, RHO, TIP_MASS = 2.1e11, 7850.0, 250.0
DAMPING = 0.005  # of each section's modes
NAMES = ("0", "1", "2", "3")


@dataclass(frozen=True)
class Nested:
    """Parameters of a boom: number of sections, elements of each, compliance (m/N) and clearance (m) of its pads."""

    count: int
    elements: int = 60
    compliance: float = 1.0 / 3e8
    clearance: float | None = None

    @property
    def boxes(self) -> list[Box]:
        """Sections from the base out."""
        return [box(k, k == self.count - 1, self.elements) for k in range(self.count)]


def full(boom: Nested) -> System:
    """System of all sections in full order."""
    return joined(boom, [full_section(one) for one in boom.boxes])


def reduced(boom: Nested, elastic: int) -> System:
    """System of sections on `elastic` elastic modes each and all rigid-body modes, with residual flexibility."""
    return joined(boom, [reduced_section(one, elastic) for one in boom.boxes])


def plain(boom: Nested, elastic: int) -> System:
    """System as by `reduced`, but without residual flexibility."""
    system = reduced(boom, elastic)
    bodies = [replace(body, flexibility=None, carriers=replace(body.carriers, flexibility=None))
              for body in system.bodies.values()]  # fmt: skip
    return joined(boom, bodies)


def with_round_off(noise: float) -> System:
    """System of two sections whose first contact gives way by round-off alone, of the size `noise` in m/N.

    Coefficients that it shares with other contacts are larger than its own.  The second contact gives way by 1e-9 m/N.
    Without noise the first one is rigid.
    """
    system = reduced(Nested(2, elements=8, compliance=0.0), 3)
    bodies, random = dict[str, SlidingBody](), np.random.default_rng(3)
    for (name, body), count in zip(system.bodies.items(), (-1, 4), strict=True):
        flexibility = body.carriers.flexibility
        R, K = flexibility.rows.copy(), len(flexibility.rows)
        touched = np.arange(K if count < 0 else count)
        R[touched] = 1e3 * noise * random.normal(size=(len(touched), K))
        R[:, touched] = R[touched].T
        R[touched, touched] = 0.0
        R[np.ix_(touched, touched)] = noise * np.eye(len(touched))
        carriers = replace(body.carriers, flexibility=replace(flexibility, rows=R))
        bodies[name] = replace(body, carriers=carriers)
    return replace(system, bodies=bodies)


def joined(boom: Nested, bodies: Sequence[SlidingBody]) -> System:
    """Join sections that extend by the paths "1" to "3"."""
    return System(dict(zip(NAMES, bodies, strict=False)), tuple(joints(boom)))


def joints(boom: Nested) -> Iterator[Contact]:
    """Contacts of the joints of all sections but the first."""
    ways = {"": 1.0} if boom.clearance is None else {" top": 1.0, " bottom": -1.0}

    def pads(name: str, section: str) -> Iterator[Contact]:
        """Pads at one end: one, or with a clearance one above and one below."""
        for way, direction in ways.items():
            place = Place(section, "w", FROM_END)
            yield Contact(name + way, place, None, direction, boom.compliance, boom.clearance)

    for outer, inner in pairwise(NAMES[: boom.count]):
        yield from (pad_at_tail(pad, outer, inner) for pad in pads(f"tail {inner}", inner))
        yield from (pad_at_mouth(pad, outer, inner, LENGTH) for pad in pads(f"mouth {outer}", inner))


@dataclass(frozen=True)
class Box:
    """Section of a boom: dimensions in m, material, elements, and what holds or loads its ends."""

    length: float
    width: float
    height: float
    wall: float
    E: float
    rho: float
    elements: int
    clamped: bool = False
    tip_mass: float = 0.0  # kg; a tip force acts where there is one

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness in N m^2."""
        inner = self.width - 2.0 * self.wall, self.height - 2.0 * self.wall
        return self.E * (self.width * self.height**3 - inner[0] * inner[1] ** 3) / 12.0

    @property
    def mass_per_length(self) -> float:
        """Mass per length in kg/m."""
        return self.rho * 2.0 * self.wall * (self.width + self.height - 2.0 * self.wall)


def box(number: int, last: bool, elements: int) -> Box:
    """Section number `number` of a steel boom; the last one carries the mass at the tip."""
    width, height, wall = BOXES[number]
    return Box(LENGTH, width + wall, height + wall, wall, E, RHO, elements, number == 0, TIP_MASS if last else 0.0)


@cache
def section(box: Box) -> FullModel:
    """Assemble a section in PETSc, with the row "w", its deflection at x."""
    body = Profile(
        length=box.length, bending_stiffness=box.bending_stiffness, mass_per_length=box.mass_per_length, axial=False
    )
    beam = Beam2D(body, np.linspace(0.0, box.length, box.elements + 1))
    operators = assemble_model(beam, beam.domain(MPI.COMM_SELF))
    M, tip, observed = operators.M, beam.size - 2, np.linspace(0.0, box.length, 11)
    M.setValue(tip, tip, M.getValue(tip, tip) + box.tip_mass)
    M.assemble()
    up = M.createVecRight()
    up.setArray(np.arange(beam.size) % 2 == 0)
    loads = {"gravity": sparse_row(np.arange(beam.size), -(M * up).getArray(), beam.size)}
    loads |= {"F": beam.displacement("tip")} if box.tip_mass else {}
    clamps = {"clamp deflection": 0, "clamp rotation": 1} if box.clamped else {}
    held = [fixed_row(name, sparse_row(dof, 1.0, beam.size), (0.0, box.length)) for name, dof in clamps.items()]
    motions = beam.rigid_motions()
    return FullModel(
        M,
        0.0 * M,
        operators.K,
        B=from_transpose(M, sp.vstack([*loads.values()])),
        outputs=from_transpose(M, sp.vstack([beam.displacement(float(x)) for x in observed])),
        rows=Rows((*held, slider_row(beam, 0.0, "w")), beam.size),
        input_names=tuple(loads),
        output_positions=observed,
        reference_frequency=beam.reference_frequency,
        rigid=RigidMotions(motions, np.zeros((0, motions.shape[1]))),
    )


@cache
def full_section(box: Box) -> FullBody:
    """Section in full order, with modal damping."""
    body = section(box).gather()
    assert body is not None
    form = modal_form(body)
    damping = form.inverse.T @ np.diag(2.0 * DAMPING * np.sqrt(np.maximum(form.omega2, 0.0))) @ form.inverse
    return replace(body, D=sp.csr_matrix(damping))


@cache
def reduced_section(box: Box, elastic: int) -> ReducedModel:
    """Section on its lowest modes, `elastic` of them elastic, with modal damping."""
    model, count = section(box), elastic + (0 if box.clamped else 2)
    found = section_model(FreeBody(model), modal_basis(free_modes(model, count)), {}, count)
    return replace(found, D=2.0 * DAMPING * np.diag(np.sqrt(np.maximum(np.diagonal(found.K), 0.0))))
