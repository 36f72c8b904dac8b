"""Payload, tip and stress of a boom that telescopes, from three sensors: python workflows/observe_boom.py.

Random motions are simulated with another model than that of the observer, which has finer meshes, more coordinates and
shorter steps; then once more with other pads, another Young's modulus and friction of the pads.  Errors of estimates
are printed, with the shares of true values within bands of 90 %.  Motions 0 to 9 were there to choose the observer's
settings; 10 to 39 are judged.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import pmr
from pmr.observe.budget import output_errors
from pmr.observe.linear import linearize
from pmr.observe.observer import Observer, Parameter, Payload, Sensor, UnknownLoad
from pmr.observe.parameters import ParameterObserver
from pmr.pipeline import run
from pmr.scene.scene import Scene
from pmr.system.system import System

Array = NDArray[np.float64]

#: Motions by which settings were chosen (`temper` by the first five of them), and those by which observers are judged.
TUNING, HELD_OUT = range(10), range(10, 40)
END, STEP, TRUE_STEP, MEASURED_EVERY = 6.0, 1e-3, 5e-4, 2  # s, s, s and steps
NOMINAL = 300.0  # kg: the model's payload
DEVIATION, TIME = 150.0, 0.15  # N and s, of the random force at the tip
FORCE, LOAD = "base: force of luffing cylinder", "fly.tip force"
ACCELERATIONS = ("acceleration of fly: tip z", "acceleration of middle: tip z")
NOISE = dict.fromkeys(ACCELERATIONS, 0.02) | {FORCE: 300.0}
TIP = "fly: tip z"
STRESSES = ("base: base probe stress axial", "middle: middle probe stress axial")
ESTIMATES = ("payload", TIP, *STRESSES)
OUTPUTS = (TIP, *NOISE, *STRESSES)
#: Elements of a section in the observer's model, and kg of a payload with which changes are computed once more.
ELEMENTS, HEAVIER = 40, 100.0
#: Largest relative deviations from the model's stiffness of pads and Young's modulus, and largest friction.
PADS, YOUNG, FRICTION = 0.5, 0.03, 0.1


@dataclass(frozen=True)
class Beams:
    """Beams and pads of a boom: stiffness of a pad in N/m, Young's modulus in Pa, coefficient of friction."""

    pads: float = 1e8
    young: float = 210e9
    friction: float = 0.0


#: What observers of other beams estimate: Young's modulus and the compliance of pads, over those of the model.  Both
#: are uniform within their ranges, or their inverse is; the models have other values of these.
PARAMETERS, MEAN, DEVIATIONS = ("young", "compliance of pads"), np.array([1.0, 1.099]), np.array([0.0173, 0.355])
MODELS = ((1.0, 1.0), (0.97, 1.0), (1.03, 1.0), (1.0, 0.65), (1.0, 1.6), (1.03, 1.6))


class Motion(NamedTuple):
    """Random motion and the beams of its second truth."""

    extensions: Sequence[float]  # (4,) m
    payload: float  # kg
    force: Array  # N, at the tip, every 0.5 ms
    other: Beams
    noise: np.random.Generator  # of measurements


def draw(number: int) -> Motion:
    """Motion of this number; stiffness, modulus and friction of its other beams are uniform within their ranges."""
    rng = np.random.default_rng([2026, number])
    extensions = rng.uniform(0.6, 4.5, 4).tolist()
    for k in range(1, 4):
        extensions[k] = float(np.clip(extensions[k], extensions[k - 1] - 1.2, extensions[k - 1] + 1.2))
    payload, decay = float(rng.uniform(200.0, 420.0)), np.exp(-TRUE_STEP / TIME)
    noise = rng.standard_normal(round(END / TRUE_STEP) + 1)
    force = np.zeros(len(noise))
    force[0] = DEVIATION * noise[0]
    for k in range(1, len(force)):
        force[k] = decay * force[k - 1] + DEVIATION * np.sqrt(1.0 - decay**2) * noise[k]
    pads, young, friction = rng.uniform((-PADS, -YOUNG, 0.0), (PADS, YOUNG, FRICTION)).tolist()
    return Motion(extensions, payload, force, Beams((1.0 + pads) * 1e8, (1.0 + young) * 210e9, friction), rng)


