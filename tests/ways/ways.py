"""Every way to use a scene: a function checks it by what mathematics fixes, or raises `Refused`."""

import csv
import json
import re
import runpy
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import one_body
import scipy.io
from export.fmi.libraries import follow_reference, loaded
from fuzz import toml
from modelica_text import declared_array
from numpy.typing import NDArray
from one_body import displacement
from processes import undrawn
from ways.subjects import Refused, Subject, command, refusals

import pmr
from pmr import ReducedModel, System
from pmr.export.fmi import fmu_contents
from pmr.export.formats import BODY_FORMATS, FORMATS
from pmr.files.arrays import Array
from pmr.fullmodel.build import full_model
from pmr.fullmodel.eigensolvers import lowest_frequencies
from pmr.scene import Scene
from pmr.scene.choice import SIMULATORS
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.moving import MovingFrame, read_scene
from pmr.simulation.native import systems
from pmr.studies.call import kind_names
from pmr.studies.study import SEPARATOR
from pmr.system.assembly import Assembly
from pmr.system.body import length_outputs

Way = Callable[[Subject], None]
ALONE = ("--set", "compare.against=[]")
TOLERANCE = 0.05
#: Displacements and forces of the same equations in another order of operations or on other ranks, and those to the
#: tolerance of Exudyn's Newton iterations; forces are displacements times stiffnesses.
ROUND_OFF, NEWTON = (1e-9, 1e-6), (1e-5, 1e-2)
#: How far two choices of the parts of a step may be apart, over the largest value (docs/pads.md).
PARTS = 1e-3


def run(subject: Subject) -> None:
    """Check that `pmr run` gives what Python gives, and that the estimated error is the one to the full model."""
    out = subject.out("run")
    command("run", str(subject.file), "--out", str(out))
    subject.assert_same(*subject.stored(out))
    summary = json.loads((out / "summary.json").read_text())
    errors, estimate = summary["errors"]["reduced_vs_full"], summary["estimate"]
    for place in ("tip", "beam"):
        assert errors[place] < 0.1
        assert errors[place] < 1e-6 or 0.8 <= estimate[place] / errors[place] <= 5.0


def tolerance(subject: Subject) -> None:
    """Check that a run with a tolerance keeps it, or warns."""
    out = subject.out("tolerance")
    command("run", str(subject.file), "--out", str(out), "--tolerance", str(TOLERANCE))
    summary = json.loads((out / "summary.json").read_text())
    assert summary["accuracy"]["tolerance"] == TOLERANCE
    if summary["accuracy"]["holds"]:
        errors = summary["errors"]["reduced_vs_full"]
        assert max(errors["tip"], errors["beam"]) <= TOLERANCE
    else:
        assert any("tolerance" in warning for warning in summary["warnings"])


def cache(subject: Subject) -> None:
    """Check that runs with a new and with a filled cache give equal results."""
    for name in ("made", "found"):
        out = subject.out(name)
        command("run", str(subject.file), "--out", str(out), "--cache", str(subject.folder / "cache"), *ALONE)
        subject.assert_same(*subject.stored(out), *ROUND_OFF)
    assert list((subject.folder / "cache").glob("*.npz"))


def simulator(name: str, subject: Subject) -> None:
    """Check that a simulator gives what march gives.

    With unilateral pads march runs too, as it chooses the parts of steps.
    """
    out, pushing = subject.out(name), _pushes(subject)
    names = f"march,{name}" if pushing and name != "march" else name
    command("run", str(subject.file), "--out", str(out), "--simulators", names, *ALONE)
    subject.assert_same(*subject.stored(out), *(ROUND_OFF if names.startswith("march") else NEWTON))
    summary = json.loads((out / "summary.json").read_text())
    assert all(apart <= NEWTON[0] * summary["max_displacement"] for apart in summary["agreement"].values())


def _pushes(subject: Subject) -> bool:
    """Whether any contact is unilateral."""
    return not np.isnan(subject.system.clearance).all()


def two_ranks(subject: Subject) -> None:
    """Check that two ranks give what one gives."""
    out = subject.out("ranks")
    done = undrawn("run", str(subject.file), "--out", str(out), *ALONE, ranks=2)
    said = [line for line in done.stderr.splitlines() if line.startswith("pmr: ")]
    if done.returncode != 0 and len(said) == 1:
        raise Refused(said[0])
    assert done.returncode == 0, done.stderr
    subject.assert_same(*subject.stored(out), 1e-7, 1e-5)


