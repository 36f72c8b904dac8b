"""What shells and solids share: materials by region, rigid motions, the scale of their frequencies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.mesh.named import NamedMesh
from pmr.mesh.nodes import Nodes
from pmr.scene.structures import Material

Array = NDArray[np.float64]
T = TypeVar("T")


def by_region(mesh: NamedMesh, default: T, regions: Mapping[str, T]) -> list[T]:
    """One entry for each cell: its region's, or the default.

    Raises
    ------
    InputError
        If the mesh has no such group of cells, or two of them share cells.
    """
    chosen = [default] * len(mesh.cells)
    owner = np.full(len(mesh.cells), -1)
    for number, (name, entry) in enumerate(regions.items()):
        if name not in mesh.regions:
            found = ", ".join(sorted(mesh.regions)) or "none"
            raise InputError("scene", f"body.regions.{name}", None, f"{mesh.source} has these regions: {found}")
        cells = mesh.regions[name]
        shared = owner[cells].max(initial=-1)
        if shared >= 0:
            raise InputError("scene", f"body.regions.{name}", None, f"shares cells with {list(regions)[shared]}")
        owner[cells] = number
        for cell in cells:
            chosen[cell] = entry
    return chosen


def rigid_motions(nodes: Nodes) -> Array:
    """Coordinates (n, 6) of unit translations along and rotations about x, y, z through the origin."""
    motions = np.zeros((nodes.size, 6))
    axis = np.eye(3)
    for i in range(3):
        motions[nodes.component == i, i] = 1.0
        motions[nodes.component == i, 3:] = np.cross(nodes.at[nodes.component == i], axis[i])
        motions[nodes.component == 3 + i, 3 + i] = 1.0
    return motions


def frequency_scale(points: Array, material: Material, thickness: float = 0.0) -> float:
    """sqrt(E / rho) r / L^2 in rad/s, with the largest extent L and half the smallest, r: that of a slender beam."""
    extent = np.ptp(points, axis=0)
    depth = max(extent.min(), thickness) / 2.0
    return float(np.sqrt(material.young / material.density) * depth / extent.max() ** 2)
