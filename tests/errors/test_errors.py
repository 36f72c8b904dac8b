import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from pmr import InputError, reduce, run
from pmr import scene as scenes
from pmr.errors import GrowthError, NotHeldError, call_on_first_rank
from pmr.errors.environment import Clock
from pmr.fem.compat import MPI
from pmr.fullmodel.from_scene import structure_of
from pmr.scene.members import member_at

WORKFLOWS = Path(__file__).parents[2] / "workflows"
pytestmark = pytest.mark.mpi


def test_an_error_travels_whole() -> None:
    error = InputError("scene.toml", "body.length", -1.0, "more than 0 is allowed")
    again = pickle.loads(pickle.dumps(error))
    assert isinstance(again, InputError) and str(again) == str(error) and vars(again) == vars(error)
    free = NotHeldError("scene", "free_motions", "refused", "it is free", "it can turn")
    for other in (pickle.loads(pickle.dumps(free)), free.with_key("sections[1].joint"), free.with_source("a.toml")):
        assert type(other) is NotHeldError and other.short == "it can turn"
    named = free.with_key("sections[1].joint").with_source("a.toml")
    assert str(named) == "a.toml: sections[1].joint = 'refused': it is free"
    everywhere = MPI.COMM_WORLD.bcast(error)
    assert str(everywhere) == "scene.toml: body.length = -1.0: more than 0 is allowed"


@pytest.mark.parametrize(
    ("rigid_rows", "rho_inf", "key", "value"),
    [
        ((), 0.9, "time.step", 0.01),
        (("slider 0",), 0.9, "time.rho_inf", 0.9),
        (("slider 0",), 0.0, "reduction.flexibility", False),  # nothing below zero
    ],
)
def test_a_motion_that_grows_names_what_a_user_can_change(
    rigid_rows: tuple[str, ...], rho_inf: float, key: str, value: float
) -> None:
    error = GrowthError("the motion grows without bound", rigid_rows)
    with pytest.raises(GrowthError) as caught, Clock().stage("reduced"):
        raise error
    travelled = pickle.loads(pickle.dumps(caught.value))
    found = travelled.refusal(0.01, rho_inf)
    assert (found.source, found.key, found.value) == ("scene", key, value)
    assert "allowed: simulation of the reduced model: the motion grows without bound" in str(found)


