"""Structural models by name, each with what scenes, reductions, charts and reports ask of a model before it exists.

`MODELS` has an entry for each structural model of pmr.  The names that ``body.model`` takes are its keys, and
`pmr.models` has a module of each name, which makes the model (`pmr.fullmodel.from_scene`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from pmr.scene.box import Box

#: Keys of a mesh that is drawn from a box.
CELLS = ("mesh.size", "mesh.along", "mesh.tail_layer", "mesh.cells")
#: Keys without effect on a body that is not meshed, and on one that has neither a mesh nor a material.
_NO_CELLS = (*CELLS, "mesh.faces", "mesh.groups", "body.shear_correction", "body.thickness")
_NO_MATERIAL = (*_NO_CELLS, "mesh.elements", "body.material", "body.regions", "body.shear", "body.walls")


@dataclass(frozen=True)
class ModelTraits:
    """Properties that all bodies with a structural model share, whatever their scene says."""

    words: str  # its name in reports, with an article
    #: ``beam``: elements on a line; ``cells``: a shell or solid on a mesh; ``mass``: a mover; or given matrices
    kind: Literal["beam", "cells", "mass", "matrices"]
    is_planar: bool  # whether it moves in the vertical plane alone
    rank: int | None  # its place among models of a box, the poorest is 0; None: it is compared with no richer model
    may_vary: bool  # whether it represents a box whose section varies along the axis
    walls_may_give: bool  # whether it obeys body.walls = "give"; walls of cells give way anyway
    #: Faces of a box at which it has stresses; none where the model alone knows them
    probe_faces: Callable[[Box], tuple[str, ...]]
    without_effect: tuple[str, ...]  # keys of a section that change nothing

    @property
    def is_beam(self) -> bool:
        """Whether the model is a beam, in the plane or in space."""
        return self.kind == "beam"

    @property
    def has_cells(self) -> bool:
        """Whether the model is a shell or a solid, which has a field of stress in its walls."""
        return self.kind == "cells"

    @property
    def has_line(self) -> bool:
        """Whether the body consists of nodes on its axis, or of a mass there, and has no cells."""
        return self.kind in ("beam", "mass")

    @property
    def needs_fenicsx(self) -> bool:
        """Whether FEniCSx assembles the model's matrices."""
        return self.kind in ("beam", "cells")


#: Structural models of pmr by their names in ``body.model``.
MODELS: dict[str, ModelTraits] = {
    "beam2d": ModelTraits(
        "a planar beam", "beam", is_planar=True, rank=0, may_vary=True, walls_may_give=True,
        probe_faces=lambda box: ("bottom", "top"), without_effect=(*_NO_CELLS, "body.shear"),
    ),
    "beam3d": ModelTraits(
        "a beam in space", "beam", is_planar=False, rank=1, may_vary=True, walls_may_give=True,
        probe_faces=lambda box: tuple(corner.name for corner in box.corners), without_effect=_NO_CELLS,
    ),
    "shell": ModelTraits(
        "a shell", "cells", is_planar=False, rank=2, may_vary=True, walls_may_give=False,
        probe_faces=lambda box: ("outer", "middle", "inner"),
        without_effect=("mesh.elements", "mesh.cells", "body.shear", "body.walls"),
    ),
    "solid": ModelTraits(
        "a solid", "cells", is_planar=False, rank=None, may_vary=False, walls_may_give=False,
        probe_faces=lambda box: (),
        without_effect=("mesh.elements", "body.shear", "body.shear_correction", "body.walls", "body.thickness"),
    ),
    "matrices": ModelTraits(
        "given matrices", "matrices", is_planar=False, rank=None, may_vary=False, walls_may_give=False,
        probe_faces=lambda box: (), without_effect=_NO_MATERIAL,
    ),
    "mover": ModelTraits(
        "a mass on a wheel", "mass", is_planar=True, rank=None, may_vary=False, walls_may_give=False,
        probe_faces=lambda box: (), without_effect=_NO_MATERIAL,
    ),
}  # fmt: skip


def model_traits(model: str) -> ModelTraits:
    """Return the traits of a structural model.

    A model that an installed package offers has the traits of a solid: it is made from the body and a mesh of cells.
    Keys about elements of beams and about walls under their pads have no effect on it.
    """
    if model in MODELS:
        return MODELS[model]
    return replace(
        MODELS["solid"], words=f"a {model.replace('_', ' ')}", without_effect=("mesh.elements", "body.walls")
    )


def models_by_rank() -> tuple[str, ...]:
    """Return the structural models with which others are compared, from the poorest to the richest.

    There is one model for each rank: the first one of this rank in `MODELS`.
    """
    ranked = {traits.rank: name for name, traits in reversed(MODELS.items()) if traits.rank is not None}
    return tuple(ranked[rank] for rank in sorted(ranked))
