"""What a tolerance takes: by the errors of models that were simulated, and as it is recommended (docs/trade.md)."""

from __future__ import annotations

from collections.abc import Mapping

from pmr.studies.engine.task import Scalar, number

#: By tolerance what docs/trade.md recommends for free modes with residual flexibility: coordinates beyond the natural
#: frequencies of the free body in the motion's band, and steps in a period of its highest frequency.
RECOMMENDED = {0.05: (3, 110.0), 0.01: (5, 280.0), 0.001: (11, 1100.0), 0.0001: (15, 7000.0)}


def points(figures: Mapping[str, Scalar]) -> list[tuple[int, float, float]]:
    """Coordinates, step as a multiple of the scene's, and error of each model that was simulated."""
    split = [(name.split("."), value) for name, value in figures.items() if name.startswith("total.")]
    return [(int(part[1]), float(".".join(part[2:])), number(value)) for part, value in split if value is not None]


def holding(figures: Mapping[str, Scalar], tolerance: float) -> tuple[int, float] | None:
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


def tried(figures: Mapping[str, Scalar], tolerance: float) -> float | None:
    """Error of what is recommended for a tolerance; None where no model is as large, or no step as short."""
    if not figures.get("band"):
        return None
    more, steps = RECOMMENDED[tolerance]
    fits = [
        (r, -h, error)
        for r, h, error in points(figures)
        if r >= number(figures["below"]) + more
        and h * number(figures["scene step"]) * number(figures["band"]) * steps <= 1.0
    ]
    return min(fits)[2] if fits else None
