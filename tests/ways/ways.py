"""Every way to use a scene: it is right by what mathematics fixes, or it raises `Refused`."""

from __future__ import annotations

import csv
import json
import re
import runpy
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.linalg
from export.fmi.libraries import Instance, compiled
from fuzz import toml
from numpy.typing import NDArray
from processes import undrawn
from ways.subjects import Refused, Subject, command, refusals

import pmr
from pmr.export.fmi.fmu import contents
from pmr.export.formats import BODY_FORMATS, FORMATS
from pmr.fullmodel.build import full_model
from pmr.fullmodel.eigensolvers import lowest_frequencies
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.simulators import SIMULATORS
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.native import simulator as march
from pmr.simulation.recorded import recorded_system
from pmr.studies.files import kind_names
from pmr.system.body import displacement, length_outputs

Array = NDArray[np.float64]
Way = Callable[[Subject], None]
ALONE = ("--set", "compare.against=[]")
TOLERANCE = 0.05
#: Displacements and forces of the same equations in another order of operations or on other ranks, and those to the
#: tolerance of Exudyn's Newton iterations; forces are displacements times stiffnesses.
ROUND_OFF, NEWTON = (1e-9, 1e-6), (1e-5, 1e-2)


def run(subject: Subject) -> None:
    """As from Python; what the estimate says of it is what the full model says."""
    out = subject.out("run")
    command("run", str(subject.file), "--out", str(out))
    subject.assert_same(*subject.stored(out))
    summary = json.loads((out / "summary.json").read_text())
    errors, estimate = summary["errors"]["reduced_vs_full"], summary["estimate"]
    for place in ("tip", "beam"):
        assert errors[place] < 0.1
        assert errors[place] < 1e-6 or 0.8 <= estimate[place] / errors[place] <= 5.0


def tolerance(subject: Subject) -> None:
    """What is said to hold does."""
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
    """Made, then found."""
    for name in ("made", "found"):
        out = subject.out(name)
        command("run", str(subject.file), "--out", str(out), "--cache", str(subject.folder / "cache"), *ALONE)
        subject.assert_same(*subject.stored(out), *ROUND_OFF)
    assert list((subject.folder / "cache").glob("*.npz"))


def simulator(name: str, subject: Subject) -> None:
    """As the compiled one."""
    out = subject.out(name)
    command("run", str(subject.file), "--out", str(out), "--simulators", name, *ALONE)
    subject.assert_same(*subject.stored(out), *(ROUND_OFF if name == "march" else NEWTON))


def two_ranks(subject: Subject) -> None:
    """As one."""
    out = subject.out("ranks")
    done = undrawn("run", str(subject.file), "--out", str(out), *ALONE, ranks=2)
    said = [line for line in done.stderr.splitlines() if line.startswith("pmr: ")]
    if done.returncode != 0 and len(said) == 1:
        raise Refused(said[0])
    assert done.returncode == 0, done.stderr
    subject.assert_same(*subject.stored(out), 1e-7, 1e-5)


def info(subject: Subject) -> None:
    """Of the model, then of the scene."""
    said = " ".join(command("info", str(subject.model_file)).split())
    assert f"{subject.model.size} coordinates" in said
    assert subject.scene.title in command("info", str(subject.file))


def reduce(subject: Subject) -> None:
    """The model of a run."""
    with refusals():
        found = pmr.reduce(subject.scene).reduced
    reduced = subject.outcome.reduced
    pairs = [(found, reduced)] if isinstance(found, ReducedModel) else [(found[name], reduced[name]) for name in found]
    for one, other in pairs:
        np.testing.assert_allclose(one.K, other.K, rtol=0.0, atol=1e-9 * np.abs(other.K).max())
        assert one.row_names == other.row_names


def simulate_in_python(subject: Subject) -> None:
    """Saved and read models, as a run has them."""
    models = {name: ReducedModel.load(file) for name, file in subject.models.items()}
    with refusals():
        found = pmr.simulate(subject.scene, models if subject.kind.has_sections else subject.model)
    subject.assert_same(found.displacement, found.slider_force)


