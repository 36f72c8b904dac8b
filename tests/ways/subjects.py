"""A scene of a kind, what `pmr run` says of it, and the ways to use it: each is right or raises `Refused`."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from ways.kinds import Kind

import pmr
from pmr.cli.app import main
from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.system.system import System

Array = NDArray[np.float64]


class Refused(Exception):  # noqa: N818  (what a user reads, no fault)
    """In one line, by exit code 2 or an `InputError`."""


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """What Python refuses."""
    try:
        yield
    except InputError as error:
        raise Refused(str(error)) from None


def command(*arguments: str) -> str:
    """What a command prints; it ends with 0, or with 2 and one line, a study's with 1 and why each run failed."""
    out, err, argv = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["pmr", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            main()
    except SystemExit as left:
        code = left.code or 0
    finally:
        sys.argv = argv
    if code == 2 and err.getvalue().count("\n") == 1:
        raise Refused(err.getvalue().strip())
    if code == 1 and (why := [line for line in err.getvalue().splitlines() if "InputError: " in line]):
        raise Refused(why[0])  # behind lines of progress, if the study took a while
    assert code == 0, err.getvalue()
    return out.getvalue()


@dataclass(frozen=True)
class Subject:
    """A kind in a folder of its own."""

    kind: Kind
    folder: Path

    @cached_property
    def file(self) -> Path:
        return self.kind.written(self.folder)

    @cached_property
    def scene(self) -> pmr.scene.Scene:
        return pmr.load_scene(self.file)

    @cached_property
    def outcome(self) -> pmr.pipeline.Outcome:
        found = pmr.run(self.scene)
        assert found is not None
        return found

    @property
    def response(self) -> pmr.results.Response:
        return self.outcome.result.responses["reduced"]

    @cached_property
    def models(self) -> dict[str, Path]:
        """Reduced models as `pmr run` leaves them."""
        reduced = self.outcome.reduced
        named = {"reduced": reduced} if isinstance(reduced, ReducedModel) else reduced
        return {name: model.save(self.folder / f"{name}.npz") for name, model in named.items()}

    @cached_property
    def system_file(self) -> Path:
        """What `pmr run` leaves: reduced.npz, or system.npz of sections."""
        return self.outcome.save(self.out("saved"))

    @cached_property
    def system(self) -> System:
        """What `pmr run` leaves, read again."""
        return System.load(self.system_file)

    @property
    def at(self) -> dict[str, float]:
        """Where its paths are held."""
        return dict.fromkeys(self.system.paths, self.kind.at)

    def out(self, name: str) -> Path:
        """A place to write to."""
        place = self.folder / name
        place.mkdir(exist_ok=True)
        return place

    def stored(self, folder: Path) -> tuple[Array, Array]:
        """Displacements and forces of a run's folder."""
        with np.load(folder / "trajectories.npz") as found:
            return found["reduced.displacement"], found["reduced.slider_force"]

    def assert_same(self, displacement: Array, forces: Array, within: float = 0.0, forces_within: float = 0.0) -> None:
        """As `pmr.run` has it, up to shares of the largest."""
        expected = self.response
        for found, own, share in (
            (displacement, expected.displacement, within),
            (forces, expected.slider_force, forces_within),
        ):
            assert np.abs(own).max() > 0.0
            np.testing.assert_allclose(found, own, rtol=0.0, atol=share * np.abs(own).max())
