r"""Linear shell on flat triangles: quadratic displacement u, Crouzeix-Raviart rotation theta, in space.

With the triangle's frame e_1, e_2, e_3, of which e_3 is normal to it, the part :math:`u_t` of u in its plane and the
surface gradient :math:`\nabla_t`, membrane strain :math:`\varepsilon`, curvature :math:`\kappa`, shear strain
:math:`\gamma` and drilling strain :math:`\varpi` are

.. math::
    \varepsilon = \mathrm{sym}(\nabla_t u_t), \quad
    \kappa = \mathrm{sym}(\nabla_t (e_3 \times \theta)), \quad
    \gamma = \nabla_t u_3 - e_3 \times \theta, \quad
    \varpi = (u_{2,1} - u_{1,2}) / 2 - \theta_3

and with the thickness t and the density :math:`\rho` stiffness k and mass m are

.. math::
    k = \int t\, \varepsilon : A : \delta\varepsilon + \frac{t^3}{12} \kappa : A : \delta\kappa
        + \kappa_s G t\, \gamma \cdot \delta\gamma + \frac{E t^3}{h^2} \varpi\, \delta\varpi \, dA, \qquad
    m = \int \rho t\, u \cdot \delta u + \frac{\rho t^3}{12} \theta \cdot \delta\theta \, dA

A is the plane-stress stiffness, E is Young's modulus, G the shear modulus, :math:`\kappa_s` the shear correction, 5/6,
and h the triangle's diameter.  The last term of k ties the drilling rotation theta_3, which has no stiffness of its
own, to the rotation of the surface.  The rotary inertia of theta_3 has no physical meaning; it keeps m definite.

The pair of spaces does not lock in shear: Campello, Pimenta, Wriggers: A triangular finite shell element based on a
fully nonlinear shell formulation, Computational Mechanics 31, 2003, 505-518 (element T6-3i).  The linear form with
stabilised drilling in UFL: Bleyer, Numerical Tours of Computational Mechanics with FEniCSx, "Linear shell model", 2024.

Stresses follow from the same strains, at the distance :math:`\zeta` from the middle along the normal n:

.. math::
    \sigma(\zeta) = A : (\varepsilon - \zeta \kappa), \qquad -t/2 \le \zeta \le t/2

A rotation theta moves the point at zeta by zeta theta x n.  On a triangle the curvature is constant and the membrane
strain linear.  Both are taken at the centroid, where the membrane strain equals its mean over the triangle: values on
the edges are one order less accurate.  Transverse shear vanishes at both faces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import ufl

from pmr.errors import InputError
from pmr.fem.compat import cellwise, constant, integration_measure, rule_points, shell_space
from pmr.files.arrays import Array
from pmr.models import Forms, UnitState
from pmr.models.box_mesh import TAPERED, BoxBoom
from pmr.models.meshed import (
    FACES,
    CellProperties,
    MeshedModel,
    cell_values,
    coordinate_rows,
    frequency_scale,
    outward_signs,
    region_properties,
)
from pmr.models.named_mesh import NamedMesh, unit_normals
from pmr.models.trace import FLAT, RAMP
from pmr.results.field_stress import PLANE, StressRows
from pmr.scene import Body
from pmr.scene.box import Box
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Material, Plate, ShellBody

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Form, Function, FunctionSpace, Mesh


KINDS = ("triangle",)
#: Smallest cosine between a triangle's normal and the body's axis at which the triangle counts as across the axis.
ACROSS = 0.9


@dataclass(frozen=True)
class Shell(MeshedModel):
    """Shell on a mesh of triangles."""

    body: ShellBody
    mesh: NamedMesh
    walls: Array | None = None  # (C,) m: thickness of each cell; None: that of its plate

    @property
    def components(self) -> Mapping[int, tuple[int, ...]]:
        """Components of an entity's node, by the dimension of the entity.

        Displacements are on vertices and edges, rotations on edges.
        """
        return {0: (0, 1, 2), 1: (0, 1, 2, 3, 4, 5)}

    @cached_property
    def plates(self) -> CellProperties:
        """Material and thickness of each cell.

        Raises the errors of `region_properties`.
        """
        return region_properties(self.mesh, self.body.plate, self.body.regions)

    @property
    def thickness(self) -> Array:
        """Thickness (C,) in m of each of C cells."""
        return self.plates.values("thickness") if self.walls is None else self.walls

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest circular frequencies in rad/s."""
        plate = self.body.plate
        return frequency_scale(self.mesh.points, plate.material, plate.thickness)

    def space(self, domain: Mesh) -> FunctionSpace:
        """Function space on `domain`, the mesh in dolfinx; collective."""
        return shell_space(domain)

    def forms(self, space: FunctionSpace) -> Forms:
        """Mass and stiffness as UFL forms on `space`."""
        mesh = space.mesh
        E, nu, rho, t = self._cellwise(mesh)
        (u, theta), (du, dtheta) = ufl.TrialFunctions(space), ufl.TestFunctions(space)
        normal = _frame(mesh)[2]
        of, by = Strains(u, theta, _frame(mesh)), Strains(du, dtheta, _frame(mesh))
        G, h, correction = E / (2 * (1 + nu)), ufl.CellDiameter(mesh), constant(mesh, self.body.shear_correction)
        stiffness = (
            t * ufl.inner(_plane_stress(E, nu, of.membrane), by.membrane)
            + t**3 / 12 * ufl.inner(_plane_stress(E, nu, of.curvature), by.curvature)
            + correction * G * t * ufl.dot(of.shear, by.shear)
            + E * t**3 / h**2 * of.drilling * by.drilling
        ) * integration_measure(mesh, 2)
        drilling = rho * t**3 / 12 * ufl.dot(theta, normal) * ufl.dot(dtheta, normal) * integration_measure(mesh, 4)
        return Forms(self.inertia(space, ufl.Identity(3)) + drilling, stiffness)

    def inertia(self, space: FunctionSpace, S: Expr) -> Form:
        r"""UFL form of :math:`\int \rho t\, v \cdot S u + \frac{\rho t^3}{12} v_{,\zeta} \cdot S u_{,\zeta}\, dA`.

        u and v are the displacements of trial and test function, rho is the density and t the thickness.  A point at
        the distance zeta from the middle along the normal n moves by u + zeta theta x n, so drilling rotations do not
        contribute.
        """
        mesh = space.mesh
        _, _, rho, t = self._cellwise(mesh)
        normal = _frame(mesh)[2]
        (u, theta), (du, dtheta) = ufl.TrialFunctions(space), ufl.TestFunctions(space)
        turn, dturn = ufl.cross(theta, normal), ufl.cross(dtheta, normal)
        of_plate = rho * t * ufl.dot(du, ufl.dot(S, u)) + rho * t**3 / 12 * ufl.dot(dturn, ufl.dot(S, turn))
        return of_plate * integration_measure(mesh, 4)

    def geometric_stiffness(self, space: FunctionSpace, state: UnitState) -> Form:
        r"""UFL form of the work of a state's membrane stress sigma on products of displacement gradients.

        .. math:: \int t\, \sigma_{\alpha\beta}\, u_{i,\alpha} v_{i,\beta}\, dA

        u and v are the displacements of trial and test function, t is the thickness.  The bending part of the stress
        and the gradient of rotations are left out.
        """
        mesh = space.mesh
        E, nu, _, t = self._cellwise(mesh)
        frame = _frame(mesh)
        (u, _), (du, _) = ufl.TrialFunctions(space), ufl.TestFunctions(space)
        at_rest, turned = ufl.split(state.displacement())
        sigma = _plane_stress(E, nu, Strains(at_rest, turned, frame).membrane)
        of, by = (_surface_gradient(field, frame) for field in (u, du))
        return t * ufl.inner(ufl.dot(of, sigma), by) * integration_measure(mesh, 3)

    def _cellwise(self, mesh: Mesh) -> list[Function]:
        """Young's modulus (Pa), Poisson's ratio, density (kg/m^3) and thickness (m), constant in each cell."""
        names = "material.young", "material.poisson", "material.density"
        return [*(cellwise(mesh, self.plates.values(name)) for name in names), cellwise(mesh, self.thickness)]

    def plane_stresses(self, space: FunctionSpace) -> Expr:
        """Membrane stresses in Pa, then bending stresses per distance from the middle in Pa/m, as a UFL vector of six.

        The stresses are linear in a trial function on `space`.  Membrane and bending stresses have three components
        each, in the axes of `frames`: along, across, and shear.
        """
        mesh, axes = space.mesh, frames(self.mesh)
        frame = [ufl.as_vector([cellwise(mesh, axes[:, k, i]) for i in range(3)]) for k in range(3)]
        E, nu, *_ = self._cellwise(mesh)
        u, theta = ufl.TrialFunctions(space)
        strains = Strains(u, theta, frame)
        stresses = [_plane_stress(E, nu, strain) for strain in (strains.membrane, strains.curvature)]
        return ufl.as_vector([sigma[i, j] for sigma in stresses for i, j in ((0, 0), (1, 1), (0, 1))])

    def stresses(self) -> StressRows:
        """Plane stress at each triangle's centroid: on the outer face, in the middle (membrane), on the inner face.

        All triangles on the outer face come first.  The components are in the axes of `frames`.
        """
        mesh, half = self.mesh, self.thickness / 2.0
        rows = cell_values(self, self.plane_stresses, rule_points("triangle", 1))
        membrane, bent = rows.entries[:, 0, :3], half[:, None, None] * rows.entries[:, 0, 3:]
        entries = np.concatenate([membrane - bent, membrane, membrane + bent])
        offsets = np.array([1.0, 0.0, -1.0])[:, None, None] * half[:, None] * frames(mesh)[:, 2]
        return StressRows(
            rows=coordinate_rows(entries, np.tile(rows.coordinates, (3, 1)), self.size),
            mises=PLANE,
            components=("along", "across", "shear"),
            points=(mesh.points[mesh.cells].mean(axis=1) + offsets).reshape(-1, 3),
            cell=np.tile(np.arange(len(mesh.cells)), 3),
            faces=FACES,
            face=np.repeat(np.arange(3), len(mesh.cells)),
        )