def boom(
    motion: Motion,
    beams: Beams,
    *,
    truth: bool,
    estimate: bool = False,
    payload: float = NOMINAL,
    cells: int = ELEMENTS,
) -> Scene:
    """Scene of a motion: the truth, with its payload and force, or the observer's model without a force."""
    elements, coordinates = (60, 9) if truth else (cells, 6)
    rubs = f",friction={beams.friction}" if beams.friction else ""
    ring = f"[{{at=0.15,stiffness={beams.pads},unilateral=false{rubs},faces={{bottom=[0.0],top=[0.0]}}}}]"
    times = (TRUE_STEP * np.arange(len(motion.force))).tolist()
    table = f"{{kind='table',interpolation='linear',times={times},values={motion.force.tolist()}}}"
    stands = "{name='luffing cylinder',on=1.5,directions=['z'],stiffness=5e7}"
    changes = [
        f"section.mesh.elements={elements}", f"section.reduction.coordinates={coordinates}",
        f"section.reduction.estimate={str(estimate).lower()}", f"sections.base.reduction.coordinates={coordinates}",
        f"section.body.material.young={beams.young}", "start='equilibrium'", f"time.end={END}",
        f"time.step={TRUE_STEP if truth else STEP}", "time.rho_inf=0.9", "compare.against=[]", "simulation.repeats=1",
        "damping={ratio=0.01,frequencies=[1.0,30.0]}", f"section.joint.tail={ring}", f"section.joint.mouth={ring}",
        f"section.joint.extension={{kind='smooth_ramp',times=[0.2,2.1,4.0,5.9],values={list(motion.extensions)}}}",
        f"sections.base.supports=[{{name='pin',on=0.0,kind='pinned'}},{stands}]",
        "sections.base.probes=[{name='base probe',at=[4.0,0.0,0.2]}]",
        "sections.middle.probes=[{name='middle probe',at=[4.8,0.0,0.18]}]",
        f"sections.fly.masses=[{{name='payload',on='tip',mass={motion.payload if truth else payload}}}]",
        f"sections.fly.loads=[{{name='tip force',on='tip',direction='z',signal={table if truth else 0.0}}}]",
    ]  # fmt: skip
    return pmr.load_scene("boom_three", changes)


class Truth(NamedTuple):
    """Simulated motion: times (n,) in s, and outputs (n,) by name, with second differences of displacements."""

    t: Array
    outputs: Mapping[str, Array]


def simulate(scene: Scene, system: System) -> Truth:
    """Outputs of a scene on a system."""
    response = pmr.simulate(scene, system)
    numbers = {output.name: k for k, output in enumerate(response.outputs)}
    outputs = {name: response.column(numbers[name.removeprefix("acceleration of ")]) for name in OUTPUTS}
    for name in ACCELERATIONS:
        outputs[name] = np.gradient(np.gradient(outputs[name], response.t), response.t)
    return Truth(response.t, outputs)


def simulate_truth(motion: Motion, beams: Beams) -> Truth:
    """Truth of a motion on these beams."""
    scene = boom(motion, beams, truth=True)
    return simulate(scene, pmr.reduce(scene).system)


@cache
def reduced(beams: Beams, payload: float = NOMINAL, cells: int = ELEMENTS) -> System:
    """Reduced system of the observer's kind of model, for all extensions of the motions."""
    motion = draw(0)._replace(extensions=(0.6, 1.8, 3.0, 4.5))
    return pmr.reduce(boom(motion, beams, truth=False, payload=payload, cells=cells)).system


def reference(motion: Motion, beams: Beams, payload: float = NOMINAL, cells: int = ELEMENTS) -> Array:
    """`OUTPUTS` (T, q) of the observer's kind of model without a force, on these beams."""
    scene = boom(motion, beams, truth=False, payload=payload, cells=cells)
    return np.column_stack([values[1:] for values in simulate(scene, reduced(beams, payload, cells)).outputs.values()])


@cache
def budget() -> Mapping[str, Any]:
    """Error budget of the observer's model, without its structural model, since the truth has beams, too."""
    scene = boom(draw(0)._replace(extensions=(0.6, 1.8, 3.0, 4.5)), Beams(), truth=False, estimate=True)
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(scene, measures=Path(folder))
    assert outcome is not None
    return {**outcome.result.summary, "budget": {"mesh": outcome.result.summary["budget"]["mesh"]}}


def observer(motion: Motion, beams: Beams, further: Sequence[Parameter]) -> Observer:
    """Observer of a motion on these beams, with `further` parameters."""
    model = linearize(boom(motion, beams, truth=False), reduced(beams), OUTPUTS, [LOAD])
    errors = {part: of for part, of in output_errors(budget(), model, STEP).items() if part != "mesh"}
    sensors = [Sensor(name, noise) for name, noise in NOISE.items()]
    loads, payload = [UnknownLoad(LOAD, DEVIATION, TIME)], Payload(LOAD, ACCELERATIONS[0], 100.0)
    return Observer(model, sensors, loads, payload, further, errors)


