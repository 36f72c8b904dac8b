"""Study files: what they may say, and the one line that says what they may not.
A body alone with second order in studies: followed where it is, refused in one line where it is not.
"""

import re
from pathlib import Path

import pytest

from pmr import InputError
from pmr.studies import call
from pmr.studies.kinds.scenes import Study, run_case

WORKFLOWS = Path(__file__).parents[2] / "workflows"
SCENE = WORKFLOWS / "paper_simple.toml"
GOOD = f'kind = "scenes"\ntitle = "T"\nscenes = ["{SCENE}"]\n'


def study(folder: Path, text: str) -> Path:
    file = folder / "study.toml"
    file.write_text(text)
    return file


def keys(path: Path, *overrides: str) -> list[str]:
    return [task.key for part in call.load(path, overrides).parts for task in part.plan.runs]


def test_scenes_cases_and_grid_are_combined(tmp_path: Path) -> None:
    text = (
        GOOD + '[grid]\nreduction.modes = [5, 6]\n[[cases]]\nname = "a"\n[[cases]]\nname = "b"\nchange.time.end = 1.0\n'
    )
    assert keys(study(tmp_path, text)) == ["a,modes=5", "a,modes=6", "b,modes=5", "b,modes=6"]
    assert keys(study(tmp_path, GOOD)) == ["paper_simple"]
    both = study(tmp_path, GOOD.replace("simple.toml", 'simple.toml", "paper_evolved.toml'))
    (tmp_path / "paper_evolved.toml").write_text(f'extends = "{SCENE}"\n')
    assert keys(both) == ["paper_simple", "paper_evolved"]


def test_options_change_a_study(tmp_path: Path) -> None:
    text = GOOD + "[grid]\nreduction.modes = [5, 6]\n"
    assert keys(study(tmp_path, text), "grid.reduction.modes=[7]") == ["modes=7"]


def test_names_of_scenes_are_relative_to_the_study(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "mine.toml").write_text(f'extends = "{SCENE}"\n')
    text = GOOD.replace(str(SCENE), "../mine.toml")
    assert keys(study(tmp_path / "sub", text)) == ["mine"]


REFUSED = [
    ("kind = 'scene'", "study.toml: kind = 'scene': did you mean 'scenes'? one of chart, collection,"),
    ("title = 'T'", "study.toml: kind: one of"),
    ("kind = ", "not valid TOML"),
    (GOOD + "jobs = 3", "jobs = 3: unknown key; allowed: kind, title,"),
    (GOOD + "gird = 3", "did you mean 'grid'"),
    (GOOD.replace("title", "titel"), "titel = 'T': unknown key; did you mean 'title'"),
    ("kind = 'scenes'\ntitle = 'T'\nscenes = []", "scenes = []: a list of at least 1 is allowed"),
    ("kind = 'scenes'\ntitle = 'T'\nscenes = ['none.toml']", "none.toml: no such scene file (run none)"),
    (GOOD + "[grid]\nreduction.modes = 5", "study.toml: grid.reduction.modes = 5: a list of values"),
    (GOOD + "[grid]\nreduction.mods = [5]", "study.toml: grid.reduction.mods = 5: unknown key; did you mean 'modes'"),
    (GOOD + "[grid]\nreduction.modes = [5, 0]", "grid.reduction.modes = 0: input should be greater"),
    (GOOD + "[grid]\nreduction.modes = [5, 0]", "(run modes=0)"),
    (GOOD + "[change]\nreduction.coordinates = 40", "change.reduction.coordinates = 40: at most snapshots"),
    (GOOD + "[grid]\nreduction.modes = [2]", "paper_base.toml: reduction.coordinates = 20: at most"),
    (GOOD + "[[cases]]\nname = 'a b'", "cases[0].name = 'a b': string should match"),
    (GOOD + "[[cases]]\nname = 'a'\nchange.time.end = -1", "cases[0].change.time.end = -1: input should be"),
    (GOOD + "[grid]\ntime.end = [1.0, 1.0]", "study.toml: two runs are called end=1.0; names of scenes"),
    (GOOD + "[[cases]]\nname = 'a'\n[[cases]]\nname = 'a'", "study.toml: two runs are called a; names of scenes"),
]  # fmt: skip


