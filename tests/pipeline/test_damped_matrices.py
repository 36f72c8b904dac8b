"""Bodies whose matrices have a damping that is not Rayleigh's, beside SciPy, and beside the same damping of a scene."""

from dataclasses import replace
from pathlib import Path

import bricks
import numpy as np
import pytest
import scipy.linalg
from generalized_alpha import GeneralizedAlpha

import pmr
from pmr.files.matrices import GivenMatrices
from pmr.reduction.held_body import framed_body, held_body

STEP, RHO = 1e-4, 0.8
CANTILEVER = f"""
title = "Cantilever"
body.model = "matrices"
mesh.file = "bar.npz"
supports = [{{ on = "tail", points = "all", kind = "clamped" }}]
loads = [{{ on = "tip", direction = "z", signal = {{ kind = "smooth_ramp", times = [0, 1e-3], values = [0, 1e3] }} }}]
observe = {{ start = 0.0, end = 1.2, count = 3 }}
time = {{ end = 0.02, step = {STEP}, rho_inf = {RHO} }}
damping = {{ mass = 2.0, stiffness = 1e-6 }}
reduction.coordinates = 36
"""
BOOM = """
title = "Boom"
section.body.model = "matrices"
section.mesh.file = "bar.npz"
section.observe = { start = 0.0, end = 2.4 }
time = { end = 0.1, step = 1e-3 }

[[sections]]
name = "base"
supports = [{ on = "tail", kind = "clamped" }]
reduction.coordinates = 6

[[sections]]
name = "fly"
reduction.coordinates = 12
loads = [{ on = "tip", direction = "z", signal = { kind = "smooth_ramp", times = [0, 0.05], values = [0, -1000] } }]
joint.cylinder.stiffness = 5e7
joint.extension = { kind = "smooth_ramp", times = [0.0, 0.1], values = [0.6, 0.9] }

[[sections.joint.tail]]
at = 0.15
unilateral = false
faces = { bottom = [0.0], top = [0.0], left = [-0.1, 0.1], right = [-0.1, 0.1] }

[[sections.joint.mouth]]
at = 0.15
unilateral = false
faces = { bottom = [0.0], top = [0.0], left = [-0.1, 0.1], right = [-0.1, 0.1] }
"""


def damped(bar: GivenMatrices, folder: Path, damping: float, spacing: float) -> GivenMatrices:
    """Save a bar with dampers between its edges into a folder."""
    body = replace(bar, D=bricks.struts(bar, damping, spacing))
    body.save(folder / "bar.npz")
    return body


def scene(folder: Path, text: str, *overrides: str) -> pmr.scene.Scene:
    (folder / "bar.toml").write_text(text)
    return pmr.load_scene(folder / "bar.toml", overrides)


def clamped(body: GivenMatrices) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M, D with the damping of the scene, K, and the mean motion of the tip along z, without the nodes of the tail."""
    at = ~np.isin(body.node, body.groups["tail"])
    M, D, K = (A.toarray()[np.ix_(at, at)] for A in (body.M, body.D, body.K))
    tip = np.isin(body.node, body.groups["tip"]) & (body.direction == 2)
    return M, D + 2.0 * M + 1e-6 * K, K, (tip / tip.sum())[at]


def march(M: np.ndarray, D: np.ndarray, K: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Coordinates (T, n) under loads f (T, n) from rest, by generalized-alpha."""
    scheme = GeneralizedAlpha(STEP, RHO)
    a_m, a_f, h = scheme.alpha_m, scheme.alpha_f, STEP
    to_q, to_v = scheme.gains
    q, v, a, acceleration = np.zeros((4, len(M)))
    effective, motion = scipy.linalg.lu_factor(M + to_v * D + to_q * K), [q]
    for load in f[1:]:
        mean = (a_f * acceleration - a_m * a) / (1.0 - a_m)
        q = q + h * v + h**2 * ((0.5 - scheme.beta) * a + scheme.beta * mean)
        v = v + h * ((1.0 - scheme.gamma) * a + scheme.gamma * mean)
        acceleration = scipy.linalg.lu_solve(effective, load - D @ v - K @ q)
        q, v = q + to_q * acceleration, v + to_v * acceleration
        a = mean + (1.0 - a_f) / (1.0 - a_m) * acceleration
        motion.append(q)
    return np.array(motion)


@pytest.mark.slow
def test_a_damped_body_has_the_motion_and_the_complex_modes_of_its_matrices(tmp_path: Path) -> None:
    body = damped(bricks.bricks((3, 1, 1), (1.2, 0.2, 0.3)), tmp_path, 2e5, 0.4)
    M, D, K, tip = clamped(body)
    of_bar = scene(tmp_path, CANTILEVER)
    response = pmr.run(of_bar).result.responses
    signal = np.array([float(of_bar.loads[0].signal.value(t)) for t in response["full"].t])
    expected = march(M, D, K, signal[:, None] * tip) @ tip
    undamped = march(M, 2.0 * M + 1e-6 * K, K, signal[:, None] * tip) @ tip
    assert np.abs(expected - undamped).max() > 0.05 * np.abs(expected).max()
    for name in ("full", "reduced"):
        assert np.abs(response[name].tip - expected).max() < 1e-9 * np.abs(expected).max()
    model = pmr.reduce(of_bar).reduced
    poles, n = [], len(M)
    for A in ((M, D, K), (model.M, model.D, model.K)):
        system = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(A[0], A[2]), -np.linalg.solve(A[0], A[1])]])
        values = scipy.linalg.eigvals(system)
        poles.append(values[np.lexsort((values.imag, np.round(np.abs(values), 3)))])
    assert np.abs(poles[1] - poles[0]).max() < 1e-9 * np.abs(poles[0]).max()


