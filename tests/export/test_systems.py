"""A whole boom at given extensions: state space, frequency response and Nastran's matrices, against its equations.
A section's model is no model of a boom: refused wherever a whole body is asked for, written alone if named.
"""

import runpy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import scipy.io
import turning_cylinder
from numpy.typing import NDArray
from oracle import project, rich_body
from state_spaces import frequency_response

import pmr
from pmr import InputError, ReducedModel, SimulationError, System
from pmr.export.control import write_modelica, write_python_control
from pmr.export.formats import BODY_FORMATS, FORMATS, Options
from pmr.export.state_space import path_positions, state_space
from pmr.scene import Scene
from pmr.scene.signals import Constant
from pmr.system.assembly import Assembly
from pmr.system.contacts import Contact, Place

BOTH_WAYS = [f"section.joint.{end}.0.unilateral=false" for end in ("tail", "mouth")]
SHORT = ["compare.against=[]", "time.end=0.05", "section.mesh.elements=8"]
#: Extensions in m of the middle section and the fly.
S = {"middle": np.array([1.0, 2.5]), "fly": np.array([3.0, 1.5])}
AT = "middle=1,fly=3; middle=2.5,fly=1.5"


@pytest.fixture(scope="module")
def system() -> System:
    """Three sections on pads that hold both ways, two rigid cylinders among the contacts."""
    return pmr.reduce(pmr.load_scene("boom_three", [*SHORT, *BOTH_WAYS])).system


@pytest.fixture
def saved(system: System, tmp_path: Path) -> Path:
    return system.save(tmp_path / "system.npz")


def response(system: System, s: dict[str, float], w: float) -> NDArray[np.complex128]:
    """Outputs and forces (q, i) from the equations with the forces of all contacts, rigid or not."""
    assembly = Assembly(system)
    rows, B = assembly.contact_rows(system.side_coordinates(s)), assembly.B.toarray()
    M, D, K = (A.toarray() for A in (assembly.M, assembly.D, assembly.K))
    A = np.block([[K + 1j * w * D - w**2 * M, rows.C.T], [rows.C, -rows.F]])
    x = np.linalg.solve(A, np.vstack([B, -rows.H]))
    q, forces = x[: len(K)], x[len(K) :]
    return np.vstack([assembly.outputs @ q + assembly.direct - rows.X @ forces, forces])


def assert_same(found: NDArray[np.complex128], expected: NDArray[np.complex128], contacts: int) -> None:
    """To each load within 1e-8 of the largest of its kind; where all are zero, of a nanometre and of the load."""
    for kind, least in ((slice(0, -contacts), 1e-9), (slice(-contacts, None), 1.0)):
        sizes = np.maximum(np.abs(expected[kind]).max(axis=0), least)
        np.testing.assert_allclose(found[kind] / sizes, expected[kind] / sizes, rtol=0.0, atol=1e-8)


def at(k: int) -> dict[str, float]:
    return {path: float(values[k]) for path, values in S.items()}


@pytest.mark.slow
def test_the_response_is_that_of_the_equations(system: System) -> None:
    """Of every output and every contact's force, those of the rigid cylinders too."""
    omega, space = np.array([0.0, 3.0, 40.0, 700.0]), state_space(system, S, "system.npz")
    assert space.inputs == system.input_names and space.outputs[-1] == "force of cylinder of fly"
    assert space.A.shape[1] == 2 * (Assembly(system).size - 2)  # which two cylinders hold
    found = frequency_response(space, omega)
    for k in range(2):
        for j, w in enumerate(omega):
            assert_same(found[k, j], response(system, at(k), w), len(system.contacts))


@pytest.mark.slow
def test_natural_frequencies_are_those_of_the_system(system: System) -> None:
    space = state_space(system, S, "system.npz")
    expected = Assembly(system).frequencies(system.side_coordinates(S), 5)
    np.testing.assert_allclose(space.natural[:, :5] / (2.0 * np.pi), expected, rtol=1e-7)


