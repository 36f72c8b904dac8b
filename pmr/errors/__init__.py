"""Errors that a user can correct, in one line and with exit code 2; public names imported at their first use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple, TypeVar
from warnings import warn

from pmr.errors.text import escape_controls

Found = TypeVar("Found")
WIDEST = 60  # largest number of letters of a value that a message shows
#: Share of a path's range by which the path may exceed its ends, as measured paths do; the excess is then cut off.
BEYOND_ENDS = 1e-5


class InputError(ValueError):
    """An input is not possible: a value of a scene, of a study, of an option or of a file.

    `source` is the file or the option with the value.  `key` is the dotted key, such as ``body.length``, or empty if
    the error concerns the whole file.  `value` is the value that was read, or None if the message shows no value.
    `allowed` says in words what is accepted.
    """

    def __init__(self, source: str, key: str, value: object, allowed: str) -> None:
        self.source, self.key, self.value, self.allowed = source, key, value, allowed
        super().__init__(self._line())

    def __reduce__(self) -> tuple[type[InputError], tuple[Any, ...]]:
        # Errors are sent between ranks and workers; without this method only the message would be sent.
        return InputError, (self.source, self.key, self.value, self.allowed)

    def with_source(self, source: str) -> InputError:
        """Return this error with the file or the option in which the user wrote the value as its source.

        An error with another source than ``"scene"`` is returned unchanged.
        """
        return InputError(source, self.key, self.value, self.allowed) if self.source == "scene" else self

    def with_key(self, key: str) -> InputError:
        """Return this error with the key as it is written in the file of the scene.

        An error with another source than ``"scene"`` is returned unchanged.
        """
        return InputError(self.source, key, self.value, self.allowed) if self.source == "scene" else self

    def _line(self) -> str:
        """Return the message in one line: source, key, value and what is allowed."""
        text = repr(self.value)
        shown = "" if self.value is None else f" = {text if len(text) <= WIDEST else f'{text[: WIDEST - 3]}...'}"
        where = f"{self.source}: {self.key}{shown}" if self.key else f"{self.source}{shown}"
        return escape_controls(" ".join(f"{where}: {self.allowed}".split()))


class NotHeldError(InputError):
    """A part can move freely; `short` is a clause that names it, such as ``"middle and fly can move along y"``."""

    def __init__(self, source: str, key: str, value: object, allowed: str, short: str) -> None:
        super().__init__(source, key, value, allowed)
        self.short = short

    def __reduce__(self) -> tuple[type[InputError], tuple[Any, ...]]:
        return NotHeldError, (self.source, self.key, self.value, self.allowed, self.short)


class SimulationError(RuntimeError):
    """A simulation stopped before its end, or its result is not finite."""


class GrowthError(SimulationError):
    """A motion grows without bound: most of its energy comes neither from loads nor from moving constraints.

    `rigid_rows` are the names of the rigid constraints that move, whose multipliers may cause the growth.
    """

    def __init__(self, message: str, rigid_rows: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.rigid_rows = rigid_rows

    def refusal(self, step: float, rho_inf: float) -> InputError:
        """Return this error as an InputError that names the key to change.

        It is time.step, time.rho_inf or reduction.flexibility.

        `step` is the scene's time step in s, and `rho_inf` its spectral radius at infinite frequency.
        """
        key, value, allowed = "time.step", step, "a smaller one is allowed"
        if self.rigid_rows and rho_inf > 0.0:
            key, value = "time.rho_inf", rho_inf
        elif self.rigid_rows:
            return InputError("scene", "reduction.flexibility", False, f"true is allowed: {self}")
        return InputError("scene", key, value, f"{allowed}: {self}")


class ConvergenceError(RuntimeError):
    """An iterative solver did not reach its tolerance; the message says what to change."""


class TooManyModesError(ConvergenceError):
    """More modes were requested (`count`) than the model has (`most`)."""

    def __init__(self, count: int, most: int) -> None:
        super().__init__(
            f"{count} modes asked for, but the model has {most} free coordinates; ask for fewer modes or refine the "
            "mesh"
        )
        self.count, self.most = count, most

    def __reduce__(self) -> tuple[type[TooManyModesError], tuple[int, ...]]:
        return TooManyModesError, (self.count, self.most)


def call_on_first_rank(comm: Any, make: Callable[[], Found]) -> Found | None:
    """Call `make` on rank 0; return its result on rank 0 and None on the other ranks.

    Collective: all ranks have to call it.

    An InputError, SimulationError or ConvergenceError on rank 0 is raised on all ranks; otherwise the other ranks would
    wait for rank 0 in their next exchange.
    """
    result, refused = None, None
    if comm.rank == 0:
        try:
            result = make()
        except (InputError, SimulationError, ConvergenceError) as error:
            refused = error
    refused = comm.bcast(refused)
    if refused is not None:
        raise refused
    return result


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
