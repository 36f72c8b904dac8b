"""What is said of a frame that moves: its angles, what of the small motion's own terms is kept, and buckling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.compare.second_order import LIMIT, Stressed, second_order_effect
from pmr.compare.summary import Part
from pmr.errors import InputError
from pmr.results import Frequencies
from pmr.scene import Scene
from pmr.scene.frame import BaseMotion
from pmr.simulation import Excitation
from pmr.simulation.frame_motion import Turning
from pmr.system.system import System

Array = NDArray[np.float64]


#: Of motions in the plane, below which those across it are none.
ACROSS = 1e-9


def frame(scene: Scene, system: System, excitation: Excitation, frequencies: Frequencies) -> Part:
    r"""``frame`` and ``buckling`` of summary.json; nothing without a frame.

    Of what turns, `gyroscopic` is :math:`2 |\omega| / \omega_1` and `centrifugal` :math:`(|\omega| / \omega_1)^2`, with
    the lowest frequency on the way: so large beside the stiffness is what is dropped without second order.  Frequencies
    are those of the boom as axial forces and the frame stress it, or ``unstressed`` without second order.

    `share` is how much axial forces and the frame's speed change the stiffness at most (`pmr.compare.second_order`):
    above `limit` second order matters.
    """
    if scene.frame is None:
        return Part()
    luffing, slewing = scene.frame.angles
    t = excitation.times
    speed = float(np.linalg.norm(Turning.of(luffing, slewing, t, scene.frame.rocking).velocity, axis=1).max())
    lowest = 2.0 * np.pi * float(np.nanmin(frequencies.models["reduced"][:, 0]))  # 0 past the buckling load
    figures = {
        "luffing": _range(luffing.value(t)),
        "slewing": _range(slewing.value(t)),
        **({} if scene.frame.base is None else {"base": _ranges(scene.frame.base, t)}),
        "angular_velocity": speed,
        "second_order": scene.frame.second_order,
        "gyroscopic": 2.0 * speed / lowest if lowest else None,
        "centrifugal": (speed / lowest) ** 2 if lowest else None,
        "frequencies": "unstressed" if frequencies.t is None else "stressed",
    }
    try:
        stresses = second_order_effect(scene, system.bodies)
    except InputError:
        if scene.frame.second_order:
            raise
        return Part({"frame": figures})
    factors = [factor if np.isfinite(factor) else None for factor in stresses.factors.tolist()]
    buckling = {
        "factor": stresses.factor if np.isfinite(stresses.factor) else None,
        "t": stresses.at,
        "over": {"t": stresses.t.tolist(), "factor": factors},
        "share": stresses.share,
        "share_t": stresses.share_at,
        "limit": LIMIT,
    }
    return Part(
        {"frame": figures, "buckling": buckling},
        [*_left_out(scene.frame.second_order is not False, stresses), *_in_plane(scene, system)],
        _past_buckling(scene.frame.second_order is not False, stresses),
    )


def _in_plane(scene: Scene, system: System) -> list[str]:
    """A line where buckling across the plane of luffing is not seen: reduced models hold what inputs move."""
    assert scene.frame is not None  # of a scene that has one
    held = []
    for name, body in system.bodies.items():
        across, up = (
            np.abs(
                np.asarray(body.outputs)[[k for k, name in enumerate(body.output_names) if name.endswith(f" {axis}")]]
            )
            for axis in "yz"
        )
        if across.size and up.size and across.max() <= ACROSS * up.max():
            held.append(name or "the body")
    if not held or not scene.frame.second_order:
        return []
    return [
        f"buckling across the plane of luffing is not looked for in {', '.join(held)}: nothing acts across it, so the "
        "reduced model does not move there; a load along y, of any size, brings it in"
    ]


def _past_buckling(is_included: bool, stresses: Stressed) -> list[str]:
    past = (
        f"the boom is past its buckling load: at {stresses.at:g} s {stresses.factor:.3g} of the axial forces bends it "
    )
    past += "without limit" if is_included else "without limit, which is not simulated without second order"
    return [past] if stresses.factor <= 1.0 else []


def _left_out(is_included: bool, stresses: Stressed) -> list[str]:
    size = f"by {100.0 * stresses.share:.2g} % at {stresses.share_at:g} s"
    left_out = f"second order is left out: axial forces and the frame's speed change the stiffness {size}, so static "
    left_out += "deflections are off by as much, vibrations drift out of phase; frame.second_order = true includes it"
    return [] if is_included or stresses.factor <= 1.0 or not stresses.matters else [left_out]


def _ranges(base: BaseMotion, t: Array) -> dict[str, dict[str, float]]:
    """Ranges of each motion of the base, m or the frame's unit, and of each given acceleration."""
    accelerations = {f"acceleration.{axis}": signal for axis, signal in base.accelerations.items()}
    return {key: _range(signal.value(t)) for key, signal in (base.motions | accelerations).items()}


def _range(angle: Array) -> dict[str, float]:
    return {"min": float(angle.min()), "max": float(angle.max())}
