"""What a step costs as the model grows: in modes, in the full beam's coordinates, in moving rows, in outputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks import beams
from benchmarks.timing import exponent
from pmr.simulate.modal import ModalForm
from pmr.simulate.native import simulator as march

MODES = (4, 8, 16, 32, 48, 64, 96, 128, 151)
ELEMENTS = (10, 20, 50, 100)
MANY_ELEMENTS = (*ELEMENTS, 200, 400)
ROWS = (1, 2, 3, 4, 5, 6)
OUTPUTS = (1, 4, 16, 51)


def measure(long: bool, repeats: int = 40) -> dict[str, Any]:
    """Nanoseconds of a step, the least of all repeats, and fitted exponents; sizes are taken in turn."""
    elements = MANY_ELEMENTS if long else ELEMENTS
    whole = beams.modal()
    modes = _series({r: (beams.leading(whole, r), 1) for r in MODES}, repeats)
    full = _series({beams.full("evolved", count).size: (beams.modal(count), 1) for count in elements}, repeats)
    rows = _series({m: (beams.leading(beams.modal(50, m), 40), 1) for m in ROWS}, repeats)
    outputs = _series({o: (beams.leading(whole, 20), o) for o in OUTPUTS}, repeats)
    return {
        "modes": modes | {"exponent": _slope(modes, above=32)},
        "full": full | {"exponent": _slope(full, above=100)},
        "rows": rows | {"coordinates": 40},
        "outputs": outputs | {"coordinates": 20},
    }


def _series(forms: dict[int, tuple[ModalForm, int]], repeats: int) -> dict[str, Any]:
    drive = beams.sliding(1500)
    best = dict.fromkeys(forms, np.inf)
    for _ in range(repeats):
        for size, (form, outputs) in forms.items():
            chosen = np.linspace(0, len(form.body.outputs) - 1, outputs).astype(int)
            seen = march.observe(form, drive, outputs=chosen)
            best[size] = min(best[size], seen.seconds / drive.stepping.steps)
    return {"size": list(best), "ns": [1e9 * seconds for seconds in best.values()]}


def _slope(series: dict[str, Any], above: int) -> float:
    """Exponent among the larger sizes, where the loops over modes and not the rest of a step take the time."""
    size, ns = np.array(series["size"], float), np.array(series["ns"])
    return exponent(size[size >= above], ns[size >= above])
