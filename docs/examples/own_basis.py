"""
A basis of one's own
====================

Any vectors on the full model's coordinates make a basis.  Here they come from pyMOR: the proper orthogonal
decomposition of shapes of the evolved case.  The shapes are the static deflection under the load and the first modes,
each with the slider held at fifteen places.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import scipy.linalg
from pymor.algorithms.pod import pod
from pymor.core.logger import set_log_levels
from pymor.operators.numpy import NumpyMatrixOperator
from pymor.vectorarrays.numpy import NumpyVectorSpace

import pmr
from pmr.fullmodel.build import full_model

set_log_levels({"pymor": "ERROR"})
COUNTS = (12, 16, 20)
CHANGES = [
    "mesh.elements=24",
    "time.end=5.0",
    "reduction.estimate=false",
    "compare.against=['full']",
    "simulation.simulators=['march']",
    "simulation.repeats=1",
]
scene = pmr.load_scene("evolved_residual", CHANGES)
body = full_model(scene).gather()  # sparse matrices of SciPy, and rows at any s
M, K = body.M.toarray(), body.K.toarray()

# %%
# The columns of N are the motions that supports and slider allow.  N^T K N x = N^T f gives the static deflection, and
# N^T K N and N^T M N give the modes.

pool = []
for s in np.linspace(*scene.path_bounds, 15):
    N = scipy.linalg.null_space(body.rows.at(s).toarray())
    pool.append(N @ np.linalg.solve(N.T @ K @ N, N.T @ body.B))
    pool.append(N @ scipy.linalg.eigh(N.T @ K @ N, N.T @ M @ N, subset_by_index=(0, 3))[1])
space = NumpyVectorSpace(len(M))
vectors, sigma = pod(space.make_array(np.hstack(pool)), product=NumpyMatrixOperator(M), modes=20)[:2]
V = np.asarray(vectors.to_numpy()).reshape(len(M), -1)

# %%
# The file has only V, with a column for each vector.  The scene says how many of them are taken.

errors = {}
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder, "basis.npz")
    np.savez(file, V=V)
    for flexibility in ("false", "true"):
        for r in COUNTS:
            own = [f"reduction={{basis='file',file='{file}',product='mass',coordinates={r},flexibility={flexibility}}}"]
            found = pmr.run(pmr.load_scene("evolved_residual", [*CHANGES, *own])).result.summary
            errors[flexibility, r] = 100 * found["errors"]["reduced_vs_full"]["beam"]

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for flexibility, label in (("false", "pyMOR's POD"), ("true", "with residual flexibility")):
    axes.semilogy(COUNTS, [errors[flexibility, r] for r in COUNTS], "o-", label=label)
axes.set(xlabel="coordinates", ylabel="error along the beam in %")
axes.legend()
plt.show()
