"""A script of a boom of sections: what it says as it stands is what a run says by Exudyn."""

import ast
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
import one_body
import pytest
from driving import driven
from numpy.typing import NDArray
from one_body import displacement
from oracle import flexible, project

import pmr
from pmr import InputError, ReducedModel, System
from pmr.export.exudyn_script import script_data, write_exudyn_script
from pmr.pipeline import Outcome
from pmr.scene.signals import Chirp, Constant, Ramp, SignalBase, Sine, SmoothRamp, Step, Sum, Table
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.exudyn.simulator import simulate_system
from pmr.simulation.native import systems
from pmr.system.body import FullBody

KNOTS = {"times": (0.2, 0.5, 0.6, 1.1, 1.3), "values": (1.0, 2.0, 1.5, 1.8, -0.5)}
SIGNALS: dict[str, SignalBase] = {
    "constant": Constant(amount=-50.0),
    "ramp": Ramp(**KNOTS),
    "smooth_ramp": SmoothRamp(**KNOTS),
    "smoother_ramp": SmoothRamp(**KNOTS, degree=9),
    "table": Table(**KNOTS),
    "linear_table": Table(**KNOTS, interpolation="linear"),
    "two_knots": Table(times=(0.3, 0.9), values=(1.0, 3.0)),
    "step": Step(time=0.5, before=1.0, after=2.0),
    "sine": Sine(amplitude=3.0, frequency=1.3, phase=0.4, offset=-2.0),
    "chirp": Chirp(amplitude=50.0, times=(0.2, 0.7, 1.2), frequencies=(1.0, 10.0, 2.0), phase=0.3),
    "sum": Sum(terms=(Sine(amplitude=1.0, frequency=3.0), Sum(terms=(Step(time=0.4, after=1.0),
     Constant(amount=2.0))))),
}  # fmt: skip
PATH = SmoothRamp(times=(0.0, 0.2), values=(2.0, 2.6))
LOADS = (SIGNALS["chirp"], SIGNALS["sum"])


def scene(path: SignalBase, *signals: SignalBase, end: float = 0.2) -> dict[str, Any]:
    """What a run leaves in the provenance of its model."""
    return {
        "title": 'A "sliding" beam',
        "slider": {"path": path.model_dump(mode="json"), "offsets": [0.0, 0.8]},
        "loads": [
            {"name": f"F{i}", "on": 5.0, "direction": "z", "signal": signal.model_dump(mode="json")}
            for i, signal in enumerate(signals)
        ],
        "time": {"end": end, "step": 1e-3, "rho_inf": 0.8},
    }


@pytest.fixture(scope="module")
def model(rich: FullBody) -> ReducedModel:
    """Two sliders, two inputs, damping."""
    reduced = project(rich, np.eye(rich.size)[:, 2:])
    return replace(reduced, input_names=("F 0", "F-1"), provenance={"scene": scene(PATH, *LOADS)})


@pytest.fixture
def script(model: ReducedModel, tmp_path: Path) -> Path:
    return write_exudyn_script(model.save(tmp_path / "beam.npz"), tmp_path / "script.py")


@pytest.mark.parametrize("kind", SIGNALS)
def test_signals_are_those_of_pmr(model: ReducedModel, kind: str, tmp_path: Path) -> None:
    signal = SIGNALS[kind]
    one = replace(model, provenance={"scene": scene(PATH, signal, signal)})
    target = write_exudyn_script(one.save(tmp_path / "beam.npz"), tmp_path / "signals.py")
    load = runpy.run_path(str(target))["LOADS"]["F-1"]
    t = np.linspace(-0.1, 1.5, 321)
    np.testing.assert_allclose([load(float(x)) for x in t], signal.value(t), rtol=1e-12, atol=1e-12)


def test_the_script_moves_as_pmr_does(model: ReducedModel, script: Path) -> None:
    names = runpy.run_path(str(script))
    t, w = names["simulate"]()
    expected = one_body.in_exudyn(model, driven(PATH, LOADS, TimeStepping(0.2, 1e-3, 0.8), model.input_names))
    np.testing.assert_allclose(t, expected.t, atol=1e-12)
    assert np.abs(w).max() > 1e-5
    np.testing.assert_allclose(w, expected.q @ model.outputs.T, rtol=0.0, atol=1e-9 * np.abs(w).max())


@pytest.mark.parametrize("gives_way", [False, True])
def test_another_pre_step_function_is_never_taken_in_silence(
    model: ReducedModel, tmp_path: Path, gives_way: bool
) -> None:
    body = replace(model, pads=np.array([2e-6, 3e-6])) if gives_way else model
    names = runpy.run_path(str(write_exudyn_script(body.save(tmp_path / "body.npz"), tmp_path / "own.py")))
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    items = names["add_system"](mbs, names["PATHS"], names["LOADS"], names["START"])
    mbs.SetPreStepUserFunction(lambda mbs, t: True)
    with pytest.raises(ValueError, match="took the place of `update`"):
        names["solve"](mbs, 0.01, 1e-3, 0.8)
    mbs.SetPreStepUserFunction(lambda mbs, t: items.update(mbs, t))
    names["solve"](mbs, 0.01, 1e-3, 0.8)


