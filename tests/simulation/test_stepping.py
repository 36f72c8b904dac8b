"""Time grids, signals and words for steps that fail; starts that satisfy rigid rows."""

from dataclasses import replace

import numpy as np
import pytest
from nested import Nested, full
from oracle import project, started

from pmr import InputError
from pmr.errors import BEYOND_ENDS
from pmr.files.arrays import Array
from pmr.scene.signals import Constant, Ramp, Sine, SmoothRamp, Sum
from pmr.simulation import Excitation, InitialState, TimeStepping
from pmr.simulation.excitation import clip_path
from pmr.simulation.start import complete_states, consistent_start, describe_divergence
from pmr.system.assembly import Assembly
from pmr.system.body import FullBody, SlidingBody
from pmr.system.contacts import Contact, Place
from pmr.system.rows import Rows


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ((1.0, 0.3), "time.step"),
        ((1.0, 0.0), "time.step"),
        ((1.0, 2.0), "time.step"),
        ((1.0, 0.1, 1.5), "time.rho_inf"),
    ],
)
def test_what_is_no_time_grid_is_refused(values: tuple[float, ...], key: str) -> None:
    with pytest.raises(InputError) as error:
        TimeStepping(*values)
    assert error.value.key == key


def test_forces_that_do_not_converge_are_named() -> None:
    """Those of terms, and friction by the sections that slide; nothing is said of buckling."""
    pads = [Contact(f"pad {k}", Place("fly", "w", 0.0), Place("base", "w", 1.0), friction=0.3) for k in range(2)]
    for terms, contacts, names in (
        (("axial", "spin"), (), "axial, spin"),
        ((), pads, "friction of fly"),
        (("axial",), pads, "axial, friction of fly"),
    ):
        said = describe_divergence(terms, contacts)
        assert said.startswith(f"the forces of {names} do not converge") and "buckl" not in said


STEPPING = TimeStepping(0.4, 1e-3)

PATHS = {"boom": Sine(amplitude=0.5, frequency=1.5, offset=2.0), "jib": Ramp(times=(0.1, 0.3), values=(1.0, 2.0))}

LOADS = {"F": Constant(amount=2.0), "T": Ramp(times=(0.0, 1.0), values=(0.0, 1.0))}


def test_paths_are_sampled_with_their_rates() -> None:
    found = Excitation(PATHS, LOADS, STEPPING)
    t, omega = STEPPING.times, 3.0 * np.pi
    np.testing.assert_allclose(found.s[:, 0], 2.0 + 0.5 * np.sin(omega * t), atol=1e-14)
    np.testing.assert_allclose(found.rates[:, 0], 0.5 * omega * np.cos(omega * t), atol=1e-12)
    assert found.s is found.s  # sampled once


@pytest.mark.parametrize("names", [["F"], ["F", "T", "G"], ["F", "G"]])
def test_a_load_without_an_input_and_an_input_without_a_load_are_refused(names: list[str]) -> None:
    with pytest.raises(InputError, match=f"loads: F, T given, one for each input is allowed: {', '.join(names)}"):
        Excitation(PATHS, LOADS, STEPPING).forces(names)


def test_several_paths_are_no_single_one() -> None:
    with pytest.raises(InputError, match=r"slider\.path: 2 given \(boom, jib\), one path"):
        _ = Excitation(PATHS, LOADS, STEPPING).path
    found = Excitation({"jib": PATHS["jib"]}, LOADS, STEPPING)
    np.testing.assert_array_equal(found.path_within((0.0, 3.0)), found.s[:, 0])
    np.testing.assert_array_equal(found.path_rate, found.rates[:, 0])


def test_another_time_grid_is_sampled_anew() -> None:
    whole = Excitation(PATHS, LOADS, STEPPING)
    fine = whole.with_stepping(STEPPING.divide(4))
    np.testing.assert_allclose(fine.s[::4], whole.s, rtol=0.0, atol=1e-14)
    assert whole.with_stepping(STEPPING) is whole


def test_path_outside_its_domain_is_refused_with_the_time() -> None:
    path, t = Ramp(times=(0.0, 1.0), values=(1.0, 3.0)), np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(clip_path(path, path.value(t), (0.0, 5.0), t), 1.0 + 2.0 * t)
    with pytest.raises(InputError, match=r"slider\.path = 2\.6: 0 to 2\.5 m is allowed; left at t = 0\.8 s"):
        clip_path(path, path.value(t), (0.0, 2.5), t)


def test_a_path_that_leaves_between_two_steps_is_refused() -> None:
    path = SmoothRamp(times=(0.0, 0.05, 0.1), values=(1.0, 2.6, 1.0))
    with pytest.raises(InputError, match="left between two steps"):
        clip_path(path, path.value(np.array([0.0, 0.1])), (0.0, 2.5), np.array([0.0, 0.1]))


@pytest.mark.parametrize("beyond", [1e-12, 0.9 * BEYOND_ENDS * 5.0])
def test_what_a_measured_path_lies_beyond_the_end_is_cut_off(beyond: float) -> None:
    path = Constant(amount=5.0 + beyond)
    np.testing.assert_array_equal(clip_path(path, path.value(np.zeros(1)), (0.0, 5.0), np.zeros(1)), [5.0])


