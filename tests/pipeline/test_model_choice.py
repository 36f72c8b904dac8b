"""Models that measurements choose: the smallest one that is near enough to a shell of the same body."""

from pathlib import Path

import pytest

import pmr
from pmr import InputError
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fullmodel.build import build_bodies
from pmr.pipeline.model_errors import decide_models
from pmr.scene import Scene
from pmr.scene.choice import model_of
from pmr.scene.members import members

pytest.importorskip("gmsh")
pytestmark = pytest.mark.slow  # each has a shell reduced
SHORT = (
    "compare.against=[]", "simulation.repeats=1", "damping.ratio=0.02", "time.end=1.0", "time.step=2e-3",
    "loads.0.signal={kind='sine',amplitude=2000.0,frequency=2.0}",
    "loads.gust.signal={kind='smooth_ramp',times=[0.0,0.3,0.6],values=[0.0,1000.0,0.0]}",
)  # fmt: skip
PATH = "slider.path={{kind='smooth_ramp',times=[0.0,0.5,1.0],values=[{0},{1},{0}]}}"
FACES = "faces={bottom=[-0.06,0.06],top=[-0.06,0.06],left=[0.0],right=[0.0]}"
#: Walls that are thick beside the section, on soft pads; the reference boom; a wide box, short and of sheet metal.
THICK = (
    PATH.format(1.5, 2.0), "body.box={length=6.0,width=0.2,height=0.2,wall=0.06}", "mesh.along=0.4",
    *(f"pads.{ring}.{one}" for ring in ("tail", "mouth") for one in (FACES, "stiffness=2e6")),
)  # fmt: skip
THIN = (PATH.format(1.5, 2.0), "mesh.size=0.15", "mesh.along=0.3")
WIDE = (
    PATH.format(0.6, 1.2), "body.box={length=2.0,width=0.6,height=0.8,wall=0.003}", "mesh.size=0.2", "mesh.along=0.2",
    "observe.start=0.1", "observe.end=1.9",
)  # fmt: skip


def box(*changes: str) -> Scene:
    return pmr.load_scene("boom", [*SHORT, *changes])


def never(*arguments, **options):
    raise AssertionError("what was measured is made again")


@pytest.mark.parametrize(
    ("changes", "model", "walls", "tried"),
    [(THICK, "beam3d", "rigid", 1), (THIN, "beam3d", "give", 2), (WIDE, "shell", "rigid", 2)],
    ids=["thick walls", "thin walls", "wide and short"],
)
def test_the_smallest_model_within_the_tolerance_is_chosen(
    changes, model, walls, tried, tmp_path: Path, monkeypatch
) -> None:
    """A beam where walls are thick, one whose walls give way where they are thin, a shell where that does not do."""
    scene, comm = box(*changes), MPI.COMM_WORLD
    assert scene.compare.model_tolerance == 0.05
    found = decide_models(scene, comm, Clock(), tmp_path)
    said = found.chosen_model
    assert (said["name"], said["walls"], len(said["tried"])) == (model, walls, tried)
    within = [one["error"] <= 0.05 for one in said["tried"]]
    assert not any(within[:-1]) and within[-1] == (model != "shell")
    (one,) = members(found.scene)
    assert (model_of(one), one.part.body.walls, one.part.body.model) == (model, walls, model)
    assert (found.budget_part is None) == (model == "shell")

    monkeypatch.setattr("pmr.pipeline.model_errors.reduce_bodies", never)
    again = decide_models(scene, comm, Clock(), tmp_path)
    assert again == found


def test_a_run_says_what_was_measured_and_its_model_takes_the_scene() -> None:
    scene = box(*THIN)
    result = pmr.run(scene).result
    said, part = result.summary["chosen_model"], result.summary["budget"]["model"]
    assert (said["name"], said["walls"]) == ("beam3d", "give") == (result.scene.body.model, result.scene.body.walls)
    rigid, gives = (one["error"] for one in said["tried"])
    assert gives <= said["tolerance"] < rigid
    assert part["beside"] == "shell" and gives == max(
        part[kind] for kind in ("beam", "tip", "pad_force", "largest", "frequency")
    )
    reduction = pmr.reduce(scene)
    assert reduction.scene.body.walls == "give"
    response = pmr.simulate(scene, reduction.reduced)  # a scene that names no model takes that which was made of it
    assert response.displacement == pytest.approx(result.responses["reduced"].displacement, rel=1e-6, abs=1e-9)
    with pytest.raises(InputError, match=r"body\.model = 'auto': a model by its name is allowed here"):
        build_bodies(scene)


PLANAR = tuple(f"pads.{ring}.faces={{bottom=[-0.1,0.1],top=[-0.1,0.1],left=[],right=[]}}" for ring in ("tail", "mouth"))


def test_without_a_shell_the_smallest_model_is_taken_and_why_is_said() -> None:
    """As of a boom that a plane alone holds, which would fall over in space."""
    scene = box(*THIN, *PLANAR, "loads.gust.direction=z")
    found = decide_models(scene, MPI.COMM_WORLD, Clock(), None)
    assert (
        found.chosen_model["name"] == "beam2d"
        and found.chosen_model["walls"] == "rigid"
        and "free" in found.chosen_model["reason"]
    )
    assert found.budget_part == {"beside": None, "reason": found.chosen_model["reason"]}


def test_where_nothing_is_lateral_a_planar_beam_does() -> None:
    """Its frequencies are compared with those of vertical modes."""
    scene = box(*THICK, "loads.gust.direction=z")
    found = decide_models(scene, MPI.COMM_WORLD, Clock(), None)
    assert found.chosen_model["name"] == "beam2d" and found.budget_part["frequency"] < 0.05
