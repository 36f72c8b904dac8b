"""Requirements on benchmarks, and whether a run of them meets these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.waited_for import allowed
from pmr.report.numbers import format_input


@dataclass(frozen=True)
class Requirement:
    """Bound on a value: a least one if `least`, else a largest one; `unit` is used for printing."""

    text: str
    value: float
    bound: float
    least: bool
    unit: str

    @property
    def holds(self) -> bool:
        """Whether the value meets the bound."""
        return self.value >= self.bound if self.least else self.value <= self.bound


def judged(sections: Mapping[str, Any]) -> list[dict[str, Any]]:
    """All requirements on the sections that were run, as mappings with ``holds``."""
    return [asdict(requirement) | {"holds": requirement.holds} for requirement in _all(sections)]


def _all(sections: Mapping[str, Any]) -> Iterator[Requirement]:
    """Yield the requirements on all sections that were run."""
    if "approaches" in sections:
        yield from _approaches(sections["approaches"])
    if "latency" in sections:
        yield from _latency(sections["latency"]["ns"])
    for name, seconds in sections.get("fmu", {"seconds": {}})["seconds"].items():
        yield Requirement(f"FMU, {name}: one internal step", seconds["median"], 5e-6, False, "s")
    for name, one in sections.get("waited for", {}).items():
        yield Requirement(name, one["here"], allowed(one), False, one["unit"])
    for name, one in sections.get("chart", {}).items():
        yield Requirement(f"load chart of 40 x 20 points, {name}: wall time", one["wall"], one["asked"], False, "s")
    if "scale" in sections:
        yield from _scale(sections["scale"])


def _approaches(found: Mapping[str, Any]) -> Iterator[Requirement]:
    """Yield the requirements on both cases of the paper by each simulator."""
    for name, case in found["cases"].items():
        reduced, full = case["reduced"], case["full"]
        r = case["coordinates"]["reduced"]
        text = f"{name} case, {r} coordinates: the paper's way in Exudyn over march"
        yield Requirement(text, min(reduced["ratio"]["callbacks"].values()), 500.0, True, "ratio")
        text = f"{name} case, {r} coordinates: the same with a Jacobian that is kept, over march"
        yield Requirement(text, min(reduced["ratio"]["callbacks, Jacobian kept"].values()), 500.0, True, "ratio")
        text = f"{name} case, {r} coordinates: largest difference of the trajectories"
        yield Requirement(text, reduced["difference"]["callbacks"], 1e-9, False, "m")
        text = f"{name} case, full beam: Exudyn with sparse matrices over march"
        yield Requirement(text, min(full["ratio"]["updates"].values()), 200.0, True, "ratio")
        text = f"{name} case, full beam: largest difference of the trajectories"
        yield Requirement(text, full["difference"]["updates"], 1e-9, False, "m")
    for name, seconds in found["small"]["seconds"].items():
        if "outputs" in name:
            text = f"evolved case, 6 coordinates ({name}): 15,000 steps"
            yield Requirement(text, seconds["min"], 1.5e-3, False, "s")
    yield from _in_exudyn(found["in_exudyn"])


def _in_exudyn(found: Mapping[str, Any]) -> Iterator[Requirement]:
    """Yield the requirements on reduced models in Exudyn."""
    r = found["coordinates"]["residual flexibility"]
    text = f"in Exudyn, evolved case: the paper's way (20) over residual flexibility ({r})"
    yield Requirement(text, min(found["ratio"]["callbacks"].values()), 15.0, True, "ratio")
    error = found["error"]["callbacks"] / found["error"]["residual flexibility"]
    yield Requirement("its error along the beam over that of residual flexibility", error, 7.0, True, "ratio")


def _scale(found: Mapping[str, Any]) -> Iterator[Requirement]:
    """Yield the requirements that models of one rank and of two agree."""
    for one in found["agreement"]:
        worst = max(value for name, value in one.items() if name != "size")
        yield Requirement(
            f"shell of {format_input(one['size'])} coordinates: one rank and two agree", worst, 1e-8, False, ""
        )


def _latency(found: Mapping[str, Any]) -> Iterator[Requirement]:
    """Yield the requirements on the time of a step from Python."""
    for name, times in found.items():
        yield Requirement(f"one step from Python, {name}: median", 1e-9 * times["median"], 0.5e-6, False, "s")
        yield Requirement(f"one step from Python, {name}: 99 of 100", 1e-9 * times["p99"], 5e-6, False, "s")
