"""Cylinders that drive a luffing angle or an extension, as data of the kernel (src/cylinder.c)."""

from __future__ import annotations

from typing import Any

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel._native import lib
from pmr.kernel.machine import CYLINDER_COLUMNS, Cylinder
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.extension import FreeExtension
from pmr.scene.signals import SignalBase

#: Units of a cylinder's columns by name; the power is that of its force and that out of the supply.
CYLINDER_UNITS = CYLINDER_COLUMNS | {"power": "W", "power supply": "W"}
#: Numbers of oil and valves in the kernel's order, and how many each has.
OIL_SIZES = {"areas": 2, "volumes": 2, "bulk_modulus": 1, "leakage": 1, "supply": 1, "tank": 1, "back_pressure": 1}
OIL_SIZES |= {"gain": 2, "dead_band": 1, "laminar": 1, "setting": 1, "ratio": 1, "range": 1, "counterbalance": 1}
#: Stroke in m that stands for an infinite one.
FAR = 1e9


def cylinder_numbers(cylinder: Cylinder) -> Array:
    """Numbers of a cylinder in the kernel's order, from `foot` on (`pmr_actuator` in src/pmr_kernel.h)."""
    oil = dict.fromkeys(OIL_SIZES, 0.0) | dict(cylinder.oil)
    numbers: list[Any] = [cylinder.foot, cylinder.lug, cylinder.spring, cylinder.damping]
    numbers += [np.minimum(cylinder.stroke, FAR), cylinder.stop_stiffness, cylinder.stop_damping]
    numbers += [cylinder.friction, cylinder.shear_stiffness]
    numbers += [np.resize(oil[name], size) for name, size in OIL_SIZES.items()]
    return np.concatenate([np.ravel(of) for of in numbers]).astype(float)


def kernel_cylinder(cylinder: LuffingCylinder | FreeExtension, t: Array) -> Cylinder:
    """Return the kernel's data of a cylinder at times t (T,).

    A cylinder without a stroke has one from 0 to inf; an extension without a drive has the drive of a force.
    """
    kind, oil = (cylinder.drives or ("force",))[0], cylinder.oil
    apart: dict[str, Any] = {}
    if isinstance(cylinder, LuffingCylinder):
        apart = {"foot": cylinder.foot, "lug": cylinder.lug}
    else:
        at_rest = max(cylinder.friction, cylinder.static_friction)
        apart["friction"] = cylinder.friction, at_rest, cylinder.stribeck_speed
        apart["shear_stiffness"] = cylinder.shear_stiffness
    drive: SignalBase | None = next(iter(cylinder.drive_signals.values()), None)
    further = dict[str, Any]()
    if oil is not None:
        further = {
            "areas": oil.areas,
            "volumes": [dead + hose for dead, hose in zip(oil.dead_volumes, oil.hose_volumes, strict=True)],
            **{key: getattr(oil, key) for key in ("bulk_modulus", "leakage", "supply", "tank", "back_pressure")},
        }
        if oil.valve is not None:
            further |= {"gain": oil.valve.gain, "dead_band": oil.valve.dead_band, "laminar": oil.valve.laminar}
        if (valve := oil.counterbalance) is not None:
            further |= {"setting": valve.setting, "ratio": valve.ratio, "range": valve.range}
            further["counterbalance"] = valve.gain
    opening = np.zeros((len(t), 2)) if drive is None else np.column_stack([drive.value(t), drive.rate(t)])
    return Cylinder(
        kind={"force": lib.PMR_CYLINDER_FORCE, "length": lib.PMR_CYLINDER_LENGTH, "oil": lib.PMR_CYLINDER_OIL}[kind],
        **apart,
        spring=cylinder.spring or 0.0,
        damping=cylinder.damping,
        stroke=cylinder.stroke or (0.0, np.inf),
        stop_stiffness=cylinder.stop_stiffness,
        stop_damping=cylinder.stop_damping,
        oil=further,
        drive=opening,
    )
