"""The full-order reference against an integrator of the test's own, against march, and against itself."""

from dataclasses import replace

import numpy as np
import one_body
import pytest
import scipy.sparse as sp
from distributed import distributed
from driving import driven, loads_at
from one_body import respond as responded
from oracle import CASES, full_body, generalized_alpha, rich_body, started
from petsc_alone import observe
from processes import resident

from pmr import InputError, SimulationError, System
from pmr.fem.compat import MPI
from pmr.files.arrays import Array
from pmr.scene.signals import Chirp, Constant, Ramp, Sine, SmoothRamp, Step
from pmr.simulation import InitialState, TimeStepping, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.petsc import integrate
from pmr.system.body import FullBody
from pmr.system.body_matrices import Rayleigh
from pmr.system.rows import Rows

PATH = Sine(amplitude=0.7, frequency=4.0, offset=2.0)
LOADS = (
    Chirp(amplitude=300.0, times=(0.0, 0.2), frequencies=(3.0, 20.0), phase=1.0),
    Step(time=0.02, before=50.0, after=-400.0),
)
STEPPING = TimeStepping(end=0.06, step=1e-3, rho_inf=0.8)


@pytest.fixture(scope="module")
def rich() -> FullBody:
    """Damping, two sliders and two inputs."""
    return rich_body()


def with_pads(body: FullBody, *compliance: float) -> FullBody:
    rows = tuple(replace(row, compliance=c) for row, c in zip(body.rows.rows, compliance, strict=True))
    return replace(body, rows=Rows(rows, body.size))


#: Compliance of the two supports and the two sliders, in m/N.
PADS = {"rigid": (0.0, 0.0, 0.0, 0.0), "one gives way": (0.0, 0.0, 0.0, 1e-6), "all": (1e-9, 1e-9, 1e-6, 2e-5)}


def some_state(body: FullBody) -> InitialState:
    """Positions that satisfy the rigid rows and load the pads, velocities that violate them."""
    q, v = np.random.default_rng(1).standard_normal((2, body.size)) * [[1e-3], [1e-2]]
    C = body.C(float(PATH.value(0.0))).toarray()[body.row_compliance == 0.0]
    return InitialState(q - np.linalg.pinv(C) @ (C @ q), v)


def assert_close(found: Array, expected: Array, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())


