"""A script of a boom of sections: what it says as it stands is what a run says by Exudyn."""

from __future__ import annotations

import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from processes import called

import pmr
from pmr.errors import InputError
from pmr.export.exudyn_script import script_data, write_exudyn_script
from pmr.pipeline.scenes import Outcome
from pmr.simulation.excitation import Excitation
from pmr.simulation.exudyn.simulator import simulate_system
from pmr.simulation.native import systems

#: Steps that are few and parts that are many; nothing is compared with a full model.
SHORT = ['simulation.simulators=["exudyn"]', "compare.against=[]", "section.mesh.elements=8"]
SHORT += ["time.end=0.03", "time.step=1e-3", "time.rho_inf=0.9"]
BOTH_WAYS = [f"section.joint.{end}=[{{at=0.15,stiffness=1e8,unilateral=false}}]" for end in ("tail", "mouth")]


def in_equal_parts(outcome: Outcome, parts: int) -> NDArray[np.float64]:
    """Displacements (T, o) m of the same in Exudyn, each step in so many parts."""
    given = Excitation.from_scene(outcome.result.scene)
    given = given.with_stepping(replace(given.stepping, parts=parts))
    found = simulate_system(outcome.system, given, systems.static_start(outcome.system, given))
    return np.hstack(list(systems.displacements(outcome.system, found).values()))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pads", "rise"), [("both ways", "0.0"), ("pushing", "0.0"), ("both ways", "0.02")], ids=["both", "push", "rise"]
)
def test_it_reproduces_the_run(pads: str, rise: str, tmp_path: Path, monkeypatch, capsys) -> None:
    """Two sections that move along the boom from equilibrium; to the tolerance that holds for a body alone.

    Where the weight rises, equilibrium at the start is that without it.
    """
    changes = [*SHORT, f"gravity.rise={rise}", *(BOTH_WAYS if pads == "both ways" else [])]
    outcome = pmr.run(pmr.load_scene("boom_two", changes))
    outcome.system.save(tmp_path / "system.npz")
    done = called(monkeypatch, capsys, "export", str(tmp_path / "system.npz"), "--to", "exudyn")
    assert done.returncode == 0, done.stderr
    script = tmp_path / "sliding_body.py"
    names = runpy.run_path(str(script))
    t, y = names["simulate"]()
    assert (names["PARTS"] > 1) == (pads == "pushing") and list(names["PATHS"]) == ["fly"]
    response = outcome.result.responses["reduced"]
    units = [unit for body in outcome.system.bodies.values() for unit in body.output_units]
    moved = y[:, [unit == "m" for unit in units]]
    size = np.abs(response.displacement).max()
    np.testing.assert_allclose(t, response.t, atol=1e-12)
    assert np.abs(moved - moved[0]).max() > 1e-5
    assert np.abs(moved - in_equal_parts(outcome, names["PARTS"])).max() < 1e-9 * size
    parts = 1e-3 if pads == "pushing" else 1e-9  # which the run chooses by what they err
    assert np.abs(moved - response.displacement).max() < parts * size
    alone = subprocess.run([sys.executable, "-I", str(script)], capture_output=True, text=True, cwd="/")
    assert alone.returncode == 0 and alone.stdout.startswith("Displacement of fly at x = 6 m over 0.03 s:")


@pytest.mark.slow
def test_extensions_by_their_overlaps_accelerate_sections_as_in_a_run(tmp_path: Path) -> None:
    """Up to the round-off of some eps that differences of an extension have, over a sixteenth of a step and a step."""
    quick = ["compare.against=[]", "section.mesh.elements=8", "section.reduction.estimate=false"]
    scene = pmr.load_scene("boom_lift", quick)
    system = pmr.reduce(scene).system
    target = write_exudyn_script(system.save(tmp_path / "system.npz"), tmp_path / "sliding_body.py")
    names, t, excitation = runpy.run_path(str(target)), np.array([0.7, 3.5, 6.2]), Excitation.from_scene(scene)
    left = 10.0 * np.finfo(float).eps * excitation.s.max() / (scene.time.step**2 / 16.0)
    for name, load in names["LOADS"].items():
        np.testing.assert_allclose([load(one) for one in t], excitation.loads[name].value(t), rtol=1e-12, atol=left)


@pytest.mark.slow
def test_a_frame_that_moves_is_refused_in_one_line(tmp_path: Path) -> None:
    raised = ["frame.pivot=[0.0,0.0,0.0]", "frame.luffing={kind='smooth_ramp',times=[0.0,0.02],values=[0.1,0.2]}"]
    scene = pmr.load_scene("boom_two", [*SHORT, *BOTH_WAYS, *raised])
    system = pmr.reduce(scene).system
    with pytest.raises(InputError, match="system.npz: frame: a scene without a frame is allowed in a script"):
        script_data(replace(system, provenance={"scene": scene.model_dump(mode="json")}), "system.npz")