def test_a_bad_option_is_said_of_the_option(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        call.load(study(tmp_path, GOOD), ["grid.reduction.modes=[0]"])
    assert str(caught.value).startswith("--set: grid.reduction.modes = 0: input should be greater")


COLLECTION = 'kind = "collection"\ntitle = "Both"\nfiles = ["one.toml", "two.toml"]\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("one", "two"):
        (tmp_path / f"{name}.toml").write_text(GOOD)
    return tmp_path


def test_a_collection_plans_its_studies(folder: Path) -> None:
    text = COLLECTION + "[change.two]\ngrid.reduction.modes = [5, 6]\n"
    project = call.load(study(folder, text))
    assert [(part.name, len(part.plan.runs)) for part in project.parts] == [("one", 1), ("two", 2)]
    assert keys(study(folder, text), "change.one.grid.time.end=[1.0]") == ["end=1.0", "modes=5", "modes=6"]


def test_a_file_study_in_a_folder_has_the_name_of_the_folder(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        study(tmp_path / name, GOOD)
    parts = call.load(study(tmp_path, COLLECTION.replace(".toml", "/study.toml"))).parts
    assert [part.name for part in parts] == ["one", "two"]


def test_some_runs_of_a_collection_alone(folder: Path) -> None:
    project = call.load(study(folder, COLLECTION + "[change.two]\ngrid.reduction.modes = [5, 6]\n"))
    assert project.runs == ("one/paper_simple", "two/modes=5", "two/modes=6")
    two = project.select_runs(["two/modes=6"])
    assert two.runs == ("two/modes=6",) and [part.name for part in two.parts] == ["two"]
    with pytest.raises(InputError, match=r"--only = 'two/modes=7': no such run; did you mean 'two/modes="):
        project.select_runs(["two/modes=7"])


CHART = f"kind='chart'\ntitle='T'\nup_to=2e3\nluffing=[0.3]\nscene='{SCENE.parent / 'crane.toml'}'\n[[published]]\n"
REFUSED += [
    (GOOD + "[[published]]\nfigure = 'tip'\ntext = 't'", "study.toml: published[0].figure = 'tip': none is allowed"),
    (
        CHART + "figure='governs.stress'\ntext='t'",
        "study.toml: published[0].figure = 'governs.stress': did you mean 'governs.sta",
    ),
    (CHART + "figure='point'\ntext='t'", "published[0].figure = 'point': did you mean 'points'? one of points, limits"),
    (COLLECTION.replace("two", "three"), "three.toml: no such study file"),
    (COLLECTION.replace("two", "one"), "files = ['one', 'one']: names must differ"),
    (COLLECTION.replace("two", "study"), "can't hold another one"),
    (COLLECTION + "[change.tow]\ntitle = 'x'", "change = 'tow': one of the files' names is allowed: one, two"),
    (COLLECTION + "[change.two]\ntitel = 'x'", "study.toml: titel = 'x': unknown key; did you mean 'title'"),
    (COLLECTION.replace("files", "studies"), "unknown key"),
]


@pytest.mark.parametrize(("text", "says"), REFUSED, ids=[says for _, says in REFUSED])
def test_what_is_not_allowed_is_refused_in_one_line(folder: Path, text: str, says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)):
        call.load(study(folder, text))


CANTILEVER = Path(__file__).parents[1] / "pipeline" / "cantilever.toml"


@pytest.mark.slow
def test_runs_of_scenes_follow_second_order() -> None:
    plan = Study(kind="scenes", title="columns", scenes=(CANTILEVER,)).plan()
    assert [task.function for task in plan.runs] == [run_case]
    record = run_case(plan.runs[0].arguments, {}).record
    assert record["coordinates.reduced"] == 14  # two of them without inertia
