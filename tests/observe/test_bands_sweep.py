"""Bands of an observer on random motions of a boom whose truth is another model.

Truth has 60 elements a section in place of 40, nine coordinates in place of six and steps of 1 ms in place of 4; a
second truth of each motion also has pads half as stiff and steel 3 % softer.  One motion as a rule; ``PMR_SWEEP=full``
takes 40.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import pmr
from pmr.observe.budget import output_errors
from pmr.observe.linear import LinearMotion, linearize, output_sensitivity
from pmr.observe.observer import Observer, Parameter, Payload, Sensor, UnknownLoad
from pmr.pipeline import run
from pmr.scene.scene import Scene

Array = NDArray[np.float64]
SEEDS = range(40) if os.environ.get("PMR_SWEEP") == "full" else (1,)
END, STEP, NOMINAL, DEVIATION, TIME = 6.0, 4e-3, 300.0, 150.0, 0.15
TIP, LOAD, FORCE = "fly: tip z", "fly.tip force", "base: force of luffing cylinder"
ACCELERATIONS = ("acceleration of fly: tip z", "acceleration of middle: tip z")
STRESSES = ("base: base probe stress axial", "middle: middle probe stress axial")
NOISE = dict.fromkeys(ACCELERATIONS, 0.02) | {FORCE: 300.0}
SOFTER = {"pads": {"pads": 5e7}, "young": {"young": 0.97 * 210e9}}
#: Largest RMS error on the beams of the model and on softer ones: of the payload's, else of the peak value.
LARGEST = {"payload": (0.04, 0.04), TIP: (0.002, 0.03), STRESSES[0]: (0.01, 0.01), STRESSES[1]: (0.01, 0.01)}


class Judged(NamedTuple):
    """RMS error of an estimate as a fraction, and share of true values within its band."""

    error: float
    share: float


def boom(seed: int, *, payload: float = NOMINAL, young: float = 210e9, pads: float = 1e8, signal: str = "0.0",
         truth: bool = False, estimate: bool = False) -> Scene:  # fmt: skip
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.6, 4.5, 4).tolist()
    for k in range(1, 4):
        values[k] = float(np.clip(values[k], values[k - 1] - 1.2, values[k - 1] + 1.2))
    ring = f"[{{at=0.15,stiffness={pads},unilateral=false,faces={{bottom=[0.0],top=[0.0]}}}}]"
    elements, coordinates, step = (60, 9, 1e-3) if truth else (40, 6, STEP)
    stands = "{name='luffing cylinder',on=1.5,directions=['z'],stiffness=5e7}"
    changes = [
        f"section.mesh.elements={elements}", f"section.reduction.coordinates={coordinates}",
        f"section.reduction.estimate={str(estimate).lower()}", f"sections.base.reduction.coordinates={coordinates}",
        f"section.body.material.young={young}", "start='equilibrium'", f"time.end={END}", f"time.step={step}",
        "time.rho_inf=0.9", "damping={ratio=0.01,frequencies=[1.0,30.0]}", "compare.against=[]",
        f"section.joint.tail={ring}", f"section.joint.mouth={ring}", "simulation.repeats=1",
        f"section.joint.extension={{kind='smooth_ramp',times=[0.2,2.1,4.0,5.9],values={values}}}",
        f"sections.base.supports=[{{name='pin',on=0.0,kind='pinned'}},{stands}]",
        "sections.base.probes=[{name='base probe',at=[4.0,0.0,0.2]}]",
        "sections.middle.probes=[{name='middle probe',at=[4.8,0.0,0.18]}]",
        f"sections.fly.masses=[{{name='payload',on='tip',mass={payload}}}]",
        f"sections.fly.loads=[{{name='tip force',on='tip',direction='z',signal={signal}}}]",
    ]  # fmt: skip
    return pmr.load_scene("boom_three", changes)


def motion(scene: Scene) -> LinearMotion:
    return linearize(scene, pmr.reduce(scene).system, [TIP, *NOISE, *STRESSES], [LOAD])


def random_force(rng: np.random.Generator) -> str:
    """Signal of a random process with the standard deviation and the time that the observer is told."""
    t, decay = np.arange(0.0, END + 1e-9, 1e-3), np.exp(-1e-3 / TIME)
    f = np.zeros(len(t))
    f[0] = DEVIATION * rng.standard_normal()
    for k in range(1, len(t)):
        f[k] = decay * f[k - 1] + DEVIATION * np.sqrt(1.0 - decay**2) * rng.standard_normal()
    return f"{{kind='table',interpolation='linear',times={t.tolist()},values={f.tolist()}}}"


def judge(seed: int, summary: dict[str, object]) -> list[dict[str, Judged]]:
    """Errors and shares by estimate, on the beams of the model and on softer ones, from 1 s on."""
    rng, model = np.random.default_rng(10_000 + seed), motion(boom(seed))
    payload, signal = rng.uniform(200.0, 420.0), random_force(rng)
    parameters = [Parameter(name, output_sensitivity(model, motion(boom(seed, **of)))) for name, of in SOFTER.items()]
    sensors = [Sensor(name, noise) for name, noise in NOISE.items()]
    judged = []
    for changes, known in (({}, []), (SOFTER["pads"] | SOFTER["young"], parameters)):
        scene = boom(seed, payload=payload, signal=signal, truth=True, **changes)
        response = pmr.simulate(scene, pmr.reduce(scene).system)
        names, every = [output.name for output in response.outputs], round(STEP / 1e-3)

        def history(name: str) -> Array:
            """Output of the truth, or second differences of a displacement, at the steps of the model."""
            y = response.column(names.index(name.removeprefix("acceleration of ")))  # noqa: B023
            if name in ACCELERATIONS:
                y = np.gradient(np.gradient(y, response.t), response.t)  # noqa: B023
            return y[::every][1:]  # noqa: B023

        data = {n: (model.t, history(n) + noise * rng.standard_normal(len(model.t))) for n, noise in NOISE.items()}
        hangs = Payload(LOAD, ACCELERATIONS[0], 100.0)
        errors = output_errors(summary, model, STEP)
        estimates = Observer(model, sensors, [UnknownLoad(LOAD, DEVIATION, TIME)], hangs, known, errors).run(data)
        late, figures = model.t > 1.0, dict[str, Judged]()
        for name in LARGEST:
            true = np.full(len(late), payload - NOMINAL) if name == "payload" else history(name)
            size = payload if name == "payload" else np.abs(true).max()
            off = np.sqrt(np.mean((estimates.of(name)[0] - true)[late] ** 2)) / size
            figures[name] = Judged(float(off), estimates.coverage(name, np.where(late, true, np.nan)))
        judged.append(figures)
    return judged


@pytest.mark.slow
@pytest.mark.numerical
def test_estimates_are_near_the_truth_and_bands_hold_it(tmp_path: Path) -> None:
    outcome = run(boom(1000, estimate=True), measures=tmp_path)
    assert outcome is not None
    summary = outcome.result.summary
    summary["budget"].pop("model")  # the truth has beams, too
    motions = [judge(seed, summary) for seed in SEEDS]
    for figures in motions:
        for name, largest in LARGEST.items():
            assert all(of[name].error < bound for of, bound in zip(figures, largest, strict=True)), (name, figures)
    shares = {name: np.mean([[of[name].share for of in figures] for figures in motions], axis=0) for name in LARGEST}
    assert all(of[0] > 0.6 for of in shares.values()), shares
