"""Every kind of scene by every way that takes it: right, or refused in one line, as the manual's table says.

The table in docs/ways.md is what is tested: a new command, format, kind of study, simulator or model has to be in it.
"""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
import typer.main
from ways.kinds import KINDS
from ways.subjects import Refused, Subject
from ways.ways import WAYS

import pmr
from pmr.cli.app import app
from pmr.export.formats import BODY_FORMATS, FORMATS
from pmr.scene import Reduction
from pmr.scene.choice import SIMULATORS
from pmr.scene.joints import Joint
from pmr.scene.model_traits import MODELS
from pmr.studies.call import kind_names

PAGE = Path(__file__).parents[2] / "docs" / "ways.md"
RIGHT = "+"
#: Commands that take no scene and no model, and names of Python that do nothing with one, or what `pmr run` does.
ELSEWHERE = {"new", "matrices", "schema", "compile", "observe", "identify"}
NO_WAY = {
    *(
        "ConvergenceError",
        "Observer",
        "PositionObserver",
        "linearize",
        "InputError",
        "SimulationError",
        "ReducedModel",
        "Response",
        "RunResult",
        "System",
        "__version__",
    ),
    *("from_matrices", "load_scene", "run"),
}
#: Kinds whose runs are short, from which the sample takes, and ways that are left to the whole sweep.
SHORT, LONG = "ACN", re.compile("mpirun|tolerance|study`, (?!scenes)")
#: Ways that run the whole scene, or compile.
SLOW = re.compile("pmr run|pmr study|fmu")
#: The one whose model takes a second to make.
SLOW_KIND = "N"


def rows(head: str) -> Iterator[list[str]]:
    """Cells of the table whose first row begins with `head`, that row first."""
    found = PAGE.read_text(encoding="utf-8").split(f"\n| {head} |", 1)[1].split("\n\n", 1)[0]
    for number, line in enumerate(f"| {head} |{found}".splitlines()):
        if number != 1:
            yield [cell.strip() for cell in line.strip("|").split("|")]


def cells() -> dict[tuple[str, str], str]:
    """By way and kind."""
    (_, *letters), *lines = rows("way")
    return {(way, letter): cell for way, *found in lines for letter, cell in zip(letters, found, strict=True)}


def notes() -> dict[str, str]:
    """By their letters, what a refusal has in it."""
    return dict(re.findall(r"^- \*\*(\w)\*\* `(.*?)`", PAGE.read_text(encoding="utf-8"), re.MULTILINE))


def declared() -> Iterator[str]:
    """The ways that the project declares: commands, options of `pmr run`, formats, simulators, studies, names."""
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        if name in ("export", "flexible"):
            yield from (f"`pmr {name} --to {to}`" for to in {"export": FORMATS, "flexible": BODY_FORMATS}[name])
        elif name == "study":
            yield from (f"`pmr study`, {kind}" for kind in kind_names())
        elif name not in ELSEWHERE:
            yield f"`pmr {name}`"
        options = {parameter.opts[0] for parameter in command.params} if name == "run" else set()
        yield from (f"`pmr run {one}`" for one in options - {"scene_files", "--out", "--set", "--simulators", "--help"})
    yield from (f"`pmr run --simulators {name}`" for name, can in SIMULATORS.items() if can.reduced_models)
    yield from (f"`pmr.{name}`" for name in set(dir(pmr)) - NO_WAY)
    yield "`mpirun -n 2 pmr run`"


def test_every_way_and_every_kind_is_in_the_manual() -> None:
    assert set(declared()) == set(WAYS)
    assert set(cells()) == {(way, kind) for way in WAYS for kind in KINDS}
    assert [line[0] for line in rows("kind")][1:] == list(KINDS)
    assert set(cells().values()) == {RIGHT, *notes()}


def test_every_model_basis_and_joint_is_among_the_kinds() -> None:
    scenes = [kind.scene for kind in KINDS.values() if not kind.has_sections]
    assert {scene["body"]["model"] for scene in scenes} == {*MODELS} - {"mover"}  # it runs on a beam
    bases = get_args(Reduction.model_fields["basis"].annotation)
    assert {scene["reduction"].get("basis", "free_modes") for scene in scenes} == {*bases}
    joints = [kind.scene["section"]["joint"] for kind in KINDS.values() if kind.has_sections]
    driven = {"overlap", "follows", "ratio", "offset", "rope"}  # another signal, and a cylinder by another stiffness
    assert set().union(*joints) == set(Joint.model_fields) - driven


@pytest.fixture(scope="module")
def subject(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Subject]:
    """Of a kind, made once."""
    made: dict[str, Subject] = {}

    def of(kind: str) -> Subject:
        if kind not in made:
            made[kind] = Subject(KINDS[kind], tmp_path_factory.mktemp(kind))
        return made[kind]

    return of


def chosen() -> Iterator[Any]:
    """All, or of every short way one kind that goes with it."""
    table = cells()
    if os.environ.get("PMR_SWEEP") == "full":
        yield from sorted(table, key=lambda cell: cell[1])
        return
    for number, way in enumerate(WAYS):
        right = [kind for kind in SHORT if table[way, kind] == RIGHT]
        if right and not LONG.search(way):
            kind = right[number % len(right)]
            yield pytest.param(way, kind, marks=[pytest.mark.slow] * bool(kind == SLOW_KIND or SLOW.search(way)))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("way", "kind"), chosen())
def test_it_is_right_or_refused_in_one_line(
    way: str, kind: str, subject: Callable[[str], Subject], unmeasured: Callable[..., None]
) -> None:
    says = cells()[way, kind]
    unmeasured(way != "`pmr run`", workers="study" in way)
    try:
        WAYS[way](subject(kind))
    except Refused as refused:
        assert says != RIGHT, refused
        assert notes()[says] in str(refused)
        assert "\n" not in str(refused)
    else:
        assert says == RIGHT
