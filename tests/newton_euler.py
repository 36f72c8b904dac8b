"""Rigid sections of a boom that luffs, slews and extends, as points: positions in space, differentiated in time.

Shares no formula with `pmr.simulation.frame`.  The axes of the boom are R = exp(psi Z) exp(-phi Y), and

    R' = psi' Z R - phi' R Y,    R'' = psi'' Z R + psi'^2 Z Z R - 2 psi' phi' Z R Y - phi'' R Y + phi'^2 R Y Y
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pmr.files.arrays import Array
from pmr.models.profile_section import section_of
from pmr.scene import Scene

Y = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
Z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Needed:
    """Force (T, 3) in N and moment about the pivot (T, 3) in N m that have to act on a section, in the boom's axes."""

    force: Array
    moment: Array


def needed(scene: Scene, number: int, t: Array) -> Needed:
    """Force and moment that section number `number` needs at the times t (T,), its attached masses included."""
    assert scene.frame is not None and scene.gravity is not None
    luffing, slewing = scene.frame.angles
    psi, psi1, psi2 = (of(t)[:, None, None] for of in (slewing.value, slewing.rate, slewing.second_rate))
    phi, phi1, phi2 = (of(t)[:, None, None] for of in (luffing.value, luffing.rate, luffing.second_rate))
    R = (
        Rotation.from_rotvec(psi[:, 0] * [0.0, 0.0, 1.0]) * Rotation.from_rotvec(phi[:, 0] * [0.0, -1.0, 0.0])
    ).as_matrix()
    R1 = psi1 * Z @ R - phi1 * R @ Y
    R2 = psi2 * Z @ R + psi1**2 * Z @ Z @ R - 2.0 * psi1 * phi1 * Z @ R @ Y - phi2 * R @ Y + phi1**2 * R @ Y @ Y
    x = np.zeros((3, len(t)))
    for k in range(1, number + 1):
        path = scene.extension(k)
        x += np.stack([path.value(t), path.rate(t), path.second_rate(t)])
    along, force, moment = np.eye(3)[0], np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for point, mass in points(scene, number):
        r = np.array(scene.frame.tail_position) + point + x[0, :, None] * along
        v, a = x[1, :, None] * along, x[2, :, None] * along
        second = np.einsum("tij,tj->ti", R2, r) + 2.0 * np.einsum("tij,tj->ti", R1, v) + np.einsum("tij,tj->ti", R, a)
        own = mass * np.einsum("tij,ti->tj", R, second + [0.0, 0.0, scene.gravity.acceleration])
        force += own
        moment += np.cross(r, own)
    return Needed(force, moment)


def of_masses(scene: Scene, number: int) -> tuple[float, float]:
    """Mass in kg of a section with its attached masses, and first moment in kg m about the section's tail."""
    of_section = list(points(scene, number))
    return sum(mass for _, mass in of_section), sum(float(mass * point[0]) for point, mass in of_section)


def points(scene: Scene, number: int) -> Iterator[tuple[Array, float]]:
    """Yield points in m from the section's tail with masses in kg that have the section's inertia about each axis."""
    part = scene.sections[number]
    assert part.body.box is not None
    section, material, length = section_of(part.body.box, 0.3), part.body.material, part.length
    across = [0.0, 0.0] if part.body.model == "beam2d" else [section.second_moment_z, section.second_moment_y]
    for x, weight in zip(*np.polynomial.legendre.leggauss(2), strict=True):
        mass = material.density * section.area * length * weight / 8.0
        for axis, second in zip((1, 2), across, strict=True):
            for side in (-1.0, 1.0):
                offset = side * np.sqrt(2.0 * second / section.area) * np.eye(3)[axis]
                yield np.array([(1.0 + x) * length / 2.0, 0.0, 0.0]) + offset, mass
    for attached in part.masses:
        yield np.array([length, 0.0, 0.0]), attached.mass
