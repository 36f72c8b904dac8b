"""A model's file: nothing stands twice in it, what is read is what was written, and files of version 5 are read."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import carried_rows, enriched, rich_body
from scipy.interpolate import PPoly

from pmr import InputError, ReducedModel
from pmr.files import npz
from pmr.system.body_matrices import symmetric_part
from pmr.system.carriers import TablesOnDemand, pack_model, unpack_model

FULL = rich_body()
TABLES = ("rows", "flexibility.rows", "flexibility.inputs", "flexibility.outputs")


@pytest.fixture
def model() -> ReducedModel:
    """Nine modes and enrichment modes with rows on single coordinates as carriers."""
    carriers = carried_rows(FULL, 9)
    assert carriers.flexibility is not None
    between = replace(carriers.flexibility, rows=symmetric_part(carriers.flexibility.rows))
    return enriched(FULL, 9).with_carriers(replace(carriers, flexibility=between))


def same(found: ReducedModel, expected: ReducedModel) -> None:
    one, other = npz.record_arrays(found), npz.record_arrays(expected)
    assert set(one) == set(other)
    for name, values in other.items():
        np.testing.assert_array_equal(one[name], values, name)


def test_tables_of_carriers_are_those_of_the_full_model(model: ReducedModel) -> None:
    plain = enriched(FULL, 9)
    assert model.flexibility is not None and plain.flexibility is not None
    for s in np.linspace(*model.domain, 7):
        assert model.rows(s) == pytest.approx(plain.rows(s), abs=1e-12 * np.abs(plain.rows.c).max())
        for name in ("rows", "inputs", "outputs"):
            found, expected = getattr(model.flexibility, name)(s), getattr(plain.flexibility, name)(s)
            assert found == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


def test_what_carriers_tell_is_left_out_and_read_back(model: ReducedModel, tmp_path: Path) -> None:
    with np.load(model.save(tmp_path / "m.npz")) as data:
        names = set(data)
    assert not names & {f"{name}.coefficients" for name in TABLES}
    assert {f"{name}.breaks" for name in TABLES} < names
    assert "carriers.flexibility.rows.triangle" in names and "carriers.flexibility.rows" not in names
    same(ReducedModel.load(tmp_path / "m.npz"), model)


def test_tables_that_are_no_products_are_kept(model: ReducedModel, tmp_path: Path) -> None:
    assert isinstance(model.flexibility, TablesOnDemand)
    G, tables = model.flexibility.rows, model.flexibility.product
    other = replace(model, flexibility=replace(tables, rows=PPoly(1.001 * G.c, G.x)))
    with np.load(other.save(tmp_path / "m.npz")) as data:
        assert {f"{name}.coefficients" for name in TABLES} < set(data)
    same(ReducedModel.load(tmp_path / "m.npz"), other)


def test_a_file_of_version_5_is_read(model: ReducedModel, tmp_path: Path) -> None:
    """It has all arrays, and may have more carriers than coordinates: here twice as many."""
    carriers = model.carriers
    assert carriers is not None and carriers.flexibility is not None
    known, S = carriers.flexibility, np.kron(np.eye(len(carriers.values)), [[1.0], [0.5]])
    twice = replace(known, rows=S @ known.rows @ S.T, inputs=S @ known.inputs, outputs=known.outputs @ S.T)
    touched = {k: 2 * numbers for k, numbers in carriers.touched.items()}
    values, modes = S @ carriers.values, S @ carriers.enrichment
    old = replace(carriers, values=values, touched=touched, enrichment=modes, flexibility=twice, inertia=None)
    header = {"format": "pmr-reduced-model", "version": 5, "units": "SI"}
    arrays = npz.record_arrays(replace(model, carriers=old))
    np.savez(tmp_path / "old.npz", header=np.array(json.dumps(header)), **arrays)
    same(found := ReducedModel.load(tmp_path / "old.npz"), replace(model, carriers=old))
    same(ReducedModel.load(found.save(tmp_path / "new.npz")), found)


@pytest.mark.parametrize(("kind", "sign"), [("triangle", 1.0), ("antitriangle", -1.0)])
def test_a_matrix_is_its_triangle_and_the_sign_of_the_other(model: ReducedModel, kind: str, sign: float) -> None:
    A = np.random.default_rng(1).normal(size=(20, 20))
    assert model.carriers is not None
    carriers = replace(model.carriers, matrices={"rotating x": A + sign * A.T, "other": A})
    arrays = pack_model(replace(model, carriers=carriers), "bodies.0.")
    assert arrays[f"bodies.0.carriers.matrices.rotating x.{kind}"].shape == (210,)
    assert np.array_equal(arrays["bodies.0.carriers.matrices.other"], A)
    assert np.array_equal(unpack_model(arrays, "bodies.0.")["bodies.0.carriers.matrices.rotating x"], A + sign * A.T)


def test_a_damaged_triangle_is_refused_in_one_line(model: ReducedModel, tmp_path: Path) -> None:
    with np.load(model.save(tmp_path / "m.npz")) as data:
        arrays = dict(data)
    arrays["carriers.flexibility.rows.triangle"] = arrays["carriers.flexibility.rows.triangle"][:-1]
    np.savez(tmp_path / "m.npz", **arrays)
    with pytest.raises(InputError, match="is not the shape of a triangle") as caught:
        ReducedModel.load(tmp_path / "m.npz")
    assert len(str(caught.value).splitlines()) == 1


def test_a_table_whose_carriers_are_missing_is_refused_in_one_line(model: ReducedModel, tmp_path: Path) -> None:
    with np.load(model.save(tmp_path / "m.npz")) as data:
        arrays = {name: array for name, array in data.items() if not name.startswith("carriers.")}
    np.savez(tmp_path / "m.npz", **arrays)
    with pytest.raises(InputError, match="not a reduced model") as caught:
        ReducedModel.load(tmp_path / "m.npz")
    assert len(str(caught.value).splitlines()) == 1


def test_a_model_without_carriers_keeps_tables_that_were_made_on_demand(model: ReducedModel, tmp_path: Path) -> None:
    alone = replace(model, carriers=None, enrichment=None)
    same(ReducedModel.load(alone.save(tmp_path / "m.npz")), alone)
