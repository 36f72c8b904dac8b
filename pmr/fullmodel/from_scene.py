"""The structure of a body of a scene: its mesh, the structural model on the mesh, pads, loads, masses and outputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pmr.errors import InputError, call_on_first_rank, environment
from pmr.fem.compat import MPI, check_fenicsx
from pmr.files.arrays import Array
from pmr.fullmodel.actions import Action, Inertia, LineLoad, PadForce, Warmth, Weight, gauges
from pmr.fullmodel.pads import Pad, Pads, Slider, Support
from pmr.fullmodel.structure import Clamp, Structure
from pmr.models import StructuralModel
from pmr.models.box_mesh import DIMENSIONS, BoxBoom, write_shell, write_solid
from pmr.models.matrices import Matrices
from pmr.models.mesh_drawing import NotDrawnError
from pmr.models.named_mesh import NamedMesh, add_faces, read_mesh
from pmr.scene.built import Load, PadRing
from pmr.scene.choice import (
    axis_loads,
    has_driven_tail,
    has_giving_walls,
    inertia_fields,
    is_accelerated,
    model_of,
    motion_directions,
    observed_places,
    pad_faces,
    traits_of,
    transverse_axes,
)
from pmr.scene.mechanism import tail_outputs
from pmr.scene.members import EXTENSION, Member
from pmr.scene.model_traits import MODELS
from pmr.scene.signals.base import Interval
from pmr.system.rows import StraightRows

#: Nodes of a beam that are observed by default: with all nodes, tables of outputs grow with the mesh's square.
MOST_OBSERVED = 1000
#: Distance from the tail to x = 0 that a mesh may have, as a share of its length.
AT_TAIL = 1e-3


def structure_of(member: Member, comm: MPI.Comm = MPI.COMM_WORLD) -> Structure:
    """Structure of a body of a scene, the same on every rank; collective.

    The outputs of the structure are, in this order:

    - displacements in m along each transverse direction at the observed stations;
    - displacements of the tip in m;
    - forces in N of the pads that do not move, have a stiffness and hold both ways, and of supports with a stiffness.
      The forces of all other pads and supports are the multipliers of their rows;
    - the rotation of the tip, if the scene observes it, and what the probes measure.

    By default the observed stations are the nodes of a beam without the last one, which is the tip.  If there are more
    than `MOST_OBSERVED` nodes, only every second or third node (and so on) is observed.

    The loads of the structure are, in this order:

    - the loads of the scene along each axis of the body, with the loads of hoists last;
    - the weight, unless a frame moves the body;
    - the acceleration by extensions;
    - the acceleration fields of a moving frame.

    Raises an `InputError` if the mesh can't be read or drawn or lacks a group, or if the model needs FEniCSx and that
    is not installed.
    """
    if traits_of(member).needs_fenicsx:
        check_fenicsx(model_of(member))
    model, pads = structural_model_of(member, comm), _member_pads(member)
    if has_giving_walls(member):
        from pmr.fullmodel.wall_compliance import walls_of  # needs FEniCSx

        pads = replace(pads, walls=walls_of(member, (*pads.fixed, *pads.moving), comm))
    base = model if member.number == 0 and pads.ends else None
    if isinstance(base, Matrices) and not len(base.coordinates_on("tail", ["x"])):
        pads = replace(pads, ends=())  # supports inside the matrices bear the cylinder of the next section
    across, observe, supports = transverse_axes(member), member.part.observe, _supports(member)
    stations: Sequence[float] | Array | None = observed_places(member)
    if stations is None:
        assert model.node_stations is not None  # the scene's check
        nodes = model.node_stations[:-1]  # the last one is the tip
        stations = nodes[:: -(-len(nodes) // MOST_OBSERVED)]
    line = [Action(f"{d} at {x:g} m", float(x), d) for d in across for x in stations]
    tip = [Action(observe.tip_along(d), observe.tip, d, measures="tip") for d in across]
    giving = [pad for pad in pads.fixed if np.isfinite(pad.stiffness) and not pad.unilateral]
    forces = [PadForce(pad.name) for pad in giving]
    forces += [PadForce(support.name, "support") for support in supports if np.isfinite(support.stiffness)]
    turned = [Action(observe.tip_along(d), observe.tip, d) for d in observe.rotations]
    weight = [Weight(member.gravity.direction)] if member.gravity and member.frame is None else []
    driven = [Weight((-1.0, 0.0, 0.0), EXTENSION)] if is_accelerated(member) else []
    inertia = [Inertia(field) for field in inertia_fields(member)]
    ports = {place if isinstance(place, str) else f"{place:g} m": place for place in member.part.reduction.ports}
    return Structure(
        model,
        clamps=tuple(
            Clamp(str(support.on), support.held_directions)
            for support in member.part.supports
            if support.points == "all"
        ),
        masses=member.part.masses,
        loads=(*(_load(member, load) for load in axis_loads(member)), *weight, *driven, *inertia),
        outputs=(*line, *tip, *forces, *turned, *gauges(member.part, model)),
        damping=member.scene.damping if member.part.body.mover is None else member.part.body.mover.rayleigh,
        pads=replace(pads, supports=supports),
        ports=(
            *(Action(f"{name} {d}", place, d) for name, place in ports.items() for d in model.directions),
            *(Action(name, "tail", name[-1]) for name in tail_outputs(member)),
        ),
    )


def _load(member: Member, load: Load) -> Action | Warmth | LineLoad:
    """Description of a load of the scene: force or moment, difference of temperature, or polynomial of the wind.

    A difference of temperature acts over the load's depth, or the width or height of the box if the load has none.  The
    last word of the name of a wind's load is the degree of its polynomial.
    """
    if load.acts == "force":
        return Action(load.name, load.on, load.direction, point=load.point)
    if load.acts == "wind":
        return LineLoad(load.name, load.direction, int(load.name.rpartition(" ")[2]))
    box = member.part.body.box
    depth = load.depth or (getattr(box, {"y": "width", "z": "height"}[load.direction]) if box else None)
    assert depth is not None  # the scene's check
    return Warmth(load.name, load.direction, load.expansion / depth)


def _member_pads(member: Member) -> Pads:
    """Pads, sliding points and contacts with other bodies that a body has, on the faces of its model.

    Supports and walls that give way are not included.  Rows need a range of path coordinates.  If the path has no
    length, the range is a thousandth of the body's length.
    """
    faces = pad_faces(member)
    fixed, moving = (
        tuple(
            pad
            for ring in member.pads
            if ring.moving is moves
            for pad in _ring_pads(ring, faces, member.ring_ranges.get(ring.name))
        )
        for moves in (False, True)
    )
    straight = tuple(StraightRows(end, names) for names, end in member.overlap_ends.items())
    if member.points:
        travel = 0.0 - min(member.points), member.part.length - max(member.points)
        sliders = tuple(map(Slider, member.point_names, member.points))
        pads = Pads(fixed, sliders=sliders, travel=travel, straight=straight)
    else:
        low, high = member.travel
        reach = 0.0 if high > low else 1e-3 * member.part.length
        pads = Pads(fixed, moving, travel=(low, high + reach), straight=straight)
    if has_driven_tail(member):
        ends = tuple(Support(name, "tail", point=point) for name, point in member.tail_points.items())
        pads = replace(pads, ends=ends, travel=_common_travel(pads))
    if member.cylinder is not None and member.frame is not None:
        pads = replace(pads, luffing=member.cylinder, tail=member.frame.tail_position)
    return pads


def _common_travel(pads: Pads) -> Interval:
    """Lowest and highest path coordinate in m between which the rows of all moving pads are defined.

    If no moving pad has a range of its own, this is the range of `pads`.
    """
    travels = [pad.travel for pad in pads.moving if pad.travel is not None] or [pads.travel]
    return Interval(float(np.max([low for low, _ in travels])), float(np.min([high for _, high in travels])))


def _ring_pads(ring: PadRing, faces: tuple[str, ...], travel: tuple[float, float] | None) -> list[Pad]:
    """Pads of a ring on the given `faces`; those on other faces are left out.

    `travel` is the least and largest path coordinate in m of these pads; if it is None, the range of the body's path
    counts.
    """
    stiffness = np.inf if ring.stiffness == "rigid" else ring.stiffness
    size, only_pushes = (ring.length, ring.width, stiffness), ring.unilateral
    return [
        Pad(name, face, ring.at, across, *size, only_pushes, ring.clearance_on(face), travel)
        for name, face, across in ring.named_pads
        if face in faces
    ]


def _supports(member: Member) -> tuple[Support, ...]:
    """Supports of a body as springs or rigid rows, one for each held direction in which its model can move.

    A support holds the mean motion of a place along or about this direction; a rigid one has an infinite stiffness.
    Supports that hold all points of a place are clamps, which are left out.
    """
    moves = motion_directions(member)
    return tuple(
        Support(support.row_name(d), support.on, d, np.inf if support.stiffness == "rigid" else support.stiffness)
        for support in member.part.supports
        if support.points == "mean"
        for d in support.held_directions
        if d in moves
    )


def structural_model_of(member: Member, comm: MPI.Comm) -> StructuralModel:
    """Structural model of a body, made by the module of `pmr.models` or of a plug-in with the model's name; collective.

    A module with `KINDS`, the kinds of cells that it allows, makes its model from the body and the mesh by ``of``.
    Other modules read no mesh and make it from the member of the scene by ``from_member``, on every rank.

    Raises an `InputError` for a plug-in that has no `KINDS` or `of`.
    """
    name, models_of_pmr = model_of(member), frozenset({"auto", *MODELS})
    if name in models_of_pmr:
        module: Any = import_module(f"pmr.models.{name}")
    else:
        module = environment.plugin_object("pmr.models", name, models_of_pmr)
        if not (hasattr(module, "KINDS") and callable(getattr(module, "of", None))):
            raise environment.plugin_error("pmr.models", name)
    model: StructuralModel
    if not hasattr(module, "KINDS"):
        model = module.from_member(member)
        return model

    def write(boom: BoxBoom, file: Path) -> None:
        """Mesh a box with cells that the model allows, and write the mesh to `file`."""
        if "triangle" in module.KINDS:
            write_shell(boom, file)
        else:
            write_solid(boom, file, hexahedra=member.part.mesh.cells == "hexahedra")

    mesh: NamedMesh = comm.bcast(call_on_first_rank(comm, lambda: _read_or_draw(member, module.KINDS, write)))
    model = module.of(member.part.body, mesh)
    return model


def _read_or_draw(member: Member, kinds: tuple[str, ...], write: Callable[[BoxBoom, Path], None]) -> NamedMesh:
    """Read the mesh of a body from its file; without a file, draw its box by gmsh.  Runs on this rank only.

    `kinds` are the kinds of cells that are allowed.  `write` writes the drawn boom to a file of gmsh, which is then
    read.  Raises an InputError about the file if it can't be read or its mesh is not where the boom is.  If the box
    can't be drawn, the InputError is about the key of the scene that is the reason.
    """
    if member.part.mesh.file is not None:
        groups = member.part.mesh.groups
        read = read_mesh(member.part.mesh.file, kinds, nodes=None if groups is None else groups.file)
        if member.frame is not None or len(member.scene.sections) > 1:
            _check_place(read)
        return add_faces(read, member.part.mesh.faces)
    from pmr.models.shell import boom_of_box

    box, mesh = member.box, member.part.mesh
    try:
        boom = boom_of_box(box, mesh.size, mesh.along or 0.0, mesh.tail_layer)
        with TemporaryDirectory() as folder:
            file = Path(folder, "boom.msh")
            write(boom, file)
            try:
                return replace(read_mesh(file, kinds), source="mesh of body.box")  # the user knows no file
            except InputError as error:  # of the temporary file, which the user does not know
                raise NotDrawnError(error.allowed) from None
    except NotDrawnError as error:
        raise InputError("scene", "body.box", None, f"with mesh.size, sizes that mesh are allowed ({error})") from None
    except InputError as error:
        if error.source != DIMENSIONS:
            raise
        key = {"size": "mesh.size", "size_along": "mesh.along", "tail_layer": "mesh.tail_layer"}.get(error.key)
        raise InputError("scene", key or f"body.box.{error.key}", error.value, error.allowed) from None


def _check_place(mesh: NamedMesh) -> None:
    """Raise an InputError for a mesh that does not lie along x from x = 0 on, or is beside the axis y = z = 0.

    Distances up to the share `AT_TAIL` of the mesh's length along x are allowed.
    """
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    slack = AT_TAIL * float(high[0] - low[0])
    if mesh.axis != 0 or abs(low[0]) > slack or np.any(low[1:] > slack) or np.any(high[1:] < -slack):
        spans = ", ".join(f"{name} from {a:g} to {b:g}" for name, a, b in zip("xyz", low, high, strict=True))
        allowed = (
            "a mesh along x whose tail is at x = 0, on the axis y = z = 0, is allowed in a frame or a boom of sections"
        )
        raise InputError(mesh.source, "", None, f"{allowed}: it has {spans} m")