def info(subject: Subject) -> None:
    """Check that `pmr info` describes the model or the system, and the scene."""
    said = " ".join(command("info", str(subject.system_file)).split())
    assert f"{sum(body.size for body in subject.system.reduced.values())} coordinates" in said
    assert subject.scene.title in command("info", str(subject.file))


def reduce(subject: Subject) -> None:
    """Check that `pmr.reduce` gives the model of a run."""
    with refusals():
        found = pmr.reduce(subject.scene).reduced
    reduced = subject.outcome.reduced
    pairs = [(found, reduced)] if isinstance(found, ReducedModel) else [(found[name], reduced[name]) for name in found]
    for one, other in pairs:
        np.testing.assert_allclose(one.K, other.K, rtol=0.0, atol=1e-9 * np.abs(other.K).max())
        assert one.row_names == other.row_names


def operators(subject: Subject) -> None:
    """Check that full operators (n, n) of each body are symmetric, with as many coordinates as a run states."""
    with refusals():
        full = pmr.full_model(subject.scene)
    bodies = full.values() if isinstance(full, dict) else [full]
    assert sum(body.size for body in bodies) == subject.outcome.result.summary["coordinates"]["full"]
    for body in bodies:
        assert all(abs(A - A.T).max() <= 1e-9 * abs(A).max() for A in (body.M, body.K))


