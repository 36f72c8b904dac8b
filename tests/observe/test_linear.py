"""Linear models along paths beside marches of the same system under other loads."""

import hoists
import numpy as np
import pytest

import pmr
from pmr import InputError, Observer, System, linearize
from pmr.observe.linear import output_sensitivity
from pmr.observe.observer import Payload, Sensor
from pmr.scene import Scene

PADS = "[{at=0.15,stiffness=1e8,unilateral=false,faces={bottom=[0.0],top=[0.0]}}]"
SMALL = (
    f"section.joint.tail={PADS}", f"section.joint.mouth={PADS}",
    "section.mesh.elements=8", "section.reduction.coordinates=3", "section.reduction.estimate=false", "time.end=0.2",
    "time.rho_inf=0.9", "start='equilibrium'", "time.step=1e-3",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.2],values=[0.6,0.9]}",
)  # fmt: skip
LOAD, TIP, FORCE = "fly.tip force", "fly: tip z", "force of fly mouth top"


def scene_with(load: float, *changes: str) -> Scene:
    signal = f"{{kind='sine',amplitude={load},frequency=9.0}}" if load else "0.0"
    loads = f"sections.fly.loads=[{{name='tip force',on='tip',direction='z',signal={signal}}}]"
    return pmr.load_scene("boom_three", [*SMALL, loads, *changes])


@pytest.fixture(scope="module")
def system() -> System:
    return pmr.reduce(scene_with(0.0)).system


@pytest.mark.slow
def test_a_load_moves_outputs_as_a_march_says(system: System) -> None:
    """Contacts hold, so the model is exact; the paths move meanwhile."""
    model = linearize(scene_with(0.0), system, [TIP, FORCE], [LOAD])
    loaded, quiet = (pmr.simulate(scene_with(f), system) for f in (500.0, 0.0))
    f, x = 500.0 * np.sin(2.0 * np.pi * 9.0 * model.t), np.zeros(model.A.shape[1])
    y = np.zeros((len(model.t), 2))
    for k in range(len(model.t)):
        y[k] = model.reference[k] + model.C[k] @ x + model.D[k, :, 0] * f[k]
        x = model.A[k] @ x + model.B[k, :, 0] * f[k]
    for column, name in enumerate((TIP, FORCE)):
        expected, still = (
            response.column([each.name for each in response.outputs].index(name))[1:] for response in (loaded, quiet)
        )
        assert np.abs(expected - still).max() > 1e-3 * np.abs(still).max()
        np.testing.assert_allclose(y[:, column], expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.slow
def test_accelerations_are_second_differences_of_a_fine_march(system: System) -> None:
    """The sections slide at up to 2.8 m/s, so the rates of rows count; what differences lack is of second order."""
    acceleration, velocity = f"acceleration of {TIP}", f"velocity of {TIP}"
    h = 2.5e-4
    model = linearize(scene_with(0.0, f"time.step={h}", "time.end=0.05"), system, [TIP, acceleration, velocity])
    tip, expected, rate = model.reference.T
    fine = (-tip[4:] + 16.0 * tip[3:-1] - 30.0 * tip[2:-2] + 16.0 * tip[1:-3] - tip[:-4]) / (12.0 * h * h)
    moved = (-tip[4:] + 8.0 * tip[3:-1] - 8.0 * tip[1:-3] + tip[:-4]) / (12.0 * h)
    middle = slice(20, -20)
    np.testing.assert_allclose(expected[2:-2][middle], fine[middle], rtol=0.0, atol=1e-4 * np.abs(fine).max())
    np.testing.assert_allclose(rate[2:-2][middle], moved[middle], rtol=0.0, atol=1e-4 * np.abs(moved).max())


def test_an_accelerometer_feels_gravity(system: System) -> None:
    names = [f"{what} of {TIP}" for what in ("acceleration", "specific force")]
    reference = linearize(scene_with(0.0, "time.end=0.005"), system, names).reference
    np.testing.assert_allclose(reference[:, 1] - reference[:, 0], 9.80665)


def test_accelerometers_of_a_boom_that_is_raised_feel_their_shares_of_gravity() -> None:
    raised = ["gravity.inclination=30.0", "section.body.model=beam3d", "free_motions=allowed", "time.end=0.005"]
    names = [f"{what} of fly: tip {axis}" for axis in "yz" for what in ("acceleration", "specific force")]
    scene = scene_with(0.0, *raised, "gravity.rise=0.0")
    reference = linearize(scene, pmr.reduce(scene).system, names).reference
    felt = reference[:, 1::2] - reference[:, ::2]
    np.testing.assert_allclose(felt, np.tile([0.0, 9.80665 * np.cos(np.pi / 6.0)], (len(felt), 1)), atol=1e-12)


def test_a_key_of_the_table_selects_its_outputs(system: System) -> None:
    model = linearize(scene_with(0.0, "time.end=0.002"), system, ["pad_force", TIP])
    assert FORCE in model.outputs and set(model.kinds) == {"pad", "tip"} and model.units[-1] == "m"


def test_a_payload_takes_the_acceleration_of_the_place_where_its_load_acts(system: System) -> None:
    """With the acceleration of the middle section a payload of 310 kg was estimated as 382 kg."""
    accelerations = [f"acceleration of {place}" for place in (TIP, "middle: tip z")]
    model = linearize(scene_with(0.0, "time.end=0.005"), system, [FORCE, *accelerations], [LOAD])
    assert model.displacements == {LOAD: (TIP,)}
    Observer(model, [Sensor(FORCE, 200.0)], payload=Payload(LOAD, accelerations[0], 100.0))
    with pytest.raises(InputError, match=f"payload.acceleration = .*: {accelerations[0]} is allowed"):
        Observer(model, [Sensor(FORCE, 200.0)], payload=Payload(LOAD, accelerations[1], 100.0))


def test_wrong_names_are_refused(system: System) -> None:
    scene = scene_with(0.0, "time.end=0.002")
    for outputs, inputs in ((["nothing"], []), ([TIP], ["nothing"]), ([f"velocity of {FORCE}"], []), (["machine"], [])):
        with pytest.raises(InputError, match="observe"):
            linearize(scene, system, outputs, inputs)
    for step in (0.0, -1e-3, 0.002):  # 0 was taken for the scene's step, and a single step ended in a traceback
        with pytest.raises(InputError, match=f"observe: step = {step}: more than 0 and at most half of .* 0.002 s"):
            linearize(scene, system, [TIP], step=step)
    first, other = (linearize(scene, system, [name]) for name in (TIP, FORCE))
    with pytest.raises(InputError, match="parameters"):
        output_sensitivity(first, other)


def test_a_hoist_is_refused() -> None:
    scene = hoists.cantilever()
    with pytest.raises(InputError, match="^observe: hoist: none is allowed"):
        linearize(scene, hoists.reduced(scene), ["tip"])
