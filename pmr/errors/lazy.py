"""Public names of a package whose modules are imported at their first use, and names of earlier versions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple
from warnings import warn


class FormerName(NamedTuple):
    """Present name of an object that had another public name, and the version of pmr that removes this earlier name."""

    now: str
    until: str


#: Present names of objects of `pmr`, by the public names that they had in earlier versions.
FORMER: Mapping[str, FormerName] = {}


def lazy_names(
    package: str,
    places: Mapping[str, str],
    before: Callable[[], object] | None = None,
    former: Mapping[str, FormerName] | None = None,
) -> Callable[[str], Any]:
    """Return a function to be used as ``__getattr__`` of a package, which imports public names at their first use.

    `places` maps each public name to its object, written ``module:name``.  `before` is called before a module is
    imported; it raises an error if the import would fail.  For a name in `former` the function returns the object of
    the present name, with a DeprecationWarning.  For any other name it raises AttributeError, which lists the names.
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
