"""What a newcomer types first: a scene of one's own, workflows by their names, keys for an editor.
`pmr chart`: the study that it writes, and what it refuses.
"""

import json
import re
import runpy
import shutil
from collections.abc import Callable
from importlib import util
from pathlib import Path

import meshio
import numpy as np
import pytest
from typer.testing import CliRunner

import pmr
from pmr import __version__
from pmr import scene as scenes
from pmr.cli.app import TEMPLATES, app, scene_kinds
from pmr.cli.console import scene_file, study_file
from pmr.errors import InputError
from pmr.fullmodel.wall_stress import YieldForce
from pmr.scene.members import member_at, members
from pmr.scene.tomlfiles import result_name
from pmr.simulation.frame import load_signals
from pmr.studies import call
from pmr.studies.kinds.chart import Study
from pmr.system.from_scene import force_names

RUN = CliRunner()
CRANE = (TEMPLATES / "crane.toml").read_text()


@pytest.mark.parametrize("kind", scene_kinds())
def test_a_new_scene_is_accepted_and_has_the_folders_name(kind: str, tmp_path: Path) -> None:
    assert RUN.invoke(app, ["new", kind, str(tmp_path / "mine")]).exit_code == 0
    assert scenes.load_any(scene_file(tmp_path / "mine")).title == "mine"


def test_what_is_there_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text("mine")
    with pytest.raises(InputError, match="not there yet"):
        RUN.invoke(app, ["new", "boom", str(tmp_path)], catch_exceptions=False, standalone_mode=False)
    assert (tmp_path / "scene.toml").read_text() == "mine"


def test_an_unknown_kind_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean 'boom'.*beam, boom, crane, platform, telescope"):
        RUN.invoke(app, ["new", "bom", str(tmp_path / "x")], catch_exceptions=False, standalone_mode=False)


@pytest.mark.parametrize(
    "changes, close",
    [
        ("slider.path.kind=smoth_ramp", "smooth_ramp"),
        ("body.model=shel", "shell"),
        ("reduction.basis=free_mode", "free_modes"),
    ],
)
def test_a_misspelt_kind_is_answered_with_the_one_that_is_like_it(changes: str, close: str) -> None:
    with pytest.raises(InputError, match=f"did you mean '{close}'"):
        scenes.load("workflows/boom.toml", [changes])


@pytest.mark.parametrize("kind", ["beam", "boom"])
def test_the_mesh_script_draws_the_body_of_its_scene(kind: str, tmp_path: Path) -> None:
    RUN.invoke(app, ["new", kind, str(tmp_path / "mine")])
    runpy.run_path(str(tmp_path / "mine" / "mesh.py"), run_name="__main__")
    (file,) = (tmp_path / "mine").glob("*.msh")
    x = meshio.read(file).points[:, 0]
    body = scenes.load(scene_file(tmp_path / "mine")).body
    assert x.min() == pytest.approx(0.0, abs=1e-9) and x.max() == pytest.approx(body.length)


def test_shells_complete_what_is_typed() -> None:
    asked = {"_PMR_COMPLETE": "complete_bash", "COMP_WORDS": "pmr new b", "COMP_CWORD": "2"}
    assert RUN.invoke(app, [], env=asked, prog_name="pmr").stdout.split() == ["beam", "boom"]


def test_workflows_are_found_by_their_names_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert scene_file(Path("paper_simple")).name == "paper_simple.toml"
    assert study_file(Path("coordinates")).parent.name == "studies"
    Path("stiff.toml").write_text("extends = 'boom_beam'\ntitle = 'stiff'\npads.tail.stiffness = 1e9")
    assert scenes.load("stiff.toml").pads[0].stiffness == 1e9
    for asked in ("paper_simpel", "paper_simpel.toml"):
        with pytest.raises(InputError, match="no such scene file; did you mean 'paper_simple'"):
            scenes.load(asked)
    Path("paper_simple.toml").write_text("title = 'mine'")
    assert scene_file(Path("paper_simple.toml")) == Path("paper_simple.toml")


