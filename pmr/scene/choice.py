"""Which structural model a body gets, what it can do, and what each simulator can.

The model of a body: the one that its scene names, or for ``auto`` the least that can carry what the scene asks for.

Which model is accurate enough is measured beside a shell (`pmr.pipeline.scenes`), not decided here.

What each simulator can do, by the names that scenes give them; what it can't is refused here, and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.scene.box import Box
from pmr.scene.built import Load
from pmr.scene.keys import Direction
from pmr.scene.members import Member
from pmr.scene.profile import FACES, Face

#: A wall is taken to answer at once up to this share of its own lowest frequency.
QUASI_STATIC = 1.0 / 3.0
#: Faces at the left and at the right.
SIDES: tuple[tuple[Face, Face], ...] = (("left", "right"), ("bottom left", "bottom right"), ("top left", "top right"))


@dataclass(frozen=True)
class Choice:
    """A model and the reasons for it, each a clause."""

    model: str
    reasons: tuple[str, ...]


def choose(member: Member) -> Choice:
    """Choose the model that the scene names, or for ``auto`` the smallest of beam2d, beam3d and shell that serves."""
    if member.part.body.model != "auto":
        return Choice(member.part.body.model, ("the scene names it",))
    if member.part.body.profile is not None:
        return Choice("beam2d", ("its stiffnesses are those of a planar beam",))
    if shell := [*_stresses(member), *_walls(member)]:
        return Choice("shell", tuple(shell))
    if space := [*_lateral(member), *_other_models(member)]:
        return Choice("beam3d", tuple(space))
    return Choice("beam2d", ("all loads and masses lie in the vertical plane",))


def is_undecided(member: Member) -> bool:
    """Whether measurements are to decide the model: ``auto``, of a box of which a beam can carry what is asked."""
    body = member.part.body
    return body.model == "auto" and body.box is not None and model_of(member) != "shell"


def model_of(member: Member) -> str:
    """The name of that model."""
    return choose(member).model


def has_giving_walls(member: Member) -> bool:
    """Whether the chosen model is a beam whose walls give way under pads."""
    return member.part.body.walls == "give" and model_of(member) in ("beam2d", "beam3d")


def has_walls_that_could_give(member: Member) -> bool:
    """Whether the chosen model is a beam of a box whose walls are rigid under its pads."""
    body = member.part.body
    return body.box is not None and body.walls == "rigid" and model_of(member) in ("beam2d", "beam3d")


def directions(member: Member) -> tuple[Direction, ...]:
    """Directions in which a place of the chosen model can move."""
    if model_of(member) != "beam2d":
        return ("x", "y", "z", "rx", "ry", "rz")
    profile = member.part.body.profile
    return ("x", "z", "ry") if profile is None or profile.axial else ("z", "ry")


def parts_of(member: Member, load: Load) -> dict[str, Direction]:
    """Names of the inputs of a load, and the axis of the body along which each acts.

    A force along an axis of the ground has a part along each axis of the body that the frame may turn towards it.
    """
    if load.axes == "body":
        return {load.name: load.direction}
    planar = member.frame is not None and member.frame.slewing is None
    turned: tuple[Direction, ...]
    if member.frame is not None and member.frame.rocking:
        turned = ("x", "y", "z")
    elif planar:
        turned = ("y",) if load.direction == "y" else ("x", "z")
    else:
        turned = ("x", "z") if load.direction == "z" else ("x", "y", "z")
    return {f"{load.name} {axis}": axis for axis in turned if axis in directions(member)}


def loads_of(member: Member) -> tuple[Load, ...]:
    """Loads by their inputs, each along an axis of the body."""
    return tuple(
        load.model_copy(update={"name": name, "direction": direction, "axes": "body"})
        for load in member.part.loads
        for name, direction in parts_of(member, load).items()
    )


def is_pinned_beam(member: Member) -> bool:
    """Whether the scene is a planar beam that a pin at x = 0 and one point that slides hold, and nothing else."""
    held = [
        (member.part.place(support.on), support.stiffness, set(support.held) & {"x", "z", "ry"})
        for support in member.part.supports
    ]
    return (
        member.part.body.profile is not None
        and held == [(0.0, "rigid", {"x", "z"})]
        and member.points == (0.0,)
        and not (member.pads or member.part.masses)
    )


def is_axial(member: Member) -> bool:
    """Whether a section moves along the boom, so that a cylinder can drive it."""
    return "x" in directions(member)


def has_tail(member: Member) -> bool:
    """Whether a cylinder may act on the tail of a body: its own one, or on the base that of the next section."""
    # every point of it
    held = any(
        support.on == "tail" and support.points == "all" and "x" in support.held for support in member.part.supports
    )
    return member.jointed and is_axial(member) and (member.number > 0 or not held)


def is_accelerated(member: Member) -> bool:
    """Whether extensions alone accelerate a body along the boom."""
    return member.number > 0 and has_tail(member) and member.frame is None


def inertia_fields(member: Member) -> tuple[str, ...]:
    """Fields in which the frame accelerates a body: along ``x``; along x, growing with z, ``xz``; none that vanish."""
    if member.frame is None:
        return ()
    turning = "xyz" if member.frame.leaves_plane else "xz"
    along = [axis for axis in turning if axis in directions(member)]
    if not member.frame.turns:
        return tuple(along)
    if model_of(member) in ("beam2d", "beam3d") and not _has_rotary_inertia(member):
        torsion = ("yz", "zy") if model_of(member) == "beam3d" and "y" in turning else ()
        return (*along, *(axis + "x" for axis in along), *torsion)
    return (*along, *(axis + over for axis in along for over in turning))


def _has_rotary_inertia(member: Member) -> bool:
    """Whether a beam's cross-sections, or what is attached to it, have inertia across the axis but for torsion."""
    is_off_axis = [mass.at is not None and mass.at[1:] != (0.0, 0.0) for mass in member.part.masses]
    attached = any(any(mass.inertia) for mass in member.part.masses)
    return attached or any(is_off_axis) or (model_of(member) == "beam3d" and member.part.body.shear)


