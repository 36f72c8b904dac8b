"""Choice of the structural model of each body, properties that follow from it, and capabilities of the simulators.

`choose_model` takes the model that a scene names, or for ``auto`` the smallest one that can carry loads, pads and
outputs of the scene.  Whether that model is accurate enough is measured by comparison with a shell
(`pmr.pipeline.scenes`), not decided here.

`SIMULATORS` lists what each simulator supports, by the names of simulators in scenes; `refuse_unsupported` raises an
InputError for everything else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pmr.errors import InputError
from pmr.scene.box import Box
from pmr.scene.built import POLYNOMIALS, PRESSED, Load
from pmr.scene.hoist import HOIST
from pmr.scene.keys import Direction
from pmr.scene.members import Member, members
from pmr.scene.model_traits import ModelTraits, model_traits
from pmr.scene.profile import FACES, Face
from pmr.scene.signals import Constant

#: Share of a wall's lowest frequency up to which its response is assumed to be quasi-static.
QUASI_STATIC = 1.0 / 3.0
#: Distance of the first and last observed position from the ends of a body, as a share of its length.
FROM_AN_END = 0.05
#: Largest distance in m of a pad from the mirror image of another one at y = 0.
SYMMETRIC = 1e-9
#: Pairs of faces that mirror each other at y = 0.
MIRRORS: tuple[tuple[Face, Face], ...] = (("left", "right"), ("bottom left", "bottom right"), ("top left", "top right"))


@dataclass(frozen=True)
class ModelChoice:
    """Name of a structural model, and the reasons for choosing it, each a clause of a sentence."""

    model: str
    reasons: tuple[str, ...]


def choose_model(member: Member, by_itself: bool = False) -> ModelChoice:
    """Return the structural model of a body, named by the scene or chosen for ``auto``, with the reasons.

    With ``auto``, a mass that moves along another section becomes the model ``mover``, and a body with a profile is a
    planar beam.  Others are planar beams, beams in space or shells, whichever is the smallest that suffices.  A body
    that could be a planar beam becomes a beam in space if any other section is not planar; `by_itself` switches this
    off.
    """
    if member.part.body.model != "auto":
        return ModelChoice(member.part.body.model, ("the scene names it",))
    if member.part.body.mover is not None:
        return ModelChoice("mover", ("it is a mass that crosses another section",))
    if member.part.body.profile is not None:
        return ModelChoice("beam2d", ("its stiffnesses are those of a planar beam",))
    if shell := [*_stress_reasons(member), *_wall_reasons(member)]:
        return ModelChoice("shell", tuple(shell))
    if space := [*_lateral_reasons(member), *([] if by_itself else _other_model_reasons(member))]:
        return ModelChoice("beam3d", tuple(space))
    return ModelChoice("beam2d", ("all loads and masses lie in the vertical plane",))


def is_undecided(member: Member) -> bool:
    """Whether the model is left to measurements: the scene says ``auto``, and a beam may represent the body's box."""
    body = member.part.body
    return body.model == "auto" and body.box is not None and traits_of(member).is_beam


def model_of(member: Member) -> str:
    """Name of the structural model that `choose_model` returns for a body."""
    return choose_model(member).model


def traits_of(member: Member) -> ModelTraits:
    """Traits of the structural model that `choose_model` returns for a body."""
    return model_traits(model_of(member))


def observed_places(member: Member) -> tuple[float, ...] | None:
    """Positions along the axis in m at which a body's motion is observed.

    They are those from `observe.start` to `observe.end`, if these are set.  Otherwise a beam or a mover is observed at
    its nodes, and the result is None.  Bodies with other models then have `observe.count` places, the first and the
    last one `FROM_AN_END` of the length away from the ends.  For these, an `InputError` is raised if the length is not
    known.
    """
    observe, length = member.part.observe, member.part.body.length
    if observe.stations is not None or traits_of(member).has_line:
        return observe.stations
    if length is None:
        allowed = "places in m are needed, from observe.start to observe.end: the body has no length without a mesh"
        raise InputError("scene", "observe.start", None, allowed)
    return tuple(np.linspace(FROM_AN_END * length, (1.0 - FROM_AN_END) * length, observe.count).tolist())


def has_giving_walls(member: Member) -> bool:
    """Whether the chosen model is a beam whose walls are locally flexible under pads, as ``body.walls`` says."""
    return member.part.body.walls == "give" and traits_of(member).walls_may_give


