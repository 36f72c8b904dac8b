"""An oscillator with one load as a linear model, its histories, and measurements of them."""

import numpy as np
from scipy.linalg import expm

from pmr.files.arrays import Array
from pmr.kernel.filter import StepMatrices
from pmr.observe.linear import LinearMotion

H, OMEGA, G = 0.01, 6.0, 9.81
OUTPUTS = ("acceleration of tip", "tip", "force")


def oscillator(steps: int, omega: float = OMEGA) -> LinearMotion:
    """Mass of 100 kg on a spring and a damper, with the states z, v and one that is not used; a load pushes it."""
    A = np.array([[0.0, 1.0], [-(omega**2), -0.3]])
    whole = expm(np.block([[A, np.array([[0.0], [0.01]])], [np.zeros((1, 3))]]) * H)
    courses = np.zeros((5, 4, 1))  # one mode, which goes on by itself: its acceleration is that by the load alone
    courses[:2, :2, 0], courses[:2, 3, 0] = whole[:2, :2], whole[:2, 2]
    C, D = np.array([A[1], [1.0, 0.0], [-100.0 * omega**2, 0.0]]), np.array([[0.01], [0.0], [0.0]])
    R, G, C, D = (np.tile(matrix, (steps, 1, 1)) for matrix in (np.zeros((1, 2)), np.ones((1, 1)), C, D))
    t, units, kinds = H * np.arange(1, steps + 1), ("m/s^2", "m", "N"), ("", "tip", "support")
    return LinearMotion(t, OUTPUTS, units, kinds, ("push",), np.zeros((steps, 3)), StepMatrices(courses, R, G, C, D))


def history(model: LinearMotion, f: Array) -> Array:
    """Outputs (T, q) under loads f (T,), from equilibrium with the first of them."""
    x, y = model.start[:, 0] * f[0], np.zeros(model.reference.shape)
    for k in range(len(f)):
        y[k] = model.C[k] @ x + model.D[k, :, 0] * f[k]
        x = model.A[k] @ x + model.B[k, :, 0] * f[k]
    return y


def weight(model: LinearMotion, mass: float, rng: np.random.Generator, pushed: float = 0.0) -> Array:
    """Outputs (T, q) of a payload of `mass` kg that hangs at the tip, while random forces of `pushed` N move it."""
    x, y, f = model.start[:, 0] * -G * mass, np.zeros(model.reference.shape), 0.0
    for k in range(len(y)):
        f = 0.9 * f + pushed * np.sqrt(1.0 - 0.81) * rng.standard_normal()
        load = (f - mass * (G + model.C[k, 0] @ x)) / (1.0 + mass * model.D[k, 0, 0])
        y[k] = model.C[k] @ x + model.D[k, :, 0] * load
        x = model.A[k] @ x + model.B[k, :, 0] * load
    return y


def measured(
    model: LinearMotion, y: Array, noise: Array, rng: np.random.Generator, names: tuple[str, ...] = OUTPUTS
) -> dict[str, tuple[Array, Array]]:
    values = y + noise * rng.standard_normal(y.shape)
    return {name: (model.t, values[:, model.output_number(name)]) for name in names}
