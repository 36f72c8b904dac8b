"""The command as a user calls it: a process of its own, its files, its exit code."""

import io
import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from oracle import flexible, full_body
from processes import python

from pmr.cli.console import Output
from pmr.cli.info import describe_model

SIMPLE = "workflows/paper_simple.toml"
SHORT = [
    *("--set", "time.end=0.5", "--set", "mesh.elements=20"),
    *("--set", "slider.path={kind='ramp',times=[0.1,0.4],values=[1.25,1.6]}"),
]


def pmr(*arguments: str, ranks: int = 1) -> subprocess.CompletedProcess[str]:
    return python("-m", "pmr", *arguments, ranks=ranks)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a short run of the simple case."""
    folder = tmp_path_factory.mktemp("run")
    done = pmr("run", SIMPLE, "--out", str(folder), *SHORT)
    assert done.returncode == 0, done.stderr
    assert "reduced against full" in done.stdout and f"{folder}/report.html" in done.stdout
    assert done.stdout.index("lowest natural frequency") < done.stdout.index("reduced against full")
    assert all(", after " in line for line in done.stderr.splitlines())  # no bars where there is no terminal
    return folder


@pytest.mark.slow
def test_a_run_leaves_what_the_help_says(folder: Path) -> None:
    assert {"report.html", "report.pdf", "summary.json", "reduced.npz", "trajectories.npz"} <= {
        file.name for file in folder.iterdir()
    }
    assert (folder / "report.pdf").read_bytes()[:5] == b"%PDF-"


@pytest.mark.slow
def test_the_summary_keeps_its_contract(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())
    for pair in ("reduced_vs_full", "full_vs_ancf", "reduced_vs_ancf"):
        assert 0.0 < summary["errors"][pair]["tip"] < 1.0 and 0.0 < summary["errors"][pair]["beam"] < 1.0
        assert 0.0 < summary["absolute_errors"][pair]["tip"] < summary["absolute_errors"][pair]["beam"]
    assert summary["max_displacement"] > summary["max_error"] > 0.0
    assert summary["coordinates"] == {"full": 63, "reduced": 20}
    assert 0.999 < summary["basis"]["kappa"] <= 1.0 and len(summary["basis"]["singular_values"]) == 30
    assert {"assemble", "snapshots", "pod", "simulate", "estimate"} == set(summary["seconds"])
    assert {"march", "exudyn", "full", "ancf"} == set(summary["seconds"]["simulate"])
    assert {"pmr", "dolfinx", "PETSc", "SLEPc", "exudyn"} <= set(summary["versions"])
    assert len(summary["scene_hash"]) == 16


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_several_scenes_make_one_report(tmp_path: Path, run_command) -> None:
    second = tmp_path / "second.toml"
    second.write_text(f'extends = "{Path(SIMPLE).resolve()}"\ntitle = "A second scene"\n')
    both = ("run", SIMPLE, str(second), "--out", str(tmp_path / "out"))
    done = run_command(*both, *SHORT, "--set", "compare.against=[]")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "report.pdf").exists()
    for stem in ("paper_simple", "second"):
        assert (tmp_path / "out" / stem / "summary.json").exists()
    html = (tmp_path / "out" / "report.html").read_text()
    assert "A second scene" in html and "Sliding beam, simple case" in html


@pytest.mark.slow
def test_info_says_what_a_file_holds(folder: Path, run_command) -> None:
    files = ([], [str(folder / "reduced.npz")], [SIMPLE])
    stack, model, scene = (run_command("info", *file) for file in files)
    assert "dolfinx" in stack.stdout and "float64" in stack.stdout
    assert "20 coordinates" in model.stdout and "slider" in model.stdout and "F in N" in model.stdout
    assert "estimated error" in model.stdout
    assert "153" not in scene.stdout and "values (1.25, 3.75) m" in scene.stdout


def test_info_describes_the_study_in_a_folder(tmp_path: Path, run_command) -> None:
    (tmp_path / "study.toml").write_text('extends = "coordinates"')
    assert "computed by" in run_command("info", str(tmp_path)).stdout
    (tmp_path / "scene.toml").write_text('extends = "boom_beam"')
    assert "computed by" not in run_command("info", str(tmp_path)).stdout


def test_info_names_inputs_and_outputs_with_units() -> None:
    model = replace(
        flexible(full_body(4), 3),
        input_names=("turn",),
        provenance={"scene": {"loads": [{"name": "turn", "direction": "rz"}, "damaged"], "gravity": {}}},
        output_names=("a", "b", "c", "d", "turned"),
        output_units=(*("m",) * 4, "rad"),
    )
    rows = describe_model(model)
    assert rows["inputs"] == "turn in N m" and rows["outputs"] == "4 in m (a, b, c, d); 1 in rad (turned)"
    lifted = replace(model, input_names=("gravity",), provenance={"scene": {"loads": "F"}})
    assert describe_model(lifted)["inputs"] == "gravity in m/s^2"


@pytest.mark.slow
def test_an_exported_script_runs_without_pmr(folder: Path, tmp_path: Path, run_command) -> None:
    (tmp_path / "reduced.npz").write_bytes((folder / "reduced.npz").read_bytes())
    done = run_command("export", str(tmp_path / "reduced.npz"), "--to", "exudyn")
    assert done.returncode == 0, done.stderr
    script = Path(done.stdout.strip())
    assert script.parent == tmp_path and "pmr" not in [
        line.split()[1].split(".")[0] for line in script.read_text().splitlines() if line.startswith(("import", "from"))
    ]
    blocked = f"import sys, runpy; sys.modules['pmr'] = None; runpy.run_path({str(script)!r}, run_name='__main__')"
    ran = python("-c", blocked, cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert "x = 5 m" in ran.stdout


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_report_that_cant_be_drawn_loses_no_results(tmp_path: Path, run_command) -> None:
    """Where the PDF belongs stands a folder, which comes up last of all."""
    (tmp_path / "out" / "report.pdf").mkdir(parents=True)
    short = ["--set", "time.end=0.2", "--set", "slider.path=1.3", "--set", "compare.against=[]"]
    done = run_command("run", SIMPLE, "--out", str(tmp_path / "out"), *short)
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
    assert "the report can't be drawn (" in done.stderr and "report.pdf" in done.stderr
    assert "coordinates; simulated in" in done.stdout
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["coordinates"]["reduced"] == 20
    assert (tmp_path / "out" / "reduced.npz").stat().st_size and (tmp_path / "out" / "trajectories.npz").stat().st_size


BAD = [
    (["run", "nowhere.toml"], "nowhere.toml: no such scene file"),
    (["run", SIMPLE, "time.end=1"], "time.end=1: no such scene file; a change of a key stands behind --set"),
    (["run", SIMPLE, "--set", "body.profile.lenght=3"], "did you mean 'length'"),
    (["run", SIMPLE, "--set", "body.profile.bending_stiffness=-1"], "body.profile.bending_stiffness = -1"),
    (["run", SIMPLE, "--set", "reduction.coordinates=31"], "snapshots * modes = 30"),
    (["run", SIMPLE, "--set", "reduction.snapshots=51", "--set", "time.end=0.1"], "at most 50"),
    (["run", SIMPLE, "--set", "mesh.elements=2", "--set", "reduction.modes=10"], "6 free coordinates; ask for fewer"),
    (["run", SIMPLE, "--out", "pyproject.toml"], "a folder that can be written to"),
    (["new", "boom", "pyproject.toml/x"], "NAME = 'pyproject.toml/x': a folder that can be written to is allowed"),
    (["run", SIMPLE, "--out", "/"], "--out = '/': a folder below the root of the file system is allowed"),
    (["chart", "crane", "--up-to", "1e4", "--out", "/"], "a folder below the root of the file system is allowed"),
    (["run", SIMPLE, "--set", f"time.end={'9' * 400}"], "integers of 64 bits are allowed"),
    (["run", SIMPLE, "--set", f"time.end={'9' * 5000}"], "integers of 64 bits are allowed"),
    (["run", SIMPLE, "--set", "section.mesh.elements=9"],
     "--set: section: only a boom of several [[sections]] has this"),
    (["run", SIMPLE, "--set", "sections.s1.mesh.elements=9"],
     "sections: one [body], or the [[sections]] of a boom, are"),
    (["run", SIMPLE, "--set", "reduction.no.such=9"], "reduction.no: unknown key; "),
    (["run", SIMPLE, SIMPLE], "names must differ"),
    (["export", "nowhere.npz"], "nowhere.npz: no such file"),
    (["export", SIMPLE], "not a system written by pmr"),
    (["export", "reduced.npz", "--to", "abaqus"], "exudyn, fmu, matlab, "),
    (["info", "nowhere.npz"], "no such file"),
    (["simulate", "reduced.npz"], "'--scene': scene with the path, loads and time steps; "),
    (["run"], "'SCENE': scene files"),
    (["study", "study.toml", "--jobs", "many"], "'--jobs'"),
    (["study", "study.toml", "--jobs", "9" * 400], "'--jobs'"),
    (["run", "boom_beam", "--set", f"loads.{'9' * 5000}.on=1.0"], "by name or number: tip force (0), gust (1)"),
    (["matrices", "/"], "STIFFNESS = '/': the name of a file is allowed"),
    (["run", SIMPLE, "--simulators", "march,euler"], "simulation.simulators[1] = 'euler'"),
    (["run", SIMPLE, "--simulators", ""], "simulation.simulators"),
    (["--set", "a=1"], "No such option: --set"),
    (["frob"], "No such command 'frob'"),
]  # fmt: skip


def test_tables_of_others_are_not_replaced(tmp_path: Path, run_command) -> None:
    """Old tables of a run are removed, so that a folder with tables and no run is another's."""
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "mine.csv").write_text("a,b\n")
    done = run_command("run", SIMPLE, "--out", str(tmp_path))
    assert done.returncode == 2 and "results would replace tables/mine.csv" in done.stderr
    assert (tmp_path / "tables" / "mine.csv").read_text() == "a,b\n"


