"""What a run says in summary.json: each part adds its figures and what a user should know, here they are combined."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pmr.compare import errors, ringing, trust
from pmr.compare.outputs import impulsive
from pmr.compare.spectrum import band_of, error_below
from pmr.errors import environment
from pmr.errors.text import remarks
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.hints import hints
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation
from pmr.simulation.stepping import overshoots, unseen
from pmr.system.system import System


@dataclass(frozen=True)
class Part:
    """Figures by their keys in summary.json, and warnings, a line each.

    `grave` are those of what does not hold, or makes a figure useless: they come before those of how far figures are
    off.
    """

    figures: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    grave: Sequence[str] = ()


def combine_parts(parts: Sequence[Part]) -> dict[str, Any]:
    """All figures, and under ``warnings`` all warnings: grave ones first, each kind in the order of the parts.

    Raises ValueError if two parts have figures of the same key.
    """
    summary, warnings = dict[str, Any](), list[str]()
    for part in parts:
        if twice := summary.keys() & part.figures.keys():
            raise ValueError(f"two parts of a summary have {', '.join(sorted(twice))}")
        summary |= part.figures
        warnings += part.warnings
    return summary | {"warnings": [*grave(parts), *remarks(summary), *warnings]}


def grave(parts: Iterable[Part]) -> list[str]:
    """The grave warnings of all parts."""
    return [line for part in parts for line in part.grave]


def origin(scene: Scene, libraries: Mapping[str, str] | None = None) -> Part:
    """Origin of the result, with hints about its numbers, and the versions of `libraries` beside pmr's own."""
    return Part(
        {
            "title": scene.title,
            "scene_hash": scene.hash,
            "versions": environment.versions() | dict(libraries or {}),
            "commit": environment.commit(),
            "date": environment.today(),
            "machine": environment.machine(),
            "notes": list(scene.published.remarks) if scene.published else [],
        },
        grave=hints(scene),
    )


def simulation_part(seconds: Mapping[str, float], agreement: Mapping[str, float], stages: Mapping[str, float]) -> Part:
    """Seconds of the `stages` and of the simulators, and how far those agree."""
    return Part({"seconds": {**stages, "simulate": dict(seconds)}, "agreement": dict(agreement)})


def comparison_part(
    responses: Mapping[str, Response],
    measured: Mapping[str, errors.Quantity],
    simulators: Mapping[str, str],
    rigid: Sequence[str] = (),
) -> Part:
    """Errors beside the references, of what is `measured`; who simulated ``reduced`` and ``full``.

    Errors that are the full model's own ringing are none: they stand in ``not_judged``, with a line each, which names
    the contacts of the full model that are `rigid`.
    """
    reduced, full = responses["reduced"].displacement, responses.get("full")
    reference = reduced if full is None else full.displacement
    measures = {"errors": errors.relative_error, "absolute_errors": errors.absolute_error}
    pairs, unjudged = errors.pairs(responses, quantities=measured), dict[str, ringing.NotJudged]()
    kinds = {kind: errors.of_pairs(pairs, measure) for kind, measure in measures.items()}
    if full is not None:
        for name, pair in pairs["reduced_vs_full"].items():
            if (not_judged := ringing.NotJudged.of(pair, full)) is not None:
                unjudged[name] = not_judged
                for kind in kinds.values():
                    del kind["reduced_vs_full"][name]
    return Part(
        {
            **kinds,
            "not_judged": {name: vars(verdict) for name, verdict in unjudged.items()},
            "max_displacement": float(np.abs(reference).max()),
            "max_error": None if full is None else float(np.abs(reduced - reference).max()),
            "simulators": {name: simulator for name, simulator in simulators.items() if name in responses},
        },
        ringing.warnings(unjudged, rigid),
    )


def impacts(system: System, excitation: Excitation, responses: Mapping[str, Response]) -> Part:
    """``impacts`` of rigid sliders at kinks of the path: the forces' error ``pad_force`` below ``band`` in Hz.

    Above it lies 1 % of the full model's motion at the tip, and the most of what an impact leaves in the forces.
    """
    alone = system.reduced.get(ALONE)
    if alone is None or "full" not in responses or not impulsive(alone, excitation):
        return Part()
    reduced, full = errors.with_common_forces(responses["reduced"], responses["full"])
    step = excitation.stepping.step
    highest = band_of(full)
    return Part(
        {"impacts": {"band": highest, "pad_force": error_below(reduced.slider_force, full.slider_force, step, highest)}}
    )


def sampling(excitation: Excitation) -> Part:
    """Warnings about path and loads that the steps do not resolve."""
    signals, stepping = excitation.signals, excitation.stepping
    return Part(warnings=unseen(signals, stepping) + overshoots(signals, stepping))


def reliability(missing: Mapping[str, str], responses: Mapping[str, Response], system: System) -> Part:
    """References that are `missing`, and whether the motion of the reduced system can be relied on."""
    absent, doubted = trust.absent(missing), trust.doubts(responses["reduced"], ringing.rigid_contacts(system))
    return Part({"no_reference": dict(missing)}, absent, doubted)


def theory(scene: Scene, responses: Mapping[str, Response]) -> Part:
    """Motions beyond what the models' theory describes."""
    length = float(np.max(scene.reach(np.linspace(0.0, scene.time.end, scene.time.steps + 1))))
    return Part(grave=trust.large_motion(length, responses.values()))
