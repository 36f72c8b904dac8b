"""Largest values with another play of pads: those of a scene with this play, and none where pads hold both ways."""

import numpy as np
import pytest

import pmr
from pmr.compare.other_runs import largest_sizes, simulate_varied_play, states_under_load
from pmr.compare.simulated import excitation_of_scene, simulate_with_states
from pmr.scene import Scene

pytestmark = pytest.mark.slow  # a boom is reduced
SHORT = ("time.end=0.4", "time.step=0.005", "compare.against=[]", "section.mesh.elements=8",
         "section.joint.extension={kind='constant', amount=4.0}")  # fmt: skip
PLAY = [f"section.joint.{end}.0.clearance={{{{top={{gap}}, bottom=0.0}}}}" for end in ("tail", "mouth")]


def boom(*keys: str, gap: float = 0.0) -> Scene:
    return pmr.load_scene("boom_three", [*SHORT, *(key.format(gap=gap) for key in PLAY), *keys])


def varied_summary(scene: Scene) -> dict:
    """The entry ``budget.play`` of a scene's reduced system, with stresses in walls of 2 and 3 Pa."""
    system = pmr.reduce(scene).system
    varied = simulate_varied_play(scene, system, excitation_of_scene(scene, system))
    assert varied is not None
    return varied.summary(
        scene, pmr.simulate(scene, system), {"wall_stress": {"value": 2.0}}, {"wall_stress": {"value": 3.0}}
    )


@pytest.mark.parametrize(("of_scene", "of_other"), [(0.0, 1e-3), (1e-3, 0.0)])
def test_values_are_those_of_the_same_scene_with_all_of_the_play_at_the_top(of_scene: float, of_other: float) -> None:
    play = varied_summary(boom(gap=of_scene))
    assert play["gap"] == of_other
    scene, other = boom(gap=of_scene), boom(gap=of_other)
    sizes, other_sizes = (largest_sizes(of, pmr.simulate(of, pmr.reduce(of).system)) for of in (scene, other))
    rows = {(row["quantity"], row["name"]): row for row in play["rows"]}
    assert [*rows] == [*sizes, ("wall_stress", "")]
    assert {quantity for quantity, _ in sizes} == {"tip", "pad_force", "support"}
    for key, row in rows.items():
        assert row["value"] == pytest.approx(sizes.get(key, 2.0), rel=1e-9)
        assert row["varied"] == pytest.approx(other_sizes.get(key, 3.0), rel=1e-9)
    down = rows["tip", "z"]
    assert (down["varied"] - down["value"]) * (of_other - of_scene) > 0.0  # with play the boom hangs lower


def test_pads_that_hold_both_ways_and_a_play_of_0_are_not_varied() -> None:
    both_ways = [f"section.joint.{end}.0.unilateral=false" for end in ("tail", "mouth")]
    for scene in (pmr.load_scene("boom_three", [*SHORT, *both_ways]), boom("compare.play=0")):
        system = pmr.reduce(scene).system
        assert simulate_varied_play(scene, system, excitation_of_scene(scene, system)) is None


def test_states_are_those_at_the_times_of_recovery_and_of_the_largest_force_of_each_pad() -> None:
    scene = boom("recovery={every=0.1}")
    system = pmr.reduce(scene).system
    varied = simulate_varied_play(scene, system, excitation_of_scene(scene, system))
    assert varied is not None and varied.simulation.run is not None
    of_scene = simulate_with_states(scene, system, scene.recovered_steps.tolist())
    states_of_scene = states_under_load(scene, system, of_scene)
    for run, states in ((of_scene.run, states_of_scene), (varied.simulation.run, varied.simulation.states)):
        assert run is not None
        between = [step for step in np.abs(run.forces).argmax(axis=0).tolist() if step not in scene.recovered_steps]
        assert between  # the sections beat on their pads between the times of recovery
        expected = [*scene.recovered_steps.tolist(), *between]
        for of_body in states.values():
            assert of_body.t.tolist() == sorted({scene.time.step * step for step in expected})
    forces = varied.simulation.run.forces
    on_fly = varied.simulation.states[scene.names[-1]].multipliers
    assert np.abs(on_fly).max() == pytest.approx(np.abs(forces[:, -len(on_fly[0]) :]).max(), rel=1e-12)