@pytest.mark.parametrize(("arguments", "says"), BAD, ids=[" ".join(a)[:60] for a, _ in BAD])
def test_bad_input_ends_with_one_line_and_exit_code_2(arguments: list[str], says: str, run_command) -> None:
    done = run_command(*arguments)
    assert done.returncode == 2
    assert done.stdout == "" and len(done.stderr.strip().splitlines()) == 1
    assert says in done.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_number_in_another_unit_is_a_warning_of_the_run_its_summary_and_its_report(
    tmp_path: Path, run_command
) -> None:
    keys = ["time.end=0.1", "slider.path=1.3", "compare.against=[]", "simulation.simulators=['march']"]
    keys += ["damping={ratio=0.5,frequencies=[1.0,10.0]}"]
    done = run_command("run", SIMPLE, "--out", str(tmp_path), *(p for k in keys for p in ("--set", k)))
    hint = "damping.ratio = 0.5 is unusual: up to 0.3 is usual here; is 0.5 % (0.005) meant?"
    assert done.returncode == 0 and f"warning: {hint}\n" in done.stdout
    assert json.loads((tmp_path / "summary.json").read_text())["warnings"][0] == hint
    assert f"D{hint[1:]}" in (tmp_path / "report.html").read_text()


def test_it_is_told_beside_what_makes_a_run_fail(tmp_path: Path, run_command) -> None:
    keys = ["mesh.elements=2", "reduction.modes=10", "compare.against=[]", "damping={ratio=0.5,frequencies=[1.0,10.0]}"]
    done = run_command("run", SIMPLE, "--out", str(tmp_path), *(p for k in keys for p in ("--set", k)))
    hint, refused = done.stderr.splitlines()
    assert done.returncode == 2 and hint.startswith("warning: damping.ratio = 0.5 is unusual: ")
    assert "6 free coordinates; ask for fewer" in refused


