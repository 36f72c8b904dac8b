"""Booms of several sections from a scene to a report."""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from pmr import InputError, ReducedModel, RunResult, run
from pmr import scene as scenes
from pmr.compare import responses
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.forces import forces_part
from pmr.compare.frequencies import frequency_map
from pmr.export.paraview import MovingFields, write_series
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.pipeline import Outcome
from pmr.pipeline.full_order import FullOrder
from pmr.reduction import bodies
from pmr.reduction.bodies import reduce_bodies
from pmr.report.document import write_report
from pmr.results import load as load_frames
from pmr.results.tables import build_tables
from pmr.scene import Scene
from pmr.simulation import Excitation
from pmr.simulation.native import systems
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of

#: Out by 0.6 m a joint within half a second.
OUT = "{kind='smooth_ramp',times=[0.0,0.5],values=[1.0,1.6]}"
QUICK = (
    "time.end=0.5", "section.mesh.elements=12", f"section.joint.extension={OUT}",
    "section.joint.tail.0.unilateral=false", "section.joint.mouth.0.unilateral=false",
)  # fmt: skip


def load(*changes: str, file: str = "boom_three") -> Scene:
    found = scenes.load_any(file, changes)
    return found


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    probe = "sections.middle.probes=[{name='waist',at=[3.0,0.0,0.0],measures=['displacement']}]"
    published = "published={source='A paper',frequencies=[{reach=9.0,first=2.0},{reach=30.0,first=1.0}]}"
    found = run(load(*QUICK, "sections.fly.loads.0.signal=3000.0", probe, published))
    assert found is not None
    return found


def test_summary_says_what_each_section_and_joint_does(outcome: Outcome) -> None:
    summary = outcome.result.summary
    assert summary["coordinates"] == {"full": 117, "reduced": 19}
    assert max(summary["errors"]["reduced_vs_full"][of] for of in ("tip", "beam", "pad_force")) < 5e-3
    assert [one["name"] for one in summary["sections"]] == ["base", "middle", "fly"]
    assert summary["sections"][2]["coordinates"] == {"full": 39, "reduced": 8}
    assert len(summary["pads"]) == 8 and len(summary["cylinders"]) == 2
    assert [row["reach"] for row in summary["published_frequencies"]] == [9.0]
    assert any(
        "at boom lengths of 30 m are left out: this boom is 8 to 9.2 m long" in said for said in summary["warnings"]
    )
    force = outcome.result.responses["reduced"].force("force of fly mouth top")
    listed = next(pad for pad in summary["pads"] if pad["name"] == "fly mouth top")
    assert listed["min"] == force.min() and listed["max"] == force.max()


def test_outputs_are_of_kinds(outcome: Outcome) -> None:
    reduced = outcome.result.responses["reduced"]
    assert {one.kind for one in reduced.outputs} == {"beam", "tip", "pad", "cylinder", "probe", "reaction"}


