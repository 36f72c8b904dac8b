"""One case of each fault, for a test of the code that judges them."""

import os
from pathlib import Path

from fuzz.mutations import Random
from fuzz.verdict import NonsenseError, ensure_finite, strictly_read

from pmr import InputError, SimulationError

KINDS = ["ran", "refused", "traceback", "died", "failed", "nonsense", "nonsense", "nonsense", "nonsense"]


def case(number: int, rng: Random, folder: Path) -> str:
    """Do what `KINDS` says of the number."""
    if number == 1:
        raise InputError("scene", "key", 1, "2 is allowed")
    if number == 2:
        raise KeyError("key")
    if number == 3:
        os._exit(3)
    if number == 4:
        raise SimulationError("it did not end")
    if number == 5:
        raise NonsenseError("what can't be")
    if number == 6:
        ensure_finite("x", [1.0, float("nan")])
    if number == 7:
        strictly_read('{"a": Infinity}')
    if number == 8:
        error = InputError("scene", "key", 1, "2 is allowed")
        error.args = ("two\nlines",)
        raise error
    return "fine"
