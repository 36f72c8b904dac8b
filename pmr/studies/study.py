"""What a study file may say, whatever its kind; a kind adds its own keys and its plan."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from pmr.scene.keys import Section
from pmr.studies.tasks import Plan, Scalar

if TYPE_CHECKING:
    from pmr.studies.results import StudyResults

Count = Annotated[int, Field(ge=1, strict=True)]


class Statement(Section):
    """Statement of a publication about something that the study finds out too."""

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


class StudyBase(Section):
    """A study: what is varied, validated and frozen.

    A kind is a module of `pmr.studies.kinds` with a class ``Study`` derived from this one, whose ``kind`` is a Literal
    of the module's name.
    """

    kind: str = Field(description="Kind of study")
    title: str = Field(description="For reports")
    source: str = Field(default="", description="Publication with which the study is compared")
    published: tuple[Statement, ...] = Field(default=(), description="Published values of figures of this study")
    remarks: tuple[str, ...] = Field(default=(), description="Remarks on the results, for the report")

    @abstractmethod
    def plan(self) -> Plan:
        """The tasks; everything that can be refused is refused here, before anything runs.

        Raises InputError with source ``"study"`` for a key of the study file; the reader of the file replaces it.
        """

    def hints(self) -> list[str]:
        """A sentence for each key of the study whose number is not usual, as one in another unit is."""
        return []

    def figures(self, results: StudyResults) -> Mapping[str, Scalar]:
        """Figures of all runs together, once they are there: they go into summary.json, for reports."""
        return {}

    def tables(self, results: StudyResults) -> Mapping[str, str]:
        """Further tables of the runs that are done, by the names of their files, as text.

        An old file of a table without text goes.
        """
        return {}

    def summary_line(self, results: StudyResults) -> str:
        """The main result in one line for the terminal, once all runs are there; empty without one."""
        return ""
