r"""The force of the cylinder that raises a boom, from what stands between the boom and the ground.

.. math::
    F = \sum_k \lambda_k\, (a_{k0} + \sum_p a_{kp} s_p) \Big/ \frac{dL}{d\varphi}

with forces lambda that the unit tells, the moment a of a unit of each about the pivot, linear in the paths s, and the
cylinder's arm (`pmr.scene.frame.LuffingCylinder`), as `pmr.simulation.pivot` computes it in a
run.  A pin at the pivot bears the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.export.fmi.drivers import Drivers
from pmr.scene.built import force_of
from pmr.scene.pivot import pin_and_cylinder, pressed_on_ground

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Luffing:
    """K forces that make the cylinder's moment."""

    hinges: tuple[float, ...]  # m: x and z of foot and lug
    sources: tuple[int, ...]  # (K,): numbers of outputs, or -1 - k of contact k
    moments: Array  # (K, 1 + P): a, in m and 1
    pin: tuple[int, int, int]  # outputs of a pin along x and z, -1 for none, and the source of the support at the lug

    @property
    def arrays(self) -> dict[str, Array]:
        """Of model.c by their declarations (drive.h)."""
        return {
            "const double luffing_hinges[4]": np.array(self.hinges),
            "const int luffing_sources[LUFFING]": np.array(self.sources),
            "const double luffing_moments[LUFFING][1 + PATHS]": self.moments,
            "const int luffing_pin[3]": np.array(self.pin),
        }


def luffing(drivers: Drivers) -> Luffing | None:
    """Of a system; None without a cylinder by its hinges, or where a force between boom and ground is unknown."""
    if (frame := drivers.frame) is None or (cylinder := frame.scene.frame.cylinder) is None:  # type: ignore[union-attr]
        return None
    rows, scene = drivers.rows, frame.scene
    outputs = [name for part in rows.parts for name, _, _ in part.output_names]
    known = {force_of(name): -1 - k for k, name in enumerate(rows.system.contact_names)}
    known |= {name: k for k, name in enumerate(outputs)}
    # without extensions, then with 1 m of each path by itself
    unit = {name: np.eye(len(rows.paths) + 1)[1 + k] for k, name in enumerate(rows.paths)}
    none = np.zeros(len(rows.paths) + 1)
    sources, moments = list[int](), list[Array]()
    for one in pressed_on_ground(scene, {name: unit.get(name, none) for name in scene.paths}):
        name = next((name for name in one.names if name in known), None)
        if name is None:
            return None
        about = one.wrench[:, 4]
        if np.any(about):
            sources.append(known[name])
            moments.append(np.concatenate([about[:1], np.pad(about[1:] - about[0], (0, not rows.paths))]))
    if not sources:
        return None
    pin, held = (-1, -1, 0), pin_and_cylinder(scene)
    if held is not None and set(held.pin) <= set(known):
        across = next(known[name] for name in held.across if name in known)
        pin = (known[held.pin[0]], known[held.pin[1]], across)
    return Luffing((*cylinder.foot, *cylinder.lug), tuple(sources), np.array(moments), pin)
