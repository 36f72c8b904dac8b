"""From a scene in space to a structure: its mesh, the model on it, pads, loads, masses and what is observed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel.pads import Hold, Pad, Pads, Slider
from pmr.fullmodel.structure import Action, Clamp, PadForce, Structure, Weight
from pmr.mesh.beam import beam_nodes
from pmr.mesh.box import DIMENSIONS, BoxBoom, write_shell, write_solid
from pmr.mesh.drawing import NotDrawnError
from pmr.mesh.named import NamedMesh, read_mesh
from pmr.models import StructuralModel
from pmr.models.beam2d import Beam2D
from pmr.models.beam3d import Beam3D
from pmr.models.profile import box_section
from pmr.models.shell import KINDS as SHELL_KINDS
from pmr.models.shell import Shell
from pmr.models.solid import KINDS as SOLID_KINDS
from pmr.models.solid import Solid
from pmr.scene import SUPPORT_ROWS, Scene, StructureScene
from pmr.scene.choice import model_of, transverse
from pmr.scene.space import Box, PadRing
from pmr.scene.structures import Beam3DBody, BoxProfile, Plate, Profile, ShellBody, SolidBody


def structure_of(scene: StructureScene, comm: MPI.Comm = MPI.COMM_WORLD) -> Structure:
    """What a scene describes; the same on every rank, collective.

    Outputs: the displacement in m along each transverse direction at the observed places, then of the tip, then the
    forces in N of the pads that stay and hold both ways; those of all others are the rows' multipliers.

    Raises
    ------
    InputError
        If the mesh can't be had, or lacks a group.
    """
    model, pads = _MODELS[model_of(scene)](scene, comm), _pads(scene)
    across = transverse(scene)
    line = [Action(f"{d} at {x:g} m", x, d) for d in across for x in scene.observe.stations]
    tip = [Action(scene.observe.tip_along(d), scene.observe.tip, d) for d in across]
    forces = [PadForce(pad.name) for pad in pads.fixed if np.isfinite(pad.stiffness) and not pad.unilateral]
    weight = [Weight(scene.gravity.direction)] if scene.gravity else []
    return Structure(
        model,
        clamps=tuple(Clamp(clamp.on, clamp.directions) for clamp in scene.clamps),
        masses=scene.masses,
        loads=(*(Action(load.name, load.on, load.direction) for load in scene.loads), *weight),
        outputs=(*line, *tip, *forces),
        damping=scene.damping,
        pads=replace(pads, holds=_holds(scene)),
    )


#: What a planar scene calls by another name: there y is the vertical.
_UPRIGHT = {"x": ("x", 1.0), "y": ("z", 1.0), "rotation": ("ry", -1.0)}


def planar_structure(scene: Scene) -> Structure:
    """What a planar scene describes."""
    body, offsets = scene.body, scene.slider.offsets
    nodes = beam_nodes(scene)
    names = [f"slider at s{offset:+g} m" if offset else "slider at s" for offset in offsets]
    pads = Pads(
        holds=tuple(
            Hold(f"support {_UPRIGHT[d][0]} at {support.at:g} m", support.at, _UPRIGHT[d][0])
            for support in scene.supports
            for d in SUPPORT_ROWS[support.kind]
            if d in body.directions
        ),
        sliders=tuple(map(Slider, names, offsets)) if offsets != (0.0,) else (Slider(),),
        travel=(0.0 - min(offsets), body.length - max(offsets)),
    )
    return Structure(
        Beam2D(Profile.model_validate(body.model_dump(exclude={"model"})), nodes),
        loads=tuple(Action(load.name, load.at, *_UPRIGHT[load.direction]) for load in scene.loads),
        outputs=tuple(Action(f"z at {x:g} m", float(x), "z") for x in nodes),
        damping=scene.damping,
        pads=pads,
    )


def _pads(scene: StructureScene) -> Pads:
    """Those that the model can feel: nothing moves a planar beam sideways."""
    faces = ("bottom", "top") if model_of(scene) == "beam2d" else ("bottom", "top", "left", "right")
    rings = {moving: [ring for ring in scene.pads if ring.moving is moving] for moving in (False, True)}
    fixed, moving = (tuple(pad for ring in rings[m] for pad in _ring(ring, faces)) for m in (False, True))
    low, high = scene.path_bounds
    reach = 0.0 if high > low else 1e-3 * max(abs(scene.observe.start), abs(scene.observe.end))
    return Pads(fixed, moving, travel=(low, high + reach))


def _ring(ring: PadRing, faces: tuple[str, ...]) -> list[Pad]:
    stiffness = np.inf if ring.stiffness == "rigid" else ring.stiffness
    return [
        Pad(name, face, ring.at, across, ring.length, ring.width, stiffness, ring.unilateral, ring.clearance_on(face))
        for name, face, across in ring.places
        if face in faces
    ]


def _holds(scene: StructureScene) -> tuple[Hold, ...]:
    return tuple(
        Hold(hold.name, hold.on, hold.direction, np.inf if hold.stiffness == "rigid" else hold.stiffness)
        for hold in scene.holds
    )


def _planar_beam(scene: StructureScene, comm: MPI.Comm) -> StructuralModel:
    box, material = _box(scene), scene.body.material
    section = box_section(BoxProfile(width=box.width, height=box.height, wall=box.wall), material.poisson)
    profile = Profile(
        length=box.length,
        bending_stiffness=material.young * section.second_moment_y,
        mass_per_length=material.density * section.area,
        axial_stiffness=material.young * section.area,
        axial=True,
    )
    return Beam2D(profile, np.linspace(0.0, box.length, scene.mesh.elements + 1))


def _beam(scene: StructureScene, comm: MPI.Comm) -> StructuralModel:
    box, body = _box(scene), scene.body
    profile = None if body.section else BoxProfile(width=box.width, height=box.height, wall=box.wall)
    return Beam3D(
        Beam3DBody(
            points=((0.0, 0.0, 0.0), (box.length, 0.0, 0.0)),
            section=body.section,
            profile=profile,
            material=body.material,
            shear=body.shear,
            elements=scene.mesh.elements,
        )
    )


def _shell(scene: StructureScene, comm: MPI.Comm) -> StructuralModel:
    body = scene.body
    thickness = body.box.wall if body.box else body.thickness
    assert thickness is not None  # the scene's check
    regions = {
        name: Plate(material=region.material or body.material, thickness=region.thickness or thickness)
        for name, region in body.regions.items()
    }
    plate = Plate(material=body.material, thickness=thickness)
    return Shell(
        ShellBody(plate=plate, regions=regions, shear_correction=body.shear_correction),
        _mesh(scene, comm, SHELL_KINDS, write_shell),
    )


def _solid(scene: StructureScene, comm: MPI.Comm) -> StructuralModel:
    body = scene.body

    def write(boom: BoxBoom, file: Path) -> None:
        write_solid(boom, file, hexahedra=scene.mesh.cells == "hexahedra")

    regions = {name: region.material or body.material for name, region in body.regions.items()}
    return Solid(SolidBody(material=body.material, regions=regions), _mesh(scene, comm, SOLID_KINDS, write))


_MODELS: dict[str, Callable[[StructureScene, MPI.Comm], StructuralModel]] = {
    "beam2d": _planar_beam,
    "beam3d": _beam,
    "shell": _shell,
    "solid": _solid,
}


def _mesh(
    scene: StructureScene, comm: MPI.Comm, kinds: tuple[str, ...], write: Callable[[BoxBoom, Path], None]
) -> NamedMesh:
    """Read or drawn by rank 0, then the same everywhere."""
    found: NamedMesh | InputError | None = None
    if comm.rank == 0:
        try:
            found = _read_or_draw(scene, kinds, write)
        except InputError as error:
            found = error
    found = comm.bcast(found)
    if isinstance(found, InputError):
        raise found
    assert found is not None
    return found


def _read_or_draw(scene: StructureScene, kinds: tuple[str, ...], write: Callable[[BoxBoom, Path], None]) -> NamedMesh:
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


def _box(scene: StructureScene) -> Box:
    assert scene.body.box is not None  # the scene's check
    return scene.body.box
