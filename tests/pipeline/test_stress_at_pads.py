"""What the stress of walls at pads is computed from: pads where they are with their forces, and section forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr.compare.simulated import simulate_with_states
from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel import wall_stress
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_stress import (
    ByPressure,
    Estimate,
    LoadedRing,
    RingStress,
    SectionPiece,
    SectionStates,
    WallPeak,
    store_stresses,
)
from pmr.pipeline import bodies as at_pads
from pmr.pipeline.model_errors import reduce_scene
from pmr.reduction.recovery import recover
from pmr.scene.joints import BoomSection

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SHORT = ["time.end=0.2", "time.step=0.02", "compare.against=[]", "section.mesh.elements=6", "recovery={every=0.1}"]


def test_rings_have_places_and_forces_of_pads_and_the_largest_stress_of_all_sections_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = pmr.load_scene(WORKFLOWS / "boom_three.toml", SHORT)
    base, middle, fly = scene.names
    reduction = reduce_scene(scene, MPI.COMM_WORLD)
    simulated = simulate_with_states(scene, reduction.system, [0, 5, 10])
    looked_at = dict[str, tuple[SectionStates, list[LoadedRing]]]()

    def wall_peak(part: BoomSection, states: SectionStates, rings: list[LoadedRing]) -> WallPeak:
        looked_at[part.name] = states, rings
        if part.name == base:
            raise InputError("body", "pads", None, "a pad on its face is allowed")
        box = part.body.box  # at the left edge of the bottom wall, on its outer face
        place = np.array([1.0, box.width / 2.0, -(box.height + box.sides[0].thickness) / 2.0])
        middle_pressed = Estimate(2e8 if part.name == middle else 1e8, 3e6)
        return WallPeak(ByPressure(middle_pressed, Estimate(1.5e8 if part.name == middle else 1.6e8, 2e6)), 1, place)

    monkeypatch.setattr(wall_stress, "wall_peak", wall_peak)
    monkeypatch.setattr(wall_stress, "yield_forces", lambda scene: {})
    recovered = recover(scene, reduction.built, reduction.bodies, simulated.states, {})
    entries = at_pads.stress_at_pads(scene, reduction.built, recovered, simulated.states)
    assert entries["wall_stress_missing"] == {base: "a pad on its face is allowed"}
    found = entries["wall_stress"]
    assert (found["value"], found["error"], found["section"], found["region"]) == (2e8, 3e6, middle, "bottom")
    assert (found["even"], found["even_error"]) == (1.6e8, 2e6)
    assert found["t"] == pytest.approx(0.1)

    response = simulated.response
    of_fly = [k for k, output in enumerate(response.outputs) if output.kind == "pad" and f"{fly} " in output.name]
    forces = np.stack([response.column(k)[[0, 5, 10]] for k in of_fly], axis=1)
    states, rings = looked_at[fly]
    assert sorted(len(ring.pads) for ring in rings) == [len(of_fly) // 2] * 2  # at its tail, and at the mouth
    of_rings = np.sort(np.hstack([ring.forces for ring in rings]), axis=1)
    np.testing.assert_allclose(of_rings[0], np.sort(forces[0]), atol=1e-9 * np.abs(forces).max())
    np.testing.assert_allclose(of_rings, np.sort(forces, axis=1), rtol=0.03)  # a response has means over steps
    joint, extension = scene.joint(2), scene.extension(2).value(response.t[[0, 5, 10]])
    tail, mouth = sorted((ring.x for ring in rings), key=lambda x: x[0])
    np.testing.assert_allclose(tail, joint.tail[0].at)
    np.testing.assert_allclose(mouth, scene.sections[1].length - joint.mouth[0].at - extension)

    # pads with their forces, and weight and loads outside of them: the moment at a ring turns back from one side only
    outer, between, inner = (np.array([states.at(k, np.array([x]))[4, 0] for k in range(3)])
                             for x in (scene.sections[2].length - 1e-3, mouth[0], joint.tail[0].at / 2.0))  # fmt: skip
    assert np.all(np.abs(between) > 20.0 * np.abs(outer)) and np.all(np.abs(between) > 20.0 * np.abs(inner))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "elements"), [("boom_three", SHORT[3]), ("boom_beam_walls", "mesh.elements=6")])
def test_stresses_stored_before_a_run_are_all_that_it_looks_at(
    monkeypatch: pytest.MonkeyPatch, name: str, elements: str
) -> None:
    """The pads of a single body, and of the joints of three sections, are at the same places in both."""
    looked_at = set[tuple[object, ...]]()

    def stresses(piece: SectionPiece, pads: list[Pad], place: float) -> list[RingStress]:
        looked_at.add((piece.length, place, *((pad.on, pad.across, pad.length, pad.width) for pad in pads)))
        stress = np.ones((2, len(pads), 1, 3))
        at_one_point = RingStress(np.array([[0.0, 0.1, 0.1]]), np.array([0.006]), stress, np.zeros(1))
        return [at_one_point, at_one_point]

    monkeypatch.setattr(SectionPiece, "stresses", stresses)
    scene = pmr.load_scene(WORKFLOWS / f"{name}.toml", [*SHORT[:3], elements, SHORT[4]])
    store_stresses(scene)
    stored = looked_at.copy()
    looked_at.clear()
    reduction = reduce_scene(scene, MPI.COMM_WORLD)
    states = simulate_with_states(scene, reduction.system, [0, 5, 10]).states
    recovered = recover(scene, reduction.built, reduction.bodies, states, {})
    at_pads.stress_at_pads(scene, reduction.built, recovered, states)
    assert looked_at and looked_at <= stored
