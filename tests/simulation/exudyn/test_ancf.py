from dataclasses import replace
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
import one_body
import pytest
from driving import driven
from oracle import nrms_error
from textbook import EA, EI, LENGTH, RHO_A, TIP_DEFLECTION

from pmr import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.scene.signals import Constant, Ramp, SmoothRamp, Step
from pmr.simulation import TimeStepping
from pmr.simulation.exudyn import ancf
from pmr.simulation.exudyn.ancf import add_sliding_cable, curvature, values
from pmr.system.body import FullBody

AT_THE_TIP = {"F": LENGTH}
CABLE = ancf.Cable(LENGTH, EA, EI, RHO_A, elements=10)
X = np.linspace(0.0, LENGTH, 51)


def nodal(w: Any, slope: Any) -> Array:
    """Coordinates (1, N, 4) of a cable with the transverse displacement w(x)."""
    x = np.linspace(0.0, LENGTH, CABLE.elements + 1)
    return np.stack([0.0 * x, w(x), 0.0 * x, slope(x)], axis=1)[None]


def still(x: Array, **given: Any) -> ancf.CableMotion:
    """A motion that is zero but for what is given, over one time."""
    zero = {
        "t": np.zeros(1), "x": x, "displacement": np.zeros((1, len(x))), "velocity": np.zeros((1, len(x), 2)),
        "curvature": np.zeros((1, len(x))), "loads": np.zeros((1, 0)), "load_displacement": np.zeros((1, 0)),
        "slider_force": np.zeros(1), "s": np.zeros(1), "seconds": 0.0,
    }  # fmt: skip
    return ancf.CableMotion(**{**zero, **given})


def test_cubics_are_interpolated_exactly() -> None:
    q = nodal(lambda x: 0.1 * x**3 - x, lambda x: 0.3 * x**2 - 1.0)
    x = np.array([0.0, 0.123, 1.0, 2.5, LENGTH])
    np.testing.assert_allclose(values(CABLE, q, x)[0], np.stack([0.0 * x, 0.1 * x**3 - x], 1), atol=1e-13)


def test_curvature_of_a_parabola() -> None:
    """K = w'' / (1 + w'^2) when x stays the parameter."""
    q = nodal(lambda x: 0.2 * x**2, lambda x: 0.4 * x)
    x = np.array([0.0, 0.123, 1.0, 2.5, LENGTH])
    np.testing.assert_allclose(curvature(CABLE, q, x)[0], 0.4 / (1.0 + 0.16 * x**2), rtol=1e-12)


def test_curvature_at_a_node_is_the_mean_of_both_sides() -> None:
    q = nodal(lambda x: 0.0 * x, lambda x: 1e-3 * (x == 1.0))  # element length 0.5: w'' = 4 theta / h to the left
    left, node, right = curvature(CABLE, q, np.array([1.0 - 1e-7, 1.0, 1.0 + 1e-7]))[0]
    np.testing.assert_allclose([left, right], [8e-3, -8e-3], rtol=1e-5)
    assert abs(node) < 1e-15


def test_energies_follow_the_papers_sums() -> None:
    x = np.array([0.0, 2.0, 5.0])
    moving = still(x, velocity=np.array([[[0.0, 0.0], [3.0, 4.0], [0.0, 2.0]]]))
    assert ancf.energy(CABLE, moving).kinetic[0] == pytest.approx(RHO_A / 2.0 * (25.0 + 1.5 * 29.0))
    bent = still(x, curvature=np.array([[0.1, -0.2, 0.0]]))
    assert ancf.energy(CABLE, bent).strain[0] == pytest.approx(EI / 2.0 * (0.05 + 1.5 * 0.04))
    loaded = still(x, loads=np.array([[-50.0, 10.0]]), load_displacement=np.array([[-0.02, 0.01]]))
    assert ancf.energy(CABLE, loaded).external[0] == pytest.approx(-(1.0 + 0.1))
    assert ancf.energy(CABLE, loaded).total[0] == pytest.approx(-1.1)


