"""Modes that move into the tables and back, against tables of the smaller and the larger model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import enriched, flexible, paper_basis, project, rich_body
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel
from pmr.system.carriers import CarrierFlexibility
from pmr.system.truncation import extend, is_modal, truncate

FULL = rich_body()
S = np.linspace(0.0, 4.2, 60)


def arrays(model: ReducedModel) -> dict[str, np.ndarray]:
    """Everything that two models may differ in, tables as values; modes have no sign."""
    assert model.flexibility and model.carriers and model.carriers.flexibility and model.carriers.inertia
    tables, carriers = model.flexibility, model.carriers
    found = {name: getattr(tables, name) for name in ("rows", "inputs", "outputs", "direct", "energy")}
    for part in ("flexibility", "inertia"):
        found |= {f"{part} {name}": getattr(getattr(carriers, part), name) for name in CarrierFlexibility.AXES}
    values = {name: A(S) if isinstance(A, PPoly) else A for name, A in found.items()}
    return (
        values
        | {name: np.abs(getattr(model, name)) for name in ("M", "D", "K", "B", "outputs")}
        | {"C": abs(model.C(S))}
    )


def assert_same(found: ReducedModel, expected: ReducedModel, tolerance: float = 1e-8) -> None:
    for (name, a), b in zip(arrays(found).items(), arrays(expected).values(), strict=True):
        assert np.abs(a - b).max() <= tolerance * max(np.abs(b).max(), 1e-30), name


def test_a_large_model_holds_the_smaller_one_and_back() -> None:
    large, small = enriched(FULL, 9), enriched(FULL, 5)
    cut = truncate(large, 5)
    assert_same(cut, small)
    assert cut.enrichment and cut.enrichment.count == 4 and cut.size == 5
    assert_same(extend(cut), large, 1e-10)
    assert extend(cut).enrichment is None


def test_matrices_of_a_moving_frame_go_and_come_back_with_the_modes() -> None:
    A = np.random.default_rng(3).standard_normal((9, 9))
    large = replace(enriched(FULL, 9), matrices={"axial tip": A})
    cut = truncate(truncate(large, 7), 5)
    assert np.array_equal(cut.matrices["axial tip"], A[:5, :5])
    assert np.array_equal(extend(cut, 2).matrices["axial tip"], A[:7, :7])
    assert np.array_equal(extend(extend(cut, 1)).matrices["axial tip"], A)
    assert cut.contradiction() is None


def test_step_by_step_is_at_once() -> None:
    large = enriched(FULL, 9)
    twice, once = truncate(truncate(large, 7), 5), truncate(large, 5)
    assert twice.enrichment and once.enrichment
    assert np.array_equal(twice.enrichment.stiffness, once.enrichment.stiffness)
    assert twice.carriers and once.carriers
    assert twice.carriers.enrichment == pytest.approx(once.carriers.enrichment, rel=1e-12)
    assert_same(extend(twice, 2), enriched(FULL, 7))
    left = extend(twice, 3).enrichment
    assert left and left.count == 1 and left.stiffness == once.enrichment.stiffness[3:]


def test_equal_frequencies_stand_in_any_order() -> None:
    model = flexible(FULL, 6)
    K = np.array(model.K)
    K[0, 0], K[1, 1] = 1e-13 * K.max(), -1e-13 * K.max()  # as those of two rigid motions may come out
    assert is_modal(replace(model, K=K))
    K[1, 1] = -1e-6 * K.max()
    assert not is_modal(replace(model, K=K))


def test_what_cannot_join_the_tables_is_refused() -> None:
    model = enriched(FULL, 6)
    with pytest.raises(ValueError, match="0 modes of 6"):
        truncate(model, 0)
    with pytest.raises(ValueError, match="6 modes of 6"):
        truncate(model, 6)
    with pytest.raises(ValueError, match="leading"):
        truncate(flexible(FULL, 6), 4)
    coupled = model.K.copy()
    coupled[3, 4] = coupled[4, 3] = 0.5 * coupled[3, 3]
    backwards = {"K": model.K[::-1, ::-1], "D": model.D[::-1, ::-1]}
    for change in ({"K": coupled}, {"M": 2.0 * model.M}, backwards):
        assert not is_modal(replace(model, **change))
        with pytest.raises(ValueError, match="only eigenmodes"):
            truncate(replace(model, **change), 4)
    assert not is_modal(project(FULL, paper_basis(FULL, 3, 3, 5)))
    unsupported = replace(model, K=np.zeros_like(model.K))
    with pytest.raises(ValueError, match="rigid-body modes have to stay"):
        truncate(unsupported, 4)
    with pytest.raises(ValueError, match="1 enrichment modes of 0"):
        extend(model, 1)
    with pytest.raises(ValueError, match="3 enrichment modes of 2"):
        extend(truncate(model, 4), 3)


def test_enrichment_and_inertia_survive_the_file(tmp_path: Path) -> None:
    model = enriched(FULL, 5, enrichment=3)
    loaded = ReducedModel.load(model.save(tmp_path / "m.npz"))
    assert loaded.enrichment and model.enrichment
    assert_same(loaded, model, 0.0)
    for name in ("stiffness", "damping", "B", "outputs"):
        assert np.array_equal(getattr(loaded.enrichment, name), getattr(model.enrichment, name))
    assert loaded.carriers and model.carriers
    assert np.array_equal(loaded.carriers.enrichment, model.carriers.enrichment)


def test_a_file_without_them_has_neither(tmp_path: Path) -> None:
    path = enriched(FULL, 5, enrichment=3).save(tmp_path / "m.npz")
    with np.load(path) as data:
        old = {name: data[name] for name in data if not name.startswith(("carriers.", "enrichment."))}
    np.savez(path, **old)
    loaded = ReducedModel.load(path)
    assert loaded.flexibility and loaded.carriers is None and loaded.enrichment is None


@pytest.mark.parametrize("kept", [True, False])
def test_a_file_with_residual_inertia_is_refused_and_one_with_its_tables_alone_is_read(
    tmp_path: Path, kept: bool
) -> None:
    path = enriched(FULL, 5, enrichment=3).save(tmp_path / "m.npz")
    with np.load(path) as data:
        old = {name: data[name] for name in data} | {"flexibility.inertia.kept": np.asarray(kept)}
    np.savez(path, **old, **{"flexibility.inertia.A0.breaks": np.zeros(2)})
    if not kept:
        assert ReducedModel.load(path).size == 5
        return
    with pytest.raises(InputError, match=r"m\.npz: flexibility\.inertia: .*more coordinates have the same effect"):
        ReducedModel.load(path)


def test_tables_and_enrichment_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    model = enriched(FULL, 5, enrichment=3)
    assert model.flexibility and model.enrichment

    def said(**change: object) -> str:
        with pytest.raises(InputError) as caught:
            ReducedModel.load(replace(model, **change).save(tmp_path / "m.npz"))
        return str(caught.value)

    tables, wrong = model.flexibility, PPoly(np.zeros((1, 1, 3, 3)), [0.0, 4.2])
    assert "flexibility.rows has shape (3, 3)" in said(flexibility=replace(tables, rows=wrong))
    assert "enrichment.B has shape (1, 2)" in said(enrichment=replace(model.enrichment, B=model.enrichment.B[:1]))
    assert "not positive" in said(enrichment=replace(model.enrichment, stiffness=np.zeros(3)))
