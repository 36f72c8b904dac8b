"""What files hold of dataclasses, and files that earlier versions wrote."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.errors import InputError
from pmr.files.npz import record_arrays, record_from_arrays
from pmr.results.field_series import Fields
from pmr.simulation.petsc.checkpoint import Checkpoint, load
from pmr.studies.results import Store
from pmr.system.reduced_model import ReducedModel

EARLIER = Path(__file__).parent / "earlier"  # written by the last commit that named arrays otherwise


@dataclass(frozen=True)
class Part:
    table: PPoly
    scale: float = 1.0


@dataclass(frozen=True)
class Whole:
    M: NDArray[np.float64]
    few: NDArray[np.float32]
    names: tuple[str, ...]
    part: Part
    groups: Mapping[str, NDArray[np.int64]]
    notes: dict[str, Any] = field(default_factory=dict)
    count: int = 0
    kept: bool = False
    other: Part | None = None
    pads: NDArray[np.float64] | None = None


def whole(**change: Any) -> Whole:
    table = PPoly(np.arange(12.0).reshape(2, 2, 3), [0.0, 1.0, 4.0])
    values = {"M": np.eye(2), "few": np.float32([1.5]), "names": ("a", "\u00e4 b"), "part": Part(table, 2.5)}
    return Whole(**(values | {"groups": {"left": np.array([1, 2])}, "notes": {"x": [1, None]}, "count": 3} | change))


@pytest.mark.parametrize("change", [{}, {"names": (), "groups": {}}, {"other": whole().part, "pads": np.ones(2)}])
def test_a_dataclass_is_its_arrays(change: dict) -> None:
    expected = whole(**change)
    named = record_arrays(expected, "a.")
    found = record_from_arrays(Whole, {"b.M": np.zeros(3), **named}, "a.")
    assert record_arrays(found, "a.").keys() == named.keys()
    for name, array in record_arrays(found, "a.").items():
        assert np.array_equal(array, named[name]) and array.dtype == named[name].dtype, name
    for name in ("names", "notes", "count", "kept"):
        assert getattr(found, name) == getattr(expected, name)
    assert (found.other is None) == (expected.other is None) and found.part.scale == 2.5


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"M": None}, KeyError),
        ({"part.table.breaks": None}, KeyError),
        ({"part.scale": np.ones(2)}, ValueError),
        ({"names": np.array("ab")}, TypeError),
        ({"names": np.ones(2)}, TypeError),
        ({"notes": np.array("[]")}, TypeError),
        ({"M": np.array(["soft"])}, ValueError),
    ],
)
def test_what_is_missing_or_of_another_type_is_refused(change: dict, error: type[Exception]) -> None:
    named = {name: array for name, array in (record_arrays(whole()) | change).items() if array is not None}
    with pytest.raises(error):
        record_from_arrays(Whole, named)


def test_a_reduced_model_of_version_4_is_read(tmp_path: Path) -> None:
    with np.load(EARLIER / "reduced.npz") as data:
        np.savez(tmp_path / "kept.npz", **{name: data[name] for name in data} | {"inertia.kept": np.asarray(True)})
    with pytest.raises(InputError, match="more coordinates have the same effect"):  # which kept its residual inertia
        ReducedModel.load(tmp_path / "kept.npz")
    model = ReducedModel.load(EARLIER / "reduced.npz")
    assert (model.input_names, model.row_names, model.left_out) == (("force",), ("slider",), ("support",))
    assert (model.output_names, model.output_units) == (("middle", "tip"), ("m", "m"))
    assert model.provenance == {"scene_hash": "abc"} and np.array_equal(model.K, np.diag([1.0, 4.0]))
    assert model.pads == [1e-6] and model.clearance == [2e-3] and model.rayleigh and model.rayleigh.alpha == 0.1
    assert np.array_equal(model.rows.c, np.arange(8.0).reshape(2, 2, 1, 2)) and model.domain == (0.0, 2.5)
    assert model.flexibility and model.enrichment
    assert np.array_equal(model.flexibility.inputs.c[:, :, 0, 0], [[3.0, 4.0], [5.0, 6.0]])
    assert np.array_equal(model.enrichment.rows.c[:, :, 0, 0], [[7.0, 8.0], [9.0, 10.0]])
    assert model.enrichment.stiffness == [9.0] and np.array_equal(model.enrichment.outputs, [[1.0], [2.0]])


def test_fields_and_results_of_version_1_are_read_and_checkpoints_refused() -> None:
    fields = Fields.load(EARLIER / "fields.npz")
    assert fields.grid.region(0) == "left" and fields.kind == "line" and fields.displacement.dtype == np.float32
    assert np.array_equal(fields.von_mises["top"], [[1.0], [2.0]]) and fields.displacement[1, 1, 2] == 11.0
    with pytest.raises(InputError, match="checkpoint.npz: a checkpoint is allowed, this is none"):
        load(Checkpoint(EARLIER / "checkpoint.npz"), {"n": 2, "norms": [1.0, 2.0]})
    stored = Store(EARLIER).read("abc")
    assert stored.warnings == ("a note",)
    assert stored.record == {"error": 0.5, "name": "a"}
    assert np.array_equal(stored.arrays["t"], np.arange(3.0)) and stored.seconds == {"march": 0.1}
    assert Store(EARLIER).is_sound("abc") and not Store(EARLIER).is_sound("reduced")