@pytest.mark.slow
def test_files_say_the_same(saved: Path, system: System, run_command) -> None:
    """Places on each path by its name; the table of a response, and stiffnesses of Nastran at each place."""
    space = state_space(system, S, "system.npz")
    for to in ("python-control", "frequency-response", "dmig", "op4"):
        done = run_command("export", str(saved), "--to", to, "--at", AT)
        assert done.returncode == 0, done.stderr
    data = scipy.io.loadmat(saved.with_name("state_space.mat"))
    for name in "ABCD":
        np.testing.assert_array_equal(np.moveaxis(data[name], 2, 0), getattr(space, name))
    np.testing.assert_array_equal(data["s"], np.column_stack(list(S.values())))
    assert [str(cell[0]) for cell in data["paths"].ravel()] == list(S)
    script = runpy.run_path(str(saved.with_name("state_space.py")))
    assert_same(script["nearest"]([2.4, 1.6])(40.0j), response(system, at(1), 40.0), len(system.contacts))
    head, *rows = saved.with_name("frequency_response.csv").read_text().splitlines()
    assert head.startswith('"middle in m","fly in m",f in Hz') and rows[0].startswith("1,3,") and len(rows) == 800
    deck = saved.with_name("sliding_body.bdf").read_text()
    assert "$ Place 2: middle = 2.5 m, fly = 1.5 m" in deck and "DMIG    K2" in deck
    assert "K2" in saved.with_name("sliding_body.op4").read_text()


@pytest.mark.parametrize("asked", ["1,2", "middle=1", "middle=1,fly=x", "middle=1,fly=99", "middle=1;fly=2", "a=1,b=2"])
def test_places_off_the_paths_are_refused(system: System, asked: str) -> None:
    with pytest.raises(InputError, match="--at = .*: each path by its name.*'middle="):
        path_positions(system, asked)


def test_an_end_of_a_path_is_allowed_as_it_is_printed() -> None:
    ranges = {"middle": (1.3, 5.699999999999999), "fly": (1.4000000000000004, 5.7)}
    system = cast(System, SimpleNamespace(ranges=ranges))
    places = path_positions(system, "middle=1.3,fly=1.4; middle=5.7,fly=5.7")
    assert {path: tuple(at.tolist()) for path, at in places.items()} == ranges
    with pytest.raises(InputError, match="fly from 1.4 to 5.7 m"):
        path_positions(system, "middle=1.3,fly=1.3999")


def test_without_places_all_sections_come_out_together(system: System) -> None:
    """As far as in the scene that the system was made from, where they stay; else as far as rows are defined."""
    assert {path: s.tolist() for path, s in path_positions(system, None).items()} == {"middle": [0.6], "fly": [0.6]}
    found = path_positions(replace(system, provenance={}), None)
    for path, (low, high) in system.ranges.items():
        np.testing.assert_allclose(found[path], np.linspace(low, high, 21))


def test_a_section_of_a_system_is_written_alone_where_it_is_named(saved: Path, run_command) -> None:
    done = run_command("export", str(saved), "--to", "matlab", "--section", "middle")
    assert done.returncode == 0 and "section middle alone, without its joints" in done.stdout
    inputs = [str(cell[0]) for cell in scipy.io.loadmat(saved.with_name("state_space.mat"))["inputs"].ravel()]
    assert inputs and all(name.startswith("middle.") for name in inputs)
    done = run_command("export", str(saved), "--to", "matlab", "--section", "jib")
    assert done.returncode == 2 and "--section = 'jib': 'base', 'middle', 'fly' is allowed" in done.stderr


@pytest.mark.parametrize("to", BODY_FORMATS)
def test_a_flexible_body_is_none_of_several_sections(to: str, tmp_path: Path, run_command) -> None:
    """In one line that says why, and what takes them."""
    target = tmp_path / "body"
    done = run_command("flexible", "boom_three", "--at", "2", "--to", to, "--out", str(target))
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and not target.exists()
    assert "sections = ['base', 'middle', 'fly']: one body is allowed: such a file holds nodes" in done.stderr