def test_each_command_names_the_other_one_for_its_files() -> None:
    with pytest.raises(InputError, match="pmr study coordinates"):
        scene_file(Path("coordinates"))
    with pytest.raises(InputError, match="pmr run paper_simple"):
        study_file(Path("paper_simple"))


def test_version_and_quiet() -> None:
    assert RUN.invoke(app, ["--version"]).stdout.strip() == f"pmr {__version__}"
    assert "beam" in RUN.invoke(app, ["info", "boom_beam"]).stdout
    assert not RUN.invoke(app, ["--quiet", "info", "boom_beam"]).stdout


def test_the_cranes_wind_keeps_its_direction_however_the_boom_is_turned() -> None:
    """It is across the boom after a quarter turn."""
    crane = scenes.load_any(Path(str(TEMPLATES / "crane.toml")))
    t = np.linspace(2.0, 29.0, 55)
    assert crane.frame is not None
    turned, loads = crane.frame.rotation(t), load_signals(crane, member_at(crane, 2))

    def of(name: str) -> np.ndarray:
        parts = [loads.get(f"{name} {axis}") for axis in "xyz"]
        return np.stack([0.0 * t if part is None else part.value(t) for part in parts], axis=1)

    wind = np.einsum("tij,tj->ti", turned, of("wind"))
    assert wind[t >= 4.0] == pytest.approx(np.outer(0.0 * t[t >= 4.0] - 1.0, [300.0, 0, 0]), abs=1e-9)
    assert of("wind")[-1] == pytest.approx([0.0, 300.0, 0.0], abs=1e-9)


AT_REST = ("time.end=0.1", "compare.against=[]", "section.mesh.elements=8", "section.reduction.estimate=false")


@pytest.mark.slow
def test_the_telescope_at_rest_presses_on_its_supports_as_statics_say() -> None:
    """Its cylinder bears the moment, and the pin the weight with the cylinder's thrust, both in the boom's axes."""
    at_rest = [*AT_REST, "section.joint.extension=2.0", "frame.luffing=30.0", "section.reduction.coordinates=6"]
    asked = [*at_rest, "section.body.walls=rigid", "frame.second_order=false"]
    outcome = pmr.run(scenes.load_any(Path(str(TEMPLATES / "telescope.toml")), asked))
    summary = outcome.result.summary
    force = {one["name"]: one["max"] for one in summary["reactions"]}
    steel = [
        7850.0 * 6.0 * 2.0 * (w + h) * wall
        for w, h, wall in ((0.3, 0.4, 0.008), (0.26, 0.36, 0.007), (0.22, 0.32, 0.006))
    ]
    moment = 9.80665 * np.cos(np.pi / 6.0) * (sum(m * (2.0 * k + 3.0) for k, m in enumerate(steel)) + 250.0 * 10.0)
    lug, foot = (1.5 - 0.2j) * np.exp(1j * np.pi / 6.0), 0.5 - 1.0j
    arm = (foot.conjugate() * lug).imag / abs(lug - foot)
    assert summary["luffing_cylinder"]["force"]["max"] == pytest.approx(moment / arm, rel=1e-3)
    thrust = summary["luffing_cylinder"]["force"]["max"] * (lug - foot) / abs(lug - foot)
    pin = (thrust - 9.80665j * (sum(steel) + 250.0)) * np.exp(-1j * np.pi / 6.0)
    assert force["base: pivot x"] == pytest.approx(pin.real, rel=1e-4)
    assert force["base: pivot z"] == pytest.approx(pin.imag, rel=1e-4)


