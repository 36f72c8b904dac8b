"""Assemble the mass matrix of a small beam and print the beam's mass.

python compiling.py [wait]
"""

import signal
import sys

import numpy as np
import ufl

from pmr.fem.compat import MPI, assemble, compiled_form, create_mesh, lagrange_space


def main() -> None:
    """Assemble and print; with ``wait``, wait for ever before printing."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it, and so do theirs
    nodes, first = np.linspace(0.0, 2.0, 9)[:, None], np.arange(8)[:, None]
    mesh = create_mesh(MPI.COMM_WORLD, "interval", nodes, first + np.arange(2))
    space = lagrange_space(mesh, 1)
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    M = assemble(compiled_form(3.0 * ufl.inner(u, v) * ufl.dx))
    while "wait" in sys.argv:
        signal.pause()
    print(round(M.getVecLeft().comm.size), round(_sum(M), 9))


def _sum(M) -> float:
    """Sum of all entries of a matrix."""
    ones, product = M.createVecs()
    ones.set(1.0)
    M.mult(ones, product)
    return float(product.dot(ones))


main()
