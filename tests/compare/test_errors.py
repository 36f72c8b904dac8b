"""Errors between responses, energies, and recovered velocities against derivatives of the body's coordinates."""

from dataclasses import replace

import numpy as np
import on_pads
import one_body
import pytest
import scipy.sparse as sp
from driving import driven, loads_at
from on_pads import beam_on_pads, flexible_on_pads
from one_body import displacement, energy, respond
from oracle import enriched, paper_basis, project, rich_body
from scipy.interpolate import PPoly

from pmr import ReducedModel, Response, SimulationError
from pmr.compare.errors import (
    absolute_error,
    errors_between,
    largest_difference,
    observed_quantities,
    relative_error,
    zero_round_off,
)
from pmr.compare.motion import force_rates, load_rates, output_rates
from pmr.files.arrays import Array
from pmr.results import Energy
from pmr.scene.signals import Sine, SmoothRamp
from pmr.simulation import TimeStepping
from pmr.system.body import Trajectory

T = np.linspace(0.0, 1.0, 1001)
#: What is compared of a planar beam that is observed at its nodes, the last of which is its tip.
OF_NODES = observed_quantities(1, slice(None))


def test_an_error_is_the_mean_over_components_of_relative_rms() -> None:
    reference = np.stack([np.sin(2 * np.pi * T), 3.0 * np.cos(2 * np.pi * T)], axis=1)
    signal = reference * [1.01, 0.97]
    assert relative_error(signal, reference) == pytest.approx((0.01 + 0.03) / 2)
    assert relative_error(signal[:, 0], reference[:, 0]) == pytest.approx(0.01)


def test_components_that_do_not_move_are_left_out() -> None:
    reference = np.stack([np.sin(T), 1e-11 * np.ones_like(T)], axis=1)
    signal = reference + [[0.0, 1.0]]
    assert relative_error(signal, reference) == 0.0
    assert relative_error(signal[:, 1], reference[:, 1]) == pytest.approx(1e11)
    assert relative_error(reference[:, 1], reference[:, 1]) == 0.0


@pytest.mark.parametrize("size", [5e-324, 1e-300, 1e-12, 1e-5, 1.0, 1e5, 1e150, 1e300])
def test_an_error_does_not_depend_on_the_unit(size: float) -> None:
    """But for the smallest number there is, of which a percentage is none: it is off or it isn't."""
    reference = np.stack([0.0 * T, np.sin(9.0 * T), 0.1 * np.cos(7.0 * T)], axis=1)  # the first one is pinned
    signal = reference * [1.0, 1.25, 0.5]
    off = relative_error(size * signal, size * reference)
    assert off > 0.3 if size < 1e-310 else off == pytest.approx((0.25 + 0.5) / 2.0)
    assert relative_error(size * reference, size * reference) == 0.0
    assert relative_error(size * signal, 0.0 * reference) == 1.0
    assert relative_error(0.0 * reference, 0.0 * reference) == 0.0


def test_what_is_so_small_beside_the_rest_that_it_may_be_round_off_does_not_count() -> None:
    reference = np.stack([np.sin(9.0 * T), 0.9e-6 * np.sin(9.0 * T), 1.1e-6 * np.sin(9.0 * T)], axis=1)
    assert relative_error(reference * [1.0, 2.0, 1.1], reference) == pytest.approx(0.05)


@pytest.mark.parametrize("measure", [relative_error, absolute_error])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_no_error_of_zero(measure, wrong: float) -> None:
    reference = np.sin(9.0 * T)[:, None]
    broken = reference.copy()
    broken[-1] = wrong
    for pair in ((broken, reference), (reference, broken), (broken, broken)):
        with pytest.raises(SimulationError, match="not finite"):
            measure(*pair)


def test_norms_of_huge_differences_are_numbers_or_refused() -> None:
    assert absolute_error(np.array([3e200, 4e200]), np.zeros(2)) == pytest.approx(5e200)
    assert absolute_error(np.array([3e-200, 4e-200]), np.zeros(2)) == pytest.approx(5e-200)
    with pytest.raises(SimulationError, match="not finite"):
        absolute_error(np.full(4, 1.5e308), np.full(4, -1.5e308))


def test_an_error_may_exceed_one() -> None:
    assert relative_error(-5.0 * np.sin(T), np.sin(T)) == pytest.approx(6.0)


def test_shapes_must_agree() -> None:
    with pytest.raises(ValueError, match="differ"):
        relative_error(np.zeros((5, 1)), np.ones((5, 2)))


def test_the_largest_difference_is_that_of_a_single_value() -> None:
    assert largest_difference(np.array([[1.0, 2.0], [4.0, -3.0]]), np.array([[1.0, 0.0], [0.0, 2.0]])) == 5.0
    with pytest.raises(SimulationError, match="not finite"):
        largest_difference(np.array([1.0, np.nan]), np.zeros(2))


