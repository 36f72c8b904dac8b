"""Names of a package that are imported when they are first asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def names_from(
    package: str, places: Mapping[str, str], before: Callable[[], object] | None = None
) -> Callable[[str], Any]:
    """`__getattr__` of a package whose names stand at `places`, each ``module:name``.

    `before` is called before a module is imported, and raises where that would be in vain.  An AttributeError that
    lists the names is raised where one is not among them.
    """

    def find(name: str) -> Any:
        if name not in places:
            raise AttributeError(
                f"module {package!r} has no public name {name!r}; there are {', '.join(sorted(places))}"
            )
        if before is not None:
            before()
        module, _, attribute = places[name].partition(":")
        return getattr(import_module(module), attribute)

    return find
