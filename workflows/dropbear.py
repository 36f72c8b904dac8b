"""Position of the roller of DROPBEAR from an acceleration, and strain: python workflows/dropbear.py FOLDER.

FOLDER holds series of Dataset-8 (A. Vereen, A. Downey, J. Dodson, A. G. Moura, DROPBEAR Acceleration vs Roller
Displacement, 2023, CC BY-SA 4.0) as .npz files with the arrays acceleration, strain_a, strain_b, pin and rate.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.signal

import pmr
from pmr.export.state_space import state_space
from pmr.observe.position import PlaceModels, PositionObserver, PositionSettings, SlidingNoise, place_models

# pin in V at commanded places in m, and frequencies in Hz identified there in stepped series
PIN = np.array([1.2275, 1.6475, 2.0835, 2.505, 2.9365, 3.369])
PLACES = np.array([48.0, 72.0, 96.0, 120.0, 144.0, 168.0]) * 1e-3
F1, F2 = (26.26, 28.23, 30.80, 33.89, 37.55, 41.97), (160.3, 178.7, 194.1, 214.0, 236.0, 268.7)
MEASURED = {s: (low, high) for s, low, high in zip(PLACES, F1, F2, strict=True)}
EVERY, STEP = 4, 8e-4  # of the samples at 5 kHz, and s
SENSOR = 0.05321  # kg, identified
DAMPING = (0.001, 0.004, 0.01)
STAND = {24.4: 0.018}  # Hz: damping ratio, of a vibration in all series that does not depend on the roller's place
GAUGE = 0.318  # m, of the strain gauges: identified on rand0
GRID = np.arange(0.040, 0.1761, 0.0025)  # m


def smooth(values: np.ndarray) -> np.ndarray:
    """Mean of each value (T,) with the twelve before it and the twelve behind it."""
    return np.convolve(np.pad(values, 12, mode="edge"), np.ones(25) / 25, "valid")


def speed(place: np.ndarray) -> np.ndarray:
    """Speed (T,) of the roller in m/s."""
    return np.abs(np.gradient(smooth(place), STEP))


def series(file: Path) -> dict[str, Any]:
    """True position (T,) in m, filtered acceleration, its power above the modes, and strains: every fourth sample."""
    with np.load(file) as data:
        raw = {name: np.asarray(data[name], float) for name in data.files}
    pin = smooth(raw["pin"])
    inner = np.interp(pin, PIN, PLACES)
    slopes = np.diff(PLACES)[[0, -1]] / np.diff(PIN)[[0, -1]]
    place = inner + np.minimum(pin - PIN[0], 0.0) * slopes[0] + np.maximum(pin - PIN[-1], 0.0) * slopes[1]

    def low(x):  # type: ignore[no-untyped-def]
        return scipy.signal.sosfilt(scipy.signal.butter(4, 300.0, fs=5000, output="sos"), x)[::EVERY]

    high = scipy.signal.sosfilt(scipy.signal.butter(4, 800.0, "high", fs=5000, output="sos"), raw["acceleration"])
    power = scipy.signal.lfilter([0.04], [1, -0.96], high**2)[::EVERY]
    strains = [low(raw[name] - raw[name][0]) for name in ("strain_a", "strain_b")]
    return {
        "name": file.stem,
        "y": low(raw["acceleration"]),
        "power": power,
        "place": place[::EVERY],
        "strain": strains,
    }


def begin(place: np.ndarray) -> int:
    """Number of the step from which a series is judged: 0.4 s after the roller first moves, nothing vibrates before."""
    return int(np.argmax(speed(place) > 0.03)) + 500


def models() -> PlaceModels:
    """Models over the roller's places, with frequencies as measured; their output is curvature at the gauges in 1/m."""
    reduction = pmr.reduce(pmr.load_scene(Path(__file__).with_suffix(".toml"), ["reduction.estimate=false"]))
    space = state_space(reduction.system, {reduction.system.paths[0]: GRID}, "dropbear")
    x = np.array([float(name.split()[2]) if " at " in name else np.inf for name in space.outputs])
    node = int(np.argmin(np.abs(x - GAUGE)))
    curvature = np.zeros(len(x))
    curvature[node - 1 : node + 2] = np.array([1.0, -2.0, 1.0]) / (x[node] - x[node - 1]) ** 2
    return place_models(space, "sensor", STEP, DAMPING, SENSOR, MEASURED, [curvature], STAND)


def judge(observer: PositionObserver, data: list[dict[str, Any]], delay: float = 0.0) -> dict[str, float]:
    """Errors of positions in mm, over all and at rest and in motion, and shares in 90 % bands.

    Positions follow from accelerations up to `delay` s later.
    """
    errors, inside, moving = list[Any](), list[Any](), list[Any]()
    for one in data:
        found = observer.run(one["y"], one["power"], delay)
        low, high = found.band()
        chosen = slice(begin(one["place"]), -25)
        errors.append((1e3 * (found.mean - one["place"]))[chosen])
        inside.append(((one["place"] > low) & (one["place"] < high))[chosen])
        moving.append((speed(one["place"]) > 0.01)[chosen])
    error, held, moves = (np.concatenate(parts) for parts in (errors, inside, moving))
    figures = {"rms": np.sqrt(np.mean(error**2)), "held": np.mean(held), "median": np.median(np.abs(error))}
    for name, which in (("rest", ~moves), ("motion", moves)):
        figures |= {f"rms {name}": np.sqrt(np.mean(error[which] ** 2)), f"held {name}": np.mean(held[which])}
    return {name: float(value) for name, value in figures.items()}


