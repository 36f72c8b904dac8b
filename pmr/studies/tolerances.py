"""What a tolerance takes, by the errors of models that were simulated."""

from __future__ import annotations

from collections.abc import Mapping

from pmr.studies.engine.task import Scalar, number

#: Of errors along the body.
TOLERANCES = (0.05, 0.01, 0.001, 0.0001)


def points(figures: Mapping[str, Scalar]) -> list[tuple[int, float, float]]:
    """Coordinates, step as a multiple of the scene's, and error of each model that was simulated."""
    split = [(name.split("."), value) for name, value in figures.items() if name.startswith("total.")]
    return [(int(part[1]), float(".".join(part[2:])), number(value)) for part, value in split if value is not None]


def coarsest_within(figures: Mapping[str, Scalar], tolerance: float) -> tuple[int, float] | None:
    """Fewest coordinates that hold a tolerance, and the longest step with which they do; None where none do.

    With shorter steps they have to, too: errors of model and step that cancel each other are no merit.
    """
    for r in sorted({r for r, _, _ in points(figures)}):
        longest = None
        for _, h, error in sorted(point for point in points(figures) if point[0] == r):
            if error > tolerance:
                break
            longest = h
        if longest is not None:
            return r, longest
    return None
