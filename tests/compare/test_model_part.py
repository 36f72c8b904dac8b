"""The model's part of the budget: motions of two models, and what they are apart."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr.compare.model_part import (
    IMPACTS,
    PLACES,
    STRESS,
    Motion,
    evenly_spaced_steps,
    frequency_error,
    largest_model_error,
    model_budget,
)
from pmr.scene import load_any
from pmr.simulation import Excitation
from pmr.simulation.excitation import side_positions
from pmr.system.assembly import Assembly

QUICK = ["compare.against=[]", "time.end=0.2", "time.step=2e-3", "mesh.elements=12"]


@pytest.fixture(scope="module")
def boom():
    """A beam on pads and its motion."""
    scene = load_any("boom_beam", QUICK)
    return scene, Motion.compute(scene, pmr.reduce(scene).system)


def scaled(motion: Motion, displacement: float = 1.0, force: float = 1.0) -> Motion:
    response = motion.response
    changes = {"displacement": displacement * response.displacement, "slider_force": force * response.slider_force}
    return replace(motion, response=replace(response, **changes))


def test_parts_are_differences_over_what_the_richer_model_does(boom) -> None:
    scene, motion = boom
    richer = replace(scaled(motion, 1.25, 2.0), frequencies=motion.frequencies / 1.1)
    found = model_budget(scene, motion, richer, "shell")
    assert [found[kind] for kind in ("beam", "tip", "largest")] == pytest.approx([0.2, 0.2, 0.2])
    assert [found[kind] for kind in ("pad_force", "frequency")] == pytest.approx([0.5, 0.1])
    assert largest_model_error(found) == found["pad_force"]
    assert "cylinder_force" not in found and found["not_covered"] == [STRESS]


def test_outputs_count_that_both_models_have(boom) -> None:
    """A planar beam has none across: lateral motion of a richer one is nothing that it says wrong."""
    scene, motion = boom
    response = motion.response
    across = [k for k, one in enumerate(response.outputs) if one.kind in ("beam", "tip") and one.direction == "y"]
    assert 0 < len(across) < len(response.output_names)
    kinds = tuple("probe y" if k in across else kind for k, kind in enumerate(response.kinds))
    planar = replace(motion, response=replace(response, kinds=kinds))
    moved = response.displacement.copy()
    moved[:, across] += 1.0
    other = replace(motion, response=replace(response, displacement=moved))
    found = model_budget(scene, planar, other, "shell")
    assert found["beam"] == 0.0 == found["tip"]


def test_what_does_not_move_is_off_by_nothing_that_is_known(boom) -> None:
    scene, motion = boom
    found = model_budget(scene, motion, scaled(motion, 0.0), "shell")
    assert found["beam"] is None and found["tip"] is None and found["pad_force"] == 0.0
    pads = [ring.model_copy(update={"unilateral": True}) for ring in scene.pads]
    pushing = scene.model_copy(update={"pads": tuple(pads)})
    assert model_budget(pushing, motion, motion, "shell")["not_covered"] == [STRESS, IMPACTS]


def test_a_tip_that_a_support_holds_is_off_by_nothing_that_is_known(boom) -> None:
    """Two meshes leave different round-off there, which is no error of either."""
    scene, motion = boom
    tips = [k for k, output in enumerate(motion.response.outputs) if output.kind == "tip"]

    def held(share: float) -> Motion:
        displacement = motion.response.displacement.copy()
        displacement[:, tips] = share * motion.response.round_off
        return replace(motion, response=replace(motion.response, displacement=displacement))

    assert motion.response.round_off > 0.0
    budget = model_budget(scene, held(0.5), held(0.01), "finer mesh")
    assert budget["tip"] is None and budget["beam"] == 0.0
    unmoved = scaled(motion, displacement=0.1 * motion.response.round_off / np.abs(motion.response.displacement).max())
    budget = model_budget(scene, unmoved, scaled(unmoved, displacement=0.5), "finer mesh")
    assert budget["tip"] is budget["beam"] is budget["largest"] is None
    assert largest_model_error({}) == 0.0


def test_modes_count_that_move_where_the_poorer_model_can(boom) -> None:
    """Beside a planar beam those of a beam in space that are lateral do not."""
    scene, motion = boom
    planar = replace(motion, mode_motions=motion.mode_motions * [[[1.0], [0.0], [1.0]]])
    vertical = motion.mode_motions[:, 2] > motion.mode_motions[:, 1]
    lowest = np.array([f[mine][:2] for f, mine in zip(motion.frequencies, vertical, strict=True)])
    assert np.any(lowest != motion.frequencies[:, :2])
    found = model_budget(scene, replace(planar, frequencies=1.1 * motion.frequencies), motion, "beam3d")["frequencies"]
    assert np.array(found["richer"]) == pytest.approx(lowest)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["boom_beam", "boom_two"])
def test_frequencies_are_those_at_places_all_along(name: str) -> None:
    """One section and several by the same code."""
    scene = load_any(name, ["compare.against=[]"])
    fewer = scene.time.model_copy(update={"step": scene.time.end / 100.0})
    scene = scene.model_copy(update={"time": fewer, "simulation": scene.simulation.model_copy(update={"repeats": 1})})
    system, excitation = pmr.reduce(scene).system, Excitation.from_scene(scene)
    steps, s = evenly_spaced_steps(excitation), excitation.s.sum(axis=1)
    assert PLACES / 2 < len(steps) <= PLACES and np.diff(s[steps]).max() < 4.0 * np.ptp(s) / PLACES
    assert s[steps[0]] == s.min() and s[steps[-1]] == s.max()
    x = side_positions(system, excitation)[steps]
    found = Motion.compute(scene, system).lowest_frequencies(np.full(3, True))
    for k in (0, len(steps) // 2, len(steps) - 1):
        assert found[k] == pytest.approx(Assembly(system).frequencies(x[k : k + 1], 2)[0], rel=1e-9)


@pytest.mark.slow
@pytest.mark.numerical
def test_with_second_order_frequencies_are_those_of_stressed_models() -> None:
    """And modes past the buckling load, where nothing holds them, are at 0 Hz."""
    changes = [
        "section.mesh.elements=8",
        "frame.second_order=true",
        "time.step=0.02",
        "sections.fly.masses.payload.mass=2000.0",
    ]
    scene = load_any(Path(__file__).parents[1] / "pipeline" / "luffing.toml", changes)
    system, excitation = pmr.reduce(scene).system, Excitation.from_scene(scene)
    assembly, steps = Assembly(system), evenly_spaced_steps(excitation)
    x, c = side_positions(system, excitation)[steps], excitation.amplitudes(system.term_names)[steps]
    found = Motion.compute(scene, system).lowest_frequencies(np.full(3, True))
    assert found == pytest.approx(assembly.frequencies(x, 2, c), rel=1e-6)
    assert np.all(np.abs(found[:, 0] / assembly.frequencies(x, 2)[:, 0] - 1.0) > 5e-4)
    assert assembly.modes(assembly.contact_rows(x[-1]), 2, 1e3 * c[-1]).omega[0] == 0.0


def test_a_rotation_of_round_off_is_off_by_nothing() -> None:
    """A lateral force on pads that are mirror images does not turn the tip about y."""
    push = "loads=[{name='push', on='tip', direction='y', signal={kind='sine', amplitude=500.0, frequency=5.0}}]"
    keys = [*QUICK, "observe.rotation=true", push, "gravity.direction=[0.0,-1.0,0.0]"]
    scenes = load_any("boom_beam", keys), load_any("boom_beam", [*keys, "mesh.elements=24"])
    coarse, fine = (Motion.compute(scene, pmr.reduce(scene).system) for scene in scenes)
    (turned,) = coarse.histories("probe").values()
    assert 0.0 < np.abs(turned).max() < 1e-12 and [*coarse.round_off] == ["tip ry"]
    assert model_budget(scenes[0], coarse, fine, "finer mesh")["probes"] == {"tip ry": 0.0}
    exact = replace(coarse, round_off={}), replace(fine, round_off={})
    assert model_budget(scenes[0], *exact, "finer mesh")["probes"]["tip ry"] > 0.1


def test_frequencies_that_one_model_lacks_have_no_error() -> None:
    """A model of rigid motions alone beside one that vibrates; entries that both have count."""
    lacking = np.array([[0.0, np.nan], [0.0, np.nan]])
    reference = np.array([[0.0, 5.0], [1e-9, 6.0]])
    assert frequency_error(lacking, reference) is None and frequency_error(reference, 0.0 * reference) is None
    assert frequency_error(np.array([[0.0, np.nan], [0.0, 6.6]]), reference) == pytest.approx(0.1)
