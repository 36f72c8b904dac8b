"""Verdict on one mutation."""

import json
import signal
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmr import ConvergenceError, InputError, SimulationError
from pmr.errors import escape_controls

LONGEST = 60.0  # s of processor time that one may take; they take one or two, on a slow machine several
PATIENCE = 1200  # s of wall time, on a machine that others use too


@dataclass(frozen=True)
class Verdict:
    """Verdict: `kind` is ``ran`` or ``refused`` (one line and exit code 2); everything else is a fault.

    ``failed``: a solver gave up; ``traceback``; ``nonsense``: an impossible result without a warning; ``slow``;
    ``died``: the process ended or hung.
    """

    number: int
    kind: str
    seconds: float
    detail: str = ""

    @property
    def is_sound(self) -> bool:
        """Whether the mutation ran or was refused."""
        return self.kind in ("ran", "refused")


class NonsenseError(Exception):
    """A result is impossible."""


class TooSlowError(BaseException):
    """The mutation takes too long; no ``except Exception`` catches this."""


def judged(number: int, run: Callable[[], Any]) -> Verdict:
    """Run a function and return the verdict on it."""

    def ring(*_: Any) -> None:
        """Raise TooSlowError when the time is over."""
        raise TooSlowError

    signal.signal(signal.SIGALRM, ring)
    signal.alarm(PATIENCE)
    start = time.process_time()
    try:
        kind, detail = "ran", str(run() or "")
    except InputError as error:
        kind, detail = "refused", str(error)
        if escape_controls(detail) != detail or not detail:
            kind = "nonsense"
    except (ConvergenceError, SimulationError) as error:
        kind, detail = "failed", str(error)
    except NonsenseError as error:
        kind, detail = "nonsense", str(error)
    except TooSlowError:
        kind, detail = "slow", traceback.format_exc(limit=-3)
    except BaseException:
        kind, detail = "traceback", traceback.format_exc(limit=-6)
    finally:
        signal.alarm(0)
    seconds = time.process_time() - start
    if kind in ("ran", "refused", "failed") and seconds > LONGEST:
        kind, detail = "slow", f"{seconds:.1f} s: {kind} {detail}"
    return Verdict(number, kind, seconds, detail[:3000])


def ensure_finite(name: str, array: Any) -> None:
    """Raise NonsenseError unless all entries are finite."""
    if not np.isfinite(array).all():
        raise NonsenseError(f"{name} is not finite")


def strictly_read(text: str) -> Any:
    """Read JSON as other readers do.

    Raises
    ------
    NonsenseError
        If it contains NaN or an infinity.
    """

    def refuse(constant: str) -> None:
        """Raise NonsenseError for a constant that JSON does not have."""
        raise NonsenseError(f"{constant} in JSON")

    return json.loads(text, parse_constant=refuse)