@pytest.mark.mpi
@pytest.mark.parametrize("memory", [2**30, 0], ids=["answers kept", "two solves"])
@pytest.mark.parametrize("pads", PADS)
def test_same_as_an_integrator_written_for_the_test(
    rich: FullBody, pads: str, memory: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two sliders, two inputs that act from the start, Rayleigh damping, a velocity that must be corrected."""
    monkeypatch.setattr(integrate, "STORED_BYTES", memory)
    body = with_pads(rich, *PADS[pads])
    found = observe(distributed(body), driven(PATH, LOADS, STEPPING), (), some_state(body))
    t = STEPPING.times
    start = started(body, float(PATH.value(0.0)), float(PATH.rate(0.0)), some_state(body))
    q, _, multipliers = generalized_alpha(body, PATH.value(t), loads_at(LOADS, t), STEPPING, start)
    assert_close(found.y, q @ body.outputs.T, 1e-11)
    assert_close(found.multipliers, multipliers, 1e-10)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.s, PATH.value(t))


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["none", "stiffness", "mass", "damper"])
def test_any_damping(rich: FullBody, kind: str) -> None:
    damper = sp.csr_matrix(([300.0], ([rich.size - 2], [rich.size - 2])), shape=rich.M.shape)
    D = {"none": 0.0 * rich.M, "stiffness": 3e-4 * rich.K, "mass": 0.7 * rich.M, "damper": rich.D + damper}[kind]
    body, t = replace(rich, D=D.tocsr()), STEPPING.times
    start = started(body, float(PATH.value(0.0)), float(PATH.rate(0.0)), some_state(body))
    found = observe(distributed(body), driven(PATH, LOADS, STEPPING), (), start)
    q, _, multipliers = generalized_alpha(body, PATH.value(t), loads_at(LOADS, t), STEPPING, start)
    assert_close(found.y, q @ body.outputs.T, 1e-11)
    assert_close(found.multipliers, multipliers, 1e-10)


@pytest.mark.mpi
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (40.0, 0.0), (0.0, 1e-3), (40.0, 1e-3)])
def test_damping_that_is_known_as_rayleighs_is_the_same_without_its_matrix(
    rich: FullBody, alpha: float, beta: float
) -> None:
    body = replace(rich, D=sp.csr_matrix(alpha * rich.M + beta * rich.K))
    plain = distributed(body)
    excitation, start = driven(PATH, LOADS, STEPPING), some_state(body)
    known, unknown = (
        observe(model, excitation, (), start) for model in (replace(plain, damping=Rayleigh(alpha, beta)), plain)
    )
    assert_close(known.y, unknown.y, 1e-9)
    assert_close(known.multipliers, unknown.multipliers, 1e-8)


@pytest.mark.mpi
@pytest.mark.parametrize("pads", PADS)
def test_the_response_is_that_of_the_whole_trajectory(rich: FullBody, pads: str) -> None:
    """Energies and residuals too, which march makes of all coordinates."""
    body, t = with_pads(rich, *PADS[pads]), STEPPING.times
    model = distributed(body)
    found = observe(model, driven(PATH, LOADS, STEPPING), (), some_state(body))
    trajectory = one_body.simulate(body, driven(PATH, LOADS, STEPPING), some_state(body))
    expected = responded(body, trajectory, PATH.rate(t), loads_at(LOADS, t))
    for name in ("kinetic", "strain", "external"):
        assert_close(getattr(found.energy, name), getattr(expected.energy, name), 1e-9)
    assert found.residual_position.max() < 1e-15
    if pads == "rigid":
        assert_close(found.residual_velocity, expected.residual_velocity, 1e-8)
    else:
        assert np.isnan(found.residual_velocity).all() and np.isnan(expected.residual_velocity).all()


@pytest.mark.mpi
@pytest.mark.parametrize("memory", [2**30, 0], ids=["answers kept", "two solves"])
def test_ranks_agree_with_one(rich: FullBody, memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrate, "STORED_BYTES", memory)
    alone, together = (
        observe(distributed(rich, comm), driven(PATH, LOADS, STEPPING), [0.03], some_state(rich))
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for name in ("y", "multipliers"):
        assert_close(getattr(together, name), getattr(alone, name), 1e-10)
    assert_close(together.energy.total, alone.energy.total, 1e-10)
    whole = np.concatenate(MPI.COMM_WORLD.allgather(together.states.q), axis=1)
    assert_close(whole, alone.states.q, 1e-10)


@pytest.mark.mpi
def test_steps_of_a_body_alone_in_the_parts_that_march_took(rich: FullBody) -> None:
    rows = tuple(
        replace(row, compliance=1e-6, clearance=1e-4) if row.held_coordinate is None else row for row in rich.rows.rows
    )
    body = replace(rich, rows=Rows(rows, rich.size))
    excitation = driven(PATH, LOADS, replace(STEPPING, end=0.15))
    expected = one_body.simulate(body, excitation)
    assert expected.parts is not None and len(set(expected.parts[1:])) > 2
    stepping = replace(excitation.stepping, schedule=tuple(expected.parts[1:].tolist()))
    found = observe(distributed(body), excitation.with_stepping(stepping))
    assert_close(found.y, expected.q @ body.outputs.T, 1e-7)
    assert_close(found.multipliers[:, 2:], expected.multipliers[:, 2:], 1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("parts", [0, 1])
def test_rows_that_only_push_as_march_has_them(rich: FullBody, parts: int) -> None:
    """They lift off and land; a step in one part, and in as many as the contact takes."""
    rows = tuple(
        replace(row, compliance=1e-6, clearance=1e-4) if row.held_coordinate is None else row for row in rich.rows.rows
    )
    body, excitation = (
        replace(rich, rows=Rows(rows, rich.size)),
        driven(PATH, LOADS, replace(STEPPING, end=0.15, parts=parts)),
    )
    omega = contact_frequency(System.of(body), excitation)
    same = replace(excitation.stepping, parts=contact_step.count_parts(omega, excitation.stepping))
    found = observe(distributed(body), excitation)
    expected = one_body.simulate(body, excitation.with_stepping(same))
    assert_close(found.y, expected.q @ body.outputs.T, 1e-9)
    forces = expected.multipliers[:, 2:]
    assert_close(found.multipliers[:, 2:], forces, 1e-8)
    changes = np.diff((forces > 0.0).astype(int), axis=0)
    assert (changes > 0).any() and (changes < 0).any() and np.all(forces >= 0.0)
    if parts == 0:
        assert found.peaks is not None and expected.peaks is not None
        assert_close(found.peaks[:, 2:], expected.peaks[:, 2:], 1e-8)
    assert found.surplus == pytest.approx(expected.surplus, abs=1e-9)
    assert found.residual_position.max() < 1e-15


@pytest.mark.slow
def test_the_papers_evolved_case_as_march_has_it() -> None:
    body, case, stepping = full_body(50), CASES["evolved"], TimeStepping(15.0, 4e-3, 0.9)
    found = observe(distributed(body, MPI.COMM_SELF), driven(case.path, case.load, stepping))
    expected = one_body.simulate(body, driven(case.path, case.load, stepping))
    assert np.abs(found.y - expected.q @ body.outputs.T).max() < 1e-9 < 4e-2 < np.abs(found.y).max()
    assert_close(found.multipliers, expected.multipliers, 1e-6)


def test_whole_states_are_kept_at_the_steps_next_to_the_times(rich: FullBody) -> None:
    model = distributed(rich, MPI.COMM_SELF)
    found = observe(model, driven(PATH, LOADS, STEPPING), [0.0123, 0.0])
    np.testing.assert_array_equal(found.s, PATH.value(found.t))
    assert found.states.q.shape == found.states.v.shape == (2, rich.size)
    np.testing.assert_allclose(found.states.t, [0.0, 0.012])
    np.testing.assert_array_equal(found.states.s[:, 0], PATH.value(found.states.t))
    assert_close(rich.outputs @ found.states.q[1], found.y[12], 1e-14)
    trajectory = one_body.simulate(rich, driven(PATH, LOADS, STEPPING))
    assert_close(found.states.v, trajectory.v[[0, 12]], 1e-10)


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize(("pads", "rho_inf"), [("rigid", 0.0), ("rigid", 0.8), ("one gives way", 0.5)])
def test_second_order_in_positions_and_multipliers(rich: FullBody, pads: str, rho_inf: float) -> None:
    """When h is halved; against march with h / 20."""
    body, end, h = with_pads(rich, *PADS[pads]), 0.2, 4e-4
    path, loads = SmoothRamp(times=(0.0, end), values=(1.7, 2.3)), [Sine(amplitude=100.0, frequency=2.0)] * 2
    exact = one_body.simulate(body, driven(path, loads, TimeStepping(end, h / 20, rho_inf)))
    model = distributed(body, MPI.COMM_SELF)
    errors = []
    for step, every in ((h, 20), (h / 2, 10)):
        found = observe(model, driven(path, loads, TimeStepping(end, step, rho_inf)))
        y, multipliers = exact.q[::every] @ body.outputs.T, exact.multipliers[::every]
        errors.append([np.abs(found.y - y).max(), np.abs(found.multipliers - multipliers).max()])
    assert np.divide(*errors) == pytest.approx([4.0, 4.0], abs=0.15)


def test_no_damping_no_loads_no_rows(rich: FullBody) -> None:
    """A free beam under a force: its mean accelerates by F / m."""
    body = replace(rich, D=0.0 * rich.D, rows=Rows((), rich.size))
    rigid = np.zeros(body.size)
    rigid[1::3] = 1.0
    mass = rigid @ (body.M @ rigid)
    loads = [Constant(amount=7.0), Constant(amount=0.0)]
    found = observe(distributed(body, MPI.COMM_SELF), driven(Constant(amount=0.0), loads, STEPPING), [0.06])
    assert rigid @ (body.M @ found.states.q[-1]) / mass == pytest.approx(7.0 / mass * 0.06**2 / 2.0, rel=1e-9)
    assert found.multipliers.shape == (61, 0) and np.all(found.residual_position == 0.0)


def test_progress_ends_with_everything(rich: FullBody) -> None:
    shares: list[float] = []
    observe(distributed(rich, MPI.COMM_SELF), driven(PATH, LOADS, STEPPING), progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0 and len(shares) == 60


def test_a_step_that_fails_is_named(rich: FullBody) -> None:
    model = distributed(rich, MPI.COMM_SELF)
    onto_the_pin = Ramp(times=(0.0, 0.02), values=(0.02, 0.0))
    said = r"step 20, t = 0.02 s, slider at 0 m: .* slider 0, pin y depend"
    with pytest.raises(SimulationError, match=said) as caught:
        observe(model, driven(onto_the_pin, LOADS, STEPPING))
    assert "0.8" not in str(caught.value)


@pytest.mark.mpi
def test_a_result_that_is_not_finite_is_named(rich: FullBody) -> None:
    huge = [Step(time=0.0105, before=0.0, after=1e308), Step(time=0.0105, before=0.0, after=-1e308)]
    stiff = replace(rich, B=1e3 * rich.B)
    with (
        np.errstate(over="ignore", invalid="ignore"),
        pytest.raises(SimulationError, match=r"step 11, t = 0.011 s.*not fin"),
    ):
        observe(distributed(stiff), driven(PATH, huge, STEPPING))


@pytest.mark.mpi
def test_what_cannot_be_is_refused(rich: FullBody) -> None:
    model = distributed(rich)
    for arguments, key in [
        ((driven(Constant(amount=9.0), LOADS, STEPPING),), "contacts.slider 0.place"),
        ((driven(PATH, LOADS[:1], STEPPING),), "loads"),
        ((driven(PATH, LOADS, TimeStepping(0.06, 1e-3, 1.0)),), "time.rho_inf"),
        ((driven(PATH, LOADS, STEPPING), [0.07]), "states"),
        ((driven(PATH, LOADS, STEPPING), (), InitialState(np.ones(rich.size), np.ones(rich.size))), "q"),
        ((driven(PATH, LOADS, STEPPING), (), InitialState(np.ones(3), np.ones(3))), "q"),
    ]:
        with pytest.raises(InputError) as caught:
            observe(model, *arguments)
        assert caught.value.key == key
    pushing = tuple(replace(row, compliance=0.0, clearance=0.0) for row in rich.rows.rows[2:])
    with pytest.raises(InputError, match=r"slider 0, slider 0\.8 only push and are rigid"):
        observe(distributed(replace(rich, rows=Rows(pushing, rich.size))), driven(PATH, LOADS, STEPPING))
    massless = distributed(replace(rich, M=0.0 * rich.M))
    with pytest.raises(InputError, match="positive definite"):
        observe(massless, driven(PATH, LOADS, STEPPING))


@pytest.mark.slow
def test_memory_does_not_grow_with_the_steps() -> None:
    """What a step leaves behind: with 4,000 coordinates and one vector a step 1,000 steps would keep 32 MB."""
    model, grown = distributed(full_body(2000)), []
    for _ in range(2):
        before = resident()
        observe(model, driven(Constant(amount=2.0), LOADS[:1], TimeStepping(end=1.0, step=1e-3)))
        grown.append(resident() - before)
    assert grown[1] < 16.0  # MiB; the first run also loads what all need