def test_a_luffing_angle_is_in_rad(tmp_path: Path, run_command, capsys: pytest.CaptureFixture[str]) -> None:
    scene = turning_cylinder.boom({"kind": "smooth_ramp", "times": [0.0, 0.02], "values": [10.0, 60.0]}, "beam2d", 1e8)
    system = pmr.reduce(scene).system
    npz, target = system.save(tmp_path / "boom.npz"), tmp_path / "response.csv"
    options = ("--to", "frequency-response", "--out", str(target), "--at")
    assert run_command("export", str(npz), *options, "s1=4,luffing=0.2; s1=4,luffing=0.9").returncode == 0
    header, first, *_ = target.read_text().splitlines()
    assert header.startswith('"s1 in m","luffing in rad",f in Hz') and first.startswith("4,0.2,")
    refused = run_command("export", str(npz), *options, "s1=4,luffing=30")
    assert refused.returncode == 2 and "luffing from -3.14159 to 3.14159 rad" in refused.stderr
    space = state_space(system, {"s1": 4.0, "luffing": 0.2}, "boom")
    assert space.place(0) == "s1 = 4.0 m, luffing = 0.2 rad"
    options = Options(at="s1=4,luffing=0.2; s1=4,luffing=0.9")
    text = write_modelica(npz, tmp_path / "Boom.mo", options).read_text()
    assert '"s1 in m, luffing in rad";' in text and "s[2, 2] = {" in text
    script = write_python_control(npz, tmp_path / "boom_space.py", options)
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out.startswith("s1 = 4 m, luffing = 0.2 rad: ")


@pytest.mark.slow
def test_pads_that_only_push_leave_no_state_space(tmp_path: Path, run_command) -> None:
    pushing = pmr.reduce(pmr.load_scene("boom_two", SHORT)).system.save(tmp_path / "system.npz")
    for to in (name for name, one in FORMATS.items() if "at" in one.options):
        done = run_command("export", str(pushing), "--to", to)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
        assert "system.npz: rows: rows that hold both ways are allowed: fly tail bottom" in done.stderr


def test_a_rigid_slider_is_held_at_one_place_and_refused_at_several() -> None:
    """The modes with the slider there, and its force by the accelerations that vanish at it."""
    rich = rich_body()
    system = System.of(project(rich, np.eye(rich.size)[:, 2:]))
    for w in (0.0, 40.0):
        found = frequency_response(state_space(system, {"slider": 1.7}, "model"), np.array([w]))[0, 0]
        assert_same(found, response(system, {"slider": 1.7}, w), len(system.contacts))
    with pytest.raises(InputError, match="slider.* are rigid: one place"):
        state_space(system, {"slider": np.array([1.7, 2.0])}, "model")


def test_two_pads_in_one_place_are_refused_with_the_place(system: System) -> None:
    """Rigid ones, whose flexibility is that of the sections alone."""
    two = [
        Contact(f"pad {k}", Place("middle", one.inner.row, 2.0), Place("base", one.inner.row, 2.0), compliance=0.0)
        for k, one in enumerate(system.contacts[:1] * 2)
    ]
    doubled = replace(system, contacts=(*system.contacts, *two))
    with pytest.raises(SimulationError, match="middle at 1 m, fly at 3 m: the forces of .*pad 1 are not determined"):
        state_space(doubled, at(0), "system.npz")


STATE_SPACES = [name for name, one in FORMATS.items() if "section" in one.options]


@pytest.fixture(scope="module")
def boom() -> Scene:
    found = pmr.load_scene("boom_two", SHORT)
    return found


@pytest.fixture(scope="module")
def models(boom: Scene) -> dict[str, ReducedModel]:
    return dict(pmr.reduce(boom).reduced)


@pytest.fixture
def fly(models: dict[str, ReducedModel], tmp_path: Path) -> Path:
    return models["fly"].save(tmp_path / "reduced-fly.npz")


@pytest.mark.parametrize("to", FORMATS)
def test_no_format_takes_it_for_a_boom(to: str, fly: Path, run_command) -> None:
    done = run_command("export", str(fly), "--to", to)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "reduced-fly.npz: section = 'fly'" in done.stderr
    assert [file.name for file in fly.parent.iterdir()] == [fly.name]


@pytest.mark.slow
@pytest.mark.parametrize("to", FORMATS)
def test_it_is_written_alone_where_it_is_named(to: str, fly: Path, run_command) -> None:
    """Only where it is named by its own name, and only as what needs no path: a state space of the free section."""
    named = ("export", str(fly), "--to", to, "--section")
    wrong, done = (run_command(*named, name) for name in ("base", "fly"))
    assert wrong.returncode == 2
    if to not in STATE_SPACES:
        assert done.returncode == 2 and "it is allowed with --to matlab, " in done.stderr
        return
    assert "--section = 'base': 'fly' is allowed" in wrong.stderr
    assert done.returncode == 0 and "section fly alone, without its joints" in done.stdout


