from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from pmr.errors.text import non_finite_names, non_finite_remarks
from pmr.files import npz

DATA: dict[str, Any] = {
    "errors": {"reduced_vs_full": {"tip": math.nan, "beam": 0.5}},
    "list": [1.0, math.inf, {"x": -math.inf}],
    "tuple": (math.nan,),
    "numpy": np.float64("nan"),
    "none": None,
    "text": "NaN",
    "count": 3,
}


def refused(constant: str) -> Any:
    raise ValueError(constant)


def test_numbers_that_are_not_finite_are_null() -> None:
    read = json.loads(npz.json_text(DATA, indent=1), parse_constant=refused)
    assert read == {
        "errors": {"reduced_vs_full": {"tip": None, "beam": 0.5}},
        "list": [1.0, None, {"x": None}],
        "tuple": [None],
        "numpy": None,
        "none": None,
        "text": "NaN",
        "count": 3,
    }


def test_they_are_named() -> None:
    assert list(non_finite_names(DATA)) == ["errors.reduced_vs_full.tip", "list[1]", "list[2].x", "tuple[0]", "numpy"]
    assert non_finite_remarks({"a": 1.0}) == []
    assert non_finite_remarks({"a": math.inf}) == ["a is not finite; in summary.json it is null"]


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(TypeError, match="JSON"):
        npz.json_text({"a": object()})