@pytest.mark.slow
def test_exudyn_simulates_the_sections_beside_march() -> None:
    """By a cylinder, pads and an acceleration along the boom; to Newton's tolerance."""
    found = run(load(*QUICK, "compare.against=[]", "simulation.simulators=['march','exudyn']", "time.end=0.1"))
    assert found is not None
    summary = found.result.summary
    assert summary["agreement"]["march_vs_exudyn"] < 1e-9 * summary["max_displacement"]
    assert summary["simulators"]["reduced"] == "march" and set(summary["seconds"]["simulate"]) == {"march", "exudyn"}


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("pads", ["both ways", "pushing"])
def test_in_petsc_the_full_model_is_the_same(pads: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion, forces and frequencies of few coordinates, diagonalised and not."""
    quick = [
        "time.end=0.02", "section.mesh.elements=8", "section.joint.extension=1.0", "section.reduction.coordinates=5",
    ]  # fmt: skip
    push = [f"section.joint.{end}.0.unilateral={str(pads == 'pushing').lower()}" for end in ("tail", "mouth")]
    boom, found = load(*quick, *push, "sections.fly.loads.0.signal=3000.0"), []
    for most in (1200, 0):
        monkeypatch.setattr(responses, "SECTIONS_MARCHED_UP_TO", most)
        found.append(run(boom))
    if MPI.COMM_WORLD.rank > 0:
        assert found == [None, None]
        return
    dense, sparse = (outcome.result for outcome in found)
    assert (dense.summary["simulators"]["full"], sparse.summary["simulators"]["full"]) == ("march", "petsc")
    for name in ("displacement", "slider_force"):
        a, b = (getattr(one.responses["full"], name) for one in (dense, sparse))
        assert np.abs(a - b).max() < 1e-6 * np.abs(a).max()
    assert sparse.frequencies.models["full"] == pytest.approx(dense.frequencies.models["full"], rel=1e-6)


@pytest.mark.mpi
@pytest.mark.slow
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="compares two ranks with one")
def test_three_shells_are_the_same_on_all_ranks_as_on_one() -> None:
    """Reduction, full model, frequencies and stresses of workflows/boom_three_shell.toml, to 1e-8.

    On larger cells and shorter paths, with longer pads, which have fewer stations.
    """
    coarse = ["section.mesh={size=0.2,along=0.8}", "time.end=0.008", "recovery.every=0.004"]
    coarse += [f"section.joint.{end}.0.{key}" for end in ("tail", "mouth") for key in ("length=0.9", "at=0.45")]
    coarse.append(f"section.joint.extension={OUT}")
    boom = load(*coarse, file="boom_three_shell")
    first = MPI.COMM_WORLD.rank == 0
    alone, together = run(boom, MPI.COMM_SELF) if first else None, run(boom, MPI.COMM_WORLD)
    assert (alone is None) == (together is None) == (not first)
    if alone is None or together is None:
        return
    one, two = alone.result, together.result
    assert two.summary["simulators"]["full"] == "petsc" and two.summary["coordinates"]["reduced"] == 28
    for model in ("full", "reduced"):
        for name in ("displacement", "slider_force"):
            a, b = (getattr(found.responses[model], name) for found in (one, two))
            assert np.abs(a - b).max() < 1e-8 * np.abs(a).max()
        assert two.frequencies.models[model] == pytest.approx(one.frequencies.models[model], rel=1e-8)
        assert two.summary["max_von_mises"][model] == pytest.approx(one.summary["max_von_mises"][model], rel=1e-8)


def test_tables_hold_forces_frequencies_and_probes_of_all_sections(outcome: Outcome) -> None:
    result, found = outcome.result, build_tables(outcome.result)
    assert set(found) == {"forces", "reactions", "frequencies", "probes"}
    reactions = [row[1] for row in found["reactions"].rows if row[0] == "reduced"]
    assert reactions == ["base: clamp x", "base: clamp z", "base: clamp ry"]
    assert found["frequencies"].columns[0] == "reach [m]"
    assert [row[0] for row in found["frequencies"].rows] == result.frequencies.along.tolist()
    listed = {row[1]: row for row in found["forces"].rows if row[0] == "reduced"}
    assert set(listed) == {one["name"] for kind in ("pads", "cylinders") for one in result.summary[kind]}
    probe = next(row for row in found["probes"].rows if row[:2] == ("reduced", "middle: waist displacement z"))
    response = result.responses["reduced"]
    beside = 1e3 * response.displacement[:, response.output_names.index("middle: z at 3 m")]
    moved = response.other("middle: waist displacement z")
    assert np.abs(moved - beside).max() < 1e-9 * np.abs(beside).max()
    assert (probe[7], probe[10]) == (moved.min(), moved.max()) and probe[2:6] == ("mm", 3.0, 0.0, 0.0)
    assert result.summary["errors"]["reduced_vs_full"]["middle: waist displacement z"] < 5e-3


@pytest.mark.slow
def test_with_a_cache_another_signal_computes_nothing_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal sections are reduced once, too; another length of one section is another one."""
    calls = list[str]()
    for owner, name in ((bodies, "free_modes"), (FullOrder, "frequencies")):
        plain = getattr(owner, name)

        def counted(*arguments: Any, name: str = name, plain: Any = plain, **named: Any) -> Any:
            calls.append(name)
            return plain(*arguments, **named)

        monkeypatch.setattr(owner, name, counted)
    quick = (*QUICK, "time.end=0.02", "section.reduction.estimate=false")
    signals = (f"sections.fly.loads.0.signal={size}" for size in (3000.0, 6000.0))
    first, other = (run(load(*quick, signal), cache=tmp_path) for signal in signals)
    assert calls == 3 * ["free_modes"] + ["frequencies"]
    assert first is not None and other is not None
    for name, model in first.reduced.items():
        assert np.array_equal(model.K, other.reduced[name].K) and np.array_equal(
            model.outputs, other.reduced[name].outputs
        )
    models = (one.result.frequencies.models["full"] for one in (first, other))
    assert np.array_equal(*models)
    run(load(*quick, "sections.fly.masses.0.mass=260.0"), cache=tmp_path)
    assert calls == 3 * ["free_modes"] + ["frequencies", "free_modes", "frequencies"]


def test_pads_that_hold_both_ways_and_pull_are_told_with_what_to_set(outcome: Outcome) -> None:
    said = [line for line in outcome.result.summary["warnings"] if "pull" in line]
    assert len(said) == 1 and "unilateral = true in joint." in said[0]
    worst = min(outcome.result.summary["pads"], key=lambda pad: pad["min"])
    assert said[0].startswith(f"the pad {worst['name']} holds both ways and pulls with up to")


@pytest.mark.slow
def test_a_section_whose_name_begins_as_pads_of_another_one_do_has_pads_of_its_own() -> None:
    found = run(load(*QUICK, "compare.against=[]", "time.end=0.02", "sections.middle.name='fly tail'"))
    assert found is not None
    said = [line.partition(" with up to ")[0] for line in found.result.summary["warnings"] if "pull" in line]
    assert said == ["the pad fly tail mouth top holds both ways and pulls"]


def test_frequencies_are_those_of_the_full_model_from_the_shortest_to_the_longest(outcome: Outcome) -> None:
    found = outcome.result.frequencies
    assert np.all(np.diff(found.along) > 0.0) and found.along[[0, -1]] == pytest.approx([8.0, 9.2])
    assert found.models["reduced"][:, :3] == pytest.approx(found.models["full"][:, :3], rel=1e-3)


def test_the_first_frequency_over_two_joints(outcome: Outcome) -> None:
    """Along the way both move alike; which of the two is out makes a difference."""
    found = outcome.result.frequencies
    over = found.over_joints
    assert over is not None and over.joints == ("middle", "fly")
    assert over.first[[0, -1]] == pytest.approx([1.0, 1.6]) and over.lowest.shape == (9, 9)
    assert over.lowest[[0, -1], [0, -1]] == pytest.approx(found.models["reduced"][[0, -1], 0], rel=1e-9)
    boom = outcome.result.scene
    system = system_of(boom, outcome.reduced)
    at = system.side_coordinates({"middle": 1.6, "fly": 1.0})
    assert over.lowest[-1, 0] == pytest.approx(Assembly(system).frequencies(at, 1)[0], rel=1e-9)
    assert np.abs(over.lowest[-1, 0] / over.lowest[0, -1] - 1.0) > 1e-3
    together = load(*QUICK, "sections.fly.joint.follows=middle")
    assert frequency_map(together, system) is None


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_result_is_read_as_it_was_saved_and_reported(outcome: Outcome, tmp_path: Path) -> None:
    outcome.result.save(tmp_path)
    again = RunResult.load(tmp_path)
    if find_spec("pandas"):
        assert len(load_frames(tmp_path)["reduced"]) == len(again.responses["reduced"].t)
    assert again.scene.hash == outcome.result.scene.hash and again.summary == json.loads(json.dumps(again.summary))
    assert np.array_equal(again.responses["full"].slider_force, outcome.result.responses["full"].slider_force)
    assert np.array_equal(again.frequencies.models["full"], outcome.result.frequencies.models["full"])
    assert again.frequencies.over_joints is not None and again.frequencies.over_joints.joints == ("middle", "fly")
    page = write_report([again], tmp_path).html.read_text(encoding="utf-8")
    terms = ["boom length", "fly mouth top", "cylinder of middle", "holds both ways and pulls"]
    as_of_one_body = ("Total energy", "joint tail", "joint extension", "Loads over time", "waist displacement")
    terms += ["estimated without the full model", "extensions of middle and fly", "A paper"]
    for said in (*terms, *as_of_one_body):
        assert said in page
    outcome.reduced["fly"].save(tmp_path / "reduced-fly.npz")
    assert ReducedModel.load(tmp_path / "reduced-fly.npz").carriers is not None


POINTS = """
title = "Three beams by their stiffnesses on points that hold both ways"
sections = [
    { name = "base", supports = [{ kind = "clamped" }], reduction.coordinates = 2 },
    { name = "one" },
    { name = "two" },
    { name = "tip", loads = [{ signal = 1e3 }] },
]
[section]
body.model = "beam2d"
body.profile = { length = 6.0, bending_stiffness = 2e7, mass_per_length = 60.0 }
mesh.elements = 10
reduction.coordinates = 4
[section.joint]
extension = 2.0
tail = [{ at = 0.15, unilateral = false }]
mouth = [{ at = 0.15, unilateral = false }]
[time]
end = 0.1
step = 1e-3
"""


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_fields_of_every_section_are_what_its_outputs_say_and_stand_where_it_is(tmp_path: Path) -> None:
    """Beams in space: the tip's displacement among the fields, stresses beside the full model's, for ParaView."""
    around = "[{at=0.15,unilateral=false,faces={bottom=[-0.06,0.06],top=[0.0],left=[0.0],right=[0.0]}}]"
    boom = load(
        *QUICK[:3], f"section.joint.tail={around}", f"section.joint.mouth={around}", "section.body.model=beam3d",
        "section.reduction.coordinates=9", "sections.base.reduction.coordinates=4", "recovery.every=0.1",
        "sections.fly.loads.0.signal=3000.0",
    )  # fmt: skip
    outcome = run(boom)
    assert outcome is not None
    result = outcome.result
    response, fields = result.responses["reduced"], result.bodies["fly"].fields
    assert fields is not None
    tip = response.displacement[::100, response.output_names.index("fly: tip z")]
    last = int(np.argmax(fields.points[:, 0]))
    assert fields.displacement[:, last, 2] == pytest.approx(tip, rel=1e-5)
    largest = result.summary["max_von_mises"]
    assert largest["reduced"] == pytest.approx(largest["full"], rel=0.02) and largest["reduced"] > 1e6
    by_section = [one["max_von_mises"]["reduced"] for one in result.summary["sections"]]
    assert max(by_section) == largest["reduced"]
    page = write_report([result], tmp_path).html.read_text(encoding="utf-8")
    assert "Largest von Mises stress of each part" in page and "full model" in page
    along = {name: one[1] for name, one in result.moving_fields.items()}
    assert along["fly"][[0, -1]] == pytest.approx([2.0, 3.2]) and not along["base"].any()
    listing = write_series(tmp_path, "fields", {name: MovingFields(*one) for name, one in result.moving_fields.items()})
    assert listing.read_text().count("DataSet") == 3 * 6
    first = meshio.read(tmp_path / "fields" / "fly-00005.vtu")
    assert first.points[:, 0].max() == pytest.approx(9.2)


@pytest.mark.slow
def test_a_shell_slides_in_beams() -> None:
    """The fly as a shell, whose stresses are computed; its pads on the beam carry its weight, full and reduced."""
    beams = [f"sections.{name}.body.model=beam3d" for name in ("base", "middle")]
    coarse = ["section.mesh={size=0.15,along=0.6,elements=12}", "time.end=0.02", "recovery.every=0.01"]
    coarse.append(f"section.joint.extension={OUT}")
    outcome = run(load(*beams, *coarse, file="boom_three_shell"))
    assert outcome is not None
    summary, weight = outcome.result.summary, 9.80665 * (7850.0 * 6.0 * 2.0 * (0.22 + 0.32) * 6e-3 + 250.0)
    assert [one["coordinates"]["full"] > 1000 for one in summary["sections"]] == [False, False, True]
    assert max(summary["errors"]["reduced_vs_full"].values()) < 1e-3
    assert summary["max_von_mises"]["reduced"] == pytest.approx(summary["max_von_mises"]["full"], rel=1e-3)
    for response in outcome.result.responses.values():
        start = dict(zip(response.force_names, response.slider_force[0], strict=True))
        faces = {"bottom": 1.0, "top": -1.0}
        up = [faces[face] * force for name, force in start.items() for face in faces if "fly" in name and face in name]
        assert sum(up) == pytest.approx(weight, rel=1e-6)


@pytest.mark.slow
def test_equal_sections_are_built_and_reduced_once_and_points_hold_beams(tmp_path: Path) -> None:
    (tmp_path / "points.toml").write_text(POINTS)
    boom = scenes.load_any(tmp_path / "points.toml")
    built = build_bodies(boom)
    reduced = reduce_bodies(boom, built)
    assert built["one"] is built["two"] and built["tip"] is not built["two"]
    assert reduced["one"].model.M is reduced["two"].model.M
    system = system_of(boom, {name: one.model for name, one in reduced.items()})
    assert system.contact_names == tuple(f"{name} {end}" for name in boom.names[1:] for end in ("tail", "mouth"))
    outcome = run(boom)
    assert outcome is not None and max(outcome.result.summary["errors"]["reduced_vs_full"].values()) < 1e-3


@pytest.mark.slow
def test_a_rigid_cylinder_pushes_with_mass_times_acceleration_weight_along_the_boom_and_friction() -> None:
    """m (a + g sin phi), of sections so stiff that they follow at once; the second cylinder carries the fly alone.

    Friction is that of the pad forces which balance weight and moment of what a joint carries; pads keep theirs.
    """
    slope = 0.3
    boom = load(
        *QUICK,
        "section.joint.extension={kind='smooth_ramp',times=[0.0,4.0],values=[1.0,4.0]}",
        "time.end=2.0",
        "section.body.material.young=2.1e17",
        "section.joint.tail.0.friction=0.1",
        "section.joint.mouth.0.friction=0.1",
        "sections.fly.loads.0.signal=0.0",
        "damping.ratio=0.0",
        f"gravity.direction=[{-np.sin(slope)},0.0,{-np.cos(slope)}]",
    )
    boxes = {part.name: part.body.box for part in boom.sections if part.body.box is not None}
    masses = {name: 7850.0 * 6.0 * 2.0 * box.wall * (box.width + box.height) for name, box in boxes.items()}
    masses["fly"] += 250.0
    system = system_of(boom, {name: one.model for name, one in reduce_bodies(boom, build_bodies(boom)).items()})
    given = Excitation.from_scene(boom)
    found = evaluate_motion(system, systems.simulate(system, given, systems.static_start(system, given)))
    t = given.times
    x = t / 4.0
    a = 3.0 * (60.0 * x - 180.0 * x**2 + 120.0 * x**3) / 4.0**2
    g = 9.80665 * np.sin(slope)
    fly = masses["fly"] * (2.0 * a + g)
    expected = {"fly": fly, "middle": masses["middle"] * (a + g) + fly}
    for name, one in expected.items():  # where the motion begins a step sees half of it
        pushed = found.force(f"force of cylinder of {name}") - found.other(f"friction of {name}")
        assert np.abs(pushed - one)[1:].max() < 1e-6 * np.abs(one).max()
    tail, slides = given.s, given.s[:, -1] > 1.001
    across = 9.80665 * np.cos(slope)
    weight, moment = np.zeros(len(t)), np.zeros(len(t))  # of all that a joint carries, about the base's tail
    for name, out in (("fly", tail.sum(axis=1)), ("middle", tail[:, 0])):
        weight += masses[name] * across
        moment += across * (masses[name] * (out + 3.0) + (250.0 * 3.0 if name == "fly" else 0.0))
        mouth = out - boom.paths[name].value(t) + 5.85
        nearer = 0.1 * boxes[name].height / 2.0  # to the tail, as the friction's moment has it
        on_mouth = (moment - weight * (out + 0.15 - nearer)) / (mouth - out - 0.15)
        resisting = 0.1 * (on_mouth + np.abs(weight - on_mouth))
        added = found.other(f"friction of {name}")
        assert np.abs(added - resisting)[slides].max() < 1e-3 * np.abs(resisting).max()
    listed = {one["name"]: one for one in forces_part(boom, system, found).figures["cylinders"]}
    assert listed["cylinder of fly"]["max"] == found.force("force of cylinder of fly").max()
    assert listed["cylinder of middle"]["friction"] == pytest.approx(np.abs(resisting).max(), rel=1e-3)


@pytest.mark.slow
def test_three_sections_as_they_come() -> None:
    outcome = run(load())
    assert outcome is not None
    summary = outcome.result.summary
    assert summary["coordinates"]["reduced"] == 19 and summary["warnings"] == []
    true, estimate = summary["errors"]["reduced_vs_full"], summary["estimate"]
    assert max(true.values()) < 2e-4
    known = {kind: error for kind, error in true.items() if not kind.startswith("reaction")}
    assert all(error < estimate[kind] < 2.0 * error for kind, error in known.items())  # though pads land and lift off
    assert min(pad["min"] for pad in summary["pads"]) >= 0.0


@pytest.mark.slow
def test_four_sections_that_extend_one_after_the_other() -> None:
    outcome = run(load("section.reduction.estimate=false", file="boom_four"))
    assert outcome is not None
    errors = outcome.result.summary["errors"]["reduced_vs_full"]
    assert outcome.result.summary["coordinates"]["reduced"] == 24
    assert errors["tip"] < 2e-4 and errors["beam"] < 2e-4 and errors["pad_force"] < 1e-2


@pytest.mark.slow
def test_the_published_boom_lift_on_two_rigid_pads_an_overlap() -> None:
    """Overlaps of 5 to 35 % of the last section: figures of a planar prototype, to 0.1 %."""
    outcome = run(load("time.end=7.0", "time.step=1e-2", file="boom_lift"))
    assert outcome is not None
    first = {name: values[::-2, 0] for name, values in outcome.result.frequencies.models.items()}
    expected = [0.8888, 0.9407, 0.9978, 1.0609, 1.1306, 1.2082, 1.2948]
    assert first["full"] == pytest.approx(expected, rel=1e-3) and first["reduced"] == pytest.approx(expected, rel=1e-3)
    overlap = 4.785 - outcome.result.frequencies.paths[::-2, 1]
    assert overlap == pytest.approx(4.478 * np.arange(0.05, 0.36, 0.05), abs=0.02)


@pytest.mark.slow
def test_the_published_boom_lift_with_rigid_overlaps() -> None:
    """Seven published frequencies to 2 %: nothing bends within an overlap, in full order and reduced."""
    outcome = run(load("time.end=7.0", "time.step=2e-2", file="boom_lift_rigid"))
    assert outcome is not None
    rows = outcome.result.summary["published_frequencies"]
    assert len(rows) == 7
    for row in rows:
        assert row["full"] == pytest.approx(row["published"], rel=0.02)
        assert row["reduced"] == pytest.approx(row["full"], rel=1e-4)
    assert [one["name"] for one in outcome.result.summary["pads"]] == ["mid tail", "mid mouth", "fly tail", "fly mouth"]


def test_a_boom_that_does_not_fit_into_memory_is_refused_before_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of several bodies all states are kept: with many steps that is said before anything is simulated."""
    boom = scenes.load_any("boom_two", ["time.step=1e-5", "section.mesh.elements=6"])
    few = boom.model_copy(update={"time": boom.time.model_copy(update={"step": 1e-3})})
    assert responses.needed_bytes(boom, 100, 30) / responses.needed_bytes(few, 100, 30) == pytest.approx(
        100.0, rel=0.01
    )
    monkeypatch.setattr("pmr.errors.environment.available_memory", lambda: 10**8)
    with pytest.raises(InputError, match="steps take about .* are free; at most"):
        run(boom)
