r"""What a frame that moves adds to the equations of small motions, as terms: which matrix of which body, times what.

.. math::
    2 \omega_k T_k \dot q + \alpha_k T_k q + (\omega_j \omega_k N_{jk} - |\omega|^2 M)\, q + \sum_j N_j(t)\, K_{g,j}\, q

with the axial force that a section's own acceleration along the boom makes of it, :math:`a_x + A_{xx} x` from its tail
on, a load along x at its tip, and that of cylinders between two tails: one of length l that pushes with F has
:math:`-F/(2 l)\, (w_i - w_o)^2`, where F accelerates all that it carries, against the loads along x
on it.  :math:`M = N_{xx} + N_{yy} + N_{zz}`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pmr.scene.choice import directions, has_tail, is_axial, loads_of, transverse
from pmr.scene.members import Member, member_at, members
from pmr.scene.names import cylinder_of, named
from pmr.scene.scene import Scene

#: Unit force states, what a section's acceleration has to be multiplied with, by its field.
OF_FIELD = {"x": "axial uniform", "xx": "axial linear"}


@dataclass(frozen=True)
class FrameTerm:
    """A term by its name, the bodies that it acts on, and its matrix."""

    name: str
    bodies: tuple[str, ...]  # one, or the inner and the outer one of a cylinder
    matrix: str  # of the body; of a cylinder that of `carried`
    of: str  # `rotation`, `turning`, `carried`, `field`, `load`, `cylinder` (inertia) or `cylinder load`
    component: str  # ``y`` of a rotation, ``xz`` of what is carried; a field; the name of a load
    number: int = 0  # of the section that is accelerated
    carried: str = ""  # name of the section that a cylinder carries


#: Of which kinds a term is that changes the stiffness, by axial forces or by the frame's speed.
STRESSES, AXIAL = (
    ("field", "load", "cylinder", "cylinder load", "carried"),
    ("field", "load", "cylinder", "cylinder load"),
)


def frame_terms(scene: Scene) -> Iterator[FrameTerm]:
    """All of them; none without second order."""
    if scene.frame is not None and scene.frame.second_order:
        yield from _all(scene)


def stress_terms(scene: Scene) -> Iterator[FrameTerm]:
    """Terms that change the stiffness, with second order or without it; none without a frame."""
    if scene.frame is not None:
        yield from (term for term in _all(scene) if term.of in STRESSES)


def _all(scene: Scene) -> Iterator[FrameTerm]:
    for member in members(scene):
        yield from _of_section(scene, member)
    for number, member in enumerate(members(scene)):
        if number and has_tail(member):
            for beyond in range(number, len(scene.sections)):
                for field in _fields(scene):
                    yield _of_cylinder(scene, number, beyond, field)
                for load in _axial_inputs(member_at(scene, beyond)):
                    yield replace(_of_cylinder(scene, number, beyond, load), of="cylinder load")


def _fields(scene: Scene) -> dict[str, str]:
    """Fields of acceleration that a frame has: without an angle it accelerates all places alike."""
    return OF_FIELD if scene.frame is not None and scene.frame.turns else {"x": OF_FIELD["x"]}


def _of_section(scene: Scene, member: Member) -> Iterator[FrameTerm]:
    assert scene.frame is not None  # of a scene that has terms
    body, slews, turns = scene.names[member.number], scene.frame.leaves_plane is not None, scene.frame.turns
    turning = "xyz" if slews else "y"
    for axis in turning if is_axial(member) and turns else ():
        matrix = f"rotating {axis}"
        yield FrameTerm(named(body, matrix), (body,), matrix, "rotation", axis)
        yield FrameTerm(named(body, f"turning {axis}"), (body,), matrix, "turning", axis)
    pairs = ("xx", "yy", "zz", "xy", "xz", "yz") if slews else ("xx", "zz")
    for pair in pairs if turns else ():
        if set(pair) <= set(directions(member)):
            yield FrameTerm(named(body, f"carried {pair}"), (body,), f"carried {pair}", "carried", pair)
    for field, matrix in _fields(scene).items():
        yield FrameTerm(named(body, matrix), (body,), matrix, "field", field, member.number)
    for load in loads_of(member):
        if load.direction == "x" and load.on == "tip":
            yield FrameTerm(named(body, f"axial {load.name}"), (body,), "axial tip", "load", load.name, member.number)


def _axial_inputs(member: Member) -> Iterator[str]:
    """Names of the inputs that act along a section."""
    return (load.name for load in loads_of(member) if load.direction == "x")


def _of_cylinder(scene: Scene, number: int, beyond: int, field: str) -> FrameTerm:
    inner, outer, carried = (scene.names[k] for k in (number, number - 1, beyond))
    name = f"{cylinder_of(inner)} that carries {carried}, {field}"
    return FrameTerm(name, (inner, outer), OF_FIELD.get(field, "axial tip"), "cylinder", field, number, carried)


def tails(member: Member) -> tuple[str, ...]:
    """Names of what measures the tail of a section across the boom in a frame, where cylinders act."""
    leans = member.frame is not None and member.jointed and has_tail(member)
    return tuple(f"tail {axis}" for axis in transverse(member)) if leans else ()