@pytest.mark.slow
def test_the_platforms_cylinder_pushes_for_all_that_its_ropes_pull() -> None:
    """At rest it bears (m1 + 2 m2 + 3 m3) g sin 60, the pivot all sections, and the basket twists the base."""
    asked = [
        *AT_REST,
        "section.reduction.flexibility=false",
        "section.body.walls=rigid",
        "sections.first.joint.extension=3.0",
    ]
    outcome = pmr.run(scenes.load_any(Path(str(TEMPLATES / "platform.toml")), asked))
    summary = outcome.result.summary
    mass = {one["name"]: one["mass"] + one["attached"] for one in summary["masses"]}
    pull = {one["name"]: one["force"]["max"] for one in summary["ropes"]}
    along = 9.80665 * np.sin(np.pi / 3.0)
    assert pull["first"] == pytest.approx(along * (mass["first"] + 2.0 * mass["second"] + 3.0 * mass["fly"]), rel=1e-6)
    assert pull["second"] == pytest.approx(along * (mass["second"] + 2.0 * mass["fly"]), rel=1e-6)
    force = {one["name"]: one for one in summary["reactions"]}
    assert -force["base: pivot x"]["min"] == pytest.approx(along * sum(mass.values()), rel=1e-6)
    aside = 400.0 * 9.80665 * np.cos(np.pi / 3.0) * 0.8
    assert -force["base: pivot rx"]["min"] == pytest.approx(aside, rel=1e-3)


def test_templates_of_machines_ask_for_stresses_beside_a_yield_stress() -> None:
    """So that the first page of a first run says whether the machine holds."""
    for kind in ("boom", "telescope", "crane", "platform"):
        scene = scenes.load_any(Path(str(TEMPLATES / f"{kind}.toml")))
        assert scene.recovery is not None
        assert all(part.body.material.yield_stress for part in scene.bodies.values())


@pytest.mark.parametrize("kind", ["boom", "telescope", "crane", "platform"])
def test_walls_of_templates_give_on_cells_about_as_wide_as_their_pads(kind: str) -> None:
    """With rigid walls the first figures that anybody sees would be off by a third and more."""
    scene = scenes.load_any(Path(str(TEMPLATES / f"{kind}.toml")))
    for member in members(scene):
        assert member.part.body.walls == "give" and member.part.mesh.along
        assert all(member.part.mesh.size < 1.5 * pad.width for pad in member.pads)


@pytest.mark.parametrize(
    ("scene", "up_to", "says"),
    [
        ("boom_beam", "1000", "SCENE = "),
        ("crane", "0", "--up-to = 0"),
        ("crane", "-5", "--up-to = -5"),
        ("crane", "inf", "--up-to = inf"),
    ],
)
def test_what_has_no_chart_is_refused_in_one_line(
    scene: str, up_to: str, says: str, tmp_path: Path, run_command
) -> None:
    folder = tmp_path / "chart"
    done = run_command("chart", scene, "--up-to", up_to, "--out", str(folder))
    assert done.returncode == 2 and says in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not folder.exists()


@pytest.fixture
def draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_command) -> Callable[..., Study]:
    """Function that returns the study that `pmr chart` writes of a scene's text, without computing it.

    Yield forces of pads of middle, and of another section whose name begins alike, take no shell.
    """
    forces = {
        f"{name} {end} bottom {side}": YieldForce(by * 38.5e3, 3e3, 60e3, name)
        for name in ("middle", "middle 2")
        for end in ("tail", "mouth")
        for side, by in (("left", 1.0), ("right", 1.2))
    }
    monkeypatch.setattr("pmr.cli.study.study", lambda *_, **__: None)
    monkeypatch.setattr("pmr.fullmodel.wall_stress.yield_forces", lambda scene: forces)
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> Study:
        shutil.rmtree("out", ignore_errors=True)
        Path("crane.toml").write_text(text)
        done = run_command("chart", "crane.toml", "--out", "out")
        assert done.returncode == 0, done.stderr
        return call.load("out/chart.toml").parts[0].study

    return write


@pytest.mark.usefixtures("draft")
def test_the_study_that_it_writes_asks_for_all_that_the_scene_goes_through(run_command) -> None:
    for load, code in (("20000", 0), ("20000", 0), ("30000", 2)):
        done = run_command("chart", "crane", "--up-to", load, "--out", "out")
        assert done.returncode == code, done.stderr
    assert "--up-to = 30000.0: 20000.0 is allowed, the up_to of" in done.stderr
    done = run_command("chart", "crane", "--set", "time.end=9.0", "--out", "out")
    assert done.returncode == 2 and "--set = 'time.end=9.0': none is allowed, the change of" in done.stderr
    asked = call.load("out/chart.toml").parts[0].study
    assert (asked.extensions[0], asked.extensions[-1]) == (
        {"middle": 0.6, "fly": 0.6}, {"middle": 4.5, "fly": 4.5},
    )  # fmt: skip
    assert (asked.luffing.least, asked.luffing.most) == (10.0, 60.0)


