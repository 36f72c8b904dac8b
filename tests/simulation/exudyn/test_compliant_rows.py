"""Rows that give way in Exudyn: springs that travel, and multipliers kept, against an integrator of the tests' own."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import exudyn as exu
import numpy as np
import one_body
import pytest
import scipy.sparse as sp
from driving import driven, named
from one_body import LOADS, PATH, STEPPING, Simulate, displacement
from oracle import CASES, flexible, full_body, generalized_alpha, project, with_pads
from own_mbs import OwnSystem
from springs import CompliantRows

from pmr import InputError, ReducedModel, SimulationError
from pmr.scene.signals import Constant
from pmr.simulation import InitialState, TimeStepping
from pmr.simulation.exudyn import simulator
from pmr.simulation.exudyn.simulator import Formulation
from pmr.system.body import FullBody, SlidingBody


@pytest.fixture(params=["springs", "multipliers"])
def simulate(request: pytest.FixtureRequest) -> Simulate:
    return partial(one_body.in_exudyn, formulation=request.param)


#: Two sliders, two inputs and damping; which rows give way, and by what, differs.
BODIES: dict[str, Callable[[FullBody], SlidingBody]] = {
    "residual flexibility": lambda rich: flexible(rich, 8),
    "residual flexibility and pads": lambda rich: flexible(with_pads(rich, 0.0, 0.0, 1e-6, 3e-6), 8),
    "a firm slider and a pad": lambda rich: replace(
        project(rich, np.eye(rich.size)[:, 2:]), pads=np.array([0.0, 3e-6])
    ),
    "sparse, a pad": lambda rich: with_pads(rich, 0.0, 0.0, 0.0, 3e-6),
    "sparse, a support that gives way": lambda rich: with_pads(rich, 0.0, 2e-6, 0.0, 0.0),
}


@pytest.mark.parametrize("which", BODIES)
def test_same_as_an_integrator_written_for_the_test(rich: FullBody, simulate: Simulate, which: str) -> None:
    body = BODIES[which](rich)
    random = np.random.default_rng(1).standard_normal((2, body.size)) * [[1e-3], [1e-2]]
    firm = [i for i in range(len(body.row_names)) if i not in CompliantRows(body).numbers]
    C = sp.csr_matrix(body.C(PATH.offset)).toarray()[firm]
    C_s = np.array([body.apply_rows(np.array([PATH.offset]), e[None], 1)[0] for e in np.eye(body.size)]).T[firm]
    q = random[0] - np.linalg.pinv(C) @ (C @ random[0]) if firm else random[0]
    rate = float(PATH.rate(0.0))
    v = random[1] - np.linalg.pinv(C) @ (C @ random[1] + rate * C_s @ q) if firm else random[1]
    start = InitialState(q, v)
    found = simulate(body, driven(PATH, LOADS, STEPPING), start)
    t = STEPPING.times
    f = np.stack([load.value(t) for load in LOADS], axis=1)
    expected = generalized_alpha(body, PATH.value(t), f, STEPPING, start)
    for a, b in zip((found.q, found.v, found.multipliers), expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=0.0, atol=2e-10 * np.abs(b).max())


@pytest.mark.slow
def test_both_ways_agree_over_a_case_of_the_paper(full: FullBody) -> None:
    """Kinks of the path and a chirp; well below the 5e-9 m to which simulators have to agree."""
    model, case = flexible(full, 6), CASES["evolved"]
    stepping = TimeStepping(4.0, 1e-3, 0.9)
    t = stepping.times
    f = case.load.value(t)[:, None]
    s = case.path.value(t)
    q, _, force = generalized_alpha(model, s, f, stepping, InitialState.at_rest(6))
    expected = displacement(model, q, s, force, f)
    for formulation in ("springs", "multipliers"):
        found = one_body.in_exudyn(model, driven(case.path, case.load, stepping), formulation=formulation)
        assert np.abs(displacement(model, found.q, s, found.multipliers, f) - expected).max() < 1e-12
        assert np.abs(found.multipliers - force).max() < 1e-7 * np.abs(force).max()
    assert np.abs(expected).max() > 1e-2


def test_a_constant_load_acts_through_a_slider_that_moves(full: FullBody) -> None:
    """The slider's share of it changes with s although the load does not."""
    model, stepping = flexible(full, 6), TimeStepping(0.2, 1e-3)
    f, s = np.full((201, 1), -50.0), np.asarray(PATH.value(stepping.times))
    q, _, force = generalized_alpha(model, s, f, stepping, InitialState.at_rest(6))
    for formulation in ("springs", "multipliers"):
        found = one_body.in_exudyn(model, driven(PATH, Constant(amount=-50.0), stepping), formulation=formulation)
        assert np.abs(found.q - q).max() < 1e-10 * np.abs(q).max()
        assert np.abs(found.multipliers - force).max() < 1e-8 * np.abs(force).max()


def test_a_free_body_without_constraint_has_no_connector(rich: FullBody) -> None:
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items = simulator.add_sliding_body(mbs, flexible(rich, 8), PATH, named(LOADS))
    assert items.oContacts is None and items.contacts == ()
    assert mbs.systemData.NumberOfObjects() == 1
    kept = simulator.add_sliding_body(mbs, flexible(rich, 8), PATH, named(LOADS), formulation="multipliers")
    assert kept.contacts == (0, 1) and mbs.GetObject(kept.oContacts)["objectType"] == "ConnectorCoordinateVector"


@pytest.mark.parametrize("formulation", ["springs", "multipliers"])
def test_two_flexible_bodies_share_a_users_system(rich: FullBody, formulation: Formulation) -> None:
    add = partial(simulator.add_sliding_body, formulation=formulation)
    model, other = flexible(rich, 8), flexible(full_body(elements=4), 5)
    own = OwnSystem(STEPPING)
    first = add(own.mbs, model, PATH, named(LOADS))
    second = add(own.mbs, other, Constant(amount=1.1), {"F": Constant(amount=20.0)})
    q, q_other = own.solve(own.coordinates(first.nBody), own.coordinates(second.nBody))
    alone = one_body.in_exudyn(model, driven(PATH, LOADS, STEPPING)).q
    alone_other = one_body.in_exudyn(other, driven(Constant(amount=1.1), [Constant(amount=20.0)], STEPPING)).q
    np.testing.assert_allclose(q, alone, rtol=0.0, atol=1e-7 * np.abs(alone).max())
    np.testing.assert_allclose(q_other, alone_other, rtol=0.0, atol=1e-7 * np.abs(alone_other).max())
    assert np.abs(alone_other).max() > 0.0


def test_callbacks_refuse_rows_that_give_way(rich: FullBody) -> None:
    for body in (flexible(rich, 8), with_pads(rich, 0.0, 0.0, 0.0, 3e-6)):
        with pytest.raises(InputError, match="exudyn-callback knows no rows that give way .slider 0"):
            one_body.in_exudyn(body, driven(PATH, LOADS, STEPPING), formulation="callbacks")


def test_a_slider_on_a_support_fails_with_its_place(simulate: Simulate, full: FullBody) -> None:
    model: ReducedModel = flexible(full, 6)
    with pytest.raises(SimulationError, match="slider at 0 m: the forces of the rows slider 0 are not"):
        simulate(model, driven(Constant(amount=0.0), Constant(amount=1.0), TimeStepping(0.01, 1e-3)))
