"""Booms of several sections as runs of a study: each from its scene to its errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pmr.scene import Boom
from pmr.studies.engine.task import Scalar, TaskResult


def boom_arguments(boom: Boom) -> dict[str, Any]:
    """A boom as arguments of a task; the hash stands for the content of files that it names."""
    plain = boom.model_copy(update={"title": "", "published": None, "recovery": None})
    return {"boom": plain.model_dump(mode="json", exclude={"section"}), "hash": plain.hash}


def run_boom_case(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: one run, as of one body.

    Figures: ``errors.reduced_vs_full.<place>`` (e_NRMS), ``coordinates.full`` and ``.reduced``, ``max_displacement``
    and ``max_error`` (m), ``largest_force`` of the pads and ``cylinders.<name>.{min,max}`` (N),
    ``frequencies.s_min.<i>`` and ``.s_max.<i>`` (Hz).  Arrays: ``t`` (s), ``tip`` and ``reach`` (m),
    ``frequencies.<model>`` (Hz).
    """
    from pmr.compare.booms import tip_columns
    from pmr.run.booms import run_boom

    boom = Boom.model_validate(arguments["boom"])
    outcome = run_boom(boom)
    assert outcome is not None  # a task runs on one rank
    result, summary = outcome.result, outcome.result.summary
    record: dict[str, Scalar] = {
        f"errors.{pair}.{place}": error for pair, places in summary["errors"].items() for place, error in places.items()
    }
    record |= {f"coordinates.{model}": size for model, size in summary["coordinates"].items()}
    record |= {key: summary[key] for key in ("max_displacement", "max_error") if summary[key] is not None}
    if summary["pads"]:
        record["largest_force"] = max(max(pad["max"], -pad["min"]) for pad in summary["pads"])
    record |= {f"cylinders.{one['name']}.{key}": one[key] for one in summary["cylinders"] for key in ("min", "max")}
    found = result.frequencies
    for place, k in (("s_min", 0), ("s_max", -1)):
        record |= {f"frequencies.{place}.{i}": float(f) for i, f in enumerate(found.models["reduced"][k, :3], start=1)}
    response = result.responses["reduced"]
    arrays = {"t": response.t, "tip": response.displacement[:, tip_columns(boom, response)[-1]], "reach": found.reach}
    arrays |= {f"frequencies.{model}": values for model, values in found.models.items()}
    return TaskResult(record, arrays, {f"simulate.{name}": one.seconds for name, one in result.responses.items()})