def test_the_study_that_it_writes_looks_over_all_sides_of_a_boom_that_slews(draft: Callable[..., Study]) -> None:
    """Rear and front of the template differ, left and right do not; one mass beside the middle takes the whole turn."""
    half, whole = (0.0, 45.0, 90.0, 135.0, 180.0), tuple(range(0, 360, 45))
    for most, angles in (("360.0", half), ("-30.0", half), ("0.0", (0.0,)), ("90.0", half)):
        signal = f"slewing = {{ kind = 'smooth_ramp', times = [2.0, 10.0], values = [0.0, {most}] }}"
        assert draft(re.sub(r"^slewing = .*$", signal, CRANE, flags=re.M)).slewing == angles
    carrier = "at = [-0.6, 0.0, -0.9]"
    for old, new, angles in (
        (carrier, "at = [-0.6, 0.1, -0.9]", whole),
        ("pivot = [0.0, 0.0, 0.0]", "pivot = [0.0, 0.3, 0.0]", whole),
        ('direction = "x"', 'direction = "y"', whole),  # wind from the side
        ('direction = "x"', 'direction = "z"\npoint = [6.0, 0.2, 0.0]', whole),
        ("at = [-2.6, 2.4]", "at = [-2.6, 2.3]", whole),  # an outrigger
        (carrier, "at = [0.0, 0.0, -0.9]", (0.0, 45.0, 90.0)),
    ):
        assert old in CRANE and draft(CRANE.replace(old, new)).slewing == angles, new
        assert ("alike on left and right" in Path("out/chart.toml").read_text()) is (angles != whole)


def test_limits_of_walls_take_the_pads_of_their_joint_alone(draft: Callable[..., Study]) -> None:
    """Neither those of another section whose name begins alike."""
    study = draft(CRANE.replace('name = "fly"', 'name = "middle 2"'))
    pads = force_names(scenes.load_any("crane.toml"))["pad"]
    of_walls = [limit for limit in study.limits if limit.name.startswith("walls at pads of ")]
    taken = [[pad for pad in pads if limit.concerns(pad)] for limit in of_walls]
    assert [len(names) for names in taken] == [8, 8, 8, 8] and sorted(sum(taken, [])) == sorted(pads)
    assert {limit.most for limit in of_walls} == {35.5e3}
    mouths = ["mouth of base, around middle", "mouth of middle, around middle 2"]
    places = ["tail of middle", mouths[0], "tail of middle 2", mouths[1]]
    assert [limit.note.partition(";")[0] for limit in of_walls] == [f"at the {place}" for place in places]


@pytest.mark.usefixtures("draft")
def test_a_chart_of_a_changed_scene_has_the_changes_in_its_study(run_command) -> None:
    """The same command goes on with it; a list, a name with a blank and a text are written as TOML."""
    Path("crane.toml").write_text(CRANE)
    changes = [
        "section.joint.extension.values=[0.8, 3.0]", "sections.fly.masses.hook block.mass=200", "title=heavy hook",
        "frame.ground.masses.carrier.mass=9000.0",
    ]  # fmt: skip
    options = [word for change in changes for word in ("--set", change)]
    for _ in range(2):
        done = run_command("chart", "crane.toml", *options, "--out", "out")
        assert done.returncode == 0, done.stderr
    study = call.load("out/chart.toml").parts[0].study
    assert study.title == "Load chart: heavy hook" and study.change["title"] == "heavy hook"
    assert study.extensions[-1] == {"middle": 3.0, "fly": 3.0}
    assert '"mass": 200.0' in json.dumps(study.plan().runs[0].arguments) and study.up_to < 21000.0
    done = run_command("chart", "crane.toml", *options[:2], "--out", "out")
    assert done.returncode == 2 and "--set = 'section.joint.extension.values=[0.8, 3.0]': { section" in done.stderr
    done = run_command("chart", "crane", "--set", "nothing=1", "--out", "refused")
    assert done.returncode == 2 and "nothing" in done.stderr and not Path("refused").exists()