def has_walls_that_could_give(member: Member) -> bool:
    """Whether the chosen model is a beam of a box whose walls are rigid under its pads, but could be made flexible."""
    body, has_pads = member.part.body, bool(member.pads) and not member.points
    return body.box is not None and body.walls == "rigid" and traits_of(member).walls_may_give and has_pads


def motion_directions(member: Member) -> tuple[Direction, ...]:
    """Return those of x, y, z, rx, ry, rz along or about which points of a body can move in its model.

    A mover moves along z, and along x with the section that carries it, if that can move along x.
    """
    if traits_of(member).kind == "mass":  # along the boom it moves with the section that carries it
        carrier = motion_directions(Member(member.scene, member.number - 1)) if member.number else ()
        return ("x", "z") if "x" in carrier else ("z",)
    if not is_planar(member):
        return ("x", "y", "z", "rx", "ry", "rz")
    profile = member.part.body.profile
    return ("x", "z", "ry") if profile is None or profile.axial else ("z", "ry")


def input_directions(member: Member, load: Load) -> dict[str, Direction]:
    """Return the axis of the body along or about which each input of a load acts, by the names of the inputs.

    A load along an axis of the body is one input, with the load's name.  A load along an axis of the ground becomes one
    input ``"NAME AXIS"`` for each axis of the body along which it may act as the frame turns; axes along which the
    model can't move are left out.  Wind becomes one input ``"NAME AXIS NUMBER"`` for each Legendre polynomial along the
    body and each axis.
    """
    if load.acts == "wind":
        pressed: tuple[Direction, ...] = tuple(axis for axis in PRESSED if axis in motion_directions(member))
        return {f"{load.name} {axis} {number}": axis for axis in pressed for number in range(POLYNOMIALS)}
    if load.axes == "body":
        return {load.name: load.direction}
    planar = member.frame is not None and member.frame.slewing is None
    turned: tuple[Direction, ...]
    if member.frame is not None and member.frame.base_angles:
        turned = ("x", "y", "z")
    elif planar:
        turned = ("y",) if load.direction == "y" else ("x", "z")
    else:
        turned = ("x", "z") if load.direction == "z" else ("x", "y", "z")
    return {f"{load.name} {axis}": axis for axis in turned if axis in motion_directions(member)}


def axis_loads(member: Member) -> tuple[Load, ...]:
    """Return one load along an axis of the body for each input that the loads of a body become (`input_directions`).

    It has all other keys of the load that it comes from, with the signal of that load.  The loads by which the rope of
    a hoist pulls the body are the last.
    """
    of_loads = tuple(
        load.model_copy(update={"name": name, "direction": direction, "axes": "body"})
        for load in member.part.loads
        for name, direction in input_directions(member, load).items()
    )
    return (*of_loads, *(pull.load for pull in rope_pulls(member)))


class RopePull(NamedTuple):
    """Load by which the rope of a hoist pulls a body at `place`, ``head`` or ``winch``; its signal is zero.

    `lever` (3,) is the displacement of the place per unit of the load's own displacement or angle.
    """

    load: Load
    place: str
    lever: tuple[float, float, float]


def rope_pulls(member: Member) -> tuple[RopePull, ...]:
    """Return the loads by which the rope of a hoist pulls a body: forces, and moments of forces off its axis."""
    pulls, moves, none = list[RopePull](), motion_directions(member), Constant(amount=0.0)
    for place, (on, (_, y, z)) in member.rope_places.items():
        levers: dict[Direction, tuple[float, float, float]] = {
            "x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
            "rx": (0.0, -z, y), "ry": (z, 0.0, 0.0), "rz": (-y, 0.0, 0.0),
        }  # fmt: skip
        for d, lever in levers.items():
            if d in moves and any(lever):
                name = f"{HOIST}{d}" if place == "head" else f"{HOIST}{place} {d}"
                pulls.append(RopePull(Load(name=name, on=on, direction=d, signal=none), place, lever))
    return tuple(pulls)


def is_pinned_beam(member: Member) -> bool:
    """Whether a body is a planar beam that only a rigid pin at x = 0 and one sliding point without an offset hold.

    The beam is given by its stiffnesses (`body.profile`), without pads and point masses.
    """
    held = [
        (member.part.position_of(support.on), support.stiffness, set(support.held_directions) & {"x", "z", "ry"})
        for support in member.part.supports
    ]
    is_bare = member.points == (0.0,) and not (member.pads or member.part.masses)
    return member.part.body.profile is not None and held == [(0.0, "rigid", {"x", "z"})] and is_bare