def test_the_joint_starts_on_the_element_below_the_slider() -> None:
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items = add_sliding_cable(mbs, CABLE, s=1.7)
    marker = mbs.GetObject(items.oJoint)["markerNumbers"][1]
    assert int(mbs.GetMarker(int(marker))["bodyNumber"]) == int(items.oElements[3])


def test_oscillates_about_the_static_deflection() -> None:
    """Under a sudden load the undamped cable swings from zero to about twice the static tip deflection."""
    excitation = driven(Constant(amount=2.5), Constant(amount=-50.0), TimeStepping(0.7, 1e-3))
    motion = ancf.simulate(CABLE, AT_THE_TIP, excitation, X)
    assert motion.displacement[:, -1].min() == pytest.approx(2.0 * TIP_DEFLECTION[2.5], rel=0.1)
    np.testing.assert_allclose(motion.load_displacement[:, 0], motion.displacement[:, -1], rtol=1e-12)


@pytest.mark.parametrize("at", [1.3, LENGTH])
def test_moves_as_the_linear_beam_does(full: FullBody, at: float) -> None:
    """A load anywhere on the beam, and a slider that passes from element to element."""
    stepping, path = TimeStepping(0.6, 1e-3), Ramp(times=(0.0, 0.6), values=(2.0, 3.3))
    load = SmoothRamp(times=(0.0, 0.2), values=(0.0, 20.0))
    excitation = driven(path, load, stepping)
    motion = ancf.simulate(replace(CABLE, elements=20), {"F": at}, excitation, X)
    beam = one_body.in_exudyn(replace(full, B=full.rows.rows[2].at(at).T.toarray()), excitation)
    assert nrms_error(motion.displacement, beam.q @ full.outputs.T) < 0.005
    assert nrms_error(motion.velocity[:, :, 1], beam.v @ full.outputs.T) < 0.02
    assert nrms_error(motion.slider_force[:, None], beam.multipliers[:, 2:]) < 0.05


def test_an_unloaded_cable_stays_still_while_the_slider_moves() -> None:
    path = Ramp(times=(0.0, 0.1), values=(1.9, 2.4))
    motion = ancf.simulate(CABLE, {}, driven(path, [], TimeStepping(0.1, 1e-3)), X)
    assert np.abs(motion.velocity).max() < 1e-6  # round-off of EA / h
    np.testing.assert_allclose(motion.s[[0, -1]], [1.9, 2.4])


def test_the_cable_passes_through_the_slider() -> None:
    path = SmoothRamp(times=(0.0, 0.2), values=(1.5, 2.5))
    excitation = driven(path, Constant(amount=-50.0), TimeStepping(0.2, 1e-3))
    motion = ancf.simulate(CABLE, AT_THE_TIP, excitation, np.array([1.5, 2.5]))
    assert abs(motion.displacement[0, 0]) < 1e-12
    assert abs(motion.displacement[-1, 1]) < 1e-6 < abs(motion.displacement[-1, 0])


@pytest.mark.parametrize(
    ("path", "at", "x", "key"), [(6.0, 5.0, 5.0, "slider.path"), (2.0, 5.1, 5.0, "loads.at"), (2.0, 5.0, -0.1, "x")]
)
def test_what_leaves_the_cable_is_refused(path: float, at: float, x: float, key: str) -> None:
    excitation = driven(Constant(amount=path), Constant(amount=1.0), TimeStepping(0.1, 1e-3))
    with pytest.raises(InputError) as error:
        ancf.simulate(CABLE, {"F": at}, excitation, np.array([x]))
    assert error.value.key == key


def test_failures_name_time_and_place() -> None:
    excitation = driven(Constant(amount=2.0), Step(time=0.05, after=1e300), TimeStepping(0.1, 1e-3))
    with pytest.raises(SimulationError, match=r"t = 0\.05 s, slider at 2 m"):
        ancf.simulate(CABLE, AT_THE_TIP, excitation, X)


def test_nothing_is_printed_or_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    ancf.simulate(CABLE, {}, driven(Constant(amount=2.0), [], TimeStepping(0.01, 1e-3)), X)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")