@pytest.mark.slow
def test_it_runs_alone_and_tells_the_tip(script: Path) -> None:
    done = subprocess.run([sys.executable, "-I", str(script)], capture_output=True, text=True, cwd="/")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Displacement at x = 5 m over 0.2 s:\n  smallest: -")
    assert done.stdout.count(" mm\n") == 3
    assert done.stderr == ""


@pytest.mark.parametrize("pads", ["none", "some", "alone", "one firm"])
def test_a_flexible_model_moves_as_pmr_has_it(rich: FullBody, tmp_path: Path, pads: str) -> None:
    model = flexible(rich, 8)
    if pads != "none":
        model = replace(model, pads=np.array([2e-6, 3e-6]))
    if pads == "alone":
        model = replace(model, flexibility=None)
    if pads == "one firm":
        model = replace(project(rich, np.eye(rich.size)[:, 2:]), pads=np.array([0.0, 3e-6]))
    model = replace(model, provenance={"scene": scene(PATH, *LOADS)})
    script = write_exudyn_script(model.save(tmp_path / "beam.npz"), tmp_path / "script.py")
    names = runpy.run_path(str(script))
    t, w = names["simulate"]()
    expected = one_body.in_exudyn(model, driven(PATH, LOADS, TimeStepping(0.2, 1e-3, 0.8), model.input_names))
    loads = np.stack([load.value(t) for load in LOADS], axis=1)
    motion = displacement(model, expected.q, expected.s, expected.multipliers, loads)
    assert np.abs(w).max() > 1e-5
    np.testing.assert_allclose(w, motion, rtol=0.0, atol=1e-9 * np.abs(w).max())


def test_it_needs_numpy_scipy_and_exudyn_only(script: Path) -> None:
    imports = [
        node for node in ast.walk(ast.parse(script.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    modules = {name.name for node in imports if isinstance(node, ast.Import) for name in node.names}
    modules |= {str(node.module) for node in imports if isinstance(node, ast.ImportFrom)}
    assert {module.split(".")[0] for module in modules} <= {"exudyn", "numpy", "pathlib", "scipy", "types", "warnings"}


def test_paths_and_loads_can_be_replaced(script: Path) -> None:
    """The tip of a body without loads stays where it is, and one that is pulled twice as much moves twice as far."""
    names = runpy.run_path(str(script))
    assert names["TITLE"] == 'A "sliding" beam' and list(names["LOADS"]) == ["F 0", "F-1"]
    moved = [
        names["simulate"](loads={name: lambda t, pull=pull: pull for name in names["LOADS"]}, end=0.02)[1]
        for pull in (0.0, 1.0, 2.0)
    ]
    assert not moved[0].any() and np.abs(moved[1]).max() > 1e-9
    np.testing.assert_allclose(moved[2], 2.0 * moved[1], rtol=1e-9, atol=1e-9 * np.abs(moved[2]).max())


def test_a_model_that_the_data_would_replace_stays(model: ReducedModel, tmp_path: Path) -> None:
    saved = model.save(tmp_path / "beam.npz")
    before = saved.read_bytes()
    with pytest.raises(InputError, match="whose data replaces no beam.npz"):
        write_exudyn_script(saved, tmp_path / "beam.py")
    assert saved.read_bytes() == before and not (tmp_path / "beam.py").exists()


def test_a_signal_that_is_no_sum_of_polynomials_and_sines_is_refused(
    model: ReducedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has a value and a rate of its own, as a kind of signal that is installed beside pmr."""
    saved = model.save(tmp_path / "beam.npz")
    for name in ("value", "rate"):
        monkeypatch.setattr(Chirp, name, lambda self, t: np.zeros(np.shape(t)))
    monkeypatch.setattr(Chirp, "strands", SignalBase.strands)
    with pytest.raises(InputError, match="beam.npz: signal of F 0: Chirp is no sum"):
        write_exudyn_script(saved, tmp_path / "script.py")


@pytest.mark.parametrize(
    "provenance", [{}, {"scene": {"slider": {}}}, {"scene": scene(PATH, *LOADS) | {"time": {"end": "soon"}}}]
)
def test_a_model_without_scene_is_refused(model: ReducedModel, provenance: dict[str, Any]) -> None:
    with pytest.raises(InputError) as error:
        script_data(System.of(replace(model, provenance=provenance)), "beam.npz")
    assert error.value.source == "beam.npz"


def test_a_scene_with_other_loads_is_refused(model: ReducedModel) -> None:
    with pytest.raises(InputError, match="1 given, one for each input"):
        script_data(System.of(replace(model, provenance={"scene": scene(PATH, LOADS[0])})), "beam.npz")


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
def test_it_reproduces_the_run(pads: str, rise: str, tmp_path: Path, run_command) -> None:
    """Two sections that move along the boom from equilibrium; to the tolerance that holds for a body alone.

    Where the weight rises, equilibrium at the start is that without it.
    """
    changes = [*SHORT, f"gravity.rise={rise}", *(BOTH_WAYS if pads == "both ways" else [])]
    outcome = pmr.run(pmr.load_scene("boom_two", changes))
    outcome.system.save(tmp_path / "system.npz")
    done = run_command("export", str(tmp_path / "system.npz"), "--to", "exudyn")
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