def test_an_allowed_pressure_of_pads_is_a_limit(draft: Callable[..., Study]) -> None:
    for text, names in ((CRANE, ["pressure of pads"]), (re.sub(r"(?m)^allowed_pressure.*\n", "", CRANE), [])):
        assert [limit.name for limit in draft(text).limits if limit.by_scene] == names


def test_forces_that_luffing_cylinder_and_pin_bear_are_limits(draft: Callable[..., Study]) -> None:
    """A slender rod buckles where the cylinder is longest; without keys of cylinder and pin there are no limits."""
    allowed = r"(?m)^allowed_(push|pull|force).*\n"
    assert len(re.findall(allowed, CRANE)) == 3
    longest = scenes.load_any(TEMPLATES / "crane.toml").frame.cylinder.length_and_arm(np.deg2rad(60.0)).length
    euler = np.pi**3 * 210e9 * 0.06**4 / (64.0 * longest**2)
    bare, table = re.sub(allowed, "", CRANE), "[frame.cylinder]\n"
    keyed = {f"{table}{keys}\n": force for keys, force in (("allowed_push = 3e5", 3e5), ("rod = 0.06", euler))}
    pull = f"{table}allowed_pull = 2e5\n"
    cylinder, without_lugs = {"luffing": 385e3, "luffing-pull": 225e3}, re.sub(r"(?m)^lug_spacing.*\n", "", CRANE)
    texts = [(bare, {}), (CRANE, cylinder | {"lug": 280e3}), (without_lugs, cylinder | {"support": 280e3})]
    texts += [(bare.replace(table, keys), {"luffing": force}) for keys, force in keyed.items()]
    texts += [(bare.replace(table, pull), {"luffing-pull": 2e5})]
    unnamed = CRANE.replace('name = "pin"\n', "", 1)
    assert unnamed != CRANE
    texts += [(unnamed, cylinder | {"lug": 280e3})]
    for text, limited in texts:
        by_kind = {limit.of: limit for limit in draft(text).limits if limit.of in (*cylinder, "support", "lug")}
        assert {of: limit.most for of, limit in by_kind.items()} == pytest.approx(limited, rel=1e-5)
        if "support" in by_kind:
            pin, names = by_kind["support"], "base pin {}".format
            assert pin.concerns(names("x")) and pin.concerns(names("z")) and not pin.concerns("base luffing cylinder")
            assert not pin.concerns(names("rx"))  # a moment
        if "lug" in by_kind:
            assert by_kind["lug"].which == ("base support on tail" if text == unnamed else "base pin",)


def test_without_fenicsx_walls_are_not_limited_and_what_needs_it_is_refused_before_a_folder_is_made(
    draft: Callable[..., Study], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, run_command
) -> None:
    find = util.find_spec
    monkeypatch.setattr("pmr.errors.environment.util.find_spec", lambda name: None if name == "dolfinx" else find(name))
    done = run_command("chart", "crane", "--out", "refused")
    assert done.returncode == 2 and "installation: dolfinx: not found" in done.stderr, done.stderr
    assert not Path("refused").exists()
    monkeypatch.setattr("pmr.scene.model_traits.ModelTraits.needs_fenicsx", False)
    assert not any("walls at pads of" in limit.name for limit in draft(CRANE).limits)
    assert "walls at pads are not limited: dolfinx is not installed" in caplog.text


