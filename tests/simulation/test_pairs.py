"""Pairs of what a machine may have run in march, a stepper and an FMU, and forces sum to zero; or they are refused."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import free_boom
import numpy as np
import pytest
from export.fmi.libraries import Instance, loaded
from oil_boom import UP_AND_DOWN, oil
from random_stands import rope_on_machine, unbalanced

import pmr
from pmr import InputError, Response, System
from pmr.compare.evaluation import evaluate_motion
from pmr.export.fmi import fmu_contents
from pmr.export.fmi.description import input_cubics
from pmr.export.fmi.variables import Drivers, Identifiers
from pmr.files.arrays import Array
from pmr.kernel.further import ground_outputs
from pmr.scene import Scene
from pmr.scene.hoist import OUTPUTS, ROPE_FORCE
from pmr.scene.keys import LUFFING
from pmr.simulation import Excitation
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.moving import DRIVE, MovingFrame, read_scene
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.free_motion import prepare_stepping, with_free_motion
from pmr.simulation.reactions import with_forces_on_machine

pytestmark = [pytest.mark.slow, pytest.mark.numerical]

RAMP = "{kind='smooth_ramp', times=[0.02, 0.1], values="
LEGS = ", ".join(
    f"{{name='{name}', at=[{x}, {y}]}}" for name, x, y in (("a", 2, 2), ("b", -2, 2), ("c", -2, -2), ("d", 2, -2))
)
GROUND = (
    "frame.ground={height=1.0, masses=[{name='carrier', mass=3000.0, at=[-0.5, 0.1, -0.6], inertia=[5e2, 9e2, 1e3]}, "
    f"{{name='weight', mass=600.0, at=[-1.0, 0.1, 0.1], slews=true}}], outriggers=[{LEGS}]}}"
)
PLAIN = (
    "frame.second_order=false", "start='equilibrium'", "time.rho_inf=0.9", "time.end=0.1", "time.step=1e-3",
    "gravity={}", f"frame.slewing={RAMP}[0.0, 0.05]}}", f"sections.fly.joint.extension={RAMP}[0.6, 0.62]}}", GROUND,
)  # fmt: skip
FEATURES: dict[str, tuple[str, ...]] = {
    "hoist": ("hoist={payload=60.0, EA=2e6, damping=1e3, falls=2, hanging=1.5, winch={at=[-0.4, 0.1, 0.5]}, "
     f"speed={RAMP}[0.0, 0.3]}}}}",),
    "oil": ("frame.luffing='free'", "frame.luffing_start=0.3", oil(UP_AND_DOWN, "", True)),
    "second order": ("frame.second_order=true",),
    "friction": free_boom.RUBBING,
    "pushing": free_boom.PUSHING,
    "slope": ("frame.ground.slope=[0.03, -0.02]",),
    "rocking base": (f"frame.base={{rx={RAMP}[0.0, 0.004]}}, ry={RAMP}[0.0, -0.003]}}}}",),
}  # fmt: skip
#: Features that run together, all pairs of them and one more.
COMBINED = (*itertools.combinations(FEATURES, 2), ("hoist", "oil", "slope"))
#: Pairs that are refused, with the key that the message names.
REFUSED = {
    ("oil", "friction"): "friction",
    ("oil", "pushing"): "unilateral",
    ("slope", "rocking base"): "frame.base.rx",
}


@dataclass(frozen=True)
class Pair:
    """A scene with two features on outriggers, its run in march, and the motions (3, T) of its drivers by name."""

    names: tuple[str, ...]
    scene: Scene
    computed: Scene
    system: System
    excitation: Excitation
    shown: Response
    frame: MovingFrame
    motions: dict[str, Array]

    @classmethod
    def of(cls, names: tuple[str, ...]) -> Pair:
        """Run a pair in steps that are not divided, where pads only push, too."""
        scene = scene_of(names)
        reduced = pmr.reduce(scene).system
        computed, system = with_free_motion(scene, with_all_inertia(reduced) if "oil" in names else reduced)
        excitation = Excitation.from_scene(computed)
        excitation = replace(excitation, stepping=replace(excitation.stepping, parts=1))
        moved = systems.simulate_form(SystemForm.of(system), excitation)
        shown = with_forces_on_machine(computed, evaluate_motion(system, moved))
        _, _, frame = prepare_stepping(system, "system")
        assert frame is not None
        motions = np.moveaxis(frame.motions(excitation, excitation.times), 1, 0)
        return cls(
            names, scene, computed, system, excitation, shown, frame, dict(zip(frame.drivers, motions, strict=True))
        )

    @property
    def driven(self) -> list[str]:
        """Names of what drives the frame in each step."""
        return [name for name in self.frame.drivers if not (self.frame.computed is not None and name == LUFFING)]

    @property
    def outputs(self) -> list[str]:
        """Names of outputs that are compared."""
        of_hoist = [] if self.scene.hoist is None else list(OUTPUTS)
        return ["fly: tip y", "fly: tip z", *of_hoist, *ground_outputs(self.scene)]

    def run_outputs(self) -> Array:
        """Outputs (T, o) of the run."""
        of_sections = dict(zip(self.shown.output_names, self.shown.displacement.T, strict=True))
        return np.stack([of_sections[n] if n in of_sections else self.shown.other(n) for n in self.outputs], axis=1)

    def stepped(self, parts: int) -> Array:
        """Outputs (T, o) of a stepper under the motions of the run."""

        def at(k: int) -> dict[str, Any]:
            given = {name: tuple(self.motions[name][:, k].tolist()) for name in self.driven}
            paths, loads = ({name: given.pop(name) for name in of} for of in (self.frame.paths, self.frame.loads))
            F = {name: motion[:2] if name.startswith(DRIVE) else motion[0] for name, motion in loads.items()}
            return {"s": paths, "F": F, "frame": given}

        h, steps = self.scene.time.step, self.excitation.stepping.steps
        stepper = pmr.Stepper(self.system, h, **at(0), rho_inf=0.9, outputs=self.outputs, parts=parts)
        return np.array(
            [stepper.outputs[self._numbers(stepper)], *(stepper.step(**at(k)) for k in range(1, steps + 1))]
        )

    def _numbers(self, stepper: pmr.Stepper) -> list[int]:
        return [stepper.output_names.index(name) for name in self.outputs]

    def in_fmu(self, folder: Path) -> Array:
        """Outputs (T, o) of an FMU under inputs that are those of the run at the end of each step.

        Where steps are divided, inputs are the cubics of the FMU's own reference.
        """
        contents = fmu_contents(self.system, read_scene(self.system, "system", free=True), "boom", "3")
        instance, h = Instance(loaded(contents, folder, "3")), self.scene.time.step
        columns = dict(
            zip(
                self.frame.drivers,
                np.moveaxis(input_cubics(Drivers.of(self.system), self.excitation), 2, 0),
                strict=True,
            )
        )
        names = {name: Identifiers()(f"s {name}" if name in self.frame.paths else name) for name in self.driven}
        outputs, suffixes = [Identifiers()(name) for name in self.outputs], ("", "_rate", "_rate_2", "_rate_3")

        def inputs(k: int) -> dict[str, float]:
            """Inputs from step k on."""
            values = dict[str, float]()
            for name, identifier in names.items():
                led = columns[name][:, k]
                if "pushing" not in self.names and not (name in self.frame.loads and not name.startswith(DRIVE)):
                    value, rate, second = self.motions[name][:, k + 1]
                    led = [value - h * rate + h**2 / 2.0 * second, rate - h * second, second, 0.0]
                elif "pushing" not in self.names:
                    led = [self.motions[name][0, k + 1], 0.0, 0.0, 0.0]
                values |= {identifier + suffix: float(x) for suffix, x in zip(suffixes, led, strict=True)}
            return values

        begun = {
            names[name] + suffix: float(x)
            for name in self.driven
            for suffix, x in zip(suffixes, self.motions[name][:, 0], strict=False)
        }
        instance.set(["internal_step"], [h])
        instance.initialise(list(begun), list(begun.values()))
        shown = [instance.get(outputs)]
        for k in range(self.excitation.stepping.steps):
            instance.set(list(inputs(k)), list(inputs(k).values()))
            instance.step(k * h, h)
            shown.append(instance.get(outputs))
        return np.array(shown)


def scene_of(names: tuple[str, ...]) -> Scene:
    """Scene with these features."""
    return free_boom.scene(*PLAIN, *(key for name in names for key in FEATURES[name]))


def rope_on_winch(pair: Pair) -> Array | float:
    """Force and moment about the pivot (T, 6) of the rope on the winch, which pulls it towards the head."""
    scene, shown = pair.scene, pair.shown
    if scene.hoist is None:
        return 0.0
    rope, psi, (x, y, z) = rope_on_machine(scene, shown), scene.frame.slewing.value(shown.t), scene.hoist.winch.at
    winch = np.stack([x * np.cos(psi) - y * np.sin(psi), x * np.sin(psi) + y * np.cos(psi), z + 0.0 * psi], axis=1)
    head = np.array(scene.frame.tail_position) + [scene.sections[-1].length, 0.0, 0.0] + np.zeros((len(psi), 3))
    head[:, 0] += scene.extension(1).value(shown.t)
    for axis in (1, 2):
        head[:, axis] += shown.displacement[:, shown.output_names.index(f"fly: tip {'xyz'[axis]}")]
    way = np.einsum("tij,tj->ti", pair.computed.frame.rotation(shown.t), head) - winch
    expected = shown.other(ROPE_FORCE)[:, None] * way / np.linalg.norm(way, axis=1)[:, None]
    assert rope[:, :3] == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())  # the boom is a little shorter
    return rope


def assert_close(values: Array, expected: Array, share: float) -> None:
    """That columns differ by no more than a share of the largest of each."""
    np.testing.assert_array_less(np.abs(values - expected).max(axis=0), share * np.abs(expected).max(axis=0) + 1e-300)


@pytest.mark.parametrize("names", COMBINED, ids=" and ".join)
def test_pairs_on_outriggers_run_everywhere_or_are_refused(names: tuple[str, ...], tmp_path: Path) -> None:
    """A stepper is march, where a computed angle is prescribed; an FMU is a stepper, led through divided steps."""
    if names in REFUSED:
        with pytest.raises(InputError, match=REFUSED[names]) as refused:
            scene_of(names)
        assert "\n" not in str(refused.value)
        return
    pair = Pair.of(names)
    sums, use = unbalanced(pair.computed, pair.shown, rope_on_winch(pair))
    assert np.abs(sums).max() < 1e-9 and 0.0 < use.min() and use.max() < 1.0
    stepped = pair.stepped(1)
    assert_close(stepped, pair.run_outputs(), 1e-4 if "oil" in names else 1e-10)
    expected = pair.stepped(0) if "pushing" in names else stepped
    # the rate of a free angle is searched for, and found to MACHINE_NEAR of machine.c where no trial comes nearer
    share = 1e-5 if "pushing" in names else 1e-9 if "oil" in names else 1e-10
    assert_close(pair.in_fmu(tmp_path), expected, share)