class Strains:
    """Strains of a shell by its displacement u and rotation theta in UFL, in a frame of three unit vectors."""

    def __init__(self, u: Expr, theta: Expr, frame: Sequence[Expr]) -> None:
        """Compute the strains of the displacement u and the rotation theta, UFL vectors of three.

        `frame` has three unit vectors; the last one is the normal.
        """
        in_plane, normal = _in_plane(frame), frame[2]
        H = ufl.dot(in_plane, _surface_gradient(u, frame))
        director = ufl.cross(normal, theta)
        self.membrane = ufl.sym(H)  # (2, 2)
        self.curvature = ufl.sym(ufl.dot(in_plane, _surface_gradient(director, frame)))  # (2, 2) 1/m
        self.shear = _surface_gradient(ufl.dot(u, normal), frame) - ufl.dot(in_plane, director)
        # the surface's rotation about its normal, less that of theta
        self.drilling = (H[1, 0] - H[0, 1]) / 2 - ufl.dot(theta, normal)


def _in_plane(frame: Sequence[Expr]) -> Expr:
    """The first two vectors of a frame as the rows of a matrix (2, 3)."""
    return ufl.as_matrix([[e[i] for i in range(3)] for e in frame[:2]])


def _surface_gradient(field: Expr, frame: Sequence[Expr]) -> Expr:
    """Derivatives of a field along the first two vectors of a frame; the last axis counts the two vectors."""
    return ufl.dot(ufl.grad(field), ufl.transpose(_in_plane(frame)))


