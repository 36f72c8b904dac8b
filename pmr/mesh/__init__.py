"""Meshes: generated, or read through meshio, and kept as points, cells and named groups."""

from pmr.mesh.drawing import graded_nodes, read_nodes
from pmr.mesh.named import Group, NamedMesh, read_mesh

__all__ = ["Group", "NamedMesh", "graded_nodes", "read_mesh", "read_nodes"]