def test_what_is_written_is_the_free_section(fly: Path, run_command) -> None:
    """Its own modes, three of them rigid, and the answer O (K - w^2 M + i w D)^-1 B + W to forces."""
    assert run_command("export", str(fly), "--to", "matlab", "--section", "fly").returncode == 0
    data, model = scipy.io.loadmat(fly.with_name("state_space.mat")), ReducedModel.load(fly)
    A, B, C, D = (data[name][:, :, 0] for name in "ABCD")
    assert data["s"].shape == (1, 1) and data["inputs"][0, 0].item() == "fly.tip force" and len(C) == len(model.outputs)
    omega2 = np.sort(-np.linalg.eigvals(A[model.size :, : model.size]).real)
    assert np.all(np.abs(omega2[:3]) <= 1e-9 * omega2[-1])  # three rigid motions
    np.testing.assert_allclose(omega2[3:], np.sort(np.diagonal(model.K))[3:], rtol=1e-9)
    w = 0.5 * np.sqrt(omega2[3])
    assert model.flexibility is not None
    direct = np.linalg.solve(model.K - w**2 * model.M + 1j * w * model.D, model.B)
    expected = model.outputs @ direct + model.flexibility.direct
    found = C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) + D
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_it_is_not_simulated_as_a_whole_body(models: dict[str, ReducedModel]) -> None:
    for use in (
        lambda: pmr.Stepper(models["fly"], 1e-3, 1.0),
        lambda: pmr.simulate(pmr.load_scene("boom_beam"), models["fly"]),
    ):
        with pytest.raises(InputError, match="section = 'fly': the model of a whole body is allowed"):
            use()
    exudyn = pytest.importorskip("exudyn")
    from pmr.simulation.exudyn import add_sliding_body

    loads = {name: Constant(amount=0.0) for name in models["fly"].input_names}
    with pytest.raises(InputError, match="section = 'fly'"):
        add_sliding_body(exudyn.SystemContainer().AddSystem(), models["fly"], Constant(amount=1.0), loads)


def test_a_whole_body_is_no_section(tmp_path: Path, run_command) -> None:
    scene = pmr.load_scene("evolved_residual", ["mesh.elements=6"])
    model = pmr.reduce(scene).reduced.save(tmp_path / "reduced.npz")
    done = run_command("export", str(model), "--to", "matlab", "--section", "fly")
    assert done.returncode == 2 and "--section = 'fly': none is allowed" in done.stderr
    with pytest.raises(InputError, match="pmr.simulate: models = 'ReducedModel': a model for each section"):
        pmr.simulate(pmr.load_scene("boom_two", SHORT), ReducedModel.load(model))


@pytest.mark.slow
def test_a_boom_is_reduced_and_simulated_in_python(
    models: dict[str, ReducedModel], boom: Scene, tmp_path: Path
) -> None:
    """Saved and read again, too: the same equations in the same order."""
    read = {name: ReducedModel.load(one.save(tmp_path / f"{name}.npz")) for name, one in models.items()}
    found, run = pmr.simulate(boom, read), pmr.run(boom).result.responses["reduced"]
    np.testing.assert_array_equal(found.displacement, run.displacement)
    np.testing.assert_array_equal(found.slider_force, run.slider_force)
    with pytest.raises(InputError, match="models.base = 'section fly': the model of section base is allowed"):
        pmr.simulate(boom, {"base": read["fly"], "fly": read["fly"]})
    with pytest.raises(InputError, match=r"models = \['fly'\]: a model for each section"):
        pmr.simulate(boom, {"fly": read["fly"]})
    with pytest.raises(InputError, match=r"sections.fly.loads = \[\]: the inputs of its model are allowed"):
        pmr.simulate(pmr.load_scene("boom_two", [*SHORT, "sections.fly.loads=[]"]), read)
    with pytest.raises(InputError, match="accuracy: none is allowed for pmr.reduce, which makes only"):
        pmr.reduce(pmr.load_scene("boom_two", [*SHORT, "accuracy.tolerance=0.01"]))
