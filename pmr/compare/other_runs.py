r"""Runs of a reduced model on another mesh, for the error of the mesh, or with another play of its pads.

Beams with rigid walls are compared with twice as many elements of half the length l:

.. math:: e_{mesh} \approx \frac{\lVert y_{l/2} - y_l \rVert}{1 - 2^{-p}}, \qquad p = 2

with the outputs y_l on elements of the length l and the order p with which they converge.  Beams without shear converge
faster, so that the stated error is too large.  Beams whose elements are longer than two pads converge more slowly, p =
1: the effect of pads then depends on where in an element the pads are.  Shells, solids and walls that give way are
compared with a mesh whose cells are twice as long, and whose reduction takes at most half the time:

.. math:: e_{mesh} \approx \frac{\lVert y_{2 l} - y_l \rVert}{2^p - 1}, \qquad p = 1

Both errors are fractions of the motion on the scene's own mesh: on cells twice as long the motion can be a quarter
smaller, since pads press on a part of a cell only.  Such a motion converges with the order of the cells only when the
cells are shorter than pads: `docs/accuracy.md` has measurements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pmr.compare.evaluation import append_machine
from pmr.compare.forces import support_rows
from pmr.compare.outputs import RoundOffBounds, differences
from pmr.compare.responses import Simulation, simulate_by
from pmr.compare.trials import Sizes, Trials
from pmr.errors import InputError
from pmr.files.arrays import Summary
from pmr.results import Response
from pmr.results.quantities import COMPARED
from pmr.results.response import Extremes
from pmr.scene import Scene
from pmr.scene.choice import has_giving_walls, traits_of
from pmr.scene.joints import BoomSection
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.scene.mechanism import CYLINDER
from pmr.scene.members import members, pads_on_faces
from pmr.simulation import Excitation
from pmr.system.contacts import Contact
from pmr.system.states import BodyStates, states_of
from pmr.system.system import System

#: Beams: factor by which elements of the other mesh are shorter, and order with which the motion converges.
FINER, ORDER = 2.0, 2.0
#: Largest ratio of the length of a beam's element to that of a pad with which `ORDER` applies; else `FIRST_ORDER` does.
LONGEST_ELEMENT = 2.0
#: Walls: factor by which cells of the other mesh are longer, and order with which the motion converges.
COARSER, FIRST_ORDER = 2.0, 1.0
#: Largest ratio of the length of a wall's cell to that of a pad: on longer cells the stated error is too small
#: (`docs/accuracy.md`).
LONGEST = 1.5
#: Positions along the body are the same if they differ by no more than this share of its length.
SAME = 1e-9


@dataclass(frozen=True)
class OtherMesh:
    """Scene on another mesh, with which a scene is compared to estimate the error of its own mesh."""

    scene: Scene
    called: str  # name of this scene in warnings and results
    share: float  # error of the scene's own mesh over the difference of motions


def other_mesh(scene: Scene) -> OtherMesh:
    """The scene on finer beams or coarser walls, with which the scene's own mesh is compared.

    Raises an `InputError` that says why there is no such mesh.
    """
    if any(part.mesh.file is not None for part in scene.sections):
        allowed = "a mesh that is read from a file cannot be refined, so there is nothing to compare it with"
        raise InputError("scene", "mesh", None, allowed)
    if all(traits_of(member).has_line and member.part.body.walls == "rigid" for member in members(scene)):
        has_long_elements = any(
            member.part.length / member.part.mesh.elements > LONGEST_ELEMENT * ring.length > 0.0
            for member in members(scene)
            for ring in member.pads
        )
        order = FIRST_ORDER if has_long_elements else ORDER
        return OtherMesh(finer_beams(scene), "finer mesh", 1.0 / (1.0 - FINER**-order))
    return OtherMesh(coarser_walls(scene), "coarser mesh", 1.0 / (COARSER**FIRST_ORDER - 1.0))


def finer_beams(scene: Scene) -> Scene:
    """The scene with twice the number of elements in all beams."""

    def halve_elements(part: BoomSection) -> dict[str, object]:
        """Change of a section's keys that halves its elements: the key ``mesh`` with its new values.

        If elements are graded, their lengths grow by a factor from element to element.  The new factor is the root of
        the old one.  So all nodes stay, and each element gets one more node.
        """
        count = int(FINER * part.mesh.elements)
        grading = part.mesh.grading ** ((count - 1) / (FINER * max(1, part.mesh.elements - 1)))
        return {"mesh": {"elements": count, "grading": grading}}

    return scene.vary_sections(halve_elements)


def coarser_walls(scene: Scene) -> Scene:
    """The scene with cells of twice the length, and with half the number of elements in all beams.

    Half of an odd number is rounded down.  A beam has at least two elements, so a beam of two elements stays as it is.
    """

    def double_cells(part: BoomSection) -> dict[str, object]:
        """Change of a section's keys that doubles its cells and halves its elements: new values of ``mesh``."""
        sizes = {"size": COARSER * part.mesh.size, "tail_layer": COARSER * part.mesh.tail_layer}
        along = None if part.mesh.along is None else COARSER * part.mesh.along
        return {"mesh": sizes | {"along": along, "elements": max(2, part.mesh.elements // 2)}}

    return scene.vary_sections(double_cells)


def mesh_budget(scene: Scene, simulate_other: Callable[[Callable[[], Scene], str], Summary]) -> dict[str, Any]:
    """Entries ``mesh`` and ``mesh_reason`` of the error budget: the mesh's error by kind, or why there is none.

    `simulate_other` runs a scene on another mesh.  Its arguments are a function that returns that scene, and a name for
    it.  `simulate_other` returns the differences to the motion of `scene` by kind, as fractions of that motion.

    Each error in ``mesh`` is such a difference times `OtherMesh.share`.  The keys are those of `COMPARED`, ``probe``
    and ``probes``, which holds the errors of probes by name.  ``frequency`` is left out if cells are long compared with
    a pad (`mesh_warnings`): both meshes then lack the bending of walls under the pad.
    """
    try:
        other = other_mesh(scene)
    except InputError as error:
        return {"mesh": None, "mesh_reason": error.allowed}
    errors = simulate_other(lambda: motion_only(other.scene), other.called)
    left_out = {"frequency"} if mesh_warnings(scene) else set[str]()
    kinds = [kind for kind in (*COMPARED, "probe") if errors.get(kind) is not None and kind not in left_out]
    shares: dict[str, Any] = {kind: other.share * errors[kind] for kind in kinds}
    if "probes" in errors:
        shares["probes"] = {name: other.share * error for name, error in errors["probes"].items()}
    return {"mesh": shares or None, "mesh_reason": errors.get("reason")}


def mesh_warnings(scene: Scene) -> list[str]:
    """List a warning if cells of walls are so long, compared with pads, that the walls are too stiff.

    The mesh may then be further off than its estimated error.  The list is empty if all cells are short enough.
    """
    worst, message = LONGEST, ""
    for member in members(scene):
        body, cells = member.part.body, member.part.mesh
        has_walls = has_giving_walls(member) or traits_of(member).has_cells
        if body.box is None or cells.file is not None or not has_walls:
            continue
        across = {side.name: side.length / side.cells(cells.size) for side in body.box.sides}
        for ring in member.pads:
            across_sizes = [(across[face], ring.width, "wide", "size") for face in ring.faces if face in across]
            for cell, pad, way, key in (*across_sizes, (cells.along or cells.size, ring.length, "long", "along")):
                if cell / pad > worst:
                    where, worst = f"section {member.part.name}: " if len(scene.sections) > 1 else "", cell / pad
                    message = (
                        f"{where}cells are {cell:.3g} m {way} under pads of {pad:.3g} m: walls are too stiff, and "
                        f"the mesh may be further off than its bar says; a smaller mesh.{key} helps"
                    )
    return [message] if message else []


def motion_only(scene: Scene) -> Scene:
    """Scene changed so that one run of the compiled simulator (``march``) computes its motion and nothing else."""
    once = {"simulators": ("march",), "repeats": 1}
    return with_estimates(scene, False).with_keys(simulation=once, recovery=None)


def with_estimates(scene: Scene, estimate: bool) -> Scene:
    """Scene whose reductions contain the modes for an estimate of their error if `estimate` is true, else do not."""
    return scene.vary_sections(lambda part: {"reduction": {"estimate": estimate}})


def mesh_errors(of_scene: Trials, other: Trials, sizes: Sizes, steps: int, share: float) -> dict[str, float]:
    """Error of the mesh, a fraction of the scene's motion, by kind: `share` times the difference to another mesh.

    `of_scene` and `other` are the trials on the two meshes, both with models of these `sizes` and this number of
    `steps`.  Numerical damping is small in both runs, as in `pmr.compare.step_error`.  Raises InputError or
    SimulationError as for `pmr.simulation.SystemSimulator`.
    """
    mine, theirs = (trials.run_undamped(sizes, steps) for trials in (of_scene, other))
    floors = RoundOffBounds.for_system(of_scene.system(sizes), of_scene.with_steps(steps), mine.force)
    # numbers (2, c), in each of the two models, of the c displacements that both have
    places, other_places = of_scene.output_positions, other.output_positions
    at, near = {name: k for k, (name, _) in enumerate(other_places)}, SAME * np.ptp([x for _, x in places])
    pairs = [(k, at[name]) for k, (name, x) in enumerate(places) if name in at]
    common = [(k, j) for k, j in pairs if abs(other_places[j][1] - places[k][1]) <= near]
    numbers, other_numbers = np.array(common, np.int64).reshape(-1, 2).T
    mine, theirs = mine.select_displacements(numbers), theirs.select_displacements(other_numbers)
    return {kind: share * size for kind, size in differences(theirs, mine, floors, of_scene.wanted).items()}


@dataclass(frozen=True)
class VariedPlay:
    """Simulation of a reduced system whose pads have another play than in its scene."""

    gap: float  # m: play from face to face; 0 if the play of the scene is taken away
    simulation: Simulation

    def summary(self, scene: Scene, response: Response, walls: Summary, varied_walls: Summary) -> dict[str, Any]:
        """Return ``budget.play`` of summary.json for the run of a scene that has this response.

        ``gap`` in m is the play of the other run.  ``rows`` compare the largest values of both runs.  A row has the
        keys:

        - ``quantity``: a key of `pmr.results.quantities.QUANTITIES`,
        - ``name``: that of a part or a direction,
        - ``value`` and ``varied``: the largest value in the scene's run and in the other run, in the quantity's unit.

        A value that is round-off in one of both runs has no row.  `walls` of the scene's run, and `varied_walls` of the
        other run, may have ``wall_stress``, the largest stress in walls at pads.
        """
        value, varied = largest_sizes(scene, response), largest_sizes(scene, self.simulation.response)
        for sizes, entries in ((value, walls), (varied, varied_walls)):
            sizes |= {("wall_stress", ""): entries["wall_stress"]["value"]} if "wall_stress" in entries else {}
        rows = [
            {"quantity": key, "name": name, "value": size, "varied": varied[key, name]}
            for (key, name), size in value.items()
            if (key, name) in varied
        ]
        return {"gap": self.gap, "rows": rows}


@dataclass(frozen=True)
class OtherPlay:
    """Contacts of a system with another play than in its scene."""

    gap: float  # m: play from face to face; 0 if the play of the scene is taken away
    contacts: tuple[Contact, ...]


def vary_play(scene: Scene, contacts: tuple[Contact, ...]) -> OtherPlay | None:
    """Change the play of the pads among a scene's contacts; return all contacts with the other play.

    If a pad has play, all pads lose it.  If no pad has play, pads get `compare.play`, all of it at the faces on top and
    left.  In a start at rest each section lies on the pads at bottom and right.  Play on one side is enough, as how far
    sections turn in each other depends on the sum of the play on both sides.

    None is returned if no pad changes.  This is so if no pad on a face only pushes.  It is also so if no pad has play,
    and either `compare.play` is 0 or all such pads are at bottom and right.
    """
    pushing = {contact.name: contact for contact in contacts if contact.clearance is not None}
    pads = {name: of for name, of in pads_on_faces(scene).items() if name in pushing}
    gap = 0.0 if any(pushing[name].clearance for name in pads) else scene.compare.play
    play = {name: gap if of.face == "left" or of.face.startswith("top") else 0.0 for name, of in pads.items()}
    varied = tuple(replace(of, clearance=play.get(of.name, of.clearance)) for of in contacts)
    return None if varied == contacts else OtherPlay(gap, varied)


def simulate_varied_play(scene: Scene, system: System, excitation: Excitation) -> VariedPlay | None:
    """Simulate a reduced system with the play of `vary_play`; None if there is no other play.

    States are those of `states_under_load`.
    """
    if (play := vary_play(scene, system.contacts)) is None:
        return None
    other = replace(system, contacts=play.contacts)
    steps = scene.recovered_steps.tolist()
    simulation = simulate_by(scene, other, excitation, scene.simulation.simulators[0], steps)
    states, response = states_under_load(scene, other, simulation), append_machine(scene, simulation.response)
    return VariedPlay(play.gap, replace(simulation, states=states, response=response))


def states_under_load(scene: Scene, system: System, simulation: Simulation) -> Mapping[str, BodyStates]:
    """Return states of the bodies of a simulated system, by name, at the times at which stress in walls is computed.

    These are the times of the scene's recovery.  If the motion at all steps is kept, the time of the largest absolute
    force of each contact is added: sections beat on their pads, and such a peak is short.  There are no states without
    a recovery.
    """
    steps, run = scene.recovered_steps, simulation.run
    if run is None or not len(steps):
        return simulation.states
    return states_of(system, run, np.union1d(steps, np.abs(run.forces).argmax(axis=0)))


def largest_sizes(scene: Scene, response: Response) -> dict[tuple[str, str], float]:
    """Return the largest sizes of tip displacements, forces, stress at probes, and the use of the support polygon.

    Sizes are named by the key of their quantity and by a direction or a part; the largest of all pads has no part.
    They have the unit of their quantity.  Histories that are round-off are left out.
    """
    sizes = dict[tuple[str, str], float]()
    for direction in ("y", "z"):
        tip = float(np.abs(response.of("tip", direction=direction)).max(initial=0.0))
        sizes |= {("tip", direction): tip} if tip > response.round_off else {}
    forces = {("pad_force", ""): response.of("pad"), ("cylinder_force", ""): response.of("cylinder")}
    if CYLINDER in response.other_names:
        forces["luffing_force", ""] = response.other(CYLINDER)
    largest = {key: float(np.abs(of).max(initial=0.0)) for key, of in forces.items()}
    for row in support_rows(scene, response):
        if not row["name"].endswith(LUFFING_CYLINDER):
            largest["support", row["name"]] = Extremes.from_summary(row).size
            largest |= {("lug_force", row["name"]): Extremes.from_summary(row["lug"]).size} if "lug" in row else {}
    sizes |= {key: size for key, size in largest.items() if size > response.force_floor}
    stresses = [response.other(of.name) for of in response.outputs if of.kind == "probe" and of.unit == "Pa"]
    for key, histories in (("probe", stresses), ("tipping", response.of("tipping"))):
        sizes |= {(key, ""): size} if (size := float(np.abs(histories).max(initial=0.0))) else {}
    return sizes
