from __future__ import annotations

import pytest

from pmr.errors import InputError
from pmr.scene.tomlfiles import Change
from pmr.studies.kinds.scenes import grid_points


def test_all_combinations_the_last_list_fastest() -> None:
    found = list(grid_points({"reduction": {"modes": [4, 6], "product": ["mass"]}, "time": {"rho_inf": [0.5, 0.9]}}))
    assert [point.words for point in found[:2]] == [
        ("modes=4", "product=mass", "rho_inf=0.5"),
        ("modes=4", "product=mass", "rho_inf=0.9"),
    ]
    assert found[3].parameters == {"reduction.modes": 6, "reduction.product": "mass", "time.rho_inf": 0.9}
    assert found[3].changes[0] == Change({"reduction": {"modes": 6}}, "grid")


def test_no_grid_is_one_point_without_changes() -> None:
    (point,) = grid_points({})
    assert (point.changes, point.words, point.parameters) == ((), (), {})


def test_names_are_as_long_as_they_must_be() -> None:
    grid = {"mesh": {"elements": [1]}, "compare": {"ancf_elements": [1]}, "load": {"at": [1]}, "support": {"at": [2]}}
    (point,) = grid_points(grid)
    assert point.words == ("elements=1", "ancf_elements=1", "load.at=1", "support.at=2")


def test_a_value_that_fits_no_file_name_goes_by_its_number() -> None:
    paths = [{"kind": "constant", "amount": 2.0}, "a/b", [1.0, 2.0]]
    found = list(grid_points({"slider": {"path": [{"kind": "ramp"}, *paths[1:]]}}))
    assert next(grid_points({"body": {"axial": [True]}})).words == ("axial=true",)
    assert [point.words for point in found] == [("path=no1",), ("path=no2",), ("path=no3",)]
    assert (
        found[0].parameters == {"slider.path": '{"kind": "ramp"}'}
        and found[2].parameters["slider.path"] == "[1.0, 2.0]"
    )


@pytest.mark.parametrize("value", [3, "text", []])
def test_anything_but_a_list_with_values_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"grid\.reduction\.modes.*a list of values"):
        list(grid_points({"reduction": {"modes": value}}))
