"""The stages of a run from scene to result: full model, reduction, system, simulation, comparison."""

from typing import TYPE_CHECKING

from pmr.errors import lazy_names

if TYPE_CHECKING:
    from pmr.fem.compat import versions as fenicsx_versions
    from pmr.pipeline.scenes import Outcome, full_model, reduce, run
    from pmr.reduction.held_body import framed_body, held_body

__all__ = ["Outcome", "fenicsx_versions", "framed_body", "full_model", "held_body", "reduce", "run"]

#: Module of each name, imported when the name is first used, so that versions are known without numerical packages.
_PLACES = {
    "Outcome": "pmr.pipeline.scenes:Outcome",
    "fenicsx_versions": "pmr.fem.compat:versions",
    "framed_body": "pmr.reduction.held_body:framed_body",
    "full_model": "pmr.pipeline.scenes:full_model",
    "held_body": "pmr.reduction.held_body:held_body",
    "reduce": "pmr.pipeline.scenes:reduce",
    "run": "pmr.pipeline.scenes:run",
}
__getattr__ = lazy_names("pmr.pipeline", _PLACES)
