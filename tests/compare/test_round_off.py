"""What is left of motions and forces that cancel or that nothing drives is nobody's error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import one_body
import pytest
from driving import driven
from one_body import respond
from scipy.interpolate import PPoly

from pmr import scene as scenes
from pmr.compare.estimate import chi
from pmr.compare.evaluation import evaluate_motion as of_sections
from pmr.compare.outputs import run_from_start
from pmr.compare.round_off import force_round_off, round_off
from pmr.pipeline import reduce, run
from pmr.scene.signals import Constant
from pmr.simulation import Excitation, TimeStepping
from pmr.system.body import Trajectory
from pmr.system.reduced_model import ReducedModel

WORKFLOWS = Path(__file__).parents[2] / "workflows"
ALONG = {
    "planar": (
        "evolved_residual.toml",
        "loads=[{name='X',on=5.0,direction='x',signal=1e3}]",
        "mesh.elements=20",
        "simulation.simulators=['march']",
        "time.end=6.0",
    ),
    "space": ("boom.toml", "loads=[]", "gravity.direction=[-1.0,0.0,0.0]", "body.model=beam3d", "mesh.elements=12"),
}


def two_springs(turned: float) -> ReducedModel:
    """A load along one spring, an output and a slider along the other; coordinates turned by an angle in rad."""
    c, s = np.cos(turned), np.sin(turned)
    T = np.array([[c, -s], [s, c]])
    K, row = T.T @ np.diag([2e4, 3e4]) @ T, np.array([[0.0, 1.0]]) @ T
    pieces = PPoly(np.stack([0.1 * row, 0.95 * row])[:, None], [0.0, 1.0])  # the row at s = 0.5 m
    return ReducedModel(
        np.eye(2), np.zeros((2, 2)), K, T.T[:, :1], row, pieces, ("F",), ("slider",), np.zeros(1), pads=np.array([1e-5])
    )


def test_round_off_is_that_of_the_body_not_of_its_coordinates() -> None:
    loads = np.array([[3.0], [-7.0]])
    w2 = (2.0 * np.pi / 5.0) ** 2
    exact = 7e-11 / np.sqrt((2e4 + w2) * (3e4 + w2))
    for turned in (0.0, 1e-3, 0.7):
        assert round_off({"": two_springs(turned)}, loads, 5.0) == pytest.approx(exact, rel=1e-9, abs=0.0)
    assert round_off({"": two_springs(0.7)}, 1e-200 * loads, 5.0) == pytest.approx(1e-200 * exact, rel=1e-9, abs=0.0)


def test_a_mode_that_only_round_off_moves_has_no_share_of_its_own() -> None:
    """The first spring moves half as far again as its load holds it, the second one by a few units of round-off."""
    t, still = np.linspace(0.0, 1.0, 5), np.array([1.0, -2.0, 1.0, 3.0, 0.0])
    load = np.cos(t)[:, None]
    q = np.column_stack([1.5 * load[:, 0] / 2e4, np.spacing(1.5 / 2e4) * still])
    run = Trajectory(t, q, np.zeros_like(q), np.zeros((5, 1)), np.full(5, 0.5), 0.0)
    assert chi(two_springs(0.0), run, load, 0) == pytest.approx(0.5 / 1.5, rel=1e-9)
    assert chi(two_springs(0.0), run, load, 1) == 0.0


def test_of_several_bodies_all_loads_reach_every_output() -> None:
    """By the triangle inequality: the sum over the loads, and the largest output."""
    loads, w2 = np.array([[3.0, 2.0], [-7.0, 5.0]]), (2.0 * np.pi / 5.0) ** 2
    found = round_off({"base": two_springs(0.0), "fly": two_springs(0.7)}, loads, 5.0)
    assert found == pytest.approx(12e-11 / np.sqrt((2e4 + w2) * (3e4 + w2)), rel=1e-9, abs=0.0)


def test_a_response_of_sections_knows_its_round_off() -> None:
    boom = scenes.load_any(WORKFLOWS / "boom_two.toml", ("time.end=0.1", "section.mesh.elements=8"))
    system, excitation = reduce(boom).system, Excitation.from_scene(boom)
    run_ = run_from_start(system, excitation)
    found, loads = of_sections(system, run_), excitation.forces(system.input_names)
    assert found.round_off == pytest.approx(round_off(system.bodies, loads, boom.time.end), rel=1e-9)
    assert 0.0 < found.round_off < 1e-6 * np.abs(found.displacement).max()


def test_forces_have_a_round_off_too() -> None:
    model, stepping = two_springs(0.7), TimeStepping(1.0, 1e-3)
    motion = one_body.simulate(model, driven(Constant(amount=0.5), Constant(amount=7.0), stepping))
    f, w2 = np.full((1001, 1), 7.0), (2.0 * np.pi) ** 2
    least = 7e-11 / np.sqrt(2e4 + w2) / np.sqrt(1.0 / (3e4 + w2) + 1e-5)
    assert force_round_off(model, f, 1.0, 0.5) == pytest.approx(least, rel=1e-9, abs=0.0)
    response = respond(model, motion, np.zeros(1001), f)
    assert np.abs(response.slider_force).max() < response.force_round_off == pytest.approx(least, rel=1e-9, abs=0.0)
    assert np.abs(response.displacement).max() < response.round_off


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONG)
def test_a_load_along_the_axis_bends_nothing(name: str) -> None:
    """A mast under its weight: no error, no step too coarse, no pad that is pulled."""
    file, *changes = ALONG[name]
    outcome = run(scenes.load(WORKFLOWS / file, changes))
    assert outcome is not None
    summary = outcome.result.summary
    errors = summary["errors"]["reduced_vs_full"]
    assert [errors[name] for name in ("tip", "beam", "pad_force")] == [
        0.0,
        0.0,
        0.0,
    ]  # along the axis the support bears
    assert (summary["estimate"]["beam"], summary["step"]["beam"], summary["warnings"]) == (0.0, 0.0, [])
