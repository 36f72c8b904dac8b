"""Structured blocks of solid cells with named faces, for small tests."""

import numpy as np

from pmr.models.named_mesh import NamedMesh, named_mesh

BLOCKS = ("hexahedron", "tetrahedron")
#: A cube in six tetrahedra around its diagonal (Kuhn); vertices count as in a tensor product.
KUHN = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]]


def block(kind: str, n: tuple[int, int, int], size: tuple[float, float, float]) -> NamedMesh:
    """Mesh of a block from the origin, with `n` cells and `size` m along x, y, z, of one of the kinds in `BLOCKS`.

    Its named faces are ``tail`` and ``tip`` at the ends of x, ``bottom`` and ``top`` at those of z; ``all`` are its
    cells.
    """
    axes = [np.linspace(0.0, length, count + 1) for length, count in zip(size, n, strict=True)]
    points = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    number = np.arange(len(points)).reshape([count + 1 for count in n])
    first = number[:-1, :-1, :-1].ravel()
    steps = [number[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    cubes = first[:, None] + np.array(steps)
    cells = cubes if kind == "hexahedron" else np.concatenate([cubes[:, tet] for tet in KUHN])
    quads = {"tail": cubes[:, [0, 2, 4, 6]], "tip": cubes[:, [1, 3, 5, 7]],
             "bottom": cubes[:, [0, 1, 2, 3]], "top": cubes[:, [4, 5, 6, 7]]}  # fmt: skip
    at = {"tail": (0, 0.0), "tip": (0, size[0]), "bottom": (2, 0.0), "top": (2, size[2])}
    blocks: list = [(kind, 3, cells)]
    for name, (axis, value) in at.items():
        faces = quads[name][np.all(points[quads[name]][:, :, axis] == value, axis=1)]
        if kind == "hexahedron":
            blocks.append(("quadrilateral", 2, faces))
        else:  # every face of the cube is cut along the diagonal from its first to its last vertex
            blocks.append(("triangle", 2, np.concatenate([faces[:, [0, 1, 3]], faces[:, [0, 2, 3]]])))
    names = ["all", *at]
    members = {
        name: [np.arange(len(b[2])) if i == k else np.empty(0, int) for i, b in enumerate(blocks)]
        for k, name in enumerate(names)
    }
    return named_mesh(points, blocks, members, (kind,))
