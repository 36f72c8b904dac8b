"""What runs and studies leave in their folders: results as objects, tables in CSV, frames of pandas."""

from pmr.fields.series import Fields
from pmr.results.boom import BoomFrequencies, BoomResult, FrequencyMap
from pmr.results.frames import load
from pmr.results.run import RESULT_FILES, Energy, FrequencyCurves, FrequencyResponse, Response, RunResult, Shapes

__all__ = [
    "RESULT_FILES",
    "BoomFrequencies",
    "BoomResult",
    "Energy",
    "Fields",
    "FrequencyCurves",
    "FrequencyMap",
    "FrequencyResponse",
    "Response",
    "RunResult",
    "Shapes",
    "load",
]
