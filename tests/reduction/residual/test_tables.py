"""Tables against C(s) R C(s)^T and the like, evaluated directly at many path coordinates.
Mirror images of loads: their answers are the images of answers.
"""

import numpy as np
import pytest

from pmr import InputError, reduce
from pmr.errors import environment
from pmr.fullmodel.build import full_model
from pmr.fullmodel.model import FullModel
from pmr.reduction.free_body import FreeBody, ResidualFlexibility
from pmr.reduction.residual import BLOCK, check_memory, load_powers, tables
from pmr.reduction.snapshots import free_modes
from pmr.system.polynomials import common_breaks
from pmr.system.rows import Rows

pytestmark = pytest.mark.mpi

RICH = [
    "mesh.elements=24",
    "mesh.grading=4.0",
    "slider.offsets=[0.0,-0.33]",
    "compare.against=[]",
    "loads=[{on=5.0,signal=-50},{name='T',on=2.2,direction='ry',signal=3.0}]",
]


@pytest.fixture(params=["dense", "slepc"])
def case(load_scene, request: pytest.FixtureRequest) -> tuple[FullModel, ResidualFlexibility]:
    full = full_model(load_scene("paper_simple", RICH))
    V = np.array(free_modes(full, 6, request.param).S.getDenseArray())
    return full, ResidualFlexibility(FreeBody(full, request.param), V)


def whole(full: FullModel, local: np.ndarray) -> np.ndarray:
    return np.concatenate(full.comm.allgather(local))


def close(found: np.ndarray, expected: np.ndarray) -> bool:
    return bool(np.abs(found - expected).max() < 1e-11 * np.abs(expected).max())


def test_tables_are_exact_between_and_on_their_breaks(case) -> None:
    full, residual = case
    first, last = full.M.getOwnershipRange()
    R = whole(full, residual.apply(np.eye(full.size)[first:last]))
    R = (R + R.T) / 2.0
    rows = full.rows.rows[2:]
    breaks = common_breaks([row.project(np.zeros((full.size, 1))) for row in rows], full.rows.domain)
    shared = Rows(rows, full.size).shared_carriers.refine(breaks)
    found = tables(load_powers(residual, shared.carriers, 1)[0], shared, full.rows.domain)
    body = full.comm.bcast(full.gather())
    O, B = body.outputs.toarray(), body.B
    assert found.rows.c.shape == (7, len(breaks) - 1, 2, 2) and found.inputs.c.shape[0] == 4
    assert full.size > BLOCK  # more than one block of solves
    for s in np.concatenate([np.random.default_rng(5).uniform(breaks[0], breaks[-1], 40), breaks]):
        C = body.C(s).toarray()[2:]
        assert close(found.rows(s), C @ R @ C.T)
        assert close(found.inputs(s), C @ R @ B)
        assert close(found.outputs(s), O @ R @ C.T)
    assert close(found.direct, O @ R @ B) and close(found.energy, B.T @ R @ B)


def test_the_sliders_flexibility_is_symmetric_and_positive(case) -> None:
    full, residual = case
    rows = full.rows.rows[2:]
    breaks = common_breaks([row.project(np.zeros((full.size, 1))) for row in rows], full.rows.domain)
    shared = Rows(rows, full.size).shared_carriers.refine(breaks)
    G = tables(load_powers(residual, shared.carriers, 1)[0], shared, full.rows.domain).rows
    assert np.array_equal(G.c, G.c.swapaxes(2, 3))
    s = np.linspace(*full.rows.domain, 301)[1:]
    assert np.linalg.eigvalsh(G(s))[:, 0].min() > 0.0


@pytest.mark.slow
def test_a_thousand_elements_are_reduced(load_scene) -> None:
    found = reduce(load_scene("evolved_residual", ["mesh.elements=1000", "compare.against=[]"])).reduced
    assert found.enrichment is not None and found.flexibility and len(found.flexibility.rows.x) == 1001


def test_short_pads_of_a_beam_take_no_more_than_its_coordinates(load_scene) -> None:
    """Pads of 6 mm on a path of 2.5 m have 25,000 stations, of which any two would be related: 5 GB."""
    changes = ["mesh.elements=6", "time.end=0.2", "compare.against=[]", "pads.0.length=0.01", "pads.1.length=0.01"]
    model = full_model(load_scene("boom_beam", changes))
    assert model.carriers.carriers.shape[0] < model.size


def test_what_pads_take_of_memory_is_said_or_refused_before_it_is_done(load_scene, monkeypatch, caplog) -> None:
    model = full_model(load_scene("boom_beam", ["mesh.elements=6"]))
    monkeypatch.setattr(environment, "available_memory", lambda: 10_000)
    with pytest.raises(InputError, match=r"pads.length: pads have 20,000 stations along their paths"):
        check_memory(model, 20_000, 2)
    monkeypatch.setattr(environment, "available_memory", lambda: 2**40)
    check_memory(model, 20_000, 2)
    first = model.comm.rank == 0  # which speaks for all
    assert ("20,000 stations" in caplog.text and "12.8 GB" in caplog.text) == first
    caplog.clear()
    check_memory(model, 2_000, 2)
    assert not caplog.text
