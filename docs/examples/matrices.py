"""
Mass and stiffness from elsewhere
=================================

`pmr` takes models of other programs: it needs two matrices, the nodes and a few named groups.  Here thirty lines of
NumPy take the place of the other program: a timber beam of bricks with eight nodes.  `pmr matrices` reads files of
CalculiX, Nastran, Ansys and Abaqus.
"""

from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp

import pmr

E, NU, RHO = 11e9, 0.3, 450.0  # a wood, taken as isotropic
SIZE, CELLS = np.array([4.0, 0.12, 0.2]), np.array([24, 2, 2])
CORNERS = np.array(list(product((-1, 1), repeat=3)))


def brick(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (24, 24) of a brick, by two Gauss points in each direction."""
    lame, shear = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    C = np.diag([2 * shear] * 3 + [shear] * 3)
    C[:3, :3] += lame
    K, M, volume = np.zeros((24, 24)), np.zeros((24, 24)), edges.prod() / 8
    for xi in CORNERS / 3**0.5:
        parts = (1 + CORNERS * xi) / 2
        N = np.kron(parts.prod(axis=1), np.eye(3))
        gradient = np.array([CORNERS[:, k] * np.delete(parts, k, 1).prod(axis=1) / edges[k] for k in range(3)])
        B = np.zeros((6, 24))
        for k in range(3):
            B[k, k::3] = gradient[k]
        for row, (a, b) in enumerate([(1, 2), (0, 2), (0, 1)], start=3):
            B[row, a::3], B[row, b::3] = gradient[b], gradient[a]
        K += volume * B.T @ C @ B
        M += volume * RHO * N.T @ N
    return K, M


# %%
# Assembled over a grid of 24 x 2 x 2 cells; x runs along the beam, z points up.

counts = CELLS + 1
index = np.arange(counts.prod()).reshape(counts)
points = np.array(list(product(*(np.linspace(0, s, n) for s, n in zip(SIZE, counts, strict=True)))))
points -= [0.0, SIZE[1] / 2, SIZE[2] / 2]
cells = np.stack([index[tuple(slice(c, c + n) for c, n in zip(corner, CELLS, strict=True))].ravel()
                  for corner in (CORNERS + 1) // 2], axis=1)  # fmt: skip
dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
rows, columns = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, 24).ravel()
K, M = (sp.csr_matrix((np.tile(A.ravel(), len(cells)), (rows, columns))) for A in brick(SIZE / CELLS))
sides = {"tail": (0, 0), "tip": (0, -1), "right": (1, 0), "left": (1, -1), "bottom": (2, 0), "top": (2, -1)}
groups = {name: np.take(index, end, axis=axis).ravel() for name, (axis, end) in sides.items()}
given = pmr.from_matrices(M, K, points, groups)

# %%
# From here on it is a scene like any other: pads on the faces, a support, loads.

SCENE = """
title = "A timber beam from elsewhere"
body.model = "matrices"
mesh.file = "timber.npz"
time = { end = 1.0, step = 1e-3 }
slider.path = { kind = "smooth_ramp", times = [0.1, 0.9], values = [1.0, 2.5] }
loads = [{ on = "tip", direction = "z", signal = { kind = "smooth_ramp", times = [0, 0.3], values = [0, -100] } }]
supports = [{ directions = ["x"] }]
reduction.coordinates = 10
damping = { ratio = 0.01, frequencies = [5.0, 50.0] }
observe = { start = 0.2, end = 3.8 }
pads = [
  { name = "tail", at = 0.2, faces = { bottom = [0.0], top = [0.0], left = [-0.05, 0.05] } },
  { name = "mouth", moving = true, faces = { bottom = [0.0], top = [0.0], left = [-0.05, 0.05] } },
]
"""
with TemporaryDirectory() as folder:
    given.save(Path(folder, "timber.npz"))
    Path(folder, "scene.toml").write_text(SCENE)
    result = pmr.run(pmr.load_scene(Path(folder))).result
size, errors = result.summary["coordinates"], result.summary["errors"]["reduced_vs_full"]
print(f"{size['full']} degrees of freedom, {size['reduced']} coordinates: {100 * errors['tip']:.3f} % off at the tip")

# %%
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
for name, style in (("full", "k-"), ("reduced", "--")):
    axes.plot(result.responses[name].t, 1e3 * result.responses[name].tip, style, label=name)
axes.set(xlabel="t in s", ylabel="tip in mm")
axes.legend()
plt.show()
