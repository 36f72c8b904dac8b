"""Names of a package that are imported when they are first asked for; those that have another name now."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple
from warnings import warn


class Former(NamedTuple):
    """Present name of a public name of earlier versions, and the version in which the old one goes."""

    now: str
    until: str


#: Public names of `pmr` that have another name now, by the old one: the one place where one is said to go.
FORMER: Mapping[str, Former] = {}


def names_from(
    package: str,
    places: Mapping[str, str],
    before: Callable[[], object] | None = None,
    former: Mapping[str, Former] | None = None,
) -> Callable[[str], Any]:
    """`__getattr__` of a package whose names stand at `places`, each ``module:name``.

    `before` is called before a module is imported, and raises where that would be in vain.  One of the `former` names
    is answered with what it is called now, and a DeprecationWarning that has both.  An AttributeError that lists the
    names is raised where one is not among them.
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