def _plane_stress(E: Expr, nu: Expr, strain: Expr) -> Expr:
    """Plane stress (2, 2) in Pa of a strain (2, 2) in UFL, for Young's modulus E and Poisson's ratio nu."""
    return E / (1 - nu**2) * ((1 - nu) * strain + nu * ufl.tr(strain) * ufl.Identity(2))


def _frame(mesh: Mesh) -> tuple[Expr, ...]:
    """Unit vectors of each triangle in UFL: along its first edge, in its plane across that edge, normal to it."""
    J = ufl.Jacobian(mesh)
    first, second = ufl.as_vector([J[i, 0] for i in range(3)]), ufl.as_vector([J[i, 1] for i in range(3)])
    normal = ufl.cross(first, second)
    e1, e3 = first / ufl.sqrt(ufl.dot(first, first)), normal / ufl.sqrt(ufl.dot(normal, normal))
    return e1, ufl.cross(e3, e1), e3


def of(body: Body, mesh: NamedMesh) -> Shell:
    """Shell model of a scene's body on a mesh.

    A region has its own thickness and material, if the scene gives them.  Without a thickness it has the thickness of
    the box there, or the body's thickness if the body has no box.  Without a material it has the body's material.
    Raises an InputError for a body that has neither a box nor a thickness.
    """
    if body.box is not None:
        of_box = shell_body(body.box, body.material)
        plate, regions = of_box.plate, dict(of_box.regions)
        if body.box.frames:
            regions["frames"] = Plate(material=body.material, thickness=body.box.frame_plate_thickness)
    else:
        if body.thickness is None:
            raise InputError("scene", "body.thickness", None, "a thickness in m is needed for a shell that is read")
        plate, regions = Plate(material=body.material, thickness=body.thickness), {}
    for name, region in body.regions.items():
        thickness = region.thickness or regions.get(name, plate).thickness
        regions[name] = Plate(material=region.material or body.material, thickness=thickness)
    shell = Shell(ShellBody(plate=plate, regions=regions, shear_correction=body.shear_correction), mesh)
    if body.box is None or not body.box.varying_keys:
        return shell
    walls = walls_along(body.box, mesh)
    for name, region in body.regions.items():
        if region.thickness is not None:
            walls[mesh.regions.get(name, [])] = region.thickness
    return replace(shell, walls=walls)


