"""Mirror images of loads: their answers are the images of answers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmr import scene
from pmr.fem.compat import MPI
from pmr.fullmodel.build import AssembledBody, build
from pmr.fullmodel.structural import MirroredLoads, images_of, mirror_images
from pmr.fullmodel.structure import couple
from pmr.reduction.basis import modal_basis
from pmr.reduction.free_body import FreeBody
from pmr.reduction.residual import section_model
from pmr.reduction.residual_tables import ResidualFlexibility
from pmr.reduction.snapshots import free_modes
from pmr.system.rows import Rows, fixed_row, sparse_row

pytestmark = pytest.mark.mpi

SHELL = Path(__file__).parents[3] / "workflows" / "boom_shell.toml"
COARSE = ["mesh.size=0.15", "mesh.along=0.5", "compare.against=[]"]


@pytest.fixture(scope="module")
def built() -> AssembledBody:
    return build(scene.load(SHELL, COARSE), MPI.COMM_WORLD)


@pytest.mark.slow
@pytest.mark.numerical
def test_one_pad_of_each_face_answers_for_all(built: AssembledBody, monkeypatch: pytest.MonkeyPatch) -> None:
    model, solved = built.model, []
    apply = ResidualFlexibility.apply

    def counted(self: ResidualFlexibility, g: np.ndarray) -> np.ndarray:
        solved.append(g.shape[1])
        return apply(self, g)

    monkeypatch.setattr(ResidualFlexibility, "apply", counted)
    basis = modal_basis(free_modes(model, 6))
    found, with_images = section_model(FreeBody(model), basis, {}, 5), sum(solved)
    expected = section_model(FreeBody(replace(model, mirrors=())), basis, {}, 5)
    assert len(model.mirrors) == 2 and 3 * with_images < 1.1 * (sum(solved) - with_images)
    assert found.carriers and expected.carriers
    for part in ("flexibility", "inertia"):
        for name in ("rows", "inputs", "outputs"):
            one, other = (getattr(getattr(model.carriers, part), name) for model in (found, expected))
            assert np.abs(one - other).max() < 1e-8 * np.abs(other).max(), (part, name)


@pytest.mark.slow
def test_images_that_miss_are_not_taken(built: AssembledBody) -> None:
    """K that is stiffer on one side, a basis that leans to it, a row that holds it, and carriers without a partner."""
    model, T = built.model, couple(built.structure).T
    first, last = model.K.getOwnershipRange()
    K = model.K.copy()
    if first == 0:  # on a corner of the tail, one of four
        K.setValue(0, 0, 1e3, addv=True)
    K.assemble()
    assert not mirror_images(built.structure.model, T, model.M, K)
    P = model.mirrors[0]
    modes = np.array(free_modes(model, 6).S.getDenseArray())
    lean = modes + 1e-6 * np.random.default_rng(2).normal(size=(model.size, 6))[first:last]
    for V, kept in ((modes, True), (lean, False)):
        assert ResidualFlexibility(FreeBody(model), V).commutes_with(P) == kept
    corner = fixed_row("corner", sparse_row(0, 1.0, model.size), model.rows.domain)
    held = FreeBody(replace(model, rows=Rows((corner, *model.rows.rows), model.size)))
    held.__dict__["Z"] = FreeBody(model).Z  # so that the row alone is what the image misses
    assert not ResidualFlexibility(held, np.ascontiguousarray(modes[:, held.Z.shape[1] :])).commutes_with(P)
    shared = model.rows.shared_carriers
    (image,) = images_of(shared.carriers, [P])
    moving = [row for row in shared.rows if row.moves]
    touched = np.unique(np.concatenate([np.unique(row.touched) for row in moving]))
    assert np.all(image.partners[touched] >= 0)
    assert np.array_equal(image.partners[image.partners[touched]], touched)
    alone = images_of(shared.carriers[np.unique(moving[0].touched)], [P])
    orbits = MirroredLoads(np.arange(np.unique(moving[0].touched).size), alone, model.M)
    assert len(orbits.representatives) == np.unique(moving[0].touched).size
