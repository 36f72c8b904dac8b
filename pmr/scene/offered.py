"""Keys whose value is one of our own words, or the name of what an installed package offers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pydantic import PlainSerializer, WrapValidator

from pmr.errors import plugins

#: Of such a value, which is none of the own words, perhaps.
AS_WORD = PlainSerializer(str)


def or_offered(group: str) -> WrapValidator:
    """For ``Annotated[Literal[...], or_offered(group), AS_WORD]``: names of a group's entry points are allowed, too."""

    def check(data: Any, check_literal: Callable[[Any], Any]) -> Any:
        return data if isinstance(data, str) and data in plugins.plugin_names(group) else check_literal(data)

    return WrapValidator(check)