def test_absolute_error_is_the_euclidean_norm_over_time() -> None:
    assert absolute_error(np.array([1.0, 2.0, 4.0]), np.array([1.0, 0.0, 0.0])) == pytest.approx(np.sqrt(20.0))


def response(scale: float) -> Response:
    w = scale * np.stack([0 * T, np.sin(9 * T), np.sin(7 * T)], axis=1)
    nothing = np.zeros_like(T)
    force = scale**2 * np.sin(8 * T)[:, None]
    return Response(T, np.arange(3.0), w, Energy(nothing, nothing, nothing), force, nothing, nothing, 0.0)


def test_all_pairs_are_compared_the_later_one_being_the_reference() -> None:
    found = errors_between({"ancf": response(1.0), "full": response(1.1), "reduced": response(1.21)}, OF_NODES)
    assert set(found) == {"reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf"}
    assert found["reduced_vs_full"] == pytest.approx({"tip": 0.1, "beam": 0.1, "pad_force": 0.21})
    assert found["reduced_vs_ancf"]["tip"] == pytest.approx(0.21)
    absolute = errors_between({"full": response(1.0), "reduced": response(1.5)}, OF_NODES, absolute_error)[
        "reduced_vs_full"
    ]
    assert absolute["tip"] == pytest.approx(0.5 * np.linalg.norm(np.sin(7 * T)))
    assert set(errors_between({"full": response(1.0), "reduced": response(1.0)}, OF_NODES)) == {"reduced_vs_full"}


def test_forces_that_are_round_off_beside_others_are_nobodys_error() -> None:
    """A cylinder of a boom that lies level bears nothing, which no two models have to the last digit."""
    pads = np.sin(8 * T)
    full, reduced = (replace(response(1.0), slider_force=np.stack([pads, one], axis=1)) for one in (1e-15 * T, 0.0 * T))
    level = {"cylinder_force": lambda one: one.slider_force[:, 1:]}
    assert errors_between({"full": full, "reduced": reduced}, level)["reduced_vs_full"]["cylinder_force"] == 0.0


def test_a_force_beside_a_reference_of_round_off_is_wrong_by_all_of_it_and_by_no_more() -> None:
    """A support along the axis of a straight beam bears only round-off; a reduced model that strays bears 1 N.

    Its moment is round-off in both, beside the forces.
    """
    bears = {"other_names": ("support z", "support x", "support rx"), "other_units": ("N", "N", "N m")}
    full, reduced = (
        replace(response(1.0), others=np.stack([800.0 * np.sin(8 * T), axial, 1e-10 * axial - 1e-10], axis=1), **bears)
        for axial in (1e-29 * np.cos(8 * T), np.cos(8 * T))
    )
    errors = errors_between({"full": full, "reduced": reduced}, OF_NODES)["reduced_vs_full"]
    assert errors["support x"] == 1.0 and errors["support z"] == errors["support rx"] == 0.0


def test_values_that_are_no_numbers_are_not_taken_for_round_off() -> None:
    broken = np.where(T[:, None] < 0.5, np.nan, 1.0)
    assert np.isnan(zero_round_off(broken, broken, 1e-9).signal[0])


def test_outputs_in_other_units_are_compared_by_their_names() -> None:
    turned = {"others": np.sin(5 * T)[:, None], "other_names": ("tip ry",), "other_units": ("rad",)}
    full = replace(response(1.0), **turned)
    reduced = replace(response(1.0), **(turned | {"others": 1.03 * turned["others"]}))
    found = errors_between({"ancf": response(1.0), "full": full, "reduced": reduced}, OF_NODES)
    assert found["reduced_vs_full"]["tip ry"] == pytest.approx(0.03) and found["reduced_vs_full"]["beam"] == 0.0
    assert "tip ry" not in found["full_vs_ancf"]  # the cable says nothing of it


@pytest.fixture
def model() -> ReducedModel:
    """Two coordinates whose one row is p0 + s p1."""
    rows = PPoly(np.array([[[[0.0, 1.0]]], [[[1.0, 0.0]]]]), [0.0, 2.0])
    M, K = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([[4.0, 1.0], [1.0, 3.0]])
    return ReducedModel(
        M, np.zeros((2, 2)), K, np.array([[1.0], [2.0]]), np.eye(2), rows, ("F",), ("slider",), np.arange(2.0)
    )


def trajectory(s: np.ndarray) -> Trajectory:
    """p = (-s p1, p1), which keeps the row; s moves at 1 m/s."""
    q = np.stack([-s * np.sin(T), np.sin(T)], axis=1)
    v = np.stack([-np.sin(T) - s * np.cos(T), np.cos(T)], axis=1)
    return Trajectory(T, q, v, np.full((len(T), 1), 7.0), s, seconds=1.5)