def test_bad_input_ends_a_process_of_its_own_likewise() -> None:
    arguments, says = BAD[3]
    done = pmr(*arguments)
    assert done.returncode == 2 and done.stdout == "" and says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_the_place_for_results_is_tried_before_anything_is_computed(tmp_path: Path, run_command) -> None:
    (tmp_path / "file").write_text("")
    for out in (f"{tmp_path}/file", f"{tmp_path}/file/x"):
        done = run_command("run", SIMPLE, "--out", out)
        assert done.returncode == 2 and "can be written to is allowed" in done.stderr and done.stdout == ""


@pytest.mark.slow
def test_an_export_replaces_no_model(folder: Path, tmp_path: Path, run_command) -> None:
    model = folder / "reduced.npz"
    content = model.read_bytes()
    (tmp_path / "script.npz").write_bytes(b"another")
    for out in (model, folder, tmp_path / "script.py"):
        assert run_command("export", str(model), "--out", str(out)).returncode == 2
    assert model.read_bytes() == content and (tmp_path / "script.npz").read_bytes() == b"another"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_several_simulators_say_how_far_they_agree(tmp_path: Path, run_command) -> None:
    short = ("--set", "time.end=0.2", "--set", "slider.path=1.3", "--set", "compare.against=[]")
    names = ("--simulators", "exudyn-callback, march,exudyn")
    done = run_command("run", SIMPLE, *short, *names, "--out", str(tmp_path))
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert list(summary["seconds"]["simulate"]) == ["exudyn-callback", "march", "exudyn"]
    assert summary["simulators"] == {"reduced": "exudyn-callback"}
    pairs = ["exudyn-callback_vs_march", "exudyn-callback_vs_exudyn", "march_vs_exudyn"]
    assert list(summary["agreement"]) == pairs and 0.0 < max(summary["agreement"].values()) < 1e-9
    assert "march and exudyn agree to" in done.stdout


