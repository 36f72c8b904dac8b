"""Which figures of a run have an error in each part of its budget, and which have none."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from pmr.compare import forces
from pmr.results import Response
from pmr.results.quantities import QUANTITIES
from pmr.results.response import ROUND_OFF
from pmr.scene import Scene

#: Error of a reduction, or of forces by the time step, from which a figure is far off.
FAR = 0.1


def figures(scene: Scene, response: Response) -> list[str]:
    """Kinds of figures beside displacements that a run states; forces that are zero or round-off don't count."""
    histories = forces.histories(response)
    sizes = {
        key: max(float(np.abs(history).max(initial=0.0)) for history in each.values())
        for key, each in histories.items()
    }
    bearing = {kind for (kind, _), size in sizes.items() if size > ROUND_OFF * max(sizes.values())}
    stated = [kind for kind in QUANTITIES if kind in bearing] + ["frequency"]
    stated += ["stress"] * (scene.recovery is not None and scene.recovery.stress)
    return stated + ["probe"] * any(output.kind == "probe" for output in response.outputs)


def not_covered(scene: Scene, response: Response, part: Mapping[str, Any], exact: Collection[str] = ()) -> list[str]:
    """Figures of a run of which a `part` of the budget has no error, in words; those that are `exact` need none."""
    stated = figures(scene, response)
    return [QUANTITIES[kind].label for kind in stated if part.get(kind) is None and kind not in exact]


def unsettled_forces(kinds: Sequence[str]) -> list[str]:
    """Kinds of forces that go on changing with smaller steps, in words."""
    return [f"{QUANTITIES[kind].label} beyond the figure stated: smaller steps go on changing them" for kind in kinds]