@pytest.mark.slow
def test_damping_of_matrices_is_that_of_a_scene_where_both_are_rayleigh(tmp_path: Path) -> None:
    """In sections with a cylinder: its modes, the estimate and the forces of supports have the damping, too."""
    bar, results = bricks.bricks((8, 1, 1), (2.4, 0.2, 0.3)), []
    for D, overrides in ((None, ("damping.mass=3", "damping.stiffness=1e-5")), (3.0 * bar.M + 1e-5 * bar.K, ())):
        replace(bar, D=D).save(tmp_path / "bar.npz")
        results.append(pmr.run(scene(tmp_path, BOOM, *overrides)).result)
    for name in ("reduced", "full"):
        one, other = (result.responses[name] for result in results)
        for key in ("displacement", "slider_force", "others"):  # the last ones are forces of supports
            a, b = getattr(one, key), getattr(other, key)
            assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    one, other = (result.summary for result in results)
    for key in ("tip", "beam", "pad_force", "cylinder_force"):
        assert other["estimate"][key] == pytest.approx(one["estimate"][key], rel=1e-4)
    for name, error in one["errors"]["reduced_vs_full"].items():
        assert other["errors"]["reduced_vs_full"][name] == pytest.approx(error, rel=1e-3, abs=1e-7)


@pytest.mark.slow
def test_the_estimate_has_the_damping_and_says_what_it_lacks(tmp_path: Path) -> None:
    """It lacks the response of what the modes leave out to the damping forces of the modes."""
    damped(bricks.bricks((8, 1, 1), (2.4, 0.2, 0.3)), tmp_path, 5e4, 0.6)
    summary = pmr.run(scene(tmp_path, BOOM)).result.summary
    errors, estimate = summary["errors"]["reduced_vs_full"], summary["estimate"]
    for key in ("tip", "beam", "pad_force"):
        assert 0.5 * errors[key] < estimate[key] < 2.0 * errors[key] < 0.05
    assert any(warning.endswith("the modes leave out, which is not Rayleigh's") for warning in summary["warnings"])


@pytest.mark.slow
def test_a_saved_model_goes_on_alone_and_step_by_step(tmp_path: Path) -> None:
    damped(bricks.bricks((12, 2, 2), (2.0, 0.2, 0.3)), tmp_path, 5e4, 0.5)
    of_bar = scene(tmp_path, bricks._SCENE)
    reduced = pmr.reduce(of_bar).reduced
    reduced.save(tmp_path / "reduced.npz")
    model = pmr.ReducedModel.load(tmp_path / "reduced.npz")
    assert np.count_nonzero(np.triu(np.abs(model.D) > 1e-3 * np.abs(model.D).max(), 1)) > model.size
    response = pmr.simulate(of_bar, model)
    stepper, path, load = pmr.Stepper(model, step=1e-3, s=0.6), of_bar.slider.path, of_bar.loads[0].signal
    y = np.array([stepper.step(float(path.value(t)), float(load.value(t))).copy() for t in response.t[1:]])
    size = np.abs(response.displacement).max()
    assert np.abs(y[:, : response.displacement.shape[1]] - response.displacement[1:]).max() < 1e-9 * size


@pytest.mark.slow
def test_flexible_bodies_have_the_damping_of_matrices(tmp_path: Path) -> None:
    """On nodes, and on frames: there the damping is three times the mass, and the first six columns are rigid."""
    bar = bricks.bricks((12, 2, 2), (2.0, 0.2, 0.3))
    held = bricks._SCENE.replace('[[supports]]\non = "tip"\ndirections = ["rx"]\nstiffness = 1e6\n', "")
    held = held.replace("left = [0.0], right = [0.0]", "left = [-0.1, 0.1], right = [-0.1, 0.1]")
    body = damped(bar, tmp_path, 5e4, 0.5)
    nodal = held_body(scene(tmp_path, held), 0.8, 8)
    expected = nodal.modes.T @ (body.D @ nodal.modes)
    assert np.abs(nodal.damping - expected).max() < 1e-9 * np.abs(expected).max()
    replace(bar, D=3.0 * bar.M).save(tmp_path / "bar.npz")
    framed = framed_body(scene(tmp_path, held), 0.8, 4)
    elastic = framed.C[6:, 6:] - 3.0 * framed.M[6:, 6:]
    assert np.abs(elastic).max() < 1e-9 * np.abs(framed.C).max()