def has_axial_motion(member: Member) -> bool:
    """Whether the body's model has displacements along the boom, as a body that a cylinder drives needs them."""
    return "x" in motion_directions(member)


def has_driven_tail(member: Member) -> bool:
    """Whether the model needs loads along x on the tail, as a cylinder could act there, even if the scene has none.

    The result is true for each section of a boom of several sections that has displacements along x.  The base may be
    an exception: there the cylinder is that of the next section.  The result is False for a base with a support that
    holds every point of its tail along x.  On a beam with a cylinder beside the axis, the support has to hold the
    rotations of the tail as well.
    """
    # a support of every point removes the tail's coordinates along x from the model
    at_tail = [support for support in member.part.supports if support.on == "tail" and support.points == "all"]
    held = {direction for support in at_tail for direction in support.held_directions}
    beside = traits_of(member).is_beam and any(point and any(point) for point in member.tail_points.values())
    is_held = {"x", "ry", "rz"} & {*motion_directions(member)} <= held if beside else "x" in held
    return member.has_joint and has_axial_motion(member) and (member.number > 0 or not is_held)


def is_accelerated(member: Member) -> bool:
    """Whether extensions alone, without a frame, accelerate a section along the boom; False for the base."""
    return member.number > 0 and has_driven_tail(member) and member.frame is None


def inertia_fields(member: Member) -> tuple[str, ...]:
    """Return the names of the acceleration fields that a moving frame applies to a body; empty without a frame.

    Field ``x`` is uniform along x; field ``xz`` acts along x and is proportional to z.  Fields that have no effect on
    the body's model are left out.
    """
    if member.frame is None:
        return ()
    turning = "xyz" if member.frame.out_of_plane_key else "xz"
    along = [axis for axis in turning if axis in motion_directions(member)]
    if not member.frame.has_angles:
        return tuple(along)
    if traits_of(member).is_beam and not _has_rotary_inertia(member):
        torsion = () if is_planar(member) or "y" not in turning else ("yz", "zy")
        return (*along, *(axis + "x" for axis in along), *torsion)
    return (*along, *(axis + over for axis in along for over in turning))


def _has_rotary_inertia(member: Member) -> bool:
    """Whether a mass on a beam has moments of inertia or is off the axis, or the beam has rotary inertia itself.

    A beam in space has rotary inertia together with its shear deformation.
    """
    is_off_axis = [mass.at is not None and mass.at[1:] != (0.0, 0.0) for mass in member.part.masses]
    attached = any(any(mass.inertia) for mass in member.part.masses)
    return attached or any(is_off_axis) or (member.part.body.shear and not is_planar(member))


def is_planar(member: Member) -> bool:
    """Whether a body is modelled as a planar beam or as a mover."""
    return traits_of(member).is_planar


def fewest_rows(member: Member) -> int:
    """Return the number of constraint rows of sliding points and of rigid supports of mean motions, without pads."""
    moves = motion_directions(member)
    rigid = [support for support in member.part.supports if support.stiffness == "rigid" and support.points == "mean"]
    return sum(direction in moves for support in rigid for direction in support.held_directions) + len(member.points)


def pad_faces(member: Member) -> tuple[str, ...]:
    """Names of the faces whose pads act on the chosen model: bottom and top for a planar beam, else all faces."""
    return ("bottom", "top") if is_planar(member) else FACES


def transverse_axes(member: Member) -> tuple[str, ...]:
    """Axes across the body along which the chosen model has displacements: z, and also y in a model in space."""
    return ("z",) if is_planar(member) else ("y", "z")


def wall_frequency(box: Box, young: float, poisson: float, density: float) -> float:
    r"""Lowest frequency in Hz of the box's flat walls as long plates that are hinged on both edges.

    Of the walls with the width b and the thickness t, the one with the least t / b^2 has the lowest frequency

    .. math:: f = \frac{\pi}{2 b^2} \sqrt{\frac{E t^2}{12 \rho (1 - \nu^2)}}

    with the Young's modulus E (`young`) in Pa, Poisson's ratio :math:`\nu` (`poisson`) and the density :math:`\rho`
    (`density`) in kg/m^3.  The frequency is infinite for a box without flat walls.

    Leissa: Vibration of Plates, NASA SP-160, 1969, section 4.1 (a infinite).
    """
    softest = min((side.thickness / side.length**2 for side in box.faces.values()), default=np.inf)
    return float(np.pi / 2.0 * softest * np.sqrt(young / (12.0 * density * (1.0 - poisson**2))))


