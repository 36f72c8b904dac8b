"""Allowed loads at random positions, by a reduced boom with error bars and by the boom of full order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plain_machines
from numpy.typing import NDArray

from pmr.files import npz
from pmr.files.arrays import Array
from pmr.scene import Scene, load_any
from pmr.simulation.statics.postures import HOOK, WEIGHT, PostureMatrices, PostureSet, with_hook
from pmr.studies import tasks
from pmr.studies.allowed import Place, allowed_loads
from pmr.studies.chart_models import compute_postures
from pmr.studies.charting import allow_row
from pmr.studies.limits import Limit, with_fields
from pmr.studies.tasks import scene_arguments

GRAVITY = 9.80665
#: The crane of the workflows as a chart takes it: without its payload, with probes on all sections.
CRANE = [
    "sections.fly.masses=[]",
    "frame.second_order=true",
    "compare.against=[]",
    "sections.base.probes=[{name='top',at=[3.0,0.0,0.2],measures=['stress']}]",
    "sections.middle.probes=[{name='top',at=[2.0,0.0,0.18],measures=['stress']}]",
    "sections.fly.probes=[{name='corner',at=[2.0,0.11,0.16],measures=['stress']}]",
]


@dataclass(frozen=True)
class Beside:
    """Allowed loads (P, l) in kg at P positions for l limits, by both models, with the reduction's error bars."""

    load: Array
    error: Array
    exact: Array
    names: Sequence[str]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where (P, l) both models reach the limit under a load."""
        return np.isfinite(self.load) & np.isfinite(self.exact)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Where (P, l) the load of full order is within the error bar."""
        return np.abs(self.exact - self.load) <= self.error + 1e-6 * self.load

    @property
    def agreed(self) -> NDArray[np.bool_]:
        """Where (P,) the load of full order that all limits allow is within the error bar of the reduced model's."""
        at = np.arange(len(self.load)), np.nanargmin(self.load, axis=1)
        return np.asarray(
            np.abs(np.nanmin(self.exact, axis=1) - self.load[at]) <= self.error[at] + 1e-6 * self.load[at]
        )


def beside(scene: Scene, places: Array, limits: Sequence[Limit], up_to: float) -> Beside:
    """Compute the allowed loads of both models at positions (P, k): extensions in m, then a luffing angle in rad."""
    scene = with_hook(scene)
    extensions, (count, _) = dict(zip(scene.names[1:], places.T[:-1].tolist(), strict=True)), places.shape
    at = {"extensions": extensions, "luffing": places[:, -1].tolist(), "slewing": [0.0] * count}
    asked: dict[str, Any] = {"up_to": up_to, "error": True}
    fields = [name for one in limits if one.of == "field" for name in one.which]
    made = compute_postures(scene_arguments(scene) | asked | {"at": at, "fields": fields}, {})
    scene = with_fields(scene, fields, count)
    asked |= {"limits": [one.model_dump(mode="json") for one in limits], "gravity": GRAVITY, "rows": [0, count]}
    cases = [{"weight": 1.0, "machine": 1.0, "load": 1.0, "hoisted": 0.0, "loads": {}}]
    asked |= scene_arguments(scene)
    found = allow_row(asked | {"cases": cases, "left": []}, {"postures": made}).arrays
    full = tasks.full_system(scene)
    whole = PostureMatrices.from_scene(scene, full, PostureSet.from_task(at))
    amounts = [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in whole.loads.names]
    near = found["load"]
    exact = np.array([allowed_loads(limits, Place(whole, k, amounts, GRAVITY), up_to, near[k]) for k in range(count)])
    return Beside(found["load"], found["error.reduction"], exact, [*(one.name for one in limits), "stability"])


def at_rest(scene: Scene, luffing: list[float], extensions: dict[str, list[float]] | None = None) -> PostureMatrices:
    """Equilibria of the reduced model at luffing angles in rad and extensions in m, by section."""
    found = arrays_at_rest(scene, luffing, extensions)
    return npz.record_from_arrays(
        PostureMatrices, {n.removeprefix("reduced."): a for n, a in found.items() if n.startswith("reduced.")}
    )


def arrays_at_rest(
    scene: Scene, luffing: list[float], extensions: dict[str, list[float]] | None = None
) -> Mapping[str, NDArray[Any]]:
    """Arrays of the equilibria as the study's task returns them, with those of turning."""
    at = {
        "extensions": extensions or {"slider": [3.0] * len(luffing)},
        "luffing": luffing,
        "slewing": [0.0] * len(luffing),
    }
    assert scene.frame is not None
    turned = ["luffing"] if scene.frame.slewing is None else ["luffing", "slewing"]
    arguments = scene_arguments(with_hook(scene)) | {"up_to": 1e6, "error": False, "at": at, "turned": turned}
    return compute_postures(arguments, {}).arrays


def random_places(seed: int, count: int = 20, least: float = 0.7, most: float = 4.5, raised: float = 1.3) -> Array:
    """Random positions (count, 3) of a boom of three sections: two extensions in m and a luffing angle in rad."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(least, most, (count, 2)), rng.uniform(0.0, raised, count)])


def crane(*more: str) -> Scene:
    """Scene of the crane as a load chart takes it, with further settings."""
    return load_any(plain_machines.CRANE, [*CRANE, *more])
