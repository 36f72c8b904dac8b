"""Beside which model a scene's own one is put, and why beside none."""

import pytest

from pmr import InputError
from pmr.scene import load_any
from pmr.scene.choice import is_undecided, model_of
from pmr.scene.members import members
from pmr.scene.model_ladder import COORDINATES, PLACES, candidate_scenes, model_comparison


def scene(name: str, *changes: str):
    return load_any(name, list(changes))


def models(one) -> set[str]:
    return {model_of(member) for member in members(one)}


@pytest.mark.parametrize(
    ("name", "asked", "own", "richer"),
    [
        ("boom_beam", "next", "beam3d", "shell"),
        ("boom_beam", "shell", "beam3d", "shell"),
        ("boom_beam_walls", "next", "beam3d", "shell"),
        ("boom_three", "next", "beam2d", "beam3d"),
        ("boom_three", "shell", "beam2d", "shell"),
    ],
)
def test_the_next_richer_model_or_that_asked_for(name: str, asked: str, own: str, richer: str) -> None:
    one, other, called = model_comparison(scene(name, f"compare.richer={asked}"))
    assert (models(one), models(other), called) == ({own}, {richer}, richer)
    for part, better in zip(one.sections, other.sections, strict=True):
        assert part.reduction == better.reduction and part.reduction.coordinates == COORDINATES
        assert part.observe == better.observe and len(part.observe.stations) == PLACES
        assert (part.pads, part.masses, part.loads, part.supports) == (
            better.pads, better.masses, better.loads, better.supports
        )  # fmt: skip
    assert {part.body.walls for part in other.sections} == {"rigid"}


@pytest.mark.parametrize(
    ("name", "asked", "why"),
    [
        ("boom_shell", "next", "richest"),
        ("boom_solid", "shell", "richest"),
        ("boom_beam", "beam3d", "is as rich as that"),
        ("paper_evolved", "next", r"\[body.box\] is needed"),
        ("boom_beam", "none", "compare.richer = 'none' leaves it out"),
    ],
)
def test_why_there_is_no_richer_one_is_said(name: str, asked: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        model_comparison(scene(name, f"compare.richer={asked}"))


@pytest.mark.parametrize("asked", ["auto", "shell"])
def test_stiffnesses_of_a_section_are_not_judged_by_a_shell_of_the_box(asked: str) -> None:
    """A box reinforced inside has its stiffnesses by body.section: a shell of its walls alone is another body."""
    moments = "second_moment_y=3e-4, second_moment_z=2e-4, torsion_constant=3e-4"
    section = f"body.section={{area=0.02, {moments}, shear_area_y=0.01, shear_area_z=0.01}}"
    with pytest.raises(InputError, match="body.section gives stiffnesses that a shell of the box does not have"):
        model_comparison(scene("boom_beam", section, f"compare.richer={asked}"))


def test_cells_of_the_shell_may_be_said_where_a_beam_is_compared_with_one() -> None:
    assert scene("boom_beam", "compare.richer=shell", "mesh.size=0.2").sections[0].mesh.size == 0.2
    with pytest.raises(InputError, match="no effect"):
        scene("boom_beam", "mesh.size=0.2")


def test_displacements_of_probes_are_compared_and_their_stresses_are_not() -> None:
    """A wall that bends by itself moves otherwise than the section of a beam: no error said so."""
    probes = "probes=[{name='a',at=[3.0,0.0,0.2]},{name='b',at=[3.0,0.0,0.2],measures=['stress','displacement']}]"
    compared = model_comparison(load_any("boom_beam", ["compare.richer='shell'", probes]))
    for scene in (compared.scene, compared.richer):
        assert [(probe.name, probe.measures) for probe in scene.only_section.probes] == [("b", ("displacement",))]


def test_the_rotation_of_the_tip_is_observed_in_the_richer_model_too() -> None:
    compared = model_comparison(scene("boom_beam", "observe.rotation=true", "compare.richer=shell"))
    for of in (compared.scene, compared.richer):
        assert of.sections[0].observe.rotation
    plain = model_comparison(scene("boom_beam", "compare.richer=shell"))
    assert not plain.richer.sections[0].observe.rotation


PLANAR = ("loads.gust.direction=z",)
AUTO = ("section.body.model=auto",)


@pytest.mark.parametrize(
    ("name", "changes", "expected"),
    [
        ("boom", (), "beam3d rigid, beam3d give, shell rigid"),
        ("boom", PLANAR, "beam2d rigid, beam3d rigid, beam2d give, beam3d give, shell rigid"),
        ("boom", ("body.walls=give",), "beam3d give, shell rigid"),
        ("boom", ("body.box.frames=[3.0]", "body.box.frame_depth=0.05"), ""),
        ("boom", ("recovery.stress=true",), ""),
        ("boom_beam", (), ""),
        ("paper_evolved", (), ""),
        ("boom_three", AUTO, "beam2d rigid, beam3d rigid, beam2d give, beam3d give, shell rigid"),
        # a gust on the fly alone: no section is planar then
        ("boom_three_shell", (*AUTO, "recovery.stress=false"), "beam3d rigid, beam3d give, shell rigid"),
    ],
)
def test_models_among_which_measurements_decide(name: str, changes: tuple[str, ...], expected: str) -> None:
    """From the smallest that can carry what is asked to a shell; none of a scene whose models are all known."""
    found = candidate_scenes(scene(name, *changes))
    assert all(len({(model_of(one), one.part.body.walls) for one in members(each)}) == 1 for each in found)
    last = [members(each)[-1] for each in found]
    assert ", ".join(f"{model_of(one)} {one.part.body.walls}" for one in last) == expected
    assert not any(is_undecided(one) for each in found for one in members(each))


def test_a_section_whose_model_is_named_keeps_it() -> None:
    found = candidate_scenes(scene("boom_three", "sections.fly.body.model=auto"))
    assert {tuple(model_of(one) for one in members(each))[:2] for each in found} == {("beam2d", "beam2d")}
    assert [model_of(members(each)[-1]) for each in found][-1] == "shell"
