"""Modes of a section's cylinder, against the wave equation of a rod and against larger bases."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq

from pmr import ReducedModel
from pmr import scene as scenes
from pmr.fem.distributed import local_csr
from pmr.fullmodel.build import build_bodies
from pmr.fullmodel.model import FullModel
from pmr.reduction.bodies import reduce_bodies
from pmr.system.attachment import CYLINDER, with_attachment_modes, with_cylinder_modes
from pmr.system.truncation import extend, truncate

PAYLOAD, LENGTH, E, RHO = 250.0, 6.0, 210e9, 7850.0


def fly(coordinates: int, *changes: str) -> ReducedModel:
    size = ("time.end=0.1", "section.mesh.elements=24", f"sections.fly.reduction.coordinates={coordinates}")
    boom = scenes.load_any("boom_two", (*size, *changes))
    return reduce_bodies(boom, build_bodies(boom))["fly"].modal


def along(model: ReducedModel) -> np.ndarray:
    """Natural circular frequencies with the tail held along the boom."""
    assert model.carriers is not None and model.carriers.answers is not None
    held = model.carriers.answers.load @ model.carriers.values
    Z = np.linalg.svd(held[None])[2][1:].T
    return np.sqrt(np.maximum(np.linalg.eigvalsh(Z.T @ model.K @ Z), 0.0))


@pytest.mark.slow
@pytest.mark.numerical
def test_a_rod_with_a_payload_at_its_end_rings_as_the_wave_equation_says() -> None:
    """x tan x = m / M with x = omega L / c; what two modes miss of it is less than what 24 elements do, h^2 / 24."""
    area = 2.0 * 0.007 * (0.26 + 0.36)
    ratio = RHO * area * LENGTH / PAYLOAD
    x = brentq(lambda x: x * np.tan(x) - ratio, 1e-6, np.pi / 2.0 - 1e-9)
    first, of_mesh = x / LENGTH * np.sqrt(E / RHO), (x / 24.0) ** 2 / 24.0
    found = along(with_cylinder_modes(fly(5)))
    assert np.min(np.abs(found / first - 1.0)) < 2.0 * of_mesh


@pytest.mark.slow
@pytest.mark.numerical
def test_under_a_cylinder_nothing_gives_way_that_has_no_mass_and_no_damping() -> None:
    modal = fly(5)
    model, r = with_cylinder_modes(modal), modal.size
    carriers, before, rayleigh = model.carriers, modal.carriers, model.rayleigh
    assert carriers is not None and carriers.flexibility is not None and carriers.answers is not None
    assert before is not None and before.flexibility is not None and rayleigh is not None
    assert model.contradiction() is None and model.cylinder_modes == CYLINDER and model.size == r + CYLINDER
    load, omega2 = carriers.answers.load, np.diagonal(model.K)[r:]
    assert not np.any(load @ carriers.flexibility.rows) and np.all(
        np.diagonal(model.D)[r:] == rayleigh.modal_damping(omega2)
    )
    values = carriers.values[:, r:]
    size = load @ before.flexibility.rows @ load
    assert (values / omega2) @ (values.T @ load) == pytest.approx(before.flexibility.rows @ load, abs=1e-9 * size)


@pytest.mark.slow
@pytest.mark.numerical
def test_matrices_of_a_moving_frame_know_the_cylinders_modes() -> None:
    """Were they mass and stiffness, they would be those of the model, of smaller and of larger ones."""
    boom = scenes.load_any("boom_two", ("time.end=0.1", "section.mesh.elements=24"))
    built = {
        name: replace(one, model=replace(one.model, matrices={"M": one.model.M, "K": one.model.K}))
        for name, one in build_bodies(boom).items()
    }
    modal = reduce_bodies(boom, built)["fly"].modal
    assert modal.enrichment is not None
    for model in (modal, extend(modal), truncate(modal, modal.size - 1), extend(modal, 1)):
        found, kept = with_cylinder_modes(model), np.diagonal(model.K) > 1e-6
        K = np.diagonal(with_cylinder_modes(model).K)
        scale = np.sqrt(np.maximum(K, K[: model.size][kept].min()))
        assert found.contradiction() is None
        assert np.abs(found.matrices["M"] - found.M).max() < 1e-7
        assert np.abs((found.matrices["K"] - found.K) / np.outer(scale, scale)).max() < 1e-7


def tip(model: FullModel) -> dict[str, sp.csr_matrix]:
    """Its last output, as a port."""
    return {"tip": sp.csr_matrix(local_csr(model.outputs).T[-1])}


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("name", ["base", "fly"])
def test_matrices_of_a_moving_frame_know_answers_to_loads(name: str) -> None:
    """Were they mass, stiffness and an output, they would be those of the model with its attachment modes."""
    boom = scenes.load_any("boom_two", ("time.end=0.1", "section.mesh.elements=24"))
    built = {
        name: replace(
            one, model=replace(one.model, matrices={"M": one.model.M, "K": one.model.K}, ports=tip(one.model))
        )
        for name, one in build_bodies(boom).items()
    }
    modal = reduce_bodies(boom, built)[name].modal
    assert modal.enrichment is not None and modal.carriers is not None
    rng = np.random.default_rng(5)
    for model in (modal, extend(modal, 1)):
        assert model.carriers is not None
        loads = rng.standard_normal((6, len(model.carriers.values) + len(model.input_names)))
        found = with_attachment_modes(model, loads)
        assert found.size > model.size + 3
        scale = np.sqrt(np.maximum(np.diagonal(found.K), np.diagonal(found.K)[model.size :].min()))
        assert np.abs(found.matrices["M"] - found.M).max() < 1e-6
        assert np.abs((found.matrices["K"] - found.K) / np.outer(scale, scale)).max() < 1e-6
        assert found.ports["tip"] == pytest.approx(found.outputs[-1], abs=1e-9 * np.abs(found.outputs[-1]).max())
        assert (found.reactions is not None) == (name == "base")
        if found.reactions is not None:
            inertia = found.reactions.inertia
            assert inertia == pytest.approx(found.reactions.matrices["M"], abs=1e-9 * np.abs(inertia).max())


@pytest.mark.slow
@pytest.mark.numerical
@pytest.mark.parametrize("side", ["bottom=[0.0]", "left=[0.0]"])
def test_smaller_and_larger_models_have_the_modes_of_their_own_residual_part(side: str) -> None:
    """Those that fewer modes leave more of, with the enrichment modes added, are those of the larger reduction."""
    faces = "{bottom=[-0.05,0.05],top=[0.0]," + side + "}" if "left" in side else "{bottom=[0.0],top=[0.0]}"
    changes = [f"section.joint.{end}.0.faces={faces}" for end in ("tail", "mouth")]
    changes += ["section.body.model=beam3d", "sections.base.reduction.coordinates=3"] if "left" in side else []
    small = fly(9, *changes)
    large = extend(small)
    again = truncate(large, 9)
    for one, other in ((small, again), (with_cylinder_modes(small), with_cylinder_modes(again))):
        assert one.carriers is not None and other.carriers is not None
        first, second = one.carriers.answers, other.carriers.answers
        assert first is not None and second is not None
        for name in ("rows", "inputs", "outputs", "stiffness", "inertia"):
            a, b = getattr(first, name), getattr(second, name)
            size = np.abs(a).max(axis=0)
            assert b / size == pytest.approx(a / size, abs=1e-7)
    assert along(with_cylinder_modes(again)) == pytest.approx(along(with_cylinder_modes(small)), rel=1e-6, abs=1e-3)


@pytest.mark.slow
def test_saved_and_read_again(tmp_path: Path) -> None:
    model = with_cylinder_modes(fly(5))
    found = ReducedModel.load(model.save(tmp_path / "fly.npz"))
    assert found.cylinder_modes == CYLINDER and found.carriers is not None and model.carriers is not None
    assert found.carriers.answers is not None and model.carriers.answers is not None
    assert np.array_equal(found.carriers.answers.turned, model.carriers.answers.turned)
