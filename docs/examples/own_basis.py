"""
A basis of one's own
====================

Any vectors on the full model's coordinates make a basis.  Here they come from pyMOR: the proper orthogonal
decomposition of shapes of the evolved case.  The shapes are the static deflection under the load and the first modes,
each with the slider held at fifteen places.
"""

import matplotlib.pyplot as plt
import numpy as np
import scipy.linalg
from pymor.algorithms.pod import pod
from pymor.core.logger import set_log_levels
from pymor.operators.numpy import NumpyMatrixOperator
from pymor.vectorarrays.numpy import NumpyVectorSpace

import pmr

set_log_levels({"pymor": "ERROR"})
COUNTS = (12, 16, 20)
CHANGES = [
    "mesh.elements=24",
    "time.end=5.0",
    "reduction.estimate=false",
    "compare.against=[]",
    "simulation.simulators=['march']",
    "simulation.repeats=1",
]
scene = pmr.load_scene("evolved_residual", CHANGES)
body = pmr.full_model(scene)  # sparse matrices of SciPy, and rows at any s
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
# The first r vectors are a basis.  All vectors that the full model has, the unit vectors, reduce nothing: they are what
# the others are compared with.


def displacement(basis, flexibility):
    """Displacements (T, o) in m along the beam on a basis (n, r)."""
    changes = [*CHANGES, "reduction.product=mass", f"reduction.flexibility={flexibility}"]
    own = pmr.load_scene("evolved_residual", changes)
    return pmr.simulate(own, pmr.reduce(own, basis=basis).reduced).displacement


reference = displacement(np.eye(len(M)), "false")
errors = {}
for flexibility in ("false", "true"):
    for r in COUNTS:
        difference = displacement(V[:, :r], flexibility) - reference
        errors[flexibility, r] = 100 * np.linalg.norm(difference) / np.linalg.norm(reference)

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for flexibility, label in (("false", "pyMOR's POD"), ("true", "with residual flexibility")):
    axes.semilogy(COUNTS, [errors[flexibility, r] for r in COUNTS], "o-", label=label)
axes.set(xlabel="coordinates", ylabel="error along the beam in %")
axes.legend()
plt.show()