def is_planar(member: Member) -> bool:
    """Tell whether a section is a planar beam."""
    return model_of(member) == "beam2d"


def fewest_rows(member: Member) -> int:
    """Rows of rigid supports and of points that slide; those of pads come on top."""
    moves = directions(member)
    rigid = [support for support in member.part.supports if support.stiffness == "rigid" and support.points == "mean"]
    return sum(direction in moves for support in rigid for direction in support.held) + len(member.points)


def felt_faces(member: Member) -> tuple[str, ...]:
    """Faces whose pads the chosen model can feel: nothing moves a planar beam sideways."""
    return ("bottom", "top") if model_of(member) == "beam2d" else FACES


def transverse(member: Member) -> tuple[str, ...]:
    """Directions in which the chosen model moves across its axis."""
    return ("z",) if model_of(member) == "beam2d" else ("y", "z")


def wall_frequency(box: Box, young: float, poisson: float, density: float) -> float:
    r"""Lowest frequency in Hz of the box's flat walls as long plates that are hinged on both edges.

    .. math:: f = \frac{\pi}{2 b^2} \sqrt{\frac{E t^2}{12 \rho (1 - \nu^2)}}

    Leissa: Vibration of Plates, NASA SP-160, 1969, section 4.1 (a infinite).
    """
    softest = min((side.thickness / side.length**2 for side in box.faces.values()), default=np.inf)
    return float(np.pi / 2.0 * softest * np.sqrt(young / (12.0 * density * (1.0 - poisson**2))))


def _stresses(member: Member) -> list[str]:
    measured = {measure for probe in member.part.probes for measure in probe.measures}
    has_stresses = member.recovery is not None and member.recovery.stress or bool(measured & {"stress", "strain"})
    return ["stresses are asked for, which pads and walls decide"] * has_stresses


def _walls(member: Member) -> list[str]:
    """Reasons for which a beam can't stand for the walls."""
    box, material = member.part.body.box, member.part.body.material
    if box is None:
        return []
    highest = max((signal.highest_frequency(-np.inf, np.inf) for signal in member.signals.values()), default=0.0)
    of_walls = wall_frequency(box, material.young, material.poisson, material.density)
    near = f"loads of {highest:g} Hz come near the walls' own frequency of {of_walls:.3g} Hz"
    return [near] * (highest > QUASI_STATIC * of_walls) + ["the box has frames"] * bool(box.frames)


def _other_models(member: Member) -> list[str]:
    """Sections that are no planar beams: all sections are such beams, or none is."""
    models = {section.part.name: choose(section).model for section in member.others}
    return [f"section {name} is no planar beam" for name, model in models.items() if model != "beam2d"]