def test_a_chart_without_a_largest_load_takes_the_mass_of_machine_and_boom(
    draft: Callable[..., Study], run_command
) -> None:
    """18 t of machine and 2.2 t of boom, rounded up; without a machine, five times the mass of the boom."""
    assert draft(CRANE).up_to == 21000.0
    said = " ".join(run_command("chart", "crane.toml", "--out", "again").stdout.split())
    assert "21000 kg is the largest load that is looked for" in said
    run_command("chart", "crane", "--out", "boom")
    assert call.load("boom/chart.toml").parts[0].study.up_to == 13000.0
    heavy = CRANE.replace("mass = 150.0", "mass = 3000.0").replace("= 1000.0", "= 5000.0")
    assert draft(heavy).up_to == 24000.0  # a hook block is a part of the boom, and the payload is not
    Path("crane.toml").write_text(heavy.replace("density = 7850.0", "density = 7.85"))
    done = run_command("chart", "crane.toml", "--out", "unknown")
    assert done.returncode == 2 and "--up-to" in done.stderr and "the mass of the boom is not known" in done.stderr


@pytest.mark.usefixtures("draft")
def test_a_chart_of_a_folder_has_its_name(run_command) -> None:
    run_command("new", "crane", "mine")
    paths = [Path(of) for of in ("mine", "mine/scene.toml", "mine/study.toml", "mine/other.toml", "crane")]
    assert [result_name(path) for path in paths] == ["mine", "mine", "mine", "other", "crane"]
    run_command("chart", "mine", "--up-to", "20000")
    study = call.load("reports/chart_mine/chart.toml").parts[0].study
    limits = [(limit.of, limit.most, limit.factor) for limit in study.limits]
    # the scene has outriggers, a probe of stress, allowed forces of cylinder and pin, and pads with an allowed pressure
    borne = [("luffing", 385e3, 1.0), ("luffing-pull", 225e3, 1.0), ("lug", 280e3, 1.0), ("pad", None, 1.0)]
    assert limits == [("tipping", 1.0, 1.33), ("stress", 690e6, 1.5), *borne, *[("pad", 35.5e3, 1.5)] * 2]
    assert [limit.which for limit in study.limits[-2:]] == [("middle tail *",), ("middle mouth *",)]
    assert study.slewing == (0.0, 45.0, 90.0, 135.0, 180.0)
    scene = json.dumps(study.plan().runs[0].arguments)
    assert "hook block" in scene and '"name": "payload"' not in scene  # the load that is looked for hangs in its place


@pytest.mark.parametrize(
    ("key", "texts"),
    [
        ("hoist.falls", ("Number of falls between head and hook", "whole number, at least 1")),
        ("sections.fly.masses.at", ("Place of its centre", "list of 3, in m")),
        ("section.joint.rope", ("Rope or chain that moves the section", "strands", "EA")),
        ("frame.cylinder", ("foot", "must be given", "stiffness", "in N/m")),
        ("limits.factor", ("number, above 0", "1.0")),
        # each of the tables that a value may be has its own keys
        ("slider.path", ('default "constant"', 'default "ramp"', 'default "sine"', 'default "sum"')),
    ],
)
def test_a_key_can_be_read_about_without_the_manual(key: str, texts: tuple[str, ...]) -> None:
    shown = RUN.invoke(app, ["schema", key])
    assert shown.exit_code == 0 and all(text in " ".join(shown.output.split()) for text in texts), shown.output


@pytest.mark.parametrize("key", ["hoist.fals", "sections.masses.nothing", "nothing", "hoist.falls.more"])
def test_a_key_that_is_not_there_is_refused_in_one_line(key: str, run_command) -> None:
    refused = run_command("schema", key)
    assert refused.returncode == 2 and f"KIND = '{key}'" in refused.stderr and refused.stderr.count("\n") == 1


def test_a_chart_without_what_reports_need_is_refused_by_the_package(tmp_path: Path, monkeypatch, run_command) -> None:
    find = util.find_spec
    monkeypatch.setattr("pmr.errors.environment.util.find_spec", lambda name: None if name == "jinja2" else find(name))
    done = run_command("chart", "crane", "--out", str(tmp_path / "out"))
    assert done.returncode == 2 and "installation: jinja2: not found; it writes reports" in done.stderr, done.stderr
    assert not (tmp_path / "out").exists()