def simulate(subject: Subject) -> None:
    """The same from the command line."""
    out = subject.out("simulated")
    command("simulate", str(subject.model_file), "--scene", str(subject.file), "--out", str(out))
    subject.assert_same(*subject.stored(out))


def stepper(subject: Subject) -> None:
    """As the compiled simulator with the same steps."""
    model, scene = subject.model, subject.scene
    if len(scene.sections) > 1:
        with refusals():
            pmr.Stepper(model, scene.time.step, model.domain[0])
    assert isinstance(scene, Scene)
    rho = min(scene.time.rho_inf, 0.9)
    excitation = Excitation.of(scene).with_stepping(TimeStepping(scene.time.end, scene.time.step, rho, parts=1))
    s, f = excitation.s[:, 0], excitation.forces(model.input_names)
    with refusals():
        one = pmr.Stepper(model, scene.time.step, s[0], f[0], rho)
    found = np.array([one.step(s[k], f[k]).copy() for k in range(1, len(s))])
    expected = march.simulate(model, excitation)
    y = displacement(model, expected.q, expected.s, expected.multipliers, f)[1:]
    moved = length_outputs(model)
    np.testing.assert_allclose(found[:, moved], y[:, moved], rtol=0.0, atol=1e-9 * np.abs(y[:, moved]).max())


def held(subject: Subject) -> tuple[Array, Array]:
    """Natural frequencies (r,) in rad/s of the model with its sliders at `Kind.at`, and M, of the equations themselves.

    Rows that give way are springs: K + C^T F^-1 C with F = G + 1/k.
    """
    model, s = subject.model, subject.kind.at
    F = np.diag(model.row_compliance)
    if model.flexibility is not None:
        F = F + model.flexibility.rows(s)
    C = model.C(s)
    K = model.K + C.T @ np.linalg.solve(F, C)
    return np.sqrt(np.maximum(scipy.linalg.eigh(K, model.M, eigvals_only=True), 0.0)), K


def static(subject: Subject) -> Array:
    """Displacements (o, i) under unit loads, of the saddle point of coordinates and forces."""
    model, s, r = subject.model, subject.kind.at, subject.model.size
    C, table = model.C(s), model.flexibility
    m, i, o = len(C), len(model.input_names), len(model.outputs)
    G, H = (np.zeros((m, m)), np.zeros((m, i))) if table is None else (table.rows(s), table.inputs(s))
    X, W = (np.zeros((o, m)), np.zeros((o, i))) if table is None else (table.outputs(s), table.direct)
    A = np.block([[model.K, C.T], [C, -G - np.diag(model.row_compliance)]])
    found = np.linalg.solve(A, np.vstack([model.B, -H]))
    return np.asarray(model.outputs @ found[:r] + W - X @ found[r:])


def exported(to: str, subject: Subject, *more: str) -> Path:
    """What `pmr export` writes in a folder of its own."""
    if to in FORMATS and "at" in FORMATS[to].options:
        more = (*more, "--at", str(subject.kind.at))
    target = subject.out(f"export-{to}") / FORMATS[to].file_name
    command("export", str(subject.model_file), "--to", to, "--out", str(target), *more)
    return target


def as_state_space(A: Array, B: Array, C: Array, D: Array, subject: Subject) -> None:
    """Frequencies and static answers of the equations."""
    omega, _ = held(subject)
    r, o = subject.model.size, len(subject.model.outputs)
    np.testing.assert_allclose(
        np.sort(np.linalg.eigvals(-A[r:, :r]).real), omega**2, rtol=1e-6, atol=1e-9 * omega[-1] ** 2
    )
    expected = static(subject)
    np.testing.assert_allclose(
        (D - C @ np.linalg.solve(A, B))[:o], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )


def matlab(subject: Subject) -> None:
    data = scipy.io.loadmat(exported("matlab", subject))
    as_state_space(*(data[name][:, :, 0] for name in "ABCD"), subject)