def project(subject: Subject) -> None:
    """Check that `pmr.project` gives Galerkin's projection of a body on the vectors of its reduction."""
    with refusals():
        reduction, full = pmr.reduce(subject.scene), pmr.full_model(subject.scene)
    bases, bodies = (one if isinstance(one, dict) else {"": one} for one in (reduction.basis, full))
    for name, body in bodies.items():
        with refusals():
            found = pmr.project(body, bases[name])
        expected = bases[name].T @ (body.K @ bases[name])
        np.testing.assert_allclose(found.K, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def simulate_with_states(subject: Subject) -> None:
    """Check that the response is that of a run, with coordinates of each body at the first and the last step."""
    with refusals():
        found = pmr.simulate_with_states(subject.scene, subject.system, [0, subject.scene.time.steps])
    subject.assert_same(found.response.displacement, found.response.slider_force)
    sizes = {name: states.p.shape for name, states in found.states.items()}
    assert sizes == {name: (2, body.size) for name, body in subject.system.bodies.items()}


def simulate_in_python(subject: Subject) -> None:
    """Check that the system and the models give the response of a run after they were saved and loaded."""
    models = {name: ReducedModel.load(file) for name, file in subject.models.items()}
    for one in (subject.system, models if subject.kind.has_sections else models["reduced"]):
        with refusals():
            found = pmr.simulate(subject.scene, one)
        subject.assert_same(found.displacement, found.slider_force)


def simulate(subject: Subject) -> None:
    """Check that `pmr simulate` gives the response of a run."""
    out = subject.out("simulated")
    command("simulate", str(subject.system_file), "--scene", str(subject.file), "--out", str(out))
    subject.assert_same(*subject.stored(out))


def stepper(subject: Subject) -> None:
    """Check that a stepper gives what the compiled simulator gives with the same steps."""
    system, scene = subject.system, subject.scene
    rho = min(scene.time.rho_inf, 0.9)
    with refusals():
        excitation = Excitation.from_scene(scene).with_stepping(
            TimeStepping(scene.time.end, scene.time.step, rho, parts=1)
        )
    (start, *given), y = stepper_inputs(system, excitation), simulated_outputs(system, excitation)
    with refusals():
        one = pmr.Stepper(system, scene.time.step, *start[:2], rho, frame=start[2] if len(start) > 2 else None)
    found = [one.step(*inputs).copy() for inputs in given]
    moved = np.concatenate([length_outputs(body) for body in system.bodies.values()])
    size = np.abs(y[:, moved]).max()
    np.testing.assert_allclose(np.array(found)[:, moved], y[1:, moved], rtol=0.0, atol=1e-9 * size)


def stepper_inputs(system: System, excitation: Excitation) -> list[tuple[Any, ...]]:
    """Paths and loads at all steps; in a frame values and rates of paths and angles."""
    if (frame := MovingFrame.from_system(system)) is None:
        s, f = excitation.s, excitation.forces(system.input_names)
        return [(at if len(at) > 1 else at[0], loads) for at, loads in zip(s, f, strict=True)]
    found = []
    for t in excitation.times:
        motions = dict(zip(frame.drivers, frame.motions(excitation, t).T, strict=True))
        found.append(
            (
                {name: motions[name] for name in frame.paths},
                {name: motions[name][0] for name in frame.loads},
                {name: motions[name] for name in (*frame.angles, *frame.axes)},
            )
        )
    return found


def simulated_outputs(system: System, excitation: Excitation) -> Array:
    """Outputs (T, o) of the compiled simulator: a body alone starts from rest, sections from equilibrium."""
    if "" in system.bodies and not system.terms:
        model = system.reduced[""]
        found, f = one_body.simulate(model, excitation), excitation.forces(model.input_names)
        return displacement(model, found.q, found.s, found.multipliers, f)
    start = {} if "" in system.bodies else systems.static_start(system, excitation)
    return np.hstack(list(systems.displacements(system, systems.simulate(system, excitation, start)).values()))


def held(subject: Subject) -> Array:
    """Natural frequencies (r,) in rad/s of the system with its paths at `Subject.at` and rigid contacts held."""
    assembly, x = Assembly(subject.system), subject.system.side_coordinates(subject.at)
    found = 2.0 * np.pi * assembly.frequencies(x, assembly.size)
    return np.asarray(found[np.isfinite(found)])


def answers(subject: Subject, w: float) -> NDArray[np.complex128]:
    """Outputs (o, i) under unit loads at circular frequency w in rad/s, from the equations of motion with contacts."""
    assembly = Assembly(subject.system)
    rows, B = assembly.contact_rows(subject.system.side_coordinates(subject.at)), assembly.B.toarray()
    M, D, K = (A.toarray() for A in (assembly.M, assembly.D, assembly.K))
    A = np.block([[K + 1j * w * D - w**2 * M, rows.C.T], [rows.C, -rows.F]])
    found = np.linalg.solve(A, np.vstack([B, -rows.H]))
    y: NDArray[np.complex128] = assembly.outputs @ found[: len(K)] + assembly.direct - rows.X @ found[len(K) :]
    return y


def exported(to: str, subject: Subject, *more: str) -> Path:
    """Export in a format, and return the path of what was written."""
    if to in FORMATS and "at" in FORMATS[to].options:
        several = ",".join(f"{path}={at}" for path, at in subject.at.items())
        more = (*more, "--at", several if len(subject.at) > 1 else str(subject.kind.at))
    target = subject.out(f"export-{to}") / FORMATS[to].file_name
    command("export", str(subject.system_file), "--to", to, "--out", str(target), *more)
    return target


def as_state_space(A: Array, B: Array, C: Array, D: Array, subject: Subject) -> None:
    """Check frequencies and static outputs of a state space."""
    omega, r = held(subject), len(A) // 2
    np.testing.assert_allclose(
        np.sort(np.linalg.eigvals(-A[r:, :r]).real), omega**2, rtol=1e-6, atol=1e-9 * omega[-1] ** 2
    )
    expected = answers(subject, 0.0).real
    np.testing.assert_allclose(
        (D - C @ np.linalg.solve(A, B))[: len(expected)], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )


def matlab(subject: Subject) -> None:
    """Check the state space that is exported for MATLAB."""
    data = scipy.io.loadmat(exported("matlab", subject))
    as_state_space(*(data[name][:, :, 0] for name in "ABCD"), subject)


def modelica(subject: Subject) -> None:
    """Check the state space that is exported for Modelica."""
    text = exported("modelica", subject).read_text(encoding="utf-8")
    as_state_space(*(declared_array(text, name)[0] for name in "ABCD"), subject)


def python_control(subject: Subject) -> None:
    """Check the state space that is exported for python-control."""
    read = runpy.run_path(str(exported("python-control", subject)))
    found = read["system"](0)
    as_state_space(found.A, found.B, found.C, found.D, subject)


def frequency_response(subject: Subject) -> None:
    """Check that the gain in the first row is that of the equations in complex numbers."""
    with exported("frequency-response", subject).open(encoding="utf-8") as stream:
        head, first = list(csv.reader(stream))[:2]
    places = max(1, len(subject.at))
    y = answers(subject, 2.0 * np.pi * float(first[places]))
    tip = int(np.flatnonzero(np.concatenate([length_outputs(one) for one in subject.system.bodies.values()]))[-1])
    assert len(head) == places + 1 + 2 * len(subject.system.input_names)
    gains = np.array([float(x) for x in first[places + 1 :: 2]])
    np.testing.assert_allclose(gains, np.abs(y[tip]), rtol=1e-6, atol=1e-8 * np.abs(y).max())


def stiffness_of_deck(subject: Subject) -> None:
    """Check the stiffness K1 + KL1 that is exported as DMIG entries, in modal coordinates."""
    omega, found = held(subject), dict[str, Array]()
    r, name = len(omega), ""
    for line in exported("dmig", subject).read_text().splitlines():
        fields = [line[:8].strip(), *(line[k : k + 16].strip() for k in range(8, len(line), 16))]
        if fields[0] == "DMIG*":
            name, column = fields[1], int(fields[2]) - 1
        elif fields[0] == "*" and name in ("K1", "KL1"):
            matrix = found.setdefault(name, np.zeros((r, r)))
            matrix[int(fields[1]) - 1, column] = matrix[column, int(fields[1]) - 1] = float(fields[3].replace("D", "e"))
    np.testing.assert_allclose(np.linalg.eigvalsh(sum(found.values())), omega**2, rtol=1e-6, atol=1e-9 * omega[-1] ** 2)


def stiffness_of_output4(subject: Subject) -> None:
    """Check the stiffness that is exported in OUTPUT4."""
    lines = iter(exported("op4", subject).read_text().splitlines())
    found = {}
    for head in lines:
        columns, rows, name = int(head[:8]), int(head[8:16]), head[32:40].strip()
        A = np.zeros((rows, columns))
        while (column := int((record := next(lines))[:8])) <= columns:
            first, count = int(record[8:16]) - 1, int(record[16:24])
            values = "".join(next(lines) for _ in range(-(-count // 3)))
            A[first : first + count, column - 1] = [float(values[24 * k : 24 * k + 24]) for k in range(count)]
        next(lines)
        found[name] = A
    omega = held(subject)
    np.testing.assert_allclose(np.linalg.eigvalsh(found["K1"]), omega**2, rtol=1e-6, atol=1e-9 * omega[-1] ** 2)


def script(subject: Subject) -> None:
    """Check that the exported script of Exudyn gives the response of a run, without pmr."""
    target = subject.out("export-exudyn") / FORMATS["exudyn"].file_name
    command("export", str(subject.system_file), "--to", "exudyn", "--out", str(target))
    _, found = runpy.run_path(str(target))["simulate"]()
    of_length = np.concatenate([length_outputs(body) for body in subject.system.bodies.values()])
    moved, expected = found[:, of_length], subject.response.displacement
    np.testing.assert_allclose(
        moved, expected, rtol=0.0, atol=(PARTS if _pushes(subject) else NEWTON[0]) * np.abs(expected).max()
    )


def fmu(subject: Subject) -> None:
    """Check that an FMU gives the outputs of its own reference under the reference's inputs."""
    with refusals():
        made = fmu_contents(subject.system, read_scene(subject.system, "system.npz"), "body", "3")
    found, expected = follow_reference(made, loaded(made, subject.out("fmu"), "3"))
    outputs = list(expected)
    largest = dict[tuple[bool, bool], float]()  # of forces, displacements and rates: one may be nothing but round-off
    for name in outputs:
        largest[_kind(name)] = max(largest.get(_kind(name), 0.0), np.abs(expected[name]).max())
    for name in outputs:
        np.testing.assert_allclose(found[name], expected[name], rtol=0.0, atol=ROUND_OFF[1] * largest[_kind(name)])


def _kind(output: str) -> tuple[bool, bool]:
    """Whether an output is a force, and whether it is a rate: outputs that share one scale."""
    return output.startswith("force_of"), output.endswith("_rate")


def flexible(to: str, subject: Subject) -> None:
    """Check that a flexible body has the frequencies of the full model with its sliders at the same position.

    Bodies on frames lack what deforms within a frame, so their frequencies differ more.
    """
    target = subject.out(to) / BODY_FORMATS[to].file_name
    bare = [] if subject.kind.has_sections else ["--set", "masses=[]"]
    asked = ["--at", str(subject.kind.at), "--to", to, "--modes", "4", *bare]
    said = command("flexible", str(subject.file), *asked, "--out", str(target))
    assert target.stat().st_size
    listed = re.search(r"modes, (.*) Hz", said)
    scene = pmr.load_scene(subject.file, ["masses=[]"])
    assert listed is not None and isinstance(scene, Scene)
    found = np.array([float(x) for x in listed[1].split(",")])
    expected = lowest_frequencies(full_model(scene), np.array([subject.kind.at]), 4, "auto")[0] / (2.0 * np.pi)
    np.testing.assert_allclose(found[:3], expected[:3], rtol=1e-3 if BODY_FORMATS[to].by == "node" else 3e-2)


STUDIES: dict[str, dict[str, Any]] = {
    "scenes": {"scenes": ["scene.toml"]},
    "collection": {"files": ["scenes.toml"]},
    "chart": {"scene": "scene.toml", "up_to": 1e4, "luffing": [0.3, 0.5]},
}


def study(kind: str, subject: Subject) -> None:
    """Check that all runs of a study are there and finite; one of a scene has the errors and warnings of a run."""
    assert subject.file.exists()
    for name in {kind, "scenes"}:
        more = {"extensions": [1.6]} if name == "chart" and subject.kind.has_sections else {}
        text = toml.written({"kind": name, "title": "A study", **STUDIES[name], **more})
        (subject.folder / f"{name}.toml").write_text(text)
    out = subject.out(f"study-{kind}")
    said = command("study", str(subject.folder / f"{kind}.toml"), "--jobs", "1", "--out", str(out))
    table = out / ("scenes/runs.csv" if kind == "collection" else "runs.csv")
    with table.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert rows and all(row.get("status", "done") == "done" for row in rows)
    if kind == "chart":
        check_chart(out)
    if kind in ("scenes", "collection"):
        summary = subject.outcome.result.summary
        errors = summary["errors"]["reduced_vs_full"]
        np.testing.assert_allclose(float(rows[0]["errors.reduced_vs_full.beam"]), errors["beam"], rtol=1e-3)
        assert rows[0]["warnings"] == SEPARATOR.join(summary["warnings"])
        assert all(" ".join(f"warning: {one}".split()) in " ".join(said.split()) for one in summary["warnings"])


def chart(subject: Subject) -> None:
    """Check that a load chart has all its points and says what its error bars do not cover."""
    out = subject.out("chart")
    command("chart", str(subject.file), "--up-to", "1e4", "--jobs", "1", "--out", str(out))
    check_chart(out)


def check_chart(out: Path) -> None:
    """Check the points of a chart, what its error bars do not cover, and that no warning comes twice."""
    summary = json.loads((out / "summary.json").read_text())
    with (out / "chart.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == summary["figures"]["points"] > 0 and all(row["not covered"] for row in rows)
    assert all(len(set(run["warnings"])) == len(run["warnings"]) for run in summary["runs"])


#: By what the manual's table calls them.
WAYS: dict[str, Way] = {
    "`pmr run`": run,
    "`pmr run --tolerance`": tolerance,
    "`pmr run --cache`": cache,
    **{
        f"`pmr run --simulators {name}`": partial(simulator, name)
        for name, can in SIMULATORS.items()
        if can.reduced_models
    },
    "`mpirun -n 2 pmr run`": two_ranks,
    "`pmr.reduce`": reduce,
    "`pmr.full_model`": operators,
    "`pmr.project`": project,
    "`pmr.simulate`": simulate_in_python,
    "`pmr.simulate_with_states`": simulate_with_states,
    "`pmr.Stepper`": stepper,
    "`pmr chart`": chart,
    "`pmr info`": info,
    "`pmr simulate`": simulate,
    "`pmr export --to exudyn`": script,
    "`pmr export --to fmu`": fmu,
    "`pmr export --to matlab`": matlab,
    "`pmr export --to modelica`": modelica,
    "`pmr export --to python-control`": python_control,
    "`pmr export --to frequency-response`": frequency_response,
    "`pmr export --to dmig`": stiffness_of_deck,
    "`pmr export --to op4`": stiffness_of_output4,
    **{f"`pmr flexible --to {name}`": partial(flexible, name) for name in BODY_FORMATS},
    **{f"`pmr study`, {name}": partial(study, name) for name in kind_names()},
}
