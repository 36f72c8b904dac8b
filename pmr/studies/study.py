"""Keys that all study files share; each kind of study adds keys of its own and its plan."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from pmr.scene.keys import SceneTable
from pmr.studies.tasks import Plan, Scalar

if TYPE_CHECKING:
    from pmr.studies.results import StudyResults

Count = Annotated[int, Field(ge=1, strict=True)]


class Statement(SceneTable):
    """Published statement with which a figure of the study is compared."""

    figure: str = Field(description="Name of the study's own figure")
    text: str = Field(description="What it is")
    value: float | str | None = Field(
        default=None, description="What is published, in SI units, per cent as a fraction"
    )
    words: str = Field(default="", description="As it is published, where a number alone would say too much")
    quantity: Literal["share", "length", "energy", "seconds", "ratio", "number"] = Field(
        default="number",
        description="How it is printed: a share in per cent, a quantity in its SI unit, or a plain number",
    )
    is_error: bool = Field(default=False, description="Whether smaller is better")
    why: str = Field(default="", description="Why the two differ, as far as is known")


class StudyBase(SceneTable):
    """A study: settings of its runs, validated and frozen.

    A kind is a module of `pmr.studies.kinds` with a class ``Study`` derived from this class; the type of its key
    ``kind`` is a Literal of the module's name.
    """

    kind: str = Field(description="Kind of study")
    title: str = Field(description="For reports")
    source: str = Field(default="", description="Publication with which the study is compared")
    published: tuple[Statement, ...] = Field(default=(), description="Published values of figures of this study")
    remarks: tuple[str, ...] = Field(default=(), description="Remarks on the results, for the report")

    @abstractmethod
    def plan(self) -> Plan:
        """Return the tasks of the study; every key that can be refused is refused here, before a task runs.

        Raises InputError with source ``"study"`` for a key of the study file; whoever reads the file replaces the
        source by the file's name.
        """

    def hints(self) -> list[str]:
        """Return a line for each key of the study with a number outside its usual range, perhaps in a wrong unit."""
        return []

    def figures(self, results: StudyResults) -> Mapping[str, Scalar]:
        """Return numbers about all runs together, by name, for ``figures`` in summary.json.

        The method is called when all runs are done.
        """
        return {}

    def tables(self, results: StudyResults) -> Mapping[str, str | bytes]:
        """Return the contents of further tables of the finished runs, by file name.

        For an empty content no file is written, and an old file is deleted.
        """
        return {}

    def summary_line(self, results: StudyResults) -> str:
        """Return the main result in one line for the terminal, or an empty text; called when all runs are done."""
        return ""