def _stress_reasons(member: Member) -> list[str]:
    """Reason for a shell if the scene asks for stresses or strains, otherwise an empty list."""
    measured = {measure for probe in member.part.probes for measure in probe.measures}
    recovery = member.scene.recovery
    has_stresses = recovery is not None and recovery.stress or bool(measured & {"stress", "strain"})
    return ["stresses are computed, which depend on pads and walls"] * has_stresses


def _wall_reasons(member: Member) -> list[str]:
    """Reasons for a shell: loads near the walls' lowest frequency, or frames in the box; otherwise an empty list."""
    box, material = member.part.body.box, member.part.body.material
    if box is None:
        return []
    highest = max((signal.highest_frequency(-np.inf, np.inf) for signal in member.signals.values()), default=0.0)
    of_walls = wall_frequency(box, material.young, material.poisson, material.density)
    near = f"loads of {highest:g} Hz come near the walls' own frequency of {of_walls:.3g} Hz"
    return [near] * (highest > QUASI_STATIC * of_walls) + ["the box has frames"] * bool(box.frames)


def _other_model_reasons(member: Member) -> list[str]:
    """Reasons for a beam in space from other sections: if one section is no planar beam, all have to be in space."""
    neighbours = [section for section in members(member.scene) if section.number != member.number]
    spatial = [other for other in neighbours if not model_traits(choose_model(other, by_itself=True).model).is_planar]
    return [f"section {other.part.name} is no planar beam" for other in spatial]


def _lateral_reasons(member: Member) -> list[str]:
    """Reasons for a beam in space: causes that move the body out of the vertical plane; otherwise an empty list."""
    reasons = lateral_load_reasons(member)
    masses_apart = [mass for mass in member.part.masses if mass.at is not None]
    reasons += [f"the mass {mass.name} has a place of its own, masses.at" for mass in masses_apart]
    loads_apart = [load for load in member.part.loads if load.point is not None]
    reasons += [f"the load {load.name} has a place of its own, loads.point" for load in loads_apart]
    if any(point and point[1] for point in member.tail_points.values()):
        reasons.append("a cylinder or rope pushes beside the vertical plane")
    if has_unlike_side_walls(member):
        reasons.append("the walls at left and right differ")
    if any(" " in face for ring in member.pads for face in ring.faces):
        reasons.append("pads are on slanted faces")
    across = [
        sorted(places) for ring in member.pads for face, places in ring.faces.items() if face in ("bottom", "top")
    ]
    if any(not np.allclose(places, np.negative(places[::-1]), rtol=0.0, atol=SYMMETRIC) for places in across):
        reasons.append("pads at the bottom or top are not alike at left and right")
    if member.gravity is not None and member.gravity.direction[1] != 0.0:
        reasons.append("the weight has a lateral part")
    if member.frame is not None and (member.frame.out_of_plane_key or member.frame.tail_position[1] != 0.0):
        reasons.append("the boom slews, or its base moves sideways")
    return reasons


def lateral_load_reasons(member: Member) -> list[str]:
    """List clauses on what pushes a body out of the vertical plane: its loads, wind, and the hoist of its scene."""
    lateral = [load for load in member.part.loads if load.direction in ("y", "rx", "rz")]
    reasons = [f"the load {load.name} acts along {load.direction}" for load in lateral]
    if member.frame is not None:
        wind = [load for load in member.part.loads if load.blows_sideways(member.frame.unit)]
        reasons += [f"the wind {load.name} blows from the side" for load in wind]
    hoist = member.scene.hoist
    if hoist is not None and hoist.lateral_key:
        reasons.append(f"hoist.{hoist.lateral_key} leads out of the vertical plane")
    return reasons


def has_unlike_side_walls(member: Member) -> bool:
    """Return whether the walls of a box at left and right differ in thickness; False without a box."""
    box = member.part.body.box
    profiles = () if box is None else [profile for part in box.stretches for profile in (part.first, part.last)]
    walls = ([(of.thickness(face), of.shift(face)) for face in pair] for of in profiles for pair in MIRRORS)
    return any(wall != other for wall, other in walls)