def strain(observer: PositionObserver, data: list[dict[str, Any]], gauge: int) -> tuple[np.ndarray, np.ndarray]:
    """Estimated curvature and measured strain of one gauge (T,) above 10 Hz, of several series behind each other.

    Modes follow the acceleration where `STRAIN_NOISE` is large; the settings for positions trust the model more.
    """
    observer = replace(observer, settings=replace(observer.settings, mode_noise=STRAIN_NOISE))
    band = scipy.signal.butter(2, 10.0, "high", fs=1.0 / STEP, output="sos")
    pairs = []
    for one in data:
        chosen = slice(begin(one["place"]), -25)
        curvature = observer.run(one["y"], one["power"]).outputs[:, 0]
        pairs.append([scipy.signal.sosfilt(band, x)[chosen] for x in (curvature, one["strain"][gauge])])
    return np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])


def tune(of: PlaceModels, data: list[dict[str, Any]], seconds: float, start: PositionSettings) -> PositionSettings:
    """Settings of the least error on some series, with bands that hold 90 %, by random search."""
    rng, names = np.random.default_rng(3), [field.name for field in fields(PositionSettings)]
    best: list[tuple[float, PositionSettings]] = []
    end = time.process_time() + seconds
    while time.process_time() < end:
        settings = start if not best else best[rng.integers(min(5, len(best)))][1]
        if best:
            for name in names:
                value = getattr(settings, name)
                exponents = rng.normal(0.0, 0.2, np.size(value)) * (rng.random(np.size(value)) < 0.4)
                moved = np.atleast_1d(value) * 10**exponents
                moved = np.minimum(moved, {"speeds": 1.5, "temper": 1.0, "attack": 1.0, "decay": 1.0}.get(name, np.inf))
                numbers = sorted(moved.tolist()) if name == "speeds" else moved.tolist()
                several = SlidingNoise._make if name == "noise" else tuple
                change: dict[str, Any] = {name: several(numbers) if isinstance(value, tuple) else numbers[0]}
                settings = replace(settings, **change)
            if settings.turn > 0.3 or settings.start > 0.3 or settings.spread > 0.15:
                continue
        try:
            figures = judge(PositionObserver(of, settings), data)
        except (np.linalg.LinAlgError, pmr.InputError):
            continue
        loss = figures["rms"] + 10.0 * abs(figures["held"] - 0.9) + 4.0 * max(0.0, 0.87 - figures["held motion"])
        best = sorted([*best, (loss if np.isfinite(loss) else 1e9, settings)], key=lambda pair: pair[0])[:20]
    return best[0][1]


def judge_strain(
    observer: PositionObserver, tuned: list[dict[str, Any]], others: list[dict[str, Any]], gauge: int
) -> dict[str, float]:
    """NRMS error and correlation of the strain of one gauge in `others`, with its sensitivity from series `tuned`."""
    curvature, measured = strain(observer, tuned, gauge)
    scale = curvature @ measured / (curvature @ curvature)
    curvature, measured = strain(observer, others, gauge)
    error = np.sqrt(np.sum((scale * curvature - measured) ** 2) / np.sum(measured**2))
    return {"NRMS": float(error), "correlation": float(np.corrcoef(scale * curvature, measured)[0, 1])}


def main() -> None:
    """Print errors of positions and strains of all series in the folder, or tune on some of them and print settings."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tune", type=float, default=0.0, help="seconds")
    parser.add_argument("--on", default="rand0,slow0,slow3", help="series that are tuned on")
    arguments = parser.parse_args()
    if not (files := sorted(arguments.folder.glob("*.npz"))):
        parser.exit(2, f"{arguments.folder}: no series there; they are those of Dataset-8 as .npz files\n")
    of, data = models(), [series(file) for file in files]
    settings = SETTINGS
    if arguments.tune:
        settings = tune(of, [one for one in data if one["name"] in arguments.on], arguments.tune, settings)
        print(settings)
    observer = PositionObserver(of, settings)
    tuned, others = ([one for one in data if (one["name"] in arguments.on) is of_them] for of_them in (True, False))
    for some in (*([one] for one in data), others):
        for delay in DELAYS if some else ():
            figures = judge(observer, some, delay)
            names, listed = "+".join(one["name"] for one in some), ", ".join(f"{k} {x:.2f}" for k, x in figures.items())
            print(names, f"{delay} s later:", listed)
    for gauge in (0, 1):
        recorded = [[one for one in some if np.isfinite(one["strain"][gauge]).all()] for some in (tuned, others)]
        if all(recorded):
            figures = judge_strain(observer, recorded[0], recorded[1], gauge)
            print(f"strain {'ab'[gauge]} of the others:", ", ".join(f"{key} {x:.3f}" for key, x in figures.items()))


#: By random search on rand0, slow0 and slow3, rounded.
SETTINGS = PositionSettings(
    mode_noise=(4.2e-4, 3.7e-3, 1.55e-3, 1.66e-3),
    speeds=(0.0084, 0.485),
    turn=0.205,
    start=0.016,
    quiet=0.2,
    spread=0.012,
    temper=0.27,
    attack=0.176,
    decay=0.0203,
    floor=2e-7,
    active=3.6e-5,
    share=0.19,
    noise=SlidingNoise(moving=4.27, rest=1.6e-6, trust=7.4e-3),
)
#: Seconds after a position whose measurements are used.
DELAYS = (0.0, 0.04, 0.1, math.inf)
#: Noise of modes for strains, chosen on rand0 as the place of the gauges.
STRAIN_NOISE = (0.0885, 0.92, 5.35e-4, 1.2e-3)

if __name__ == "__main__":
    main()
