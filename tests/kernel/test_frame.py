"""A frame that is raised, slewed and shaken: loads and terms as `pmr.simulation.moving` finds them."""

import driven_frame
import numpy as np
import pytest
from kernels import kernel_of
from nested import Nested, reduced
from shaken_crane import RHO, STEP, shaken_crane

from pmr import InputError, System
from pmr.kernel.kernel import Kernel
from pmr.kernel.state import Settings, State
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.simulation.moving import MovingFrame


@pytest.fixture(scope="module")
def system() -> System:
    return shaken_crane()[0]


@pytest.fixture(scope="module")
def frame() -> MovingFrame:
    return shaken_crane()[1]


@pytest.fixture(scope="module")
def kernel(system: System, frame: MovingFrame) -> Kernel:
    return Kernel.of(system, {name: modal_form(body) for name, body in system.bodies.items()}, frame)


@pytest.mark.slow
def test_loads_and_terms_follow_from_any_motion(frame: MovingFrame, kernel: Kernel) -> None:
    assert kernel.names("motions") == frame.drivers and kernel.motions == len(frame.drivers)
    rng = np.random.default_rng(2)
    for _ in range(40):
        motions = rng.uniform(0.5, 2.0, (3, kernel.motions)) * rng.choice([-1.0, 1.0], (3, kernel.motions))
        motions[0, : kernel.paths] = np.abs(motions[0, : kernel.paths])
        u, (f, c) = kernel.frame_drivers(motions), driven_frame.find(frame, motions)
        order = [frame.drivers.index(name) for name in kernel.names("drivers")[: kernel.paths]]
        np.testing.assert_array_equal(u[: kernel.paths], motions[0, order])
        for found, expected in (
            (u[kernel.paths : kernel.paths + kernel.inputs], f),
            (u[kernel.paths + kernel.inputs :], c),
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@pytest.mark.slow
def test_motions_between_the_ends_of_a_step_are_followed_as_far_as_they_count(
    frame: MovingFrame, kernel: Kernel
) -> None:
    """In four parts, beside four steps to where lines or cubics stand between."""
    excitation = Excitation.from_scene(frame.scene).with_stepping(
        TimeStepping(frame.scene.time.end, STEP, RHO, parts=1)
    )
    for count in (1, 2, 3):
        whole, fine = State(kernel, Settings(STEP, RHO, parts=(4,))), State(kernel, Settings(STEP / 4.0, RHO))
        rows = np.full(kernel.motions, count, np.int32)
        begun = frame.motions(excitation, 0.0)
        for state in (whole, fine):
            state.start_in_frame("equilibrium", begun, rows)
        for number in range(1, 4):
            ended = frame.motions(excitation, STEP * number)
            whole.step_in_frame(ended, rows)
            for part in range(1, 5):
                fine.step_in_frame(_between(begun, ended, count, part / 4.0), rows)
            begun = ended
            np.testing.assert_allclose(whole.z, fine.z, rtol=0.0, atol=1e-10 * np.abs(fine.z).max())


def _between(begun: np.ndarray, ended: np.ndarray, count: int, share: float) -> np.ndarray:
    """The polynomial through what counts at both ends, from a linear system."""
    h, at = STEP, {1: (0,), 2: (0, 1), 3: (0, 2)}[count]
    powers = np.arange(2 * len(at))

    def row(order: int, t: float) -> np.ndarray:
        factors = [np.prod(np.arange(p - order + 1, p + 1)) if p >= order else 0.0 for p in powers]
        return np.array([f * t ** max(p - order, 0) for f, p in zip(factors, powers, strict=True)])

    A = np.array([row(order, t) for t in (0.0, h) for order in at])
    b = np.array([motions[order] for motions in (begun, ended) for order in at])
    c = np.linalg.solve(A, b)
    if share == 1.0:
        return ended
    return np.array([row(order, share * h) @ c for order in range(3)])


def test_a_system_without_a_frame_has_no_motions() -> None:
    plain, _ = kernel_of(reduced(Nested(2, elements=8), 3))
    with pytest.raises(InputError, match="frame"):
        plain.frame_drivers(np.zeros((3, 4)))
