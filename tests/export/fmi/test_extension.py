"""FMU of a boom with a section that slides by itself, beside a stepper."""

from pathlib import Path

import free_boom
import numpy as np
import pytest
from export.fmi.libraries import CallError, Instance, loaded
from free_extension import free, scene, system

import pmr
from pmr.export.fmi import fmu_contents
from pmr.simulation.moving import read_scene
from pmr.system.system import System

DRIVES = {
    "force": "force={kind='smooth_ramp', times=[0.0, 0.05], values=[196.0, 800.0]}",
    "straight": "force={kind='ramp', times=[0.0, 0.05], values=[196.0, 800.0]}",
    "opening": "oil={areas=[2e-3, 1.2e-3], dead_volumes=[2e-4, 3e-4], bulk_modulus=1.4e9, back_pressure=1e6, "
    "supply=20e6, valve={opening={kind='smooth_ramp', times=[0.0, 0.05], values=[0.0, 0.3]}, gain=[2e-7, 1.5e-7]}}",
}


#: Pads that only push, and a tip force that lifts the section off them.
LIFTING = (
    *free_boom.PUSHING,
    *(f"section.joint.{ring}.0.stiffness=1e7" for ring in ("tail", "mouth")),
    "sections.fly.loads.2.signal={kind='constant', amount=2.4e3}",
)


@pytest.mark.slow
@pytest.mark.parametrize(("drive", "keys"), [("force", ()), ("opening", ()), ("straight", LIFTING)])
def test_a_free_extension_is_that_of_a_stepper(drive: str, keys: tuple[str, ...], tmp_path: Path) -> None:
    """Under the same drive at the ends of steps; value and rate of the extension at the start are parameters."""
    changes = (*keys, free(DRIVES[drive]), "time.end=0.02", "time.step=1e-3", "time.rho_inf=0.8")
    boom = System.load(system(*changes).save(tmp_path / "system.npz"))
    contents = fmu_contents(boom, read_scene(boom, "system.npz", free=True), "boom", "3")
    library, h = loaded(contents, tmp_path, "3"), 1e-3
    assert {"s_fly_start", "s_fly_start_rate"} <= set(library.references)
    assert not {"s_fly", "s_fly_rate", "s_fly_start_rate_2"} & set(library.references)
    names = ["fly: tip z", "extension of fly", "extension cylinder of fly force", "force of fly mouth bottom left"]
    stepper = pmr.Stepper(boom, step=h, s={"fly": (0.7, 0.05)}, rho_inf=0.8, outputs=names, parts=0)
    instance, shown = Instance(library), [name.replace(": ", "_").replace(" ", "_") for name in names]
    instance.set(["internal_step", "s_fly_start", "s_fly_start_rate"], [h, 0.7, 0.05])
    instance.initialise()
    extension = scene(*changes).sections[1].joint.extension
    ((drive, signal),) = extension.drive_signals.items()
    for k in range(1, 41):
        at, rate = float(signal.value(k * h)), float(signal.rate(k * h))
        expected = stepper.step({}, {f"extension drive {drive}": (at, rate)})
        instance.set([f"extension_drive_{drive}", f"extension_drive_{drive}_rate"], [at - h * rate, rate])
        instance.step((k - 1) * h, h)
        np.testing.assert_allclose(instance.get(shown), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    with pytest.raises(CallError, match="fixed once the start is made"):
        instance.set(["s_fly_start"], [0.5])