def observers(motion: Motion, *, other: bool) -> Observer | ParameterObserver:
    """Observer of a motion; for `other` beams one that estimates Young's modulus and the compliance of pads.

    Mesh and friction are parameters that only widen bands.  A stress is wrong where a pad passes its probe, so the
    change of the mesh is that to infinitely many elements, by Richardson.  Friction does not change accelerations,
    since starts and stops of pads that rub have no pattern known beforehand.
    """
    usual = reference(motion, Beams())
    mesh = 4.0 / 3.0 * (reference(motion, Beams(), cells=2 * ELEMENTS) - usual)
    further = [Parameter("mesh", mesh, estimated=False)]
    if not other:
        return observer(motion, Beams(), further)
    rubbing, heavier = Beams(friction=FRICTION), NOMINAL + HEAVIER
    change = reference(motion, rubbing) - usual
    growth = (reference(motion, rubbing, heavier) - reference(motion, Beams(), heavier) - change) / HEAVIER
    growth = (
        change * np.sum(change * growth, axis=0) / np.sum(change**2, axis=0)
    )  # forces of pads grow with the payload
    rates = [OUTPUTS.index(name) for name in ACCELERATIONS]
    change[:, rates] = growth[:, rates] = 0.0
    further.append(Parameter("friction", change, np.sqrt(1.0 / 12.0), False, 0.5, growth))
    models = [Beams(1e8 / compliance, 210e9 * young) for young, compliance in MODELS]
    each = [observer(motion, beams, further) for beams in models]
    return ParameterObserver(PARAMETERS, MEAN, DEVIATIONS, np.array(MODELS), each)


class Judged(NamedTuple):
    """RMS error of an estimate, as a fraction of the payload or of the largest true value, and share in 90 % bands."""

    error: float
    share: float
    last: float  # error at the end


def judge(number: int, *, other: bool) -> dict[str, Judged]:
    """Errors and shares by estimate from 1 s on, on the beams of the model or on the `other` ones of a motion."""
    motion = draw(number)
    truth, every = simulate_truth(motion, motion.other if other else Beams()), round(STEP / TRUE_STEP)
    estimator, t = observers(motion, other=other), STEP * np.arange(1, round(END / STEP) + 1)
    true = {name: values[every::every].copy() for name, values in truth.outputs.items()}
    for name in ACCELERATIONS:
        true[name][-1] = np.nan  # second differences end before the last step
    at = slice(MEASURED_EVERY - 1, None, MEASURED_EVERY)
    measured = {
        name: (t[at], (true[name] + noise * motion.noise.standard_normal(len(t)))[at]) for name, noise in NOISE.items()
    }
    estimates, late, judged = estimator.run(measured), t > 1.0, dict[str, Judged]()
    true["payload"] = np.full(len(t), motion.payload - NOMINAL)
    for name in ESTIMATES:
        error = estimates.of(name)[0] - true[name]
        size = motion.payload if name == "payload" else np.abs(true[name]).max()
        share = estimates.coverage(name, np.where(late, true[name], np.nan))
        judged[name] = Judged(float(np.sqrt(np.mean(error[late] ** 2)) / size), share, float(abs(error[-1]) / size))
    return judged


def main() -> None:
    """Print errors and shares of each motion, and of all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tuning", action="store_true", help="motions 0 to 9 in place of the held-out ones")
    numbers = TUNING if parser.parse_args().tuning else HELD_OUT
    for other in (False, True):
        print("other beams" if other else "the model's beams", flush=True)
        motions = list[dict[str, Judged]]()
        for number in numbers:
            motions.append(judge(number, other=other))
            listed = (f"{100.0 * each.error:.3f} % ({each.share:.2f})" for each in motions[-1].values())
            print(f"  {number}:", ", ".join(listed), flush=True)
        for name in ESTIMATES:
            error, share, last = np.array([motion[name] for motion in motions]).T
            rms, at_end = (100.0 * np.sqrt(np.mean(values**2)) for values in (error, last))
            print(f"{name}: {rms:.3f} %, at the end {at_end:.3f} %, within bands {share.mean():.3f}", flush=True)


if __name__ == "__main__":
    main()
