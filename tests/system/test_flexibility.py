"""Residual flexibility of a reduced model: its file and what contradicts it."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import full_body, paper_basis, project
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel
from pmr.system.carriers import Flexibility

RNG = np.random.default_rng(4)


def table(*shape: int) -> PPoly:
    return PPoly(RNG.standard_normal((3, 2, *shape)), [0.0, 2.0, 5.0])


@pytest.fixture
def model() -> ReducedModel:
    full = full_body(elements=6)
    plain = project(full, paper_basis(full, 3, 3, 5))
    o, i, m = len(plain.outputs), 1, len(plain.row_names)
    flexibility = Flexibility(table(m, m), table(m, i), table(o, m), np.ones((o, i)), np.ones((i, i)))
    return replace(plain, flexibility=flexibility, pads=np.full(m, 1e-6))


def test_a_flexible_model_survives_its_file(model: ReducedModel, tmp_path: Path) -> None:
    loaded = ReducedModel.load(model.save(tmp_path / "m.npz"))
    assert loaded.flexibility and model.flexibility
    s = np.linspace(0.0, 5.0, 7)
    for name in ("rows", "inputs", "outputs"):
        assert np.array_equal(getattr(loaded.flexibility, name)(s), getattr(model.flexibility, name)(s))
    assert np.array_equal(loaded.flexibility.direct, model.flexibility.direct)
    assert np.array_equal(loaded.flexibility.energy, model.flexibility.energy)
    assert np.array_equal(loaded.row_compliance, model.row_compliance) and loaded.row_compliance[0] == 1e-6


def test_a_model_without_flexibility_stays_so(model: ReducedModel, tmp_path: Path) -> None:
    loaded = ReducedModel.load(replace(model, flexibility=None, pads=None).save(tmp_path / "m.npz"))
    assert loaded.flexibility is None and not loaded.row_compliance.any()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"pads": np.ones(3)}, "pads has shape (3,)"),
        ({"pads": -np.ones(1)}, "negative"),
        ({"rows": table(2, 2)}, "flexibility.rows has shape (2, 2)"),
        ({"outputs": table(3, 1)}, "flexibility.outputs has shape (3, 1)"),
        ({"direct": np.ones((2, 2))}, "flexibility.direct has shape (2, 2)"),
        ({"direct": np.full((7, 1), np.nan)}, "flexibility.direct is not finite"),
        ({"energy": np.full((1, 1), np.inf)}, "flexibility.energy is not finite"),
        ({"pads": np.array(["soft"])}, "could not convert string to float"),
    ],
)
def test_a_flexibility_that_does_not_fit_is_refused(
    model: ReducedModel, tmp_path: Path, change: dict, says: str
) -> None:
    assert model.flexibility
    if "pads" not in change:
        change = {"flexibility": replace(model.flexibility, **change)}
    with pytest.raises(InputError, match=re.escape(says)):
        ReducedModel.load(replace(model, **change).save(tmp_path / "m.npz"))


def test_leading_coordinates_are_those_of_the_smaller_basis() -> None:
    full = full_body(elements=6)
    V = paper_basis(full, 3, 3, 6)
    small, cut = project(full, V[:, :4]), project(full, V).leading(4)
    for name in ("M", "K", "B", "outputs"):
        assert getattr(cut, name) == pytest.approx(getattr(small, name), rel=1e-12)
    assert cut.C(1.3) == pytest.approx(small.C(1.3), rel=1e-12) and cut.size == 4
    for count in (0, -1, 5):
        with pytest.raises(ValueError, match=f"1 to 4 coordinates are allowed, not {count}"):
            cut.leading(count)


def test_leading_coordinates_of_a_flexible_model_are_refused(model: ReducedModel) -> None:
    with pytest.raises(ValueError, match="belongs to all"):
        model.leading(3)
