"""A structural model is a module and an entry of the table of traits: every check and every word follows from these."""

import sys
from dataclasses import replace
from importlib import import_module

import pytest

from pmr import scene as scenes
from pmr.errors import InputError, environment
from pmr.fullmodel.from_scene import structure_of
from pmr.models import beam3d
from pmr.report.subject import structural_model_words
from pmr.scene.members import member_at
from pmr.scene.model_ladder import model_comparison
from pmr.scene.model_traits import MODELS

BOOM = "boom_beam"
COARSE = ("mesh.elements=8", "mesh.size=0.2", "mesh.along=0.5")


@pytest.fixture
def second_beam(monkeypatch: pytest.MonkeyPatch) -> str:
    """The beam in space under another name, which no module but the table of traits contains."""
    name = "second_beam"
    monkeypatch.setitem(MODELS, name, replace(MODELS["beam3d"], words="a second beam"))
    monkeypatch.setitem(sys.modules, f"pmr.models.{name}", beam3d)
    monkeypatch.setattr(environment, "plugin_names", lambda group: {name} if group == "pmr.models" else set())
    return name


@pytest.mark.parametrize("name", MODELS)
def test_every_model_has_a_module_that_makes_it(name: str) -> None:
    module = import_module(f"pmr.models.{name}")
    assert callable(module.of if MODELS[name].has_cells else module.from_member)
    assert hasattr(module, "KINDS") == MODELS[name].has_cells


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("mesh.size=0.05", "mesh.size.*it has no effect on second_beam"),
        ("body.regions={flange={thickness=0.01}}", "only shells and solids have regions"),
        ("mesh.elements=20000", "at most 5000 are allowed for second_beam"),
        ("probes=[{name='p',at=[1.0,0.0,0.0],face='nowhere',measures=['stress']}]", "bottom right, bottom left"),
        ("mesh.grading=2.0", "1 is allowed"),
        ("pads=[]", "walls give way only under pads with faces"),
    ],
)
def test_checks_of_beams_hold_for_a_new_one(second_beam: str, change: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        scenes.load(BOOM, [f"body.model={second_beam}", *["body.walls=give"] * (change == "pads=[]"), change])


def test_walls_give_way_under_the_pads_of_a_new_beam(second_beam: str) -> None:
    def compliances(model: str) -> list[float]:
        scene = scenes.load(BOOM, [f"body.model={model}", "body.walls=give", *COARSE])
        pads = structure_of(member_at(scene)).pads
        return [pads.wall_compliance(pad.name, 2.0) for pad in (*pads.fixed, *pads.moving)]

    assert compliances(second_beam) == pytest.approx(compliances("beam3d"), rel=1e-12)
    assert min(compliances(second_beam)) > 0.0


def test_walls_that_a_new_beam_cannot_compute_are_refused(second_beam: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(MODELS, second_beam, replace(MODELS[second_beam], walls_may_give=False))
    with pytest.raises(InputError, match="'rigid' is allowed"):
        scenes.load(BOOM, [f"body.model={second_beam}", "body.walls=give"])


def test_a_new_beam_is_compared_with_a_shell_and_named_in_reports(second_beam: str) -> None:
    richer = model_comparison(scenes.load(BOOM, [f"body.model={second_beam}", "compare.richer=next"]))
    assert richer.name == "shell" and richer.scene.body.model == second_beam
    assert structural_model_words(second_beam, "give") == "a second beam whose walls give under pads"


@pytest.mark.parametrize("change", ["body.walls=give", "mesh.elements=9"])
def test_keys_without_effect_on_a_model_of_another_package_are_refused(
    change: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "plugin_names", lambda group: {"thick"} if group == "pmr.models" else set())
    with pytest.raises(InputError, match="it has no effect on thick"):
        scenes.load("boom_shell", ["body.model=thick", change])
