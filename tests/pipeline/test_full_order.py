"""References of a scene, by whichever simulator.
Who simulates all sections in full order is whom the scene names.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ways.kinds import KINDS

import pmr
from pmr import Response, System
from pmr.compare.responses import MARCHED_UP_TO, exudyn, full_simulator
from pmr.fem.compat import MPI
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullSystem
from pmr.pipeline import full_order
from pmr.pipeline.full_order import FullOrder
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.petsc import History
from pmr.system.states import SystemTrajectory

SHORT = ("time.end=0.04", "mesh.elements=20", "slider.path={kind='ramp',times=[0.01,0.03],values=[1.25,1.3]}")
SIMULATORS = ("march", "exudyn")


def whole(scene: Scene) -> FullOrder:
    return FullOrder.join(scene, {ALONE: full_model(scene)})


@pytest.mark.mpi
def test_the_full_model_moves_alike_by_all_that_simulate_it(load_scene) -> None:
    found = {}
    for simulator in ("march", "exudyn", "petsc"):
        scene = load_scene("paper_evolved", [*SHORT, f"simulation.full={simulator}", "compare.against=['full']"])
        found[simulator] = whole(scene).references().responses
    if MPI.COMM_WORLD.rank > 0:
        assert found["march"] == found["exudyn"] == {}
        return
    expected = found["march"]["full"]
    size = np.abs(expected.displacement).max()
    assert size > 1e-6
    for simulator in ("exudyn", "petsc"):
        response = found[simulator]["full"]
        np.testing.assert_allclose(response.displacement, expected.displacement, rtol=0.0, atol=1e-6 * size)
        scale = np.abs(expected.energy.strain).max()
        np.testing.assert_allclose(response.energy.total, expected.energy.total, rtol=0.0, atol=1e-6 * scale)
        np.testing.assert_array_equal(response.t, expected.t)
        np.testing.assert_array_equal(response.x, expected.x)


def test_the_cable_is_one_too(load_scene) -> None:
    scene = load_scene("paper_evolved", [*SHORT, "compare.ancf_elements=4", "compare.against=['full','ancf']"])
    full = whole(scene)
    found = full.references().responses
    assert list(found) == ["full", "ancf"]
    np.testing.assert_array_equal(found["ancf"].x, full.system.models[0].output_positions)
    assert whole(load_scene("paper_evolved", [*SHORT, "compare.against=[]"])).references().responses == {}
    assert full.reference("full") is not None


@pytest.mark.parametrize(("size", "chosen"), [(MARCHED_UP_TO, "march"), (MARCHED_UP_TO + 1, "petsc")])
def test_the_size_decides_unless_the_scene_does(load_scene, size: int, chosen: str) -> None:
    assert full_simulator(load_scene("paper_simple"), size) == chosen
    assert full_simulator(load_scene("paper_simple", ["simulation.full=exudyn"]), size) == "exudyn"


@pytest.mark.mpi
def test_states_are_the_same_by_all_that_know_them(load_scene) -> None:
    found, steps = {}, [0, 20, 40]
    for simulator in ("march", "petsc"):
        scene = load_scene("paper_evolved", [*SHORT, f"simulation.full={simulator}", "compare.against=['full']"])
        full = whole(scene)
        found[simulator] = full.references(steps=steps).states[ALONE].p
        assert found[simulator].shape == (3, full.system.models[0].M.getLocalSize()[0])
    size = MPI.COMM_WORLD.allreduce(np.abs(found["march"]).max(), op=MPI.MAX)
    assert size > 1e-6
    np.testing.assert_allclose(found["petsc"], found["march"], rtol=0.0, atol=1e-6 * size)


def test_a_rotation_is_observed_by_all_that_simulate_it(load_scene) -> None:
    found = {}
    for simulator in ("march", "petsc"):
        changes = ["mesh.elements=8", "time.end=0.3", f"simulation.full={simulator}", "observe.rotation=true"]
        scene = load_scene("evolved_residual", changes)
        found[simulator] = whole(scene).references().responses
    if MPI.COMM_WORLD.rank > 0:
        return
    one, other = (found[simulator]["full"] for simulator in found)
    assert one.other_names == other.other_names and (one.other_names[0], one.other_units[0]) == ("tip ry", "rad")
    turned = one.other("tip ry")
    assert np.abs(turned).max() > 0.0 and one.displacement.shape[1] == 9
    assert np.abs(turned - other.other("tip ry")).max() < 1e-8 * np.abs(turned).max()


@pytest.mark.slow
def test_pads_that_push_are_followed_in_the_parts_that_the_reduced_model_chose(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In full order by PETSc, and of the reduced model by Exudyn."""
    scene = pmr.load_scene(KINDS["J"].written(tmp_path), ["simulation.full=petsc", "time.end=0.02"])
    scene = scene.model_copy(update={"simulation": scene.simulation.model_copy(update={"simulators": SIMULATORS})})
    asked, observed, in_exudyn = dict[str, TimeStepping](), full_order.observe, exudyn.simulate_system

    def observe(system: FullSystem, excitation: Excitation, *more: Any, **named: Any) -> History:
        asked["petsc"] = excitation.stepping
        return observed(system, excitation, *more, **named)

    def simulated(system: System, excitation: Excitation, *more: Any) -> SystemTrajectory:
        asked["exudyn"] = excitation.stepping
        return in_exudyn(system, excitation, *more)

    monkeypatch.setattr(full_order, "observe", observe)
    monkeypatch.setattr(exudyn, "simulate_system", simulated, raising=False)
    pmr.run(scene)
    assert len(asked["petsc"].schedule) == 20  # one number a step, instead of the most for all of them
    assert asked["exudyn"].schedule == asked["petsc"].schedule


SHORT_SIMULATORS = ["section.mesh.elements=4", "section.reduction.coordinates=4", "time.end=0.02", "time.step=1e-3"]
SHORT_SIMULATORS += ["time.rho_inf=0.9", "simulation.repeats=1"]
BOTH_WAYS = [f"section.joint.{end}=[{{at=0.15,stiffness=1e8,unilateral=false}}]" for end in ("tail", "mouth")]


@pytest.mark.slow
@pytest.mark.parametrize("pads", ["both ways", "pushing"])
def test_every_simulator_of_the_full_model_is_honoured(pads: str) -> None:
    """They follow the same motion; where pads only push, each step in the parts that the reduced model's took."""
    found = dict[str, Response]()
    for name in ("march", "petsc", "exudyn"):
        asked = [*SHORT_SIMULATORS, *(BOTH_WAYS if pads == "both ways" else []), f"simulation.full={name}"]
        result = pmr.run(pmr.load_scene("boom_two", asked)).result
        assert result.summary["simulators"]["full"] == name
        found[name] = result.responses["full"]
    expected = found["march"].displacement
    for name in ("petsc", "exudyn"):
        assert np.abs(found[name].displacement - expected).max() <= 1e-6 * np.abs(expected).max()
