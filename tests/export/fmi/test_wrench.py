"""The six loads of the manual at a boom's tip, zero in the scene, as inputs of its FMU: beside statics by hand."""

import re
from pathlib import Path

import numpy as np
import plain_machines
import pytest
from export.fmi.libraries import Instance, loaded

import pmr
from pmr import System
from pmr.export.fmi import fmu_contents
from pmr.scene import load_any
from pmr.simulation.moving import read_scene

ROOT = Path(__file__).parents[3]
NAMES = [f"fly_{name}" for name in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")]
FOOT, LUG = np.array([0.5, -1.0]), np.array([1.5, -0.2])  # m, x and z from the pin: hinges of the luffing cylinder
QUICK = (
    *("compare.against=[]", "section.mesh.elements=6", "time.end=0.02", "time.step=2e-3", "frame.second_order=false"),
    # pads three times as long: tables are as much shorter, which compilers are slow at reading
    *(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("length=0.9", "at=0.45")),
)


@pytest.mark.slow
def test_a_wrench_at_the_tip_reaches_the_pin(tmp_path: Path) -> None:
    """Each force and moment as a free body says; and one of them moves the tip as a load that the scene has."""
    (wrench,) = re.findall(
        r"```toml\n(\[\[sections\.loads\]\]\nname = \"Fx\".*?)```", (ROOT / "docs/fmu.md").read_text(), re.S
    )
    text = plain_machines.CRANE.read_text()
    (tmp_path / "crane.toml").write_text(text.replace("\n[damping]", f"\n{wrench}\n[damping]"))
    found = pmr.reduce(load_any(tmp_path / "crane.toml", QUICK))
    system = System.load(found.system.save(tmp_path / "system.npz"))
    library = loaded(fmu_contents(system, read_scene(system, "system.npz"), "crane", "3"), tmp_path, "3")
    inputs = [name for name in library.named("input") if "_rate" not in name]
    assert [name for name in inputs if name in NAMES] == NAMES
    reactions = [f"reaction_of_base_pin_{axis}" for axis in ("x", "y", "z", "rx", "rz")]
    seen = [*reactions, "fly_tip_y", "fly_tip_z"]

    def at_rest(**loads: float) -> np.ndarray:
        """In equilibrium, level, with extensions of 0.6 m: the tip is 7.2 m from the pin."""
        instance = Instance(library)
        instance.choose_start(1)
        given = dict.fromkeys(NAMES, 0.0) | {"luffing": 0.0, "slewing": 0.0, "fly_gust": 0.0} | loads
        instance.initialise(list(given), list(given.values()))
        return instance.get(seen)

    arm, without = 7.2, at_rest()
    # The cylinder alone takes moments about y, and the pin what it presses with along its line.
    x, z = (LUG - FOOT) / np.linalg.norm(LUG - FOOT)
    thrust = np.array([x, 0.0, z, 0.0, 0.0]) / (LUG[0] * z - LUG[1] * x)  # on the pin, of a moment that lifts by 1 N m
    expected = {
        "Fx": [1.0, 0.0, 0.0, 0.0, 0.0], "Fy": [0.0, 1.0, 0.0, 0.0, arm],
        "Fz": [0.0, 0.0, 1.0, 0.0, 0.0] - arm * thrust, "Mx": [0.0, 0.0, 0.0, 1.0, 0.0], "My": thrust,
        "Mz": [0.0, 0.0, 0.0, 0.0, 1.0],
    }  # fmt: skip
    size = 100.0
    for name, pressed in expected.items():
        change = at_rest(**{f"fly_{name}": size}) - without
        np.testing.assert_allclose(change[:5], size * np.array(pressed), rtol=0.0, atol=1e-6 * size)
    side, gust = (at_rest(**{name: size}) - without for name in ("fly_Fy", "fly_gust"))
    assert side[5] > 1e-4
    np.testing.assert_allclose(side, gust, rtol=0.0, atol=1e-9 * np.abs(gust).max())
