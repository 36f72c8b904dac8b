"""The reduced models of a boom's sections, each by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fullmodel.build import Built
from pmr.reduced.attachment import with_cylinder_modes
from pmr.reduced.model import ReducedModel, SectionOf
from pmr.reduction.basis import Basis, modal_basis
from pmr.reduction.cache import Cache, Reduced
from pmr.reduction.from_scene import ENRICHMENT_MODES, provenance
from pmr.reduction.reactions import support_motions, with_reactions
from pmr.reduction.residual.model import section_model
from pmr.reduction.snapshots.free_body import FreeBody
from pmr.reduction.snapshots.free_modes import free_modes
from pmr.scene import Reduction, Scene
from pmr.scene.members import members

#: Enrichment modes of a section where a tolerance or a budget is given: among them the smallest model is looked for.
SEARCHED = 12


@dataclass(frozen=True)
class ReducedSection:
    """A section's model on free modes, and this rank's rows V (n_local, r) of its basis."""

    modal: ReducedModel
    V: NDArray[np.float64]

    @cached_property
    def model(self) -> ReducedModel:
        """What is simulated: with the modes of its cylinder."""
        return with_cylinder_modes(self.modal)


def reduce_sections(
    scene: Scene, built: Mapping[str, Built], caches: Mapping[str, Cache] | None = None
) -> Mapping[str, ReducedSection]:
    """The reduced model of every section, those of equal ones once; collective.

    In `caches`, by the sections' names, they are cached and found.

    Raises an `InputError` with the section's key.
    """
    beyond = ENRICHMENT_MODES if scene.ordered is None else SEARCHED
    made, found = dict[tuple[int, Reduction], tuple[ReducedModel, Basis]](), dict[str, ReducedSection]()
    for member in members(scene):
        part = member.part
        key = id(built[part.name]), part.reduction
        if key not in made:
            try:
                made[key] = _reduced(built[part.name], part.reduction, beyond, (caches or {}).get(part.name))
            except InputError as error:
                raise error.called(scene.key_of(member.number, error.key)) from None
        model, basis = made[key]
        about, joints = provenance(scene, basis, member.number), member.joint_rows
        own = SectionOf(part.name, scene.title, tuple(row for row in model.row_names if row in joints))
        V = np.array(basis.V.getDenseArray())
        found[part.name] = ReducedSection(replace(model, provenance=about, section=own), V)
    return found


def _reduced(built: Built, choice: Reduction, beyond: int, cache: Cache | None) -> tuple[ReducedModel, Basis]:
    """With so many enrichment modes, where an error is estimated."""
    enrichment = beyond if choice.needs_inertia else 0

    def make() -> Reduced:
        body = FreeBody(built.model, choice.solver)
        snapshots = free_modes(built.model, choice.coordinates, choice.solver, enrichment, body)
        basis = modal_basis(snapshots)
        motions = support_motions(body)
        model = section_model(body, basis, {}, choice.coordinates, motions)
        return Reduced(snapshots, basis, with_reactions(model, body, np.array(basis.V.getDenseArray()), motions))

    found = make() if cache is None else cache.reduced(choice.model_dump(mode="json") | {"section": enrichment}, make)
    model = found.model
    if not choice.flexibility:
        assert model.carriers is not None  # as section models have
        model = replace(model, flexibility=None, carriers=replace(model.carriers, flexibility=None, answers=None))
    return model, found.basis