def python_control(subject: Subject) -> None:
    read = runpy.run_path(str(exported("python-control", subject)))
    found = read["system"](0)
    as_state_space(found.A, found.B, found.C, found.D, subject)


def frequency_response(subject: Subject) -> None:
    """The first row's gain is that of the equations in complex numbers."""
    with exported("frequency-response", subject).open(encoding="utf-8") as stream:
        head, first = list(csv.reader(stream))[:2]
    model, s, w = subject.model, subject.kind.at, 2.0 * np.pi * float(first[1])
    table = model.flexibility
    assert table is not None
    C = model.C(s)
    dynamic = model.K - w**2 * model.M + 1j * w * model.D
    A = np.block([[dynamic, C.T], [C, -table.rows(s) - np.diag(model.row_compliance)]])
    found = np.linalg.solve(A, np.vstack([model.B, -table.inputs(s)]))
    y = model.outputs @ found[: model.size] + table.direct - table.outputs(s) @ found[model.size :]
    tip = int(np.flatnonzero(length_outputs(model))[-1])
    assert len(head) == 2 + 2 * len(model.input_names)
    gains = np.array([float(x) for x in first[2::2]])
    np.testing.assert_allclose(gains, np.abs(y[tip]), rtol=1e-6, atol=1e-8 * np.abs(y).max())


def stiffness_of_deck(subject: Subject) -> None:
    """K1 + KL1 of the entries, in modal coordinates."""
    r, found = subject.model.size, {}
    name = ""
    for line in exported("dmig", subject).read_text().splitlines():
        fields = [line[:8].strip(), *(line[k : k + 16].strip() for k in range(8, len(line), 16))]
        if fields[0] == "DMIG*":
            name, column = fields[1], int(fields[2]) - 1
        elif fields[0] == "*" and name in ("K1", "KL1"):
            matrix = found.setdefault(name, np.zeros((r, r)))
            matrix[int(fields[1]) - 1, column] = matrix[column, int(fields[1]) - 1] = float(fields[3].replace("D", "e"))
    omega, _ = held(subject)
    np.testing.assert_allclose(np.linalg.eigvalsh(sum(found.values())), omega**2, rtol=1e-6, atol=1e-9 * omega[-1] ** 2)


def stiffness_of_output4(subject: Subject) -> None:
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
    omega, _ = held(subject)
    np.testing.assert_allclose(np.linalg.eigvalsh(found["K1"]), omega**2, rtol=1e-6, atol=1e-9 * omega[-1] ** 2)


def script(subject: Subject) -> None:
    """The script's own simulation of what `pmr run` leaves, without pmr."""
    target = subject.out("export-exudyn") / FORMATS["exudyn"].file_name
    saved = subject.outcome.save(subject.out("saved"))
    command("export", str(saved), "--to", "exudyn", "--out", str(target))
    read = runpy.run_path(str(target))
    model = read["read_model"](target.with_name(read["MODEL"]))
    wanted = [read[name] for name in ("PATHS", "LOADS", "END", "STEP", "RHO_INF", "START", "PARTS")]
    _, found = read["simulate"](model, *wanted)
    of_length = np.concatenate([length_outputs(body) for body in subject.system.bodies.values()])
    moved, expected = found[:, of_length], subject.response.displacement
    np.testing.assert_allclose(moved, expected, rtol=0.0, atol=NEWTON[0] * np.abs(expected).max())


