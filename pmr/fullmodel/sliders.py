"""Points that slide on a planar beam."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pmr.constraints.rows import Row, row_on_coordinates

if TYPE_CHECKING:
    from pmr.models.beam2d import Beam2D  # its forms need FEniCSx, which given matrices do without


def slider_row(beam: Beam2D, offset: float = 0.0, name: str = "slider") -> Row:
    """The row w(s + offset) = 0 as an exact piecewise cubic in s; its multiplier is a force in N."""
    return row_on_coordinates(name, np.unique(beam.nodes) - offset, beam.bending_dofs, beam.deflection, beam.size)
