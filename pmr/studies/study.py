"""What a study file may say, whatever its kind; a kind adds its own keys and its plan."""

from __future__ import annotations

from abc import abstractmethod

from pydantic import BaseModel, ConfigDict

from pmr.studies.task import Plan


class StudyBase(BaseModel):
    """A study: what is varied, validated and frozen.

    A kind is a module of `pmr.studies.kinds` with a class ``Study`` derived from this one, whose ``kind`` is a Literal
    of the module's name.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: str
    title: str

    @abstractmethod
    def plan(self) -> Plan:
        """The tasks; everything that can be refused is refused here, before anything runs.

        Raises
        ------
        InputError
            With source ``"study"`` for a key of the study file; the reader of the file replaces it.
        """
