"""Both cases of the paper in every way there is: how long, how many times faster, and the same trajectory?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import beams
from benchmarks.timing import Times, side_by_side
from pmr.body import SlidingBody, Trajectory, displacement
from pmr.simulate import exudyn, march
from pmr.simulate.modal import ModalForm, modal_form
from pmr.simulate.stepping import loads_at

Array = NDArray[np.float64]

#: Part of the time span for which the full beam is simulated in the paper's way: the whole takes minutes.
SHARE = 0.02
#: The compiled simulator takes milliseconds: so many runs count as one, the quickest of them.
MARCHES = 10


def measure(name: str, repeats: int, share: float = SHARE) -> dict[str, Any]:
    """One case: seconds for the whole time span by size and way, ratios, and largest differences in m."""
    sizes = {"reduced": _size(name, beams.reduced(name), beams.reduced(name), 1.0, repeats),
             "full": _size(name, beams.full(name), beams.dense(name), share, repeats)}  # fmt: skip
    return {"coordinates": {"reduced": beams.reduced(name).size, "full": beams.full(name).size}, **sizes}


def small(repeats: int) -> dict[str, Any]:
    """Six coordinates in the evolved case: seconds for its time span with all outputs of all steps, and the tip's."""
    drive, found = beams.drive("evolved"), {}
    forms = {"POD": modal_form(beams.plain(6)), "residual flexibility": modal_form(beams.flexible(6))}
    ways: dict[str, Callable[[], float]] = {}
    for name, form in forms.items():
        count = len(form.body.outputs)
        for outputs, chosen in {f"{count} outputs": list(range(count)), "tip": [count - 1]}.items():
            ways[f"{name}, {outputs}"] = partial(_observe, form, drive, chosen)
    for name, times in side_by_side(ways, MARCHES * repeats).items():
        found[name] = times.summary()
    return {"steps": drive.stepping.steps, "span": drive.stepping.end, "seconds": found}


def _observe(form: ModalForm, drive: beams.Drive, chosen: Sequence[int]) -> float:
    return march.observe(form, drive.path, drive.loads, drive.stepping, outputs=chosen).seconds


def _size(name: str, body: SlidingBody, as_in_paper: SlidingBody, share: float, repeats: int) -> dict[str, Any]:
    drive, form = beams.drive(name), modal_form(body)
    part = drive.shorter(share)
    found: dict[str, Array] = {}

    def by(way: str, simulate: Callable[..., Trajectory], body: SlidingBody, drive: beams.Drive) -> Callable[[], float]:
        def run() -> float:
            trajectory = simulate(body, drive.path, drive.loads, drive.stepping)
            found[way] = _outputs(body, trajectory, drive)
            return trajectory.seconds

        return run

    def quickest(run: Callable[[], float]) -> Callable[[], float]:
        return lambda: min(run() for _ in range(MARCHES))

    def observed() -> float:
        seen = march.observe(form, drive.path, drive.loads, drive.stepping)
        found["march, outputs only"] = seen.y
        return seen.seconds

    def modal() -> float:
        return march.simulate_modal(form, drive.path, drive.loads, drive.stepping).seconds

    march.simulate(body, drive.path, drive.loads, drive.shorter(0.001).stepping)  # compiled before the clock runs
    found["march"] = _outputs(body, march.simulate(body, drive.path, drive.loads, drive.stepping), drive)
    times = side_by_side(
        {
            "callbacks": by("callbacks", exudyn.simulate_with_callbacks, as_in_paper, part),
            "updates": by("updates", exudyn.simulate, body, drive),
            "march": quickest(modal),
            "march, outputs only": quickest(observed),
        },
        repeats,
    )
    times["callbacks"] = times["callbacks"].times(1.0 / share)
    return {
        "share_of_span": {"callbacks": share},
        "seconds": {way: taken.summary() for way, taken in times.items()},
        "ratio": {way: _ratio(times[way], times["march"]) for way in ("callbacks", "updates")},
        "difference": {way: _difference(found[way], found["march"]) for way in found if way != "march"},
    }


def _outputs(body: SlidingBody, trajectory: Trajectory, drive: beams.Drive) -> Array:
    f = loads_at(drive.loads, trajectory.t)
    return displacement(body, trajectory.q, trajectory.s, trajectory.multipliers, f)


def _ratio(slow: Times, fast: Times) -> dict[str, float]:
    return {"of_min": slow.least / fast.least, "of_median": slow.median / fast.median}


def _difference(a: Array, b: Array) -> float:
    return float(np.abs(a - b[: len(a)]).max())