@pytest.mark.slow
def test_a_path_stays_within_its_own_bounds() -> None:
    """Whose model is made for it: of a sum of tones no sample need lie on a crest."""
    tones = [Sine(amplitude=0.7 / k, frequency=0.0231 * k**1.5, phase=0.3 * k) for k in range(1, 6)]
    path, t = Sum(terms=(Constant(amount=3.0), *tones)), np.linspace(0.0, 60.0, 60_001)
    s, bounds = path.value(t), path.bounds(0.0, 60.0)
    assert clip_path(path, s, bounds, t) == pytest.approx(s, rel=0.0, abs=1e-12)


S, S_RATE = 2.1, 1.7  # m, m/s


@pytest.fixture(params=["sparse", "dense"])
def body(rich: FullBody, request: pytest.FixtureRequest) -> SlidingBody:
    return rich if request.param == "sparse" else project(rich, np.eye(rich.size)[:, 2:])


def rows_at(body: SlidingBody, derivative: int = 0) -> Array:
    return np.asarray(body.C(S, derivative) @ np.eye(body.size))


def any_state(body: SlidingBody) -> InitialState:
    """On the rows, with a velocity that is not."""
    random = np.random.default_rng(1)
    q, v = random.standard_normal((2, body.size))
    C = rows_at(body)
    return InitialState(q - np.linalg.pinv(C) @ (C @ q), v)


def test_velocity_is_corrected_by_an_impulse_of_the_rows(body: SlidingBody) -> None:
    initial = any_state(body)
    start = started(body, S, S_RATE, initial)
    C, C_s = rows_at(body), rows_at(body, 1)
    np.testing.assert_allclose(C @ start.v, -S_RATE * C_s @ initial.q, atol=1e-12)
    np.testing.assert_array_equal(start.q, initial.q)
    impulse = body.M @ (start.v - initial.v)  # least kinetic energy: M dv lies in the range of C^T
    np.testing.assert_allclose(C.T @ np.linalg.lstsq(C.T, impulse, rcond=None)[0], impulse, atol=1e-12)


def test_a_consistent_velocity_is_kept(body: SlidingBody) -> None:
    once = started(body, S, S_RATE, any_state(body))
    np.testing.assert_array_equal(started(body, S, S_RATE, once).v, once.v)


def test_a_position_off_the_rows_is_refused_by_name(body: SlidingBody) -> None:
    initial = any_state(body)
    off = initial.q + 1e-3 * np.linalg.pinv(rows_at(body))[:, -1]
    with pytest.raises(InputError, match=r"row 'slider 0\.8' is violated by 0\.001"):
        started(body, S, S_RATE, InitialState(off, initial.v))


@pytest.mark.parametrize("wrong", [np.zeros(3), np.full(21, np.nan)])
def test_wrong_vectors_are_refused(rich: FullBody, wrong: Array) -> None:
    with pytest.raises(InputError, match="21 finite values are allowed"):
        started(rich, S, S_RATE, InitialState(np.zeros(21), wrong))


def test_a_state_for_no_body_of_the_system_is_refused() -> None:
    """A misspelt name would otherwise leave its body at rest."""
    with pytest.raises(InputError, match="initial state: flj: one of the bodies is allowed: base, fly"):
        complete_states({"base": 3, "fly": 2}, {"flj": InitialState.at_rest(2)})


def test_contradicting_rows_are_refused(rich: FullBody) -> None:
    slider = rich.rows.rows[2]
    other = replace(slider, name="again", coefficients=2.0 * slider.coefficients)
    twice = replace(rich, rows=Rows((*rich.rows.rows, other), 21))
    with pytest.raises(InputError, match="depend on each other"):
        started(twice, S, S_RATE, any_state(rich))


def test_velocities_of_a_boom_are_corrected_on_all_its_rigid_contacts() -> None:
    """Of both bodies at once, with the least kinetic energy, while the inner one moves out."""
    system = full(Nested(2, elements=6, compliance=0.0))
    a, x, x_rate = Assembly(system), system.side_coordinates({"1": 2.0}), np.array([0.0, S_RATE, -S_RATE, 0.0])
    rows, rates = a.contact_rows(x).C, a.row_rates(x, x_rate)
    np.testing.assert_allclose(
        rates, (a.contact_rows(x + 1e-6 * x_rate).C - a.contact_rows(x - 1e-6 * x_rate).C) / 2e-6, atol=1e-5
    )
    q, v = np.random.default_rng(2).standard_normal((2, a.size))
    q -= np.linalg.pinv(rows) @ (rows @ q)
    initial = {}
    for name, body in system.bodies.items():
        state = InitialState.at_rest(body.size)
        state.q[a.free_coordinates[name]], state.v[a.free_coordinates[name]] = (
            q[a.coordinate_slices[name]],
            v[a.coordinate_slices[name]],
        )
        initial[name] = state
    found = consistent_start(a, x, x_rate, initial)
    after = np.concatenate([found[name].v[a.free_coordinates[name]] for name in system.bodies])
    assert np.abs(rows @ after + rates @ q).max() < 1e-9 * np.abs(rates @ q).max()
    impulse = a.M @ (after - v)
    residual = rows.T @ np.linalg.lstsq(rows.T, impulse, rcond=None)[0] - impulse
    assert np.abs(residual).max() < 1e-9 * np.abs(impulse).max()