def test_residuals_vanish_for_a_consistent_motion_and_only_for_it(model: ReducedModel) -> None:
    s = 0.5 + T
    exact = respond(model, trajectory(s), np.ones_like(T), np.ones((len(T), 1)))
    assert exact.residual_position.max() < 1e-15 and exact.residual_velocity.max() < 1e-14
    assert exact.slider_force[:, 0] == pytest.approx(7.0) and exact.seconds == 1.5
    assert exact.displacement == pytest.approx(trajectory(s).q)
    still = respond(model, trajectory(s), np.zeros_like(T), np.ones((len(T), 1)))
    assert still.residual_velocity == pytest.approx(np.abs(np.sin(T)))  # the missing term, s' C'(s) q
    off = respond(model, Trajectory(**{**vars(trajectory(s)), "s": s + 0.1}), np.ones_like(T), np.ones((len(T), 1)))
    assert off.residual_position == pytest.approx(0.1 * np.sin(T))


@pytest.mark.parametrize("matrix", [np.asarray, sp.csr_matrix])
def test_energies(model: ReducedModel, matrix) -> None:
    body = ReducedModel(**{**vars(model), "M": matrix(model.M), "K": matrix(model.K)})
    motion, F = trajectory(0.5 + T), np.full((len(T), 1), 3.0)
    e = energy(body, motion, F)
    q, v = motion.q[400], motion.v[400]
    assert e.kinetic[400] == pytest.approx(v @ model.M @ v / 2)
    assert e.strain[400] == pytest.approx(q @ model.K @ q / 2)
    assert e.external[400] == pytest.approx(-3.0 * (q[0] + 2.0 * q[1]))
    assert e.total == pytest.approx(e.kinetic + e.strain + e.external)


def test_energies_that_overflow_are_refused(model: ReducedModel) -> None:
    huge = Trajectory(**{**vars(trajectory(0.5 + T)), "q": 1e300 * trajectory(0.5 + T).q})
    with pytest.raises(SimulationError, match="too large for double precision"):
        respond(model, huge, np.ones_like(T), np.ones((len(T), 1)))


FULL = rich_body()

PATH = SmoothRamp(times=(0.0, 0.3), values=(1.5, 2.1))

LOADS = (Sine(amplitude=200.0, frequency=3.0), SmoothRamp(times=(0.0, 0.3), values=(0.0, 80.0)))

STEPPING = TimeStepping(0.3, 2e-5, 0.9)

EXTENSION = driven(PATH, LOADS, STEPPING)

SHORT = driven(PATH, LOADS, TimeStepping(0.1, 1e-3))


def rate(x: Array) -> Array:
    """Central differences at all but the first and last step."""
    return (x[2:] - x[:-2]) / (2.0 * STEPPING.step)


@pytest.mark.parametrize("pads", [None, np.array([2e-6, 5e-6])])
def test_they_are_the_rates_of_outputs_and_forces(pads: Array | None) -> None:
    model = replace(enriched(FULL, 5), pads=pads)
    run = one_body.simulate(model, EXTENSION)
    y = displacement(model, run.q, run.s, run.multipliers, loads_at(LOADS, run.t))
    found, late = output_rates(model, run, EXTENSION)[1:-1], slice(300, None)  # the start strikes
    assert np.abs(found - rate(y))[late].max() < 2e-4 * np.abs(found).max()
    assert np.abs(run.v @ model.outputs.T - output_rates(model, run, EXTENSION)).max() > 1e-2 * np.abs(found).max()
    z = force_rates(model, run, EXTENSION.path_rate, load_rates(model, EXTENSION))
    assert np.abs(z.rate[1:-1] - rate(run.multipliers))[late].max() < 1e-3 * np.abs(z.rate).max()


def test_rows_that_are_open_have_no_force_that_changes() -> None:
    """A beam that rises from the lower pads to the upper ones and back."""
    model = flexible_on_pads(beam_on_pads(clearance=1e-3), 5)
    loads = (SmoothRamp(times=(0.0, 0.1), values=(0.0, 9.81)), Sine(amplitude=4000.0, frequency=5.0))
    excitation = on_pads.driven(PATH, loads, STEPPING)
    run = one_body.simulate(model, excitation)
    z = force_rates(model, run, excitation.path_rate, load_rates(model, excitation))
    pushes = run.multipliers > 0.0
    assert not z.rate[~pushes].any() and 0.1 < pushes.mean() < 0.9
    y = displacement(model, run.q, run.s, run.multipliers, loads_at(loads, run.t))
    same = np.all((pushes[2:] == pushes[1:-1]) & (pushes[:-2] == pushes[1:-1]), axis=1)
    found = output_rates(model, run, excitation)[1:-1]
    assert np.abs(found - rate(y))[same].max() < 2e-4 * np.abs(found).max()


def test_without_flexibility_they_are_those_of_the_coordinates() -> None:
    model = project(FULL, paper_basis(FULL, 3, 3, 6))
    run = one_body.simulate(model, SHORT)
    assert np.array_equal(output_rates(model, run, SHORT), run.v @ model.outputs.T)
    with pytest.raises(ValueError, match="without residual flexibility"):
        force_rates(model, run, SHORT.path_rate, load_rates(model, SHORT))
