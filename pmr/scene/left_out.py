"""What a scene's model leaves out, in words for the first page of a run and for a load chart."""

from __future__ import annotations

from pmr.scene.built import Load
from pmr.scene.choice import has_walls_that_could_give, traits_of
from pmr.scene.keys import qualified_name
from pmr.scene.members import members
from pmr.scene.scene import Scene
from pmr.scene.structures import PointMass

#: Least share of a hung load's mass that point masses at its place must have, so that the load counts as having a mass.
HAS_MASS = 0.5


def left_out(scene: Scene, at_rest: bool = False) -> dict[str, str]:
    """Return effects that the model of a scene does not contain, as clauses by subject.

    The list follows from the scene: what has a key of its own, such as wind or friction, is named only where the scene
    does not use it.  A model `at_rest`, as that of a load chart, has neither friction nor fatigue.
    """
    clauses = {
        "strength": _strength(scene, at_rest),
        "walls": _walls(scene),
        "pads": _pads(scene, at_rest),
        "masses": _masses(scene),
        "loads": _loads(scene),
        "machine": _machine(scene),
    }
    return {subject: ", ".join(parts) for subject, parts in clauses.items() if parts}


def hung_forces(scene: Scene) -> dict[str, float]:
    """Return the mass in kg that would weigh as much as each force, by load name, that only pulls the tip down.

    These are forces on the last section along the vertical whose largest pull during the run counts.  The result is
    empty without gravity, and if the masses at the tip are at least the share `HAS_MASS` of the sum.
    """
    part = scene.sections[-1]
    gravity = scene.gravity.acceleration if scene.gravity is not None else 0.0
    at_tip = sum(mass.mass for mass in part.masses if mass.on == "tip")
    hung = {
        qualified_name(part.name, load.name): -load.signal.bounds(0.0, scene.time.end)[0] / gravity
        for load in part.loads
        if gravity and is_hung(load, scene)
    }
    return hung if at_tip < HAS_MASS * sum(hung.values()) else {}


def is_hung(load: Load, scene: Scene) -> bool:
    """Return whether a load is a force that pulls the tip of a section down in space, and never up."""
    low, high = load.signal.bounds(0.0, scene.time.end)
    is_down = (load.acts, load.axes, load.direction, load.on) == ("force", "ground", "z", "tip")
    return is_down and low < 0.0 >= high


def hung_force_remark(scene: Scene) -> str:
    """Return a sentence that names the forces of `hung_forces`; empty if there are none."""
    hung = hung_forces(scene)
    names = " and ".join(f"{name} ({mass:.4g} kg)" for name, mass in hung.items())
    are, its = ("are forces", "their") if len(hung) > 1 else ("is a force", "its")
    return (
        f"{names} {are} without mass: frequencies, accelerations and the forces that they cause lack {its} inertia; "
        "[[masses]] with payload = true, or [hoist], has it"
        if hung
        else ""
    )


def _strength(scene: Scene, at_rest: bool) -> list[str]:
    """Effects on strength that no stress contains; with `at_rest`, fatigue is always among them.

    The list is empty if no section has a cross-section.
    """
    if all(part.body.profile is not None or part.body.mover is not None for part in scene.sections):
        return []  # lines without a section, which have no stress
    clauses, boxes = list[str](), [member for member in members(scene) if member.part.body.box is not None]
    if any(traits_of(member).is_beam and member.pads for member in boxes):
        clauses.append("local bending of walls under pads in the stress of beams")
    if boxes:
        clauses.append("buckling of plates")
    clauses += ["how loads enter walls at lugs, hinges and the head"] if boxes else []
    clauses += ["welds, bolts and cut-outs", "plastic deformation"]
    return clauses if scene.fatigue is not None and not at_rest else [*clauses, "fatigue"]


def _walls(scene: Scene) -> list[str]:
    """What stiff walls of beams leave out of the motion, if pads press on them."""
    if not any(has_walls_that_could_give(member) and member.pads for member in members(scene)):
        return []
    return [
        "compliance of walls under pads, so that deflections are too small, frequencies too high and forces of pads "
        "off: body.walls = 'give' adds it"
    ]


def _pads(scene: Scene, at_rest: bool) -> list[str]:
    """Effects in pads that the scene does not use; with `at_rest`, friction is always among them.

    The list is empty if there are no pads.
    """
    rings = [ring for part in scene.sections for ring in part.rings]
    if not rings:
        return []
    clauses = [] if not at_rest and any(getattr(ring, "friction", 0.0) for ring in rings) else ["friction"]
    gaps = [ring.clearance.values() if isinstance(ring.clearance, dict) else [ring.clearance] for ring in rings]
    if not any(gap for of_ring in gaps for gap in of_ring):
        clauses.append("play, which at side pads changes the stress in walls")
    return [*clauses, "wear", "spread of the pressure under a pad"]


def _masses(scene: Scene) -> list[str]:
    """Parts of a boom of boxes that have no mass in the model, unless the scene names a mass for them."""
    if not any(part.body.box for part in scene.sections):
        return []
    joined = any(part.joint is not None and part.joint.cylinder is not None for part in scene.sections)
    cylinders = ["cylinders"] if joined or scene.frame is not None and scene.frame.cylinder is not None else []
    return [*cylinders, "stiffeners, pads, hoses and fittings, unless [[masses]] has them: walls alone have weight"]


def _loads(scene: Scene) -> list[str]:
    """Loads and their dynamic effects that the scene does not have.

    The list is empty for a scene without a frame whose sections are no boxes.
    """
    loads = [load for part in scene.sections for load in part.loads]
    masses: list[PointMass] = [mass for part in scene.sections for mass in part.masses]
    if scene.frame is None and not any(part.body.box for part in scene.sections):
        return []
    acting = {load.acts for load in loads}
    clauses = [] if "wind" in acting else ["wind on the sections"]
    clauses += [] if "temperature" in acting else ["temperature"]
    if any(mass.payload for mass in masses):
        clauses.append("swing of the payload, which is fixed to the tip, and its rope")
    return clauses


def _machine(scene: Scene) -> list[str]:
    """Parts of the machine that the model holds rigid or leaves out; empty for a single body without a frame."""
    frame = scene.frame
    if frame is None and len(scene.sections) == 1:
        return []
    clauses = ["play in hinges"]
    if frame is not None and frame.machine is None:
        stands = frame.ground is not None
        clauses.append("ground and chassis that give way" if stands else "what the machine stands on, and its tipping")
    if frame is None or frame.cylinder is None or frame.cylinder.oil is None:
        clauses.append("oil and valves: drives follow the given motion")
    else:
        clauses.append("relief valves and dry friction of the cylinder on oil")
    return [*clauses, "buckling of cylinders"]
