r"""Local bases: modes with the slider held, one set for each of several positions, interpolated along the path.

.. math::
    u = V(s)\, p, \qquad V^T M V \ddot p + (V^T D V + 2 \dot s V^T M V')\, \dot p
    + \big(V^T K V + \ddot s V^T M V' + \dot s^2 V^T M V'' + \dot s V^T D V'\big)\, p = V^T B f

There are no constraint rows: the modes hold the slider at the positions where they were computed, and nearly so between
these. Modes at neighbouring positions are rotated onto each other (Procrustes) before cubic splines are fitted to them.
The method ``matrices`` leaves the terms in V' and V'' out, as parametric model reduction does for parameters that don't
change during a simulation.

Amsallem, Farhat: An online method for interpolating linear parametric reduced-order models, SIAM Journal on Scientific
Computing 33, 2011 (alignment); Panzer, Mohring, Eid, Lohmann: Parametric model order reduction by matrix interpolation,
at - Automatisierungstechnik 58, 2010; Fischer, Eberhard: Application of parametric model reduction with matrix
interpolation for simulation of moving loads in elastic multibody systems, Advances in Computational Mathematics 41,
2015.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.linalg
from experiment import Findings, Row, Settings, rows, run, save
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from residual import full_motion
from scipy.interpolate import CubicSpline

import pmr
from pmr.compare.errors import nrms
from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures import WIDE, add_legend, curve_style, drawing, log_axis, make_sheet
from pmr.report.numbers import format_percent
from pmr.system.body import FullBody

SETTINGS = {"scenes": ["simple_residual", "evolved_residual"], "coordinates": [2, 3, 4, 5, 6, 8, 10, 12, 16, 20]}
METHODS = {"local": "local bases", "matrices": "interpolated matrices", "flexibility": "residual flexibility"}
PLAIN = ["compare.against=[]", "reduction.estimate=false", "simulation.simulators=['march']", "simulation.repeats=1"]
#: Positions of the modes on a length of the body.
POSITIONS = 200
#: Share of the body's length on which there are modes at least, where the slider rests too.
SHORTEST = 0.02


def held_modes(full: FullBody, phi: np.ndarray, omega2: np.ndarray, s: float, r: int) -> np.ndarray:
    """Return the r lowest modes (n, r) of the body with its rows held at s in m, M-orthonormal.

    They are in the coordinates of the body's own modes `phi` (n, n), whose squared frequencies are `omega2` (n,).
    """
    C = full.rows.at(s).toarray() @ phi
    free = scipy.linalg.qr(C.T)[0][:, len(C) :]
    return free @ scipy.linalg.eigh(free.T @ (omega2[:, None] * free), subset_by_index=[0, r - 1])[1]


def aligned(modes: list[np.ndarray]) -> np.ndarray:
    """Return sets of modes (k, n, r), each rotated onto the one before by the polar factor of V_k^T V_{k-1}."""
    result = [modes[0]]
    for V in modes[1:]:
        U, _, Wt = np.linalg.svd(V.T @ result[-1])
        result.append(V @ (U @ Wt))
    return np.array(result)


def simulate(scene: str, r: int, method: str) -> np.ndarray:
    """Return displacements (T, o) in m of r local modes, from rest by generalized-alpha.

    `method` is ``"local"``, or ``"matrices"`` without the terms in V' and V''. Raises SimulationError if the motion
    grows without bound.
    """
    full, phi, omega2, _, _ = full_motion(scene)
    loaded = pmr.load_scene(scene, PLAIN)
    length = float(np.ptp(full.output_positions))
    middle, span = np.mean(loaded.path_bounds), max(np.ptp(loaded.path_bounds), SHORTEST * length)
    bounds = middle - span / 2.0, middle + span / 2.0
    places = np.linspace(*bounds, max(5, round(POSITIONS * span / length)) + 1)
    V = CubicSpline(places, aligned([held_modes(full, phi, omega2, float(s), r) for s in places]))
    D, B, outputs = phi.T @ full.D @ phi, phi.T @ full.B, full.outputs @ phi
    h, steps, rho = loaded.time.step, loaded.time.steps, loaded.time.rho_inf
    t = h * np.arange(-1, steps + 2)
    s = np.clip(np.broadcast_to(loaded.slider.path.value(t), t.shape), *bounds)
    rate, second = np.gradient(s, h)[1:-1], (s[2:] - 2.0 * s[1:-1] + s[:-2]) / h**2
    f = np.column_stack([np.broadcast_to(load.signal.value(t[1:-1]), steps + 1) for load in loaded.only_section.loads])
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    gamma = 0.5 - alpha_m + alpha_f
    beta, gain = 0.25 * (gamma + 0.5) ** 2, (1.0 - alpha_f) / (1.0 - alpha_m)
    q, v, a, acceleration, y = np.zeros(r), np.zeros(r), np.zeros(r), np.zeros(r), np.empty((steps + 1, len(outputs)))
    for k in range(steps + 1):
        V0, V1, V2 = (V(s[k + 1], order) for order in range(3))
        M, damping, stiffness = V0.T @ V0, V0.T @ D @ V0, V0.T @ (omega2[:, None] * V0)
        if method == "local":
            damping = damping + 2.0 * rate[k] * V0.T @ V1
            convected = second[k] * V0.T @ V1 + rate[k] ** 2 * V0.T @ V2 + rate[k] * V0.T @ (D @ V1)
            stiffness = stiffness + convected
        if k > 0:  # what the step before leaves
            following = (alpha_f * acceleration - alpha_m * a) / (1.0 - alpha_m)
            q = q + h * v + h**2 * ((0.5 - beta) * a + beta * following)
            v, a = v + h * ((1.0 - gamma) * a + gamma * following), following
        dv, dq = (h * gamma * gain, h**2 * beta * gain) if k > 0 else (0.0, 0.0)
        side = V0.T @ (B @ f[k]) - damping @ v - stiffness @ q
        acceleration = np.linalg.solve(M + dv * damping + dq * stiffness, side)
        a, v, q = a + (gain if k > 0 else 1.0) * acceleration, v + dv * acceleration, q + dq * acceleration
        y[k] = outputs @ (V0 @ q)
    if not np.isfinite(y).all():
        raise pmr.SimulationError("the motion of local bases grows without bound")
    return y


def row(scene: str, method: str, coordinates: int) -> Row:
    """Return ``error``, the e_NRMS along the beam against the full model's motion; NaN if there is no model."""
    reference = full_motion(scene)[3].displacement
    try:
        if method == "flexibility":
            loaded = pmr.load_scene(scene, [*PLAIN, f"reduction.coordinates={coordinates}"])
            return {"error": nrms(pmr.simulate(loaded, pmr.reduce(loaded).reduced).displacement, reference)}
        return {"error": nrms(simulate(scene, coordinates, method), reference)}
    except (pmr.SimulationError, pmr.InputError):
        return {"error": np.nan}


