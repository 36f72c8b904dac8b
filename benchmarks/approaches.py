"""Measure both cases of the paper by each simulator: times, their ratios, and differences between trajectories."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import beams
from benchmarks.timing import Times, side_by_side
from pmr.compare.errors import relative_error
from pmr.simulation import Excitation, SystemSimulator
from pmr.simulation.exudyn import simulator as exudyn
from pmr.simulation.modal import ModalForm, modal_form
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.system.body import SlidingBody
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]

#: Part of the time span for which the full beam is simulated in the paper's way: the whole takes minutes.
SHARE = 0.02
#: The compiled simulator takes milliseconds: so many runs count as one, the middle one of them.
MARCHES = 10

#: The paper's way, with a new Jacobian in each iteration, and with one that is kept while Newton's method converges.
CALLBACKS = partial(exudyn.simulate_system, formulation="callbacks")
MODIFIED = partial(exudyn.simulate_system, formulation="callbacks-modified-newton")


def measure(name: str, repeats: int, share: float = SHARE) -> dict[str, Any]:
    """Measure one case of the paper with the reduced and the full model.

    Return for each model the seconds for the whole time span by simulator, ratios to `march`, and largest differences
    in m.  With the full model the paper's simulator runs only the share `share` of the span; its time is extrapolated.
    """
    sizes = {"reduced": _size(name, beams.reduced(name), beams.reduced(name), 1.0, repeats),
             "full": _size(name, beams.full(name), beams.dense(name), share, repeats)}  # fmt: skip
    return {"coordinates": {"reduced": beams.reduced(name).size, "full": beams.full(name).size}, **sizes}


def small(repeats: int) -> dict[str, Any]:
    """Measure six coordinates in the evolved case: seconds for its time span with all outputs, and with the tip's."""
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


def in_exudyn(repeats: int) -> dict[str, Any]:
    """Measure the evolved case in Exudyn: the paper's simulator with 20 coordinates, residual flexibility with six.

    Return seconds, ratios to residual flexibility, and e_NRMS of the whole beam against the full model.
    """
    drive, paper, flexible = beams.drive("evolved"), beams.reduced("evolved"), beams.flexible(6)
    simulators: dict[str, tuple[SystemSimulator, SlidingBody]] = {
        "callbacks": (CALLBACKS, paper),
        "callbacks, Jacobian kept": (MODIFIED, paper),
        "residual flexibility": (exudyn.simulate_system, flexible),
    }
    full = beams.full("evolved")
    reference = _outputs(full, systems.simulate(System.of(full), drive))
    errors = dict[str, float]()

    def by(name: str) -> Callable[[], float]:
        """Function that runs the simulator called `name`, stores its error, and returns its seconds."""
        simulate, body = simulators[name]

        def run() -> float:
            """Run the simulator, store its error against the full model, and return its seconds."""
            trajectory = simulate(System.of(body), drive)
            errors[name] = relative_error(_outputs(body, trajectory), reference)
            return trajectory.seconds

        return run

    times = side_by_side({name: by(name) for name in simulators}, repeats)
    own = times["residual flexibility"]
    return {
        "coordinates": {name: body.size for name, (_, body) in simulators.items()},
        "seconds": {name: taken.summary() for name, taken in times.items()},
        "ratio": {name: _ratio(taken, own) for name, taken in times.items() if name != "residual flexibility"},
        "error": errors,
    }


def _observe(form: ModalForm, drive: Excitation, chosen: Sequence[int]) -> float:
    """Seconds of a simulation in modal form that stores only the outputs numbered `chosen`."""
    return systems.observe(SystemForm.of_modal_body(form), drive, outputs=chosen).seconds


def _size(name: str, body: SlidingBody, as_in_paper: SlidingBody, share: float, repeats: int) -> dict[str, Any]:
    """Measure one model by each simulator; `as_in_paper` is the same model with dense matrices."""
    drive, form = beams.drive(name), modal_form(body)
    parts = beams.stretches(drive, share)
    found: dict[str, list[Array]] = {}

    def by(way: str, simulate: SystemSimulator, body: SlidingBody, drives: Sequence[Excitation]) -> Callable[[], float]:
        """Function that simulates `body` under each of `drives`, stores the outputs as `way` and returns seconds."""

        def run() -> float:
            """Simulate the body under all excitations, store the outputs, and return the seconds in all."""
            trajectories = [simulate(System.of(body), each) for each in drives]
            found[way] = [_outputs(body, one) for one in trajectories]
            return sum(trajectory.seconds for trajectory in trajectories)

        return run

    def modal() -> float:
        """Seconds of a simulation in modal form that stores all modes."""
        return systems.simulate_form(SystemForm.of_modal_body(form), drive).seconds

    by("march, parts", systems.simulate, body, parts)()  # compiled before the clock runs
    by("march", systems.simulate, body, [drive])()
    everything = list(range(len(body.output_positions)))
    times = side_by_side(
        {
            "callbacks": by("callbacks", CALLBACKS, as_in_paper, parts),
            "callbacks, Jacobian kept": by("callbacks, Jacobian kept", MODIFIED, as_in_paper, parts),
            "updates": by("updates", exudyn.simulate_system, body, [drive]),
            "march": _middle(modal),
            "march, outputs only": _middle(partial(_observe, form, drive, everything)),
        },
        repeats,
    )
    scale = drive.stepping.steps / sum(part.stepping.steps for part in parts)
    partly = [way for way in times if way.startswith("callbacks")]
    times |= {way: times[way].times(scale) for way in partly}
    return {
        "share_of_span": dict.fromkeys(partly, share),
        "seconds": {way: taken.summary() for way, taken in times.items()},
        "ratio": {way: _ratio(times[way], times["march"]) for way in (*partly, "updates")},
        "difference": {way: _difference(found[way], found["march, parts" if way in partly else "march"])
                       for way in (*partly, "updates")},
    }  # fmt: skip


def _middle(run: Callable[[], float]) -> Callable[[], float]:
    """Function that returns the median of `MARCHES` runs of `run`."""
    return lambda: statistics.median(run() for _ in range(MARCHES))


def _outputs(body: SlidingBody, trajectory: SystemTrajectory) -> Array:
    """Displacements (T, o) in m of a body alone."""
    (found,) = systems.displacements(System.of(body), trajectory).values()
    return found


def _ratio(slow: Times, fast: Times) -> dict[str, float]:
    """Ratios of the least and of the median times, slow over fast."""
    return {"of_min": slow.least / fast.least, "of_median": slow.median / fast.median}


def _difference(a: Sequence[Array], b: Sequence[Array]) -> float:
    """Largest absolute difference between arrays of two lists, pair by pair."""
    return max(float(np.abs(one - other).max()) for one, other in zip(a, b, strict=True))