@pytest.mark.slow
def test_no_room_for_a_drawn_mesh_is_one_line(tmp_path: Path) -> None:
    """No file may be longer than 1,000 bytes, once MPI has its own: nothing is written before the mesh is.

    Python stores no bytecode (-B), because bytecode that is cut off at 1,000 bytes would break later imports.
    """
    limit = "import resource, pmr.fem.compat; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))"
    command = ["pmr", "run", "workflows/boom_shell.toml", "--out", str(tmp_path)]
    done = python("-B", "-c", f"{limit}; import sys; sys.argv = {command}; from pmr.cli.app import main; main()")
    assert (done.returncode, done.stdout) == (1, "")
    assert (
        done.stderr.count("\n") == 1
        and "File too large: free space is needed" in done.stderr
        and "(TMPDIR)" in done.stderr
    )


@pytest.mark.slow
def test_bad_input_ends_all_ranks() -> None:
    done = pmr("run", SIMPLE, "--set", "reduction.snapshots=51", ranks=2)
    assert done.returncode != 0 and "at most 50" in done.stderr


@pytest.mark.slow
def test_a_form_that_is_not_compiled_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The C compiler gives up, as it does where its output has no room."""
    for name in ("CC", "LDSHARED"):
        monkeypatch.setenv(name, "/bin/false")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    done = pmr("run", SIMPLE, "--out", str(tmp_path / "out"))
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.count("\n") == 1 and "a finite-element form was not compiled" in done.stderr


@pytest.mark.parametrize("terminal", [True, False])
def test_sentences_break_between_words_on_a_terminal_alone(terminal: bool) -> None:
    """A line elsewhere, where another program reads it; what is one word stays whole."""
    text = "the error of the time step itself is " + 20 * "0.00254 % at the tip and " + "all sections"
    screen = Output(file=io.StringIO(), width=80, force_terminal=terminal, color_system=None)
    screen.sentences(text)
    lines = screen.file.getvalue().rstrip("\n").split("\n")
    assert " ".join(map(str.strip, lines)) == text and (max(map(len, lines)) <= 80) == (len(lines) > 1) == terminal
