"""A boom on oil that luffs by itself, and the equations of a rigid boom and of the oil's flows in NumPy."""

from functools import cache
from types import SimpleNamespace

import free_boom
import numpy as np

from pmr.files.arrays import Array
from pmr.simulation.free_base import FreeBase
from pmr.simulation.native.free_motion import LuffingRun
from pmr.simulation.native.machine import CYLINDER_COLUMNS

G = 9.80665
FOOT, LUG, STROKE = np.array([0.5, -0.6]), np.array([1.2, -0.15]), (0.6, 1.3)
AREAS, DEAD, K, LEAKAGE, SUPPLY, TANK, BACK = (8e-3, 5e-3), (2e-4, 3e-4), 1.4e9, 2e-13, 20e6, 2e5, 1e6
GAIN, BAND, LAMINAR = (2e-7, 1.5e-7), 0.05, 1e4
SETTING, RATIO, RANGE, COUNTERBALANCE = 9e6, 3.0, 4e6, 2.5e-7
#: Stiff enough to be rigid beside the oil, at a constant extension.
RIGID = (
    "section.body.material.young=2.1e16",
    "section.joint.tail.0.stiffness=1e13",
    "section.joint.mouth.0.stiffness=1e13",
    "sections.fly.joint.extension={kind='constant', amount=0.6}",
    "frame.luffing='free'",
    "frame.luffing_start=0.3",
)


def oil(opening: str = "", changes: str = "", counterbalance: bool = False) -> str:
    """Key of a cylinder with oil, fed by a valve of such an opening."""
    valve = f"valve={{opening={opening}, gain={list(GAIN)}, dead_band={BAND}, laminar={LAMINAR}}}, " if opening else ""
    if counterbalance:
        valve += f"counterbalance={{setting={SETTING}, ratio={RATIO}, range={RANGE}, gain={COUNTERBALANCE}}}, "
    keys = f"areas={list(AREAS)}, dead_volumes={list(DEAD)}, bulk_modulus={K}, leakage={LEAKAGE}, "
    keys += f"supply={SUPPLY}, tank={TANK}, back_pressure={BACK}, "
    inner = (keys + valve + changes).rstrip(", ")
    return f"frame.cylinder={{foot={FOOT.tolist()}, lug={LUG.tolist()}, stroke={list(STROKE)}, oil={{{inner}}}}}"


def simulated(*changes: str) -> SimpleNamespace:
    """Columns of the cylinder, angle, rate and second rate (3, T), times, and the boom, of a run with these keys."""
    made = tuple(key for key in changes if not key.startswith("time."))
    scene = free_boom.scene(*changes)
    run = LuffingRun(scene, free_boom.system(*made))
    moved = run.with_luffing().frame.luffing.samples
    columns = dict(zip(CYLINDER_COLUMNS, run.simulation.cylinder.T, strict=True))
    t = scene.time.step * np.arange(moved.values.shape[1])
    return SimpleNamespace(
        t=t, angle=moved.values, boom=rigid(*made), **{k.replace(" ", "_"): v for k, v in columns.items()}
    )


@cache
def rigid(*changes: str) -> SimpleNamespace:
    """Moments of the undeformed boom about the pivot: of inertia J in kg m^2, first ones along x and z in kg m.

    `second` are the integrals of rho x^2, z^2, x z, x y and y z in kg m^2.
    """
    scene = free_boom.scene(*changes)
    boom = FreeBase(scene, free_boom.system(*changes)).boom
    out = np.cumsum([0.0, float(scene.extension(1).value(np.zeros(1))[0])])
    I = boom.inertia.sum(axis=0)  # noqa: E741
    J, sx, sz = I[1, 1], 0.0, 0.0
    second = (
        np.array([I[1, 1] + I[2, 2] - I[0, 0], I[0, 0] + I[1, 1] - I[2, 2], *(-2.0 * I[0, [2, 1]]), -2.0 * I[1, 2]])
        / 2.0
    )
    for mass, first, extension in zip(boom.masses, boom.first, out, strict=True):
        x, z = boom.place[0] + extension, boom.place[2]
        J += mass * (x * x + z * z) + 2.0 * (x * first[0] + z * first[2])
        place = np.array([x, boom.place[1], z])
        shifted = mass * np.outer(place, place) + np.outer(place, first) + np.outer(first, place)
        second += shifted[[0, 2, 0, 0, 1], [0, 2, 2, 1, 2]]
        sx, sz = sx + mass * x + first[0], sz + mass * z + first[2]
    return SimpleNamespace(J=J, sx=sx, sz=sz, second=second)


def geometry(angle: float) -> tuple[float, float]:
    """Length of the cylinder and its arm dL / d angle."""
    c, s = np.cos(angle), np.sin(angle)
    lug = np.array([[c, -s], [s, c]]) @ LUG
    length = float(np.hypot(*(lug - FOOT)))
    return length, float((lug - FOOT) @ (np.array([[-s, -c], [c, -s]]) @ LUG)) / length


def weight_moment(boom: SimpleNamespace, angle: float) -> float:
    return -G * (boom.sx * np.cos(angle) - boom.sz * np.sin(angle))


def chambers(length: float) -> Array:
    return np.array([DEAD[0] + AREAS[0] * (length - STROKE[0]), DEAD[1] + AREAS[1] * (STROKE[1] - length)])


def edge(gain: float, drop: float) -> float:
    return gain * drop / (drop**2 + LAMINAR**2) ** 0.25


def flows(opening: float, p: Array, counterbalance: bool) -> Array:
    """Flows into bore and rod side."""
    effective = np.sign(opening) * max(abs(opening) - BAND, 0.0) / (1.0 - BAND)
    source = (SUPPLY, TANK) if effective > 0.0 else (TANK, SUPPLY)
    gain = abs(effective) * np.array(GAIN)
    if counterbalance and p[0] > source[0] and gain[0] > 0.0:
        lift = np.clip((p[0] + RATIO * p[1] - SETTING) / RANGE, 0.0, 1.0)
        second = COUNTERBALANCE * lift
        gain[0] = gain[0] * second / np.hypot(gain[0], second)
    q = np.array([edge(gain[i], source[i] - p[i]) for i in range(2)])
    return q + LEAKAGE * (p[::-1] - p)


UP_AND_DOWN = "{kind='smooth_ramp', times=[0.05, 0.15, 0.4, 0.5, 0.55, 0.7], values=[0.0, 0.6, 0.6, 0.0, 0.0, -0.5]}"


def opening_at(t: float) -> float:
    """Opening of `UP_AND_DOWN`."""
    times, values = np.array([0.05, 0.15, 0.4, 0.5, 0.55, 0.7]), np.array([0.0, 0.6, 0.6, 0.0, 0.0, -0.5])
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, 4))
    x = float(np.clip((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0))
    return float(values[k] + (values[k + 1] - values[k]) * x**3 * (10.0 - 15.0 * x + 6.0 * x * x))