@dataclass(frozen=True)
class SimulatorNeeds:
    """Needs of a simulation that its simulator has to meet; rows of pads, supports and sliders by their names."""

    pushing_rows: tuple[str, ...] = ()  #: Rows that only push
    #: Rows that only push and are rigid: neither a pad's stiffness nor residual flexibility lets them give way
    rigid_pushing_rows: tuple[str, ...] = ()
    flexible_rows: tuple[str, ...] = ()  #: Rows that give way
    rigid_moving_rows: tuple[str, ...] = ()  #: Rigid rows that travel along a path
    friction_rows: tuple[str, ...] = ()  #: Rows with friction
    hoist: bool = False  #: A hoist, whose payload swings
    free_machine_directions: tuple[str, ...] = ()  #: Directions in which the machine below the boom is free
    rho_inf: float = 0.0  #: Spectral radius at infinite frequency


@dataclass(frozen=True)
class Capabilities:
    """Features that a simulator supports; every simulator integrates by generalized-alpha."""

    rows_that_push: bool = False
    rows_that_give_way: bool = True
    rows_that_rub: bool = False
    machine_that_moves: bool = False
    payload_that_swings: bool = False
    reduced_models: bool = True  # whether it simulates reduced models, as one of `simulation.simulators`
    package: str | None = None  # package that has to be installed for it


#: Simulators by their names in `simulation.simulators` and `simulation.full`.
SIMULATORS = {
    "march": Capabilities(rows_that_push=True, rows_that_rub=True, machine_that_moves=True, payload_that_swings=True),
    "exudyn": Capabilities(rows_that_push=True, rows_that_rub=True, package="exudyn"),
    "exudyn-multiplier": Capabilities(package="exudyn"),
    "exudyn-callback": Capabilities(rows_that_give_way=False, package="exudyn"),
    "petsc": Capabilities(rows_that_push=True, rows_that_rub=True, reduced_models=False),
}


@dataclass(frozen=True)
class SimulatorKey:
    """Key that names a simulator: the file (or ``"scene"``) in which the key is written, the key and its value."""

    source: str
    key: str
    value: object


#: Key by which a scene asks for the simulation of its full model, as a reference.
REFERENCE = SimulatorKey("scene", "compare.against", ["full"])


def refuse_unsupported(name: str, needs: SimulatorNeeds, place: SimulatorKey | None = None) -> None:
    """Raise an InputError for the first of the `needs` that the simulator `name` does not support.

    The error says what to change.  `place` is the key that names the simulator; None means ``simulation.simulators``.
    """
    can, place = SIMULATORS[name], place or SimulatorKey("scene", "simulation.simulators", name)
    lacking = {
        "rows_that_push": (needs.pushing_rows, f"knows no rows that only push ({', '.join(needs.pushing_rows)})"),
        "rows_that_give_way": (needs.flexible_rows, f"knows no rows that give way ({', '.join(needs.flexible_rows)})"),
        "rows_that_rub": (needs.friction_rows, f"knows no friction ({', '.join(needs.friction_rows)})"),
        "machine_that_moves": (
            needs.free_machine_directions,
            f"computes no motion that is free ({', '.join(needs.free_machine_directions)})",
        ),
        "payload_that_swings": (needs.hoist, "knows no hoist, whose payload swings"),
    }
    for capability, (needed, reason) in lacking.items():
        if needed and not getattr(can, capability):
            able = [other for other, has in SIMULATORS.items() if has.reduced_models and getattr(has, capability)]
            instead = "[]" if place is REFERENCE else " or ".join(able)
            raise InputError(place.source, place.key, place.value, f"{instead} is allowed: {name} {reason}")
    if needs.rigid_pushing_rows:
        allowed = (
            f"{', '.join(needs.rigid_pushing_rows)} only push and are rigid, so that an impact has no finite force; "
            "true, or a stiffness of the pads in N/m, is allowed"
        )
        raise InputError("scene", "reduction.flexibility", False, allowed)
    if needs.rho_inf == 1.0 and needs.rigid_moving_rows:
        without = ", or compare.against = []" if place is REFERENCE else ""
        allowed = (
            f"less than 1 is allowed while the rigid row {', '.join(needs.rigid_moving_rows)} moves: an algebraic "
            "constraint (index 3) has multipliers that nothing damps, and they grow without bound; pads that give "
            f"way, or a residual flexibility, allow 1{without}"
        )
        raise InputError("scene", "time.rho_inf", needs.rho_inf, allowed)