def fmu(subject: Subject) -> None:
    """Its source, compiled here, under the inputs of its own reference gives the reference's outputs."""
    with refusals():
        made = contents(subject.system, recorded_system(subject.system, "system.npz"), "body", "3")
    given, expected = (_table(made.texts[f"resources/reference_{one}.csv"]) for one in ("in", "out"))
    instance = Instance(compiled(made, subject.out("fmu"), "3"))
    t, inputs, outputs = given.pop("time"), list(given), [name for name in expected if name != "time"]
    rows = np.column_stack(list(given.values()))
    instance.initialise(inputs, rows[0])
    found = [instance.get(outputs)]
    for k in range(len(rows) - 1):
        instance.set(inputs, rows[k])
        instance.step(t[k], t[k + 1] - t[k])
        found.append(instance.get(outputs))
    shown = np.searchsorted(t, expected["time"] - 1e-9)
    largest = dict[tuple[bool, bool], float]()  # of forces, displacements and rates: one may be nothing but round-off
    for name in outputs:
        largest[_kind(name)] = max(largest.get(_kind(name), 0.0), np.abs(expected[name]).max())
    for name, own in zip(outputs, np.array(found)[shown].T, strict=True):
        np.testing.assert_allclose(own, expected[name], rtol=0.0, atol=ROUND_OFF[1] * largest[_kind(name)])


def _kind(output: str) -> tuple[bool, bool]:
    return output.startswith("force_of"), output.endswith("_rate")


def _table(text: str) -> dict[str, Array]:
    """Columns of comma-separated values by their names."""
    head, *rows = csv.reader(text.splitlines())
    return dict(zip(head, np.array(rows, float).T, strict=True))


def flexible(to: str, subject: Subject) -> None:
    """Frequencies of the full model with its sliders there; those on frames leave out what lies within a frame."""
    target = subject.out(to) / BODY_FORMATS[to].file_name
    asked = ["--at", str(subject.kind.at), "--to", to, "--modes", "4", "--set", "masses=[]"]
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
    "combinations": {"scene": "scene.toml", "combinations": [[2, 2]], "fewest": 3},
    "convergence": {"scene": "scene.toml", "full": [4, 6], "ancf": [2, 4]},
    "error_map": {"scene": "scene.toml", "most_snapshots": 2, "most_modes": 2, "largest_pool": 4, "budget": 4},
    "histories": {"scenes": ["scene.toml"]},
    "residual": {"scenes": ["scene.toml"], "coordinates": [4, 5]},
    "speed": {"scenes": ["scene.toml"], "repeats": 1},
    "trade": {"scenes": ["scene.toml"], "methods": ["modes", "flexibility"], "coordinates": [4, 6]}
    | {"steps": [2.0, 1.0], "radii": [0.9], "elements": [4]},
    "collection": {"files": ["scenes.toml"]},
}


def study(kind: str, subject: Subject) -> None:
    """All runs are there and finite; a study of one scene finds what a run of it does."""
    assert subject.file.exists()
    for name in {kind, "scenes"}:
        text = toml.written({"kind": name, "title": "A study", **STUDIES[name]})
        (subject.folder / f"{name}.toml").write_text(text)
    out = subject.out(f"study-{kind}")
    command("study", str(subject.folder / f"{kind}.toml"), "--jobs", "1", "--out", str(out))
    table = out / ("scenes/runs.csv" if kind == "collection" else "runs.csv")
    with table.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert rows and all(row.get("status", "done") == "done" for row in rows)
    if kind in ("scenes", "collection"):
        errors = subject.outcome.result.summary["errors"]["reduced_vs_full"]
        np.testing.assert_allclose(float(rows[0]["errors.reduced_vs_full.beam"]), errors["beam"], rtol=1e-3)


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
    "`pmr.simulate`": simulate_in_python,
    "`pmr.Stepper`": stepper,
    "`pmr info`": info,
    "`pmr simulate`": simulate,
    "`pmr export --to exudyn`": script,
    "`pmr export --to fmu`": fmu,
    "`pmr export --to matlab`": matlab,
    "`pmr export --to python-control`": python_control,
    "`pmr export --to frequency-response`": frequency_response,
    "`pmr export --to dmig`": stiffness_of_deck,
    "`pmr export --to op4`": stiffness_of_output4,
    **{f"`pmr flexible --to {name}`": partial(flexible, name) for name in BODY_FORMATS},
    **{f"`pmr study`, {name}": partial(study, name) for name in kind_names()},
}
