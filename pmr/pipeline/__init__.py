"""The stages of a run from scene to result: full model, reduction, system, simulation, comparison."""

from typing import TYPE_CHECKING

from pmr.errors import declared_names, lazy_names

if TYPE_CHECKING:
    from pmr.fem.compat import versions as fenicsx_versions
    from pmr.pipeline.scenes import Outcome, full_model, reduce, run
    from pmr.reduction.held_body import framed_body, held_body

__all__ = ["Outcome", "fenicsx_versions", "framed_body", "full_model", "held_body", "reduce", "run"]

#: Versions are known without numerical packages.
if not TYPE_CHECKING:  # to type checkers no other name exists
    __getattr__ = lazy_names("pmr.pipeline", declared_names(__file__))
