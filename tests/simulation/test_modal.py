"""Modal form: the decomposition, and what it makes of damping.
What signals do between two steps: said where it matters, and nothing said where the steps follow.
"""

from dataclasses import replace

import numpy as np
import one_body
import pytest
import scipy.linalg
from driving import driven
from oracle import couples_modes, flexible, full_body, project

from pmr import InputError
from pmr.scene.signals import Chirp, Constant, Ramp, Signal, Sine, SmoothRamp, Step, Sum, Table
from pmr.simulation import TimeStepping, modal
from pmr.simulation.excitation import clip_path
from pmr.simulation.modal import diagonalise, modal_form
from pmr.simulation.stepping import STEPS_A_PERIOD, UNSEEN, describe_lost_features, describe_overshoots, is_aliased
from pmr.system.body import FullBody

EXTENDED = np.finfo(np.longdouble).eps < 1e-18
U = np.finfo(float).eps / 2.0
needs_extended = pytest.mark.skipif(not EXTENDED, reason="no precision beyond double here")


def test_modes_of_a_fine_beam_are_sharp_from_the_rigid_ones_to_the_highest(full: FullBody) -> None:
    """As sharp as modes in double precision can be, whatever LAPACK they came from.

    Rounding their entries, |dX| <= u |X|, changes X^T A X by 2 u |X|^T |A| |X| at most; a product in double precision
    of n terms adds n u to each factor where there is no longer one.  Of K, which is rounded itself, three entries that
    are added leave a rigid motion 4 u |x|^T |K| |x| of stiffness.
    """
    M, K = full.M.toarray(), full.K.toarray()
    omega2, X = diagonalise(M, K)
    u = U if EXTENDED else len(M) * U
    size_M, size_K = (np.abs(X).T @ np.abs(A) @ np.abs(X) for A in (M, K))
    assert np.abs(product(X, M) - np.eye(len(M))).max() <= 2.0 * u * size_M.max()
    scale = np.sqrt(np.outer(omega2 + 100.0, omega2 + 100.0))
    assert (np.abs(product(X, K) - np.diag(omega2)) / scale).max() <= 2.0 * u * (size_K / scale).max()
    assert np.all(np.abs(omega2[:3]) <= 4.0 * u * np.diagonal(size_K)[:3])
    assert np.all(np.diff(omega2) >= 0.0)


def product(X: np.ndarray, A: np.ndarray) -> np.ndarray:
    """X^T A X in the longest precision there is."""
    X, A = X.astype(np.longdouble), A.astype(np.longdouble)
    return np.asarray(X.T @ (A @ X), float)


@needs_extended
def test_products_have_the_digits_of_longer_numbers() -> None:
    """Integers whose products and sums no double holds, but a longer number does, in rows of any size: exact."""
    random, n = np.random.default_rng(5), 2 * modal.SMALL
    A, B = random.integers(-(2**26), 2**26, (2, n, n))
    sizes = 2.0 ** random.integers(-30, 30, (n, 1))
    found = modal.product(sizes * A.astype(np.longdouble), B.astype(np.longdouble))
    assert np.array_equal(found, sizes * (A @ B).astype(np.longdouble))
    assert not np.array_equal(found, sizes * (A.astype(float) @ B.astype(float)))


@needs_extended
def test_low_eigenvalues_beside_high_ones_lose_no_digits() -> None:
    """Of an integer matrix: H diag(4^k) H, H Hadamard's of 16 columns, which are its eigenvectors; values 16 4^k.

    LAPACK alone leaves some eps of the largest one, 4^15, in all of them: 1e-7 of the lowest. Products in extended
    precision leave 32 2^-64 |x|^T |K| |x|, and |K| is at most twice its largest eigenvalue.
    """
    exact = 4.0 ** np.arange(16)
    H = scipy.linalg.hadamard(16).astype(float)
    omega2, _ = diagonalise(np.eye(16), H @ np.diag(exact) @ H)
    assert np.all(np.abs(omega2 / 16.0 - exact) <= 64 * 2.0**-64 * 16 * exact[-1] + U * exact)


@needs_extended
def test_modes_that_are_turned_stay_orthonormal() -> None:
    """By 5e-4 in one correction: to first order X^T X would be 3e-7 off; exp(A) to second order leaves A^4 / 4."""
    angle = 5e-4
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    M, K = np.eye(2, dtype=np.longdouble), np.diag([1.0, 4.0]).astype(np.longdouble)
    _, X = modal._refine_modes(M, K, turned)
    assert np.abs(X.T @ X - np.eye(2)).max() <= angle**4 / 4.0 + 4.0 * U
    assert np.abs(X - np.eye(2)).max() <= angle**2


