"""Scene of a kind with the results of `pmr run`, which every way to use it is compared with or raises `Refused`."""

import contextlib
import io
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from ways.kinds import Kind

import pmr
import pmr.pipeline
from pmr import InputError, ReducedModel, System
from pmr.cli import main
from pmr.files.arrays import Array


class Refused(Exception):  # noqa: N818  (what a user reads, no fault)
    """A way was refused in one line, by exit code 2 or an `InputError`."""


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Raise `Refused` for an `InputError` within a ``with``."""
    try:
        yield
    except InputError as error:
        raise Refused(str(error)) from None


def command(*arguments: str) -> str:
    """Run the command `pmr` and return what it prints; raise `Refused` for exit code 2 with one line.

    A study with exit code 1 raises it too if it names an `InputError`; any other code than 0 fails.
    """
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
    """Scene of a kind in a folder of its own."""

    kind: Kind
    folder: Path

    @cached_property
    def file(self) -> Path:
        """Path of the scene file."""
        return self.kind.written(self.folder)

    @cached_property
    def scene(self) -> pmr.scene.Scene:
        """Scene as it is loaded."""
        return pmr.load_scene(self.file)

    @cached_property
    def outcome(self) -> pmr.pipeline.Outcome:
        """Outcome of a run of the scene."""
        found = pmr.run(self.scene)
        assert found is not None
        return found

    @property
    def response(self) -> pmr.results.Response:
        """Response of the reduced model in this run."""
        return self.outcome.result.responses["reduced"]

    @cached_property
    def models(self) -> dict[str, Path]:
        """Reduced models that `pmr run` saves, by name."""
        reduced = self.outcome.reduced
        named = {"reduced": reduced} if isinstance(reduced, ReducedModel) else reduced
        return {name: model.save(self.folder / f"{name}.npz") for name, model in named.items()}

    @cached_property
    def system_file(self) -> Path:
        """Path of what `pmr run` saves: reduced.npz, or system.npz of sections."""
        return self.outcome.save(self.out("saved"))

    @cached_property
    def system(self) -> System:
        """System that `pmr run` saves, loaded again."""
        return System.load(self.system_file)

    @property
    def at(self) -> dict[str, float]:
        """Positions in m at which the paths are held."""
        return dict.fromkeys(self.system.paths, self.kind.at)

    def out(self, name: str) -> Path:
        """Folder to write to, made if need be."""
        place = self.folder / name
        place.mkdir(exist_ok=True)
        return place

    def stored(self, folder: Path) -> tuple[Array, Array]:
        """Displacements and forces in the folder of a run."""
        with np.load(folder / "trajectories.npz") as found:
            return found["reduced.displacement"], found["reduced.slider_force"]

    def assert_same(self, displacement: Array, forces: Array, within: float = 0.0, forces_within: float = 0.0) -> None:
        """Fail unless displacements and forces are those of the run, up to shares of their largest values."""
        expected = self.response
        for found, own, share in (
            (displacement, expected.displacement, within),
            (forces, expected.slider_force, forces_within),
        ):
            assert np.abs(own).max() > 0.0
            np.testing.assert_allclose(found, own, rtol=0.0, atol=share * np.abs(own).max())