def main(settings: Settings, out: Path, jobs: int) -> Chapter:
    """Compute all scenes, methods and numbers of coordinates, save the errors, and return the chapter of the report."""
    asked = [(s, m, r) for s in settings["scenes"] for m in METHODS for r in settings["coordinates"]]
    found = rows(row, [{"scene": s, "method": m, "coordinates": r} for s, m, r in asked], out, jobs)
    figures = {f"{s}.{m}.{r}": one["error"] for (s, m, r), one in zip(asked, found, strict=True)}
    save(out, figures=figures)
    return chapter(figures, settings, Findings(figures))


def chapter(figures: dict[str, float], settings: Settings, findings: Findings) -> Chapter:
    """Return the chapter of the report on errors by ``<scene>.<method>.<coordinates>``."""
    scenes, sizes = settings["scenes"], settings["coordinates"]
    caption = "Normalised RMS error along the beam against the full model, over the number of coordinates."
    grids = [
        Grid(
            f"Error along the beam, {scene.replace('_', ' ')}.",
            ("method", *map(str, sizes)),
            tuple(
                (words, *("–" if np.isnan(e := figures[f"{scene}.{method}.{r}"]) else format_percent(e) for r in sizes))
                for method, words in METHODS.items()
            ),
        )
        for scene in scenes
    ]
    middle = sizes[len(sizes) // 2]
    return Chapter(
        anchor="local-bases",
        title="Local bases",
        headline="Modes with the slider held, interpolated along the path, beside one basis with residual flexibility.",
        key_numbers=[
            KeyNumber(format_percent(figures[f"{scenes[-1]}.{method}.{middle}"]), f"{words}, {middle} coordinates")
            for method, words in METHODS.items()
            if np.isfinite(figures[f"{scenes[-1]}.{method}.{middle}"])
        ],
        blocks=[
            Block("Errors", (drawing("local-errors", draw_errors, caption, figures, settings),), grids=tuple(grids))
        ],
    )


def draw_errors(figures: dict[str, float], settings: Settings) -> Figure:
    """Draw the errors over the number of coordinates, one panel for each scene."""
    scenes, sizes = settings["scenes"], np.array(settings["coordinates"])
    figure, axes = make_sheet(
        WIDE, 2.6, columns=len(scenes), margins={"top": 0.5}, sharey=True, gridspec_kw={"wspace": 0.05}
    )
    for ax, scene in zip(axes[0], scenes, strict=True):
        for number, method in enumerate(METHODS):
            error = np.array([figures[f"{scene}.{method}.{r}"] for r in sizes])
            ax.plot(sizes[np.isfinite(error)], error[np.isfinite(error)], **curve_style(number, 2.2))
        ax.set_title(scene.replace("_", " "), loc="left", pad=3.0)
        ax.set_xlabel("Number of coordinates (–)")
    log_axis(axes[0, 0], float(np.nanmin(list(figures.values()))), 1.0)
    axes[0, 0].set_ylabel("e_NRMS (–)")
    add_legend(
        figure, [Line2D([], [], label=words, **curve_style(number)) for number, words in enumerate(METHODS.values())]
    )
    return figure


if __name__ == "__main__":
    run(main, SETTINGS, __doc__)
