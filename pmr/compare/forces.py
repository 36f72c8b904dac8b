"""Forces of pads, cylinders, ropes and supports: their extremes, what exceeds limits, and forces that are unknown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from pmr.files.arrays import Array
from pmr.results import Response
from pmr.results.quantities import FORCE_OF
from pmr.results.response import Extremes
from pmr.results.run import SummaryPart
from pmr.results.tables import lug_forces, reaction_extremes, support_forces
from pmr.scene import Scene
from pmr.scene.built import PadRing, force_name, friction_name, reaction_name
from pmr.scene.choice import has_axial_motion
from pmr.scene.frame import INERTIA
from pmr.scene.keys import LUFFING, cylinder_name, qualified_name
from pmr.scene.mechanism import drive_rows, longest_rope, rope_shares
from pmr.scene.members import EXTENSION, members, pads_on_faces
from pmr.simulation.native.watched import NO_FORCE, History, exceeded_limits, exceeded_warnings, run_limits
from pmr.system.body import SlidingBody
from pmr.system.contacts import Friction
from pmr.system.system import System


def forces_part(scene: Scene, system: System, response: Response) -> SummaryPart:
    """Entries ``pads``, ``cylinders``, ``reactions`` and ``supports`` of summary.json: extremes of each force.

    Each extreme has its time and place.  Pads have their largest mean ``pressure`` in Pa, too: the absolute force
    divided by length times width of the pad.  If their ring states an ``allowed_pressure``, they also have this.
    Cylinders also have the largest ``friction`` in N to be overcome, the energy in J ``dissipated`` by friction, and
    their impulses at ``kinks``.  Warnings name forces and reactions that are not known, and kinks of paths at which
    cylinders take impulses.
    """
    joined, along, figures = len(scene.sections) > 1, scene.path_positions(response.t), dict[str, Any]()
    if joined or scene.pads:
        figures["pads"] = list(_pad_rows(scene, pad_extremes(scene, response)))
    if joined:
        figures["cylinders"] = list(_cylinder_rows(scene, system, response))
    kinks = {row["name"]: row.get("kinks", ()) for row in figures.get("cylinders", ())}
    warnings = _kink_warnings(kinks) + unknown_force_warnings(scene, response)
    warnings += missing_reaction_warnings(scene)
    figures |= reaction_rows(scene, response, along)
    supports = support_rows(scene, response)
    return SummaryPart(figures | ({"supports": supports} if supports else {}), warnings)


def limits_part(scene: Scene, system: System, response: Response) -> SummaryPart:
    """Entry ``exceeded`` of summary.json: a row for each limit of `run_limits` that does not hold in a response.

    A row has ``what`` happens and the time ``t`` in s at which it began.  There is a warning for each cause.  The entry
    is missing if all limits hold.
    """
    limits = run_limits(scene, system.contacts, max(NO_FORCE, response.force_floor))
    exceeded = exceeded_limits(limits, history_by_name(scene, response))
    rows: list[dict[str, Any]] = [{"what": of.limit.event, "t": float(response.t[of.first])} for of in exceeded]
    lines = exceeded_warnings(exceeded, lambda k: f"at {response.t[k]:g} s")
    return SummaryPart({"exceeded": rows} if rows else {}, grave=list(lines))


def history_by_name(scene: Scene, response: Response) -> History:
    """Return a function from the name of a force, of another output or of the luffing angle to its history (T,).

    It returns None for any other name.  The force of a rigid pad that does not move is the reaction of a support.
    """

    def history(name: str) -> Array | None:
        """History (T,) of the output `name` in its unit, or of the angle `LUFFING` in rad; None if there is none."""
        if name in response.force_names:
            return response.force(name)
        if name == LUFFING and scene.frame is not None:
            return np.asarray(scene.frame.angles.luffing.value(response.t))
        named = (name, reaction_name(name.removeprefix(FORCE_OF)))
        stored_name = next((of for of in named if of in response.other_names), None)
        return None if stored_name is None else response.other(stored_name)

    return history


def _pad_rows(scene: Scene, loads: Mapping[str, Extremes]) -> Iterator[dict[str, Any]]:
    """Yield rows of ``pads`` in summary.json from the extremes `loads` of the pads' forces, by name.

    The row of a pad on a face also has the pad's largest ``pressure`` in Pa, and the ``allowed_pressure`` if the scene
    has one.
    """
    on_faces = pads_on_faces(scene)
    for name, extremes in loads.items():
        row: dict[str, Any] = {"name": name, **extremes.summary()}
        if (pad := on_faces.get(name)) is not None:
            row["pressure"] = extremes.size / pad.area
            if pad.ring.allowed_pressure is not None:
                row["allowed_pressure"] = pad.ring.allowed_pressure
        yield row


def support_rows(scene: Scene, response: Response) -> list[dict[str, Any]]:
    """Rows of ``supports`` of summary.json: a row with extremes in N of each support's force.

    The row of a pin with lugs has the extremes of the larger force of its lugs, too, in ``lug``.
    """
    along = scene.path_positions(response.t)
    forces, of_lugs = (
        {name: Extremes.from_history(force, response.t, along).summary() for name, force in forces.items()}
        for forces in (support_forces(scene, response), lug_forces(scene, response))
    )
    return [
        {"name": name, **extremes} | ({"lug": of_lugs[name]} if name in of_lugs else {})
        for name, extremes in forces.items()
    ]


def pad_extremes(scene: Scene, response: Response) -> dict[str, Extremes]:
    """Extremes in N of the forces of all pads in the response, by name; a positive force pushes the body inwards.

    For a single body they are in the order of its rings.  For sections they are in the order of the response's outputs.
    """
    along = scene.path_positions(response.t)
    names = [name for ring in _pad_rings(scene) for name, _, _ in ring.named_pads]
    if len(scene.sections) > 1:
        names = [output.name.removeprefix(FORCE_OF) for output in response.outputs if output.kind == "pad"]
    history = history_by_name(scene, response)
    forces = {name: force for name in names if (force := history(force_name(name))) is not None}
    return {name: Extremes.from_history(force, response.t, along) for name, force in forces.items()}


def _pad_rings(scene: Scene) -> tuple[PadRing, ...]:
    """Rings of pads of a single body; empty for a boom of several sections."""
    return scene.pads if len(scene.sections) == 1 else ()


def _cylinder_rows(scene: Scene, system: System, response: Response) -> Iterator[dict[str, Any]]:
    """Yield rows of ``cylinders`` in summary.json: extremes of each cylinder's force, then its friction and kinks.

    Cylinders without a force in the response have no row.  Friction and ``kinks`` are left out where there are none.
    """
    at_kinks, along = cylinder_impulses(scene, system), scene.path_positions(response.t)
    driven = {force_name(cylinder_name(name)): name for name in scene.names[1:]}
    for force in response.force_names:
        if (body := driven.get(force)) is not None:
            history = response.clear_round_off(response.force(force))
            extremes = Extremes.from_history(history, response.t, along)
            row = {"name": cylinder_name(body), **extremes.summary()}
            if friction_name(body) in response.other_names:
                row |= _friction_figures(scene, system, response, body)
            yield row | ({"kinks": kinks} if (kinks := at_kinks[cylinder_name(body)]) else {})


def _friction_figures(scene: Scene, system: System, response: Response, body: str) -> dict[str, float]:
    r"""Largest ``friction`` in N along a section's joint, and the energy ``dissipated`` there in J, by these keys.

    .. math:: \int f\, dy - f^2 / (2 \textstyle\sum \kappa), \qquad y = s - \Lambda / k

    with the joint's total friction f, the extension s, the cylinder's force :math:`\Lambda` and stiffness k, and the
    stiffnesses :math:`\kappa` with which the joint's pads stick, as if all pads stuck in the same way
    (`pmr.system.contacts`).  `body` is the name of the section, whose pads must have friction.
    """
    friction = Friction.from_contacts(system.contacts)
    assert friction is not None  # the response has friction
    joint = friction.joints.index(body)
    f, drive = response.other(friction_name(body)), response.force(force_name(cylinder_name(body)))
    y = scene.paths[body].value(response.t) - friction.cylinder_compliance[joint] * drive
    grip = friction.stiffness[friction.first_pads[joint] : friction.first_pads[joint + 1]].sum()
    dissipated = (f[1:] + f[:-1]) @ np.diff(y) / 2.0 - (f[-1] ** 2 - f[0] ** 2) / (2.0 * grip)
    return {"friction": float(np.abs(f).max()), "dissipated": max(0.0, float(dissipated))}


def reaction_rows(scene: Scene, response: Response, path: Array) -> dict[str, object]:
    """Entry ``reactions`` of summary.json: rows with ``name``, ``unit`` and the keys of `Extremes.summary`.

    There is a row for each direction in which a support holds, rigid or not, and for each reaction at the pivot, on the
    ground and of a machine.  Without these the result is empty.  In a boom, names of supports begin with that of the
    section.  `path` (T,) in m is the path coordinate, or the reach of the sections, at the times of the response.
    """
    extremes_of = reaction_extremes(response, path)
    rows = [{"name": of.support, "unit": of.unit, **extremes.summary()} for of, extremes in extremes_of.items()]
    for body, part in zip(scene.names, scene.sections, strict=True):
        for name, unit in part.spring_units.items():
            if (force := qualified_name(body, force_name(name))) in response.force_names:
                extremes = Extremes.from_history(response.force(force), response.t, path)
                rows.append({"name": qualified_name(body, name), "unit": unit, **extremes.summary()})
    return {"reactions": rows} if rows else {}


def missing_reaction_warnings(scene: Scene) -> list[str]:
    """List a warning for each of two kinds of reactions that the models do not compute, if the scene has any.

    The first are reactions along x of beams without axial coordinates, if a weight or a sliding section acts along
    these beams.  The second are forces of supports with ``points = "all"``.
    """
    weight_along = scene.gravity is not None and scene.gravity.direction[0] != 0.0
    # sections that slide in others are accelerated along them, and have cylinders; a mass on a wheel has none
    slides = any(part.joint is not None and part.body.mover is None for part in scene.sections)
    without_axial = [
        member for member in members(scene) if member.part.body.mover is None and not has_axial_motion(member)
    ]
    bodies_without_axial = [m.part.name or "the body" for m in without_axial if weight_along or slides]
    supports = [(body, support) for body, part in scene.bodies.items() for support in part.supports]
    supports_of_all_points = [qualified_name(body, str(of.on)) for body, of in supports if of.points == "all"]
    of_bodies = (
        f"{', '.join(bodies_without_axial)}: planar beams without coordinates along x (body.profile.axial is false), "
        "so that reactions and cylinder forces along it are not computed"
    )
    of_supports = (
        f"forces of supports with points = 'all' ({', '.join(supports_of_all_points)}) are not computed, with 'mean' "
        "they are"
    )
    return [of_bodies] * bool(bodies_without_axial) + [of_supports] * bool(supports_of_all_points)


def unknown_force_warnings(scene: Scene, response: Response) -> list[str]:
    """List a warning that names those rigid pads at rest on a single body whose forces are unknown.

    The model does not contain such a force: the pad holds the body by the choice of coordinates alone.  The list is
    empty if all forces of pads are known, if there are several sections, or if the response has no contact forces at
    all.
    """
    staying = [ring for ring in _pad_rings(scene) if ring.stiffness == "rigid" and not ring.moving]
    history = history_by_name(scene, response)
    names = [name for ring in staying for name, _, _ in ring.named_pads if history(force_name(name)) is None]
    if not names or not response.force_names:
        return []
    pads = f"the pads {', '.join(names)} are" if len(names) > 1 else f"the pad {names[0]} is"
    return [f"{pads} rigid and stay on the body: their forces are unknown; give them a stiffness in N/m"]


def cylinder_impulses(boom: Scene, system: System) -> dict[str, list[dict[str, float]]]:
    r"""Impulses of each cylinder at the kinks of all extensions, by cylinder, in order of time: ``t`` and ``impulse``.

    .. math:: I_i = \sum_{k \ge i} m_k\, \Delta \dot X_k, \qquad \Delta \dot X_k = \sum_{j \le k} \Delta \dot s_j

    with the jump :math:`\Delta \dot s_j` in the speed of the extension of section j, the mass :math:`m_k` of section k,
    and the jump :math:`\Delta \dot X_k` in the speed of section k.  The time ``t`` is in s, the ``impulse`` in N s.
    The cylinder i pushes section i and all sections beyond, which lean on section i.
    """
    jumps = [path.kinks(boom.time.end) for path in boom.paths.values()]
    masses = [_accelerated_mass(system.bodies[name]) for name in boom.names[1:]]
    kinks_of_cylinders = dict[str, list[dict[str, float]]]()
    for i, name in enumerate(boom.names[1:]):
        at = {t: 0.0 for kinks in jumps for t in sorted(kinks)}
        for t in at:
            speeds = np.cumsum([kinks.get(t, 0.0) for kinks in jumps])
            at[t] = float(np.dot(masses[i:], speeds[i:]))
        kinks_of_cylinders[cylinder_name(name)] = [{"t": t, "impulse": impulse} for t, impulse in sorted(at.items())]
    return kinks_of_cylinders


def _accelerated_mass(body: SlidingBody) -> float:
    """Mass in kg that an extension of the body accelerates; 0 if the body has no input for this acceleration."""
    along = [k for k, name in enumerate(body.input_names) if name in (EXTENSION, INERTIA + "x")]
    if not along:
        return 0.0
    B = np.asarray(body.B)[:, along[0]]
    return float(B @ spla.spsolve(sp.csc_matrix(body.M), B))


def _kink_warnings(kinks_of_cylinders: Mapping[str, Sequence[Mapping[str, float]]]) -> list[str]:
    """List a warning that forces at kinks must not be used for sizing; empty if no cylinder has kinks.

    `kinks_of_cylinders` has the time and the impulse of each kink, by cylinder; the largest impulse is named.
    """
    kinks = [(kink, name) for name, of_cylinder in kinks_of_cylinders.items() for kink in of_cylinder]
    if not kinks:
        return []
    most, t, name = max((abs(kink["impulse"]), kink["t"], name) for kink, name in kinks)
    return [
        f"extensions have kinks, where cylinders give impulses, up to {most:.4g} N s: {name} at {t:g} s; the height of "
        "cylinder and pad forces there depends on the step, on stiffnesses and on the number of coordinates, so size "
        "nothing by them (cylinders in summary.json have all impulses; a smooth_ramp has no kinks)"
    ]


def rope_forces(scene: Scene, response: Response) -> dict[str, Array]:
    r"""Force (T,) in N on each section that has a rope, follows another or is followed, by name; positive pushes out.

    If a rope that the joint j drives moves section k, its extension is :math:`s_k = r_k s_j + c_k`, with the ratio r_k
    and the offset c_k.  Let :math:`F_k` be the force along the boom between section k and the next outer one if each
    section had a cylinder of its own.  By virtual work

    .. math::
        T_j = F_j + \sum_{k\ \mathrm{follows}\ j} r_k T_k

    is the force with which the rope or cylinder of the joint j pushes; for a rope, with all of its strands together.
    The power with which a cylinder moves its section and all sections that follow it is :math:`T_j \dot s_j`.  The
    friction of the joints' pads is included, the friction of sheaves is not.

    The result is empty if there are no such sections, or if forces along the boom are unknown.
    """
    shares = rope_shares(scene)
    if any(force_name(cylinder_name(name)) not in response.force_names for name in shares):
        return {}
    cylinders = [name for name in map(cylinder_name, scene.names[1:]) if force_name(name) in response.force_names]
    forces_of_all = np.array([response.force(force_name(name)) for name in cylinders])
    return {name: row @ forces_of_all for name, row in drive_rows(scene, cylinders).items() if name in shares}


def ropes_part(scene: Scene, response: Response) -> SummaryPart:
    """Entry ``ropes`` of summary.json, a row for each section in `rope_forces`: extremes of the ``force`` in N.

    A row has the ``name`` of the section and the section that it ``follows``, or None.  If a section follows no other,
    its row has the ``power`` in W for moving this section and all its followers.  If a rope has a stiffness EA, its row
    has the rope's largest ``length`` in m on the way, and the ``stiffness`` in N/m of all strands together at that
    length.  The part is empty without such sections.
    """
    if len(scene.sections) < 2:
        return SummaryPart()
    along, rows = scene.path_positions(response.t), list[Mapping[str, Any]]()
    for name, force in rope_forces(scene, response).items():
        number = scene.names.index(name)
        follows = scene.joint(number).follows
        force = response.clear_round_off(force)
        extremes = Extremes.from_history(force, response.t, along)
        row: dict[str, Any] = {"name": name, "follows": follows, "force": extremes.summary()}
        if follows is None:
            power = force * scene.paths[name].rate(response.t)
            row["power"] = Extremes.from_history(power, response.t, along).summary()
        if (rope := scene.joint(number).rope) is not None:
            length = longest_rope(scene, number)
            row |= {"length": length, "stiffness": rope.strands * rope.EA / length}
        rows.append(row)
    return SummaryPart({"ropes": rows} if rows else {})