def test_a_multiple_eigenvalue_keeps_its_space() -> None:
    random = np.random.default_rng(0)
    Q = np.linalg.qr(random.standard_normal((6, 6)))[0]
    L = np.tril(random.standard_normal((6, 6))) + 4.0 * np.eye(6)
    expected = np.array([0.0, 0.0, 2.0, 2.0, 2.0, 1e6])
    omega2, X = diagonalise(L @ L.T, L @ Q @ np.diag(expected) @ Q.T @ L.T)
    np.testing.assert_allclose(omega2, expected, atol=1e-9)
    np.testing.assert_allclose(X.T @ (L @ L.T) @ X, np.eye(6), atol=1e-13)


def test_the_form_is_the_body(rich: FullBody) -> None:
    form = modal_form(rich)
    assert form.rows == (2, 3) and form.body.row_names == ("slider 0", "slider 0.8")
    z = np.random.default_rng(1).standard_normal(form.body.size)
    q = form.X @ z
    assert not q[:2].any()  # the pin
    np.testing.assert_allclose(form.inverse @ q, z, atol=1e-13)
    np.testing.assert_allclose(form.body.C(2.3) @ z, (rich.C(2.3) @ q)[2:], rtol=1e-12)
    np.testing.assert_allclose(form.body.outputs @ z, rich.outputs @ q, atol=1e-13)
    np.testing.assert_allclose(z @ form.body.D @ z, q @ (rich.D @ q), rtol=1e-12)
    np.testing.assert_allclose(form.body.B.T @ z, rich.B.T @ q, rtol=1e-12)


def test_rayleigh_and_modal_damping_stay_in_the_diagonal(rich: FullBody) -> None:
    assert not couples_modes(modal_form(rich))
    np.testing.assert_allclose(np.diagonal(modal_form(rich).body.D), 0.4 + 2e-4 * modal_form(rich).omega2)
    body = project(full_body(elements=8), np.eye(27)[:, 2:])
    omega2, X = diagonalise(body.M, body.K)
    ratios = np.linspace(0.01, 0.2, body.size)
    D = body.M @ X @ np.diag(2.0 * ratios * np.sqrt(np.abs(omega2))) @ X.T @ body.M
    form = modal_form(replace(body, D=D))
    assert not couples_modes(form)
    np.testing.assert_allclose(np.diagonal(form.body.D)[1:], 2.0 * ratios[1:] * np.sqrt(omega2[1:]), rtol=1e-8)


def test_a_damper_at_one_point_couples_modes_however_stiff_the_beam(full: FullBody) -> None:
    D = 1e-6 * full.K.toarray()
    D[-2, -2] += 1.0
    assert couples_modes(modal_form(replace(full, D=type(full.D)(D))))


def test_what_cannot_be_diagonalised_is_refused(rich: FullBody, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="body: M: a mass matrix that is positive definite"):
        modal_form(replace(rich, M=-rich.M))
    monkeypatch.setattr(modal, "LARGEST", 20)
    with pytest.raises(InputError, match="21 coordinates, up to 20 are diagonalised"):
        modal_form(rich)


@pytest.mark.parametrize(("share", "coupled"), [(1e-9, False), (1e-6, True)])
def test_what_round_off_leaves_of_modes_is_no_coupling(share: float, coupled: bool) -> None:
    """Modes of a solid of 20,000 coordinates leave 6e-10."""
    body = project(full_body(elements=8), np.eye(27)[:, 2:])
    omega2, X = diagonalise(body.M, body.K)
    damping = 1.0 + 1e-4 * omega2
    coupling = share * np.sqrt(np.outer(damping, damping))
    back = np.linalg.inv(X)
    damped = replace(body, D=back.T @ (np.diag(damping) + coupling) @ back)
    assert couples_modes(modal_form(damped)) is coupled


STEPPING = TimeStepping(1.0, 1e-3)
SLOW = Ramp(times=(0.0, 1.0), values=(0.0, 100.0))

FOLLOWED = [
    Constant(amount=3.0),
    Sine(amplitude=1.0, frequency=100.0),
    Sine(amplitude=0.0, frequency=1e6),
    Chirp(amplitude=1.0, times=(0.0, 1.0), frequencies=(1.0, 140.0)),
    Chirp(amplitude=1.0, times=(1.5, 2.5), frequencies=(1.0, 1000.0)),  # fast only after the end
    Step(time=0.5005, after=1.0),  # seen at most a step late
    Step(time=0.3, after=1.0),
    Ramp(times=(0.1, 0.1015, 0.2), values=(0.0, 1.0, 1.0)),
    SmoothRamp(times=(0.1, 0.11, 0.12), values=(0.0, 1.0, 0.0)),
    Table(times=tuple(np.linspace(0.0, 1.0, 1001)), values=tuple(np.cos(np.arange(1001.0)))),
]
LOST = {
    "1000 Hz stands still at steps of 0.001 s; steps of 0.00014 s": Sine(amplitude=1.0, frequency=1000.0, phase=1.0),
    "999 Hz looks like 1 Hz": Sine(amplitude=1.0, frequency=999.0),
    "1300 Hz looks like 300 Hz": Chirp(amplitude=1.0, times=(0.0, 0.5), frequencies=(1.0, 1300.0)),
    "200 Hz has 5 steps": Sine(amplitude=1.0, frequency=200.0),
    "about t = 0.5005 s": Ramp(times=(0.5001, 0.5005, 0.5009), values=(0.0, 1.0, 0.0)),
    "about t = 0.4002 s": Sum(terms=(Step(time=0.4002, after=3.0), Step(time=0.4004, after=-3.0))),
    "passes between two": Table(times=tuple(np.linspace(0.0, 1.0, 4001)), values=tuple(np.sin(np.arange(4001.0)))),
}  # fmt: skip