def _lateral(member: Member) -> list[str]:
    """Reasons for which the motion leaves the vertical plane."""
    reasons = [
        f"the load {load.name} acts along {load.direction}"
        for load in member.part.loads
        if load.direction in ("y", "rx", "rz")
    ]
    reasons += [
        f"the mass {mass.name} lies beside the vertical plane"
        for mass in member.part.masses
        if mass.at is not None and mass.at[1] != 0.0
    ]
    box = member.part.body.box
    profiles = () if box is None else [profile for part in box.stretches for profile in (part.first, part.last)]
    if any(profile.thickness(face) != profile.thickness(other) for profile in profiles for face, other in SIDES):
        reasons.append("the walls at left and right differ")
    if any(" " in face for ring in member.pads for face in ring.faces):
        reasons.append("pads are on slanted faces")
    if member.gravity is not None and member.gravity.direction[1] != 0.0:
        reasons.append("the weight has a lateral part")
    if member.frame is not None and (member.frame.leaves_plane or member.frame.place[1] != 0.0):
        reasons.append("the boom slews, or its base moves sideways")
    return reasons


@dataclass(frozen=True)
class Needs:
    """Needs of a body on its way that a simulator has to meet; rows by their names."""

    pushing: tuple[str, ...] = ()  #: Rows that only push
    #: Those of them that neither a pad's stiffness nor residual flexibility lets give way
    rigid_pushing: tuple[str, ...] = ()
    giving: tuple[str, ...] = ()  #: Rows that give way
    rigid_moving: tuple[str, ...] = ()  #: Rigid rows that travel along a path
    rubbing: tuple[str, ...] = ()  #: Rows with friction
    machine: tuple[str, ...] = ()  #: Directions in which the machine below moves by itself
    rho_inf: float = 0.0  #: Spectral radius at infinite frequency


@dataclass(frozen=True)
class Capabilities:
    """Capabilities of a simulator; it integrates by generalized-alpha, which damps less than rho_inf says."""

    rows_that_push: bool = False
    rows_that_give_way: bool = True
    rows_that_rub: bool = False
    machine_that_moves: bool = False
    reduced_models: bool = True  # it is one of `simulation.simulators`
    package: str | None = None  # that it needs installed


#: By the names of `simulation.simulators` and `simulation.full`.
SIMULATORS = {
    "march": Capabilities(rows_that_push=True, rows_that_rub=True, machine_that_moves=True),
    "exudyn": Capabilities(rows_that_push=True, rows_that_rub=True, package="exudyn"),
    "exudyn-multiplier": Capabilities(package="exudyn"),
    "exudyn-callback": Capabilities(rows_that_give_way=False, package="exudyn"),
    "petsc": Capabilities(rows_that_push=True, rows_that_rub=True, reduced_models=False),
}


@dataclass(frozen=True)
class Asked:
    """Place where a simulator is named: file or ``"scene"``, key and value there."""

    source: str
    key: str
    value: Any


#: The full model as a reference.
REFERENCE = Asked("scene", "compare.against", ["full"])


def refuse(name: str, needs: Needs, place: Asked | None = None) -> None:
    """Refuse, by InputError, what the simulator of this name can't do, in a line that names the key that mends it."""
    can, place = SIMULATORS[name], place or Asked("scene", "simulation.simulators", name)
    lacking = {
        "rows_that_push": (needs.pushing, f"knows no rows that only push ({', '.join(needs.pushing)})"),
        "rows_that_give_way": (needs.giving, f"knows no rows that give way ({', '.join(needs.giving)})"),
        "rows_that_rub": (needs.rubbing, f"knows no friction ({', '.join(needs.rubbing)})"),
        "machine_that_moves": (needs.machine, f"knows no machine that moves by itself ({', '.join(needs.machine)})"),
    }
    for capability, (needed, reason) in lacking.items():
        if needed and not getattr(can, capability):
            able = [
                simulator for simulator, has in SIMULATORS.items() if has.reduced_models and getattr(has, capability)
            ]
            instead = "[]" if place is REFERENCE else " or ".join(able)
            raise InputError(place.source, place.key, place.value, f"{instead} is allowed: {name} {reason}")
    if needs.rigid_pushing:
        allowed = (
            f"{', '.join(needs.rigid_pushing)} only push and are rigid: true, or a stiffness in N/m of the pads, is "
            "allowed; the force of an impact of rigid parts is no number"
        )
        raise InputError("scene", "reduction.flexibility", False, allowed)
    if needs.rho_inf == 1.0 and needs.rigid_moving:
        without = ", or compare.against = []" if place is REFERENCE else ""
        allowed = (
            f"less than 1 is allowed while the rigid row {', '.join(needs.rigid_moving)} moves: an algebraic "
            "constraint (index 3) has multipliers that nothing damps, and they grow without bound; pads that give "
            f"way, or a residual flexibility, allow 1{without}"
        )
        raise InputError("scene", "time.rho_inf", needs.rho_inf, allowed)