@pytest.mark.parametrize(
    ("scene", "change", "said"),
    [
        ("boom_shell", "mesh.size=7.0", "mesh.size = 7.0: more than 0 and up to the length is allowed"),
        ("boom_shell", "mesh.tail_layer=0.5", "mesh.tail_layer = 0.5: 0, or from a ten-thousandth up to all"),
        ("boom_shell", "mesh.size=1e-11", "mesh.size = 1e-11: sizes that make at most 100,000 cells are allowed"),
        ("boom_solid", "mesh.along=1e-9", "mesh.along = 1e-09: sizes that make at most 100,000 cells are allowed"),
        ("boom_solid", "body.box.radius=0.003", "body.box.radius: 0 is allowed, or more than 0.004 m, half the wall"),
        ("boom_solid", "body.box={length=6.0,width=0.3,height=0.4,wall=0.008,frames=[3.0],frame_depth=0.1}",
         "body.box.frames = (3.0,): a solid boom has none"),
        ("boom_shell", "mesh.tail_layer=1e-12", "mesh.tail_layer = 1e-12: 0, or from a ten-thousandth up to all"),
        ("boom_solid", "mesh.tail_layer=1e-12", "mesh.tail_layer = 1e-12: 0, or from a ten-thousandth up to all"),
        ("boom_shell", "body.box={length=6.0,width=0.3,height=0.4,wall=0.008,frames=[1.0,1.000000001],frame_depth=0.1}",
         "body.box.frames = (1.0, 1.000000001): ascending places between tail and tip"),
        ("boom_shell", "body.box={length=6.0,width=0.3,height=0.4,wall=0.008,frames=[1e-12],frame_depth=0.1}",
         "body.box.frames = (1e-12,): ascending places between tail and tip"),
        ("boom_shell", "body.box={length=6.0,width=0.3,height=0.4,wall=0.008,frames=[3.0],frame_depth=1e-12}",
         "body.box.frame_depth = 1e-12: more than a ten-thousandth"),
        ("boom_solid", "body.box={length=6.0,width=0.3,height=0.4,wall=0.008,radius=0.004000000001}",
         "body.box: with mesh.size, sizes that mesh are allowed"),
    ],
)  # fmt: skip
def test_a_bad_mesh_is_one_line_on_every_rank(scene: str, change: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        structure_of(member_at(scenes.load(WORKFLOWS / f"{scene}.toml", [change])))


CYLINDER = "{name='cylinder',directions=['x']}"
TWICE = "supports=[{name='a',directions=['x']},{name='b',directions=['x']}]"
CLAMPED = "{on='tail',kind='clamped',points='all'}"
RIGID = "stiffness='rigid',faces={bottom=[-0.1,0.1],top=[-0.1,0.1],left=[0.0],right=[0.0]}"
ALL_RIGID = f"pads=[{{name='tail',at=0.15,{RIGID}}},{{name='mouth',moving=true,{RIGID}}}]"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ((ALL_RIGID,), "the rigid rows tail top right, tail top left, tail right hold what others hold already"),
        ((f"supports=[{CYLINDER},{CLAMPED}]",), "supports.cylinder.directions = 'x': a support of all points"),
        ((f"supports=[{CYLINDER},{{on='tail',directions=['x'],points='all'}}]",), "supports.cylinder.directions = 'x'"),
        ((TWICE,), "the rigid rows b hold what others hold already"),
        (("supports=[{name='a',on='nose'}]",),
         "supports[0].on = 'nose': tail, tip or a number from 0 to 6 m is allowed"),
        (("masses=[{name='m',on='2.5',mass=1.0}]",), "masses[0].on = '2.5': tail, tip or a number from 0 to 6 m is"),
        (("masses=[{name='m',on=6.5,mass=1.0}]",), "masses[0].on = 6.5: on the body, 0 to 6 m, is allowed"),
        (("masses=[{name='m',on=2.5,mass=1.0,coupling='rigid'}]",),
         "masses[0].coupling = 'rigid': 'average' is allowed"),
        (("body.model='beam2d'", "loads=[{name='F',signal=1.0}]",
         "masses=[{name='m',on='tip',mass=1.0,at=[6.0,0.0,0.4]}]"),
         "masses[0].at = [6.0, 0.0, 0.4]: none is allowed on a planar beam, whose masses are at `on`, on its axis"),
        (("supports=[{on='nose',points='all'}]",), "place = 'nose': tail or tip is allowed"),
    ],
)  # fmt: skip
def test_supports_that_can_not_be_are_one_line(changes: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        reduce(scenes.load(WORKFLOWS / "boom_beam.toml", changes))


@pytest.mark.slow
@pytest.mark.parametrize("past", [5.000000000000001, 5.000000000001])
def test_a_path_may_pass_the_end_by_round_off(past: float) -> None:
    """By an ulp, or 1e-12 m: the slider is then at the end, whoever simulates."""
    changes = ["time.end=0.2", "time.step=0.02", "compare.against=[]", "simulation.repeats=1", "mesh.elements=10"]
    changes += ["reduction.coordinates=10", "simulation.simulators=['march','exudyn','exudyn-multiplier']"]
    path = "slider.path={{kind='ramp',times=[0.0,0.1],values=[4.0,{}]}}"
    tips = []
    for end in (5.0, past):
        outcome = run(scenes.load(WORKFLOWS / "paper_simple.toml", [*changes, path.format(end)]))
        if outcome is not None:
            tips.append(outcome.result.responses["reduced"].tip)
            assert max(outcome.result.summary["agreement"].values()) < 1e-9
    if tips:
        assert np.abs(tips[1] - tips[0]).max() <= 1e-9 * np.abs(tips[0]).max()


@pytest.mark.parametrize("content", ["", "no mesh at all", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"])
def test_a_bad_mesh_file_is_one_line_on_every_rank(tmp_path: Path, content: str) -> None:
    file = Path(MPI.COMM_WORLD.bcast(str(tmp_path))) / "bad.msh"
    file.write_text(content)
    text = (WORKFLOWS / "boom.toml").read_text()
    start, end = text.index("[body]"), text.index("# Twelve pads")
    (tmp_path / "own.toml").write_text(text[:start] + "[body]\nmodel = 'shell'\nthickness = 0.008\n" + text[end:])
    with pytest.raises(InputError, match="bad.msh"):
        structure_of(member_at(scenes.load(tmp_path / "own.toml", [f"mesh.file={file}"])))


@pytest.mark.parametrize("error", [InputError("scene", "time.step", 0.1, "less"), GrowthError("it grows", ("pin",))])
def test_what_rank_0_refuses_is_refused_on_all(error: Exception) -> None:
    def fail() -> None:
        raise error

    with pytest.raises(type(error)) as caught:
        call_on_first_rank(MPI.COMM_WORLD, fail)
    assert str(caught.value) == str(error)
    assert getattr(caught.value, "rigid_rows", ("pin",)) == ("pin",)
    assert call_on_first_rank(MPI.COMM_WORLD, lambda: 1) == (1 if MPI.COMM_WORLD.rank == 0 else None)
