"""From a scene to a structure: its mesh, the model on it, pads, loads, masses and what is observed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, on_first
from pmr.fem.compat import MPI, check_fenicsx
from pmr.files.matrices import GivenMatrices
from pmr.fullmodel.pads import Pad, Pads, Slider, Support
from pmr.fullmodel.probes import gauges
from pmr.fullmodel.structure import Action, Clamp, PadForce, Structure, Weight
from pmr.mesh.beam import beam_nodes
from pmr.mesh.box import DIMENSIONS, BoxBoom, write_shell, write_solid
from pmr.mesh.drawing import NotDrawnError
from pmr.mesh.named import NamedMesh, read_mesh
from pmr.models import StructuralModel
from pmr.models.box_section import box_section
from pmr.models.matrices import Matrices
from pmr.scene import Scene
from pmr.scene.built import Box, PadRing
from pmr.scene.choice import directions, model_of, transverse
from pmr.scene.structures import Beam3DBody, BoxProfile, Material, Profile

Array = NDArray[np.float64]


#: Models that need no FEniCSx; the modules of all others load it.
WITHOUT_FORMS = ("matrices",)
#: Nodes of a beam that are observed by default: with all of them the tables of outputs grow with the mesh's square.
MOST_OBSERVED = 1000


def structure_of(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Structure:
    """What a scene describes; the same on every rank, collective.

    Outputs: the displacement in m along each transverse direction at the observed places (by default a beam's nodes but
    for the last, which is the tip; of more than `MOST_OBSERVED` every second, third ...), then of the tip, then the
    forces in N of the pads that stay and hold both ways and of the supports that give way; those of all others are the
    rows' multipliers.  Then what the probes measure.

    Raises an `InputError` if the mesh can't be had, or lacks a group.
    """
    if model_of(scene) not in WITHOUT_FORMS:
        check_fenicsx(model_of(scene))
    model, pads = _MODELS.get(model_of(scene), _meshed)(scene, comm), _pads(scene)
    across, observe, supports = transverse(scene), scene.observe, _supports(scene)
    stations: Sequence[float] | Array | None = observe.stations
    if stations is None:
        assert model.node_stations is not None  # the scene's check
        nodes = model.node_stations[:-1]  # the last one is the tip
        stations = nodes[:: -(-len(nodes) // MOST_OBSERVED)]
    line = [Action(f"{d} at {x:g} m", float(x), d) for d in across for x in stations]
    tip = [Action(observe.tip_along(d), observe.tip, d) for d in across]
    forces = [PadForce(pad.name) for pad in pads.fixed if np.isfinite(pad.stiffness) and not pad.unilateral]
    forces += [PadForce(support.name) for support in supports if np.isfinite(support.stiffness)]
    turned = [Action(f"{observe.tip} ry", observe.tip, "ry")] if observe.rotation else []
    weight = [Weight(scene.gravity.direction)] if scene.gravity else []
    return Structure(
        model,
        clamps=tuple(Clamp(str(one.on), one.held) for one in scene.supports if one.points == "all"),
        masses=scene.masses,
        loads=(*(Action(load.name, load.on, load.direction) for load in scene.loads), *weight),
        outputs=(*line, *tip, *forces, *turned, *gauges(scene, model)),
        damping=scene.damping,
        pads=replace(pads, supports=supports),
        ports=tuple(_port(model, place, d) for place in scene.reduction.ports for d in model.directions),
    )


def _port(model: StructuralModel, place: str | float, direction: str) -> Action:
    return Action(f"{place if isinstance(place, str) else f'{place:g} m'} {direction}", place, direction)


def _pads(scene: Scene) -> Pads:
    """Those that the model can feel: nothing moves a planar beam sideways."""
    faces = ("bottom", "top") if model_of(scene) == "beam2d" else ("bottom", "top", "left", "right")
    rings = {moving: [ring for ring in scene.pads if ring.moving is moving] for moving in (False, True)}
    fixed, moving = (tuple(pad for ring in rings[m] for pad in _ring(ring, faces)) for m in (False, True))
    if scene.points:
        travel = 0.0 - min(scene.points), scene.length - max(scene.points)
        return Pads(fixed, sliders=tuple(Slider(_slider_name(scene, at), at) for at in scene.points), travel=travel)
    low, high = scene.travel
    reach = 0.0 if high > low else 1e-3 * scene.length
    return Pads(fixed, moving, travel=(low, high + reach))


def _slider_name(scene: Scene, offset: float) -> str:
    if scene.points == (0.0,):
        return "slider"
    return f"slider at s{offset:+g} m" if offset else "slider at s"


def _ring(ring: PadRing, faces: tuple[str, ...]) -> list[Pad]:
    stiffness = np.inf if ring.stiffness == "rigid" else ring.stiffness
    return [
        Pad(name, face, ring.at, across, ring.length, ring.width, stiffness, ring.unilateral, ring.clearance_on(face))
        for name, face, across in ring.places
        if face in faces
    ]


def _supports(scene: Scene) -> tuple[Support, ...]:
    """One for each direction that the model knows: nothing moves a planar beam along others."""
    moves = directions(scene)
    return tuple(
        Support(one.row_name(d), one.on, d, np.inf if one.stiffness == "rigid" else one.stiffness)
        for one in scene.supports
        if one.points == "mean"
        for d in one.held
        if d in moves
    )


def _planar_beam(scene: Scene, comm: MPI.Comm) -> StructuralModel:
    from pmr.models.beam2d import Beam2D

    profile = scene.body.profile or _planar_profile(_box(scene), scene.body.material)
    return Beam2D(profile, beam_nodes(profile.length, scene.mesh))


def _planar_profile(box: Box, material: Material) -> Profile:
    section = box_section(_profile(box), material.poisson)
    return Profile(
        length=box.length,
        bending_stiffness=material.young * section.second_moment_y,
        mass_per_length=material.density * section.area,
        axial_stiffness=material.young * section.area,
        axial=True,
    )


def _profile(box: Box) -> BoxProfile:
    return BoxProfile(width=box.width, height=box.height, wall=box.wall, radius=box.radius)


def _beam(scene: Scene, comm: MPI.Comm) -> StructuralModel:
    from pmr.models.beam3d import Beam3D

    box, body = _box(scene), scene.body
    profile = None if body.section else _profile(box)
    return Beam3D(
        Beam3DBody(
            length=box.length,
            section=body.section,
            profile=profile,
            material=body.material,
            shear=body.shear,
            elements=scene.mesh.elements,
        )
    )


def _meshed(scene: Scene, comm: MPI.Comm) -> StructuralModel:
    """A shell or solid: its module, named as the scene names the model, says of which cells it is, and makes it."""
    kind = import_module(f"pmr.models.{model_of(scene)}")

    def write(boom: BoxBoom, file: Path) -> None:
        if "triangle" in kind.KINDS:
            write_shell(boom, file)
        else:
            write_solid(boom, file, hexahedra=scene.mesh.cells == "hexahedra")

    model: StructuralModel = kind.of(scene.body, _mesh(scene, comm, kind.KINDS, write))
    return model


def _matrices(scene: Scene, comm: MPI.Comm) -> StructuralModel:
    """Read by every rank: they are its own."""
    assert scene.mesh.file is not None  # the scene's check
    return Matrices(GivenMatrices.load(scene.mesh.file))


_MODELS: dict[str, Callable[[Scene, MPI.Comm], StructuralModel]] = {
    "beam2d": _planar_beam,
    "beam3d": _beam,
    "matrices": _matrices,
}


def _mesh(scene: Scene, comm: MPI.Comm, kinds: tuple[str, ...], write: Callable[[BoxBoom, Path], None]) -> NamedMesh:
    """Read or drawn by rank 0, then the same everywhere."""
    found: NamedMesh = comm.bcast(on_first(comm, lambda: _read_or_draw(scene, kinds, write)))
    return found


def _read_or_draw(scene: Scene, kinds: tuple[str, ...], write: Callable[[BoxBoom, Path], None]) -> NamedMesh:
    if scene.mesh.file is not None:
        return read_mesh(scene.mesh.file, kinds)
    box, mesh = _box(scene), scene.mesh
    try:
        drawn = BoxBoom(**box.model_dump(), size=mesh.size, size_along=mesh.along or 0.0, tail_layer=mesh.tail_layer)
        with TemporaryDirectory() as folder:
            file = Path(folder, "boom.msh")
            write(drawn, file)
            try:
                return read_mesh(file, kinds)
            except InputError as error:  # of a file that nobody has ever seen
                raise NotDrawnError(error.allowed) from None
    except NotDrawnError as error:
        raise InputError("scene", "body.box", None, f"with mesh.size, sizes that mesh are allowed ({error})") from None
    except InputError as error:
        if error.source != DIMENSIONS:
            raise
        key = {"size": "mesh.size", "size_along": "mesh.along", "tail_layer": "mesh.tail_layer"}.get(error.key)
        raise InputError("scene", key or f"body.box.{error.key}", error.value, error.allowed) from None


def _box(scene: Scene) -> Box:
    assert scene.body.box is not None  # the scene's check
    return scene.body.box
