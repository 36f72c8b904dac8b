"""Results that runs and studies leave in their folders: as objects, as tables in CSV, and as data frames of pandas."""

from pmr.results.field_series import Fields
from pmr.results.response import Energy, Response
from pmr.results.run import (
    RESULT_FILES,
    BodyResult,
    Frequencies,
    FrequencyMap,
    FrequencyResponse,
    Loads,
    Paths,
    RunResult,
    Shapes,
)
from pmr.results.tables import load

__all__ = [
    "RESULT_FILES",
    "BodyResult",
    "Energy",
    "Fields",
    "Frequencies",
    "FrequencyMap",
    "FrequencyResponse",
    "Loads",
    "Paths",
    "Response",
    "RunResult",
    "Shapes",
    "load",
]