def boom_of_box(box: Box, size: float, along: float, tail_layer: float = 0.0) -> BoxBoom:
    """Description of a box and the sizes of its cells, from which gmsh draws and meshes it.

    Cells have the width `size` (m) around the section and the length `along` (m); 0 stands for the same as `size`.
    `tail_layer` (m) is the length of the first layer of cells at the tail; 0 stands for the length of all other layers.
    """
    depth = np.inf if box.frame_depth == "full" else box.frame_depth
    if not box.varying_keys:
        return BoxBoom(box.sides, box.length, size, along, tail_layer, box.frames, depth)
    parts = tuple(box.stretches)
    # if bottom and top corners differ in thickness on any stretch, they differ in name on all
    names = max(([side.name for side in part.first.sides] for part in parts), key=lambda names: len(set(names)))
    sides = tuple(replace(side, name=name) for side, name in zip(box.sides, names, strict=True))
    return BoxBoom(sides, box.length, size, along, tail_layer, box.frames, depth, parts)


def walls_along(box: Box, mesh: NamedMesh) -> Array:
    """Thickness (C,) in m in the middle of each of C cells of a box that varies along its axis.

    The mesh must be drawn from the description that `boom_of_box` returns.  Cells of frames have the thickness of the
    frames' plates.
    """
    boom = boom_of_box(box, box.length, 0.0)
    middle = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    thickness = np.full(len(middle), box.frame_plate_thickness)
    for k, side in enumerate(boom.sides):
        for part in boom.parts:
            of_side = [mesh.regions[side.name + end] for end in ("", RAMP, TAPERED) if side.name + end in mesh.regions]
            cells = np.concatenate(of_side)
            cells_of_part = cells[(part.start < middle[cells]) & (middle[cells] < part.end)]
            share = (middle[cells_of_part] - part.start) / (part.end - part.start)
            first, last = part.first.sides[k], part.last.sides[k]
            thickness[cells_of_part] = (1.0 - share) * first.thickness + share * last.thickness
    return thickness


def shell_body(profile: BoxProfile, material: Material) -> ShellBody:
    """Body of `material` with the thickness of a profile's thickest plate.

    Thinner plates are regions, called by the names of their walls.
    """
    walls = profile.walls
    thickest = max(walls.values())
    thinner = {name: Plate(material=material, thickness=wall) for name, wall in walls.items() if wall < thickest}
    return ShellBody(plate=Plate(material=material, thickness=thickest), regions=thinner)


def frames(mesh: NamedMesh) -> Array:
    """Unit vectors (C, 3, 3) of C triangles: along the body's axis, across that in the triangle, outward normal.

    For a triangle that lies across the body's axis, the next of the axes x, y, z is used instead of the body's axis.
    """
    corners = mesh.points[mesh.cells]
    # unit normals (f, 3), turned away from the body's axis
    normals = unit_normals(corners)
    largest = np.take_along_axis(normals, np.abs(normals).argmax(axis=1)[:, None], axis=1)[:, 0]
    flat = bool(np.all(np.abs(normals @ normals[0]) > FLAT))
    side = np.zeros(len(normals)) if flat else outward_signs(mesh, corners.mean(axis=1), normals)
    n = np.asarray(normals * np.where(side == 0.0, np.sign(largest), side)[:, None])
    along = np.eye(3)[np.where(np.abs(n[:, mesh.axis]) > ACROSS, (mesh.axis + 1) % 3, mesh.axis)]
    e1 = along - np.sum(along * n, axis=1)[:, None] * n
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    return np.stack([e1, np.cross(n, e1), n], axis=1)
