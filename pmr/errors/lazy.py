"""Public names of a package that are imported when they are first used, and names of earlier versions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple
from warnings import warn


class FormerName(NamedTuple):
    """Present name of a public name of earlier versions, and the version that removes the old one."""

    now: str
    until: str


#: Public names of earlier versions of `pmr` that have another name now.
FORMER: Mapping[str, FormerName] = {}


def lazy_names(
    package: str,
    places: Mapping[str, str],
    before: Callable[[], object] | None = None,
    former: Mapping[str, FormerName] | None = None,
) -> Callable[[str], Any]:
    """Return the function `__getattr__` of a package with public names at `places`, each ``module:name``.

    `before` is called before a module is imported; it raises an error if the import would fail.  A name in `former`
    gives the object of its present name and a DeprecationWarning.  For any other name the function raises
    AttributeError, which lists the names.
    """

    def find(name: str) -> Any:
        if former and name in former:
            now, until = former[name]
            warn(f"{package}.{name} is called {package}.{now} now; {until} has the old name no more",
                 DeprecationWarning, stacklevel=2)  # fmt: skip
            name = now
        if name not in places:
            raise AttributeError(
                f"module {package!r} has no public name {name!r}; there are {', '.join(sorted(places))}"
            )
        if before is not None:
            before()
        module, _, attribute = places[name].partition(":")
        return getattr(import_module(module), attribute)

    return find
