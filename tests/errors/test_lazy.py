"""Names that are imported when they are first asked for."""

from __future__ import annotations

import pytest

from pmr.errors import InputError
from pmr.errors.lazy import lazy_names


def test_a_name_is_looked_up_where_it_stands() -> None:
    find = lazy_names("some", {"Refused": "pmr.errors:InputError"})
    assert find("Refused") is InputError


def test_a_name_that_there_is_not_lists_those_that_there_are() -> None:
    with pytest.raises(AttributeError, match="module 'some' has no public name 'd'; there are b, c$"):
        lazy_names("some", {"c": "json:c", "b": "json:b"})("d")


def test_nothing_is_imported_where_it_would_be_in_vain() -> None:
    def missing() -> None:
        raise InputError("environment", "package", "missing", "nothing")

    find = lazy_names("some", {"x": "no_such_module:x"}, before=missing)
    with pytest.raises(InputError):
        find("x")
    with pytest.raises(AttributeError):  # whatever is installed
        find("y")