@pytest.mark.parametrize("signal", FOLLOWED, ids=lambda signal: signal.kind)
def test_what_the_steps_follow_is_not_warned_of(signal: Signal) -> None:
    assert describe_lost_features([("F", signal)], STEPPING) == []


@pytest.mark.parametrize(("said", "signal"), LOST.items())
def test_what_is_lost_between_the_steps_is_said(said: str, signal: Signal) -> None:
    (line,) = describe_lost_features([("still", Constant(amount=1.0)), ("load F", signal)], STEPPING)
    assert line.startswith("load F: ") and said in line


def test_a_small_fast_part_of_a_large_slow_signal_is_seen() -> None:
    both = Sum(terms=(SLOW, Sine(amplitude=0.01, frequency=2000.0)))
    (line,) = describe_lost_features([("F", both)], STEPPING)
    assert "2000 Hz stands still" in line and is_aliased(both, STEPPING) and not is_aliased(SLOW, STEPPING)


@pytest.mark.parametrize("frequency", [499.0, 513.0, 870.0, 1300.0])
def test_the_step_that_is_said_to_follow_does(frequency: float) -> None:
    tone = Sine(amplitude=1.0, frequency=frequency)
    (line,) = describe_lost_features([("F", tone)], STEPPING)
    step = float(line.split("steps of ")[-1].split(" s or less")[0])
    assert describe_lost_features([("F", tone)], TimeStepping(1.0, 1.0 / np.ceil(1.0 / step))) == []


def test_the_fewest_steps_a_period_keep_to_the_share() -> None:
    assert (1.0 - np.cos(np.pi / STEPS_A_PERIOD)) / 2.0 < UNSEEN < (1.0 - np.cos(np.pi / (STEPS_A_PERIOD - 1))) / 2.0


@pytest.mark.parametrize("frequency", [1e5, 5e2, 1e9])
def test_a_path_that_leaves_the_beam_between_the_steps_is_refused(frequency: float) -> None:
    path = Sine(amplitude=10.0, frequency=frequency, offset=2.5)
    domain, inside = (0.0, 5.0), path.model_copy(update={"amplitude": 2.0})
    assert clip_path(inside, inside.value(STEPPING.times), domain, STEPPING.times) == pytest.approx(2.5, abs=1e-3)
    with pytest.raises(InputError, match="left between two steps"):
        clip_path(path, path.value(STEPPING.times), domain, STEPPING.times)
    model = flexible(full_body(10), 4)
    with pytest.raises(InputError, match="left between two steps"):
        one_body.simulate(model, driven(path, Constant(amount=1.0), STEPPING))


#: Flat, then two rows on either side of a top that no row holds.
TURNING = Table(times=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0), values=(0.0, 0.3, 1.0, 1.0, 0.3, 0.0))


def test_a_table_whose_curve_leaves_its_values_is_told_with_the_amount() -> None:
    high = float(TURNING.value(np.linspace(0.0, 1.0, 10_001)).max())
    assert high - 1.0 > UNSEEN
    for signal in (TURNING, Sum(terms=(Constant(amount=3.0), TURNING))):
        (line,) = describe_overshoots([("load F", signal)], STEPPING)
        assert line.startswith(f"load F: the curve through its table (akima) goes from 0 to {high:.4g}")
        assert f" {100.0 * (high - 1.0):.2g} % of the table's range" in line
    straight = TURNING.model_copy(update={"interpolation": "linear"})
    assert describe_overshoots([("load F", straight), ("load G", Constant(amount=1.0))], STEPPING) == []
    assert describe_overshoots([("load F", TURNING)], TimeStepping(0.4, 1e-3)) == []  # nothing of that is reached


def test_a_table_with_rows_where_it_turns_keeps_to_them() -> None:
    t = np.linspace(0.0, 1.0, 51)
    fine = Table(times=tuple(t), values=tuple(np.sin(2.0 * np.pi * t)))
    assert describe_overshoots([("load F", fine)], STEPPING) == []
