"""Stress in the walls of a box under a pad: similar boxes, shorter cells, and what limits of a chart take from it."""

import numpy as np
import pytest

import pmr
from pmr.errors import InputError
from pmr.fullmodel import wall_stress
from pmr.fullmodel.pads import Pad
from pmr.fullmodel.wall_stress import joint_pads, pad_stress, stress_growth, yield_forces
from pmr.scene import Scene
from pmr.scene.joints import BoomSection

pytest.importorskip("gmsh")


def section(by: float = 1.0, **keys: object) -> BoomSection:
    """A square box of 1.2 m, all of whose lengths are `by` times as large; further `keys` of the box."""
    sizes = {key: by * size for key, size in {"length": 1.2, "width": 0.2, "height": 0.2, "wall": 0.006}.items()}
    scene = pmr.load_scene("boom_three")
    part = scene.sections[1]
    box = part.body.box
    assert box is not None
    return part.with_keys(body={"box": type(box).model_validate(sizes | keys)})


def pad(by: float = 1.0, at: float = 0.6) -> Pad:
    return Pad("pad", "bottom", by * at, by * 0.05, by * 0.16, by * 0.05)


@pytest.mark.slow
def test_of_similar_boxes_the_stress_by_a_newton_falls_with_the_square_of_their_size() -> None:
    """Elasticity has no length of its own, so cells, pads and walls that are all 1.5 times as large give it exactly."""
    one, larger = (pad_stress(section(by), [pad(by), pad(by, at=0.1)]) for by in (1.0, 1.5))
    assert larger == pytest.approx(one / 1.5**2, rel=1e-6)
    assert one[1] > 1.02 * one[0]  # near an open end walls are softer


@pytest.mark.slow
def test_cells_half_as_long_change_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the module states of its cells, and that cells as long as the pad miss a part."""
    on_its_cells = pad_stress(section(), [pad()])
    monkeypatch.setattr(wall_stress, "ALONG", 2 * wall_stress.ALONG)
    monkeypatch.setattr(wall_stress, "ACROSS", 2 * wall_stress.ACROSS)
    on_half = pad_stress(section(), [pad()])
    assert on_its_cells == pytest.approx(on_half, rel=0.04)
    monkeypatch.setattr(wall_stress, "ALONG", 1)
    monkeypatch.setattr(wall_stress, "ACROSS", 1)
    assert pad_stress(section(), [pad()])[0] < 0.9 * on_half[0]


def test_walls_that_change_along_a_section_are_refused() -> None:
    doubler = {"start": 0.4, "end": 0.8, "thickness": 0.004}
    with pytest.raises(InputError, match="walls that stay the same along the section"):
        pad_stress(section(doublers=[doubler]), [pad()])
    other_plate = section().with_keys(body={"regions": {"bottom": {"thickness": 0.01}}})
    with pytest.raises(InputError, match="walls that stay the same along the section"):
        pad_stress(other_plate, [pad()])


def test_the_weaker_wall_of_a_joint_decides_and_joints_without_a_yield_stress_are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pads press on both sections of a joint; a section without yield stress takes its own joint and the next away."""
    scene = pmr.load_scene("boom_three")
    assert isinstance(scene, Scene)
    strong = scene.vary_sections(lambda part: {"body": {"material": {"yield_stress": 350e6}}})
    by_section = dict(zip(strong.names, (2e3, 1e3, 4e3), strict=True))  # Pa/N
    monkeypatch.setattr(wall_stress, "pad_stress", lambda part, pads: np.full(len(pads), by_section[part.name]))
    forces = yield_forces(strong)
    inner, outer = strong.names[2], strong.names[1]
    assert {name: (of.force, of.section) for name, of in forces.items()} == {
        outer: (350e6 / 2e3, strong.names[0]),
        inner: (350e6 / 4e3, inner),
    }
    last = strong.sections[2].with_keys(body={"material": {"yield_stress": None}})
    assert list(yield_forces(strong.with_keys(sections=(*strong.sections[:2], last)))) == [outer]


def test_the_nearest_pad_of_a_joint_says_how_the_stress_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = pmr.load_scene("boom_three")
    pads = [each.pad for each in joint_pads(scene, 1)]
    looked_at = list[Pad]()

    def stress(part: BoomSection, of: list[Pad]) -> np.ndarray:
        looked_at.extend(of)
        return np.array([3e3])

    monkeypatch.setattr(wall_stress, "pad_stress", stress)
    monkeypatch.setattr(wall_stress, "_largest_stress", lambda body, of: np.array([2e3]))
    box = scene.sections[1].body.box
    assert box is not None
    bottom = next(pad for pad in pads if pad.on == "bottom")
    at = np.array([bottom.at, -bottom.across, -box.height / 2.0])  # under its mirror image
    assert stress_growth(scene, 1, at) == pytest.approx(1.5)
    assert (looked_at[0].on, looked_at[0].at) == ("bottom", pytest.approx(bottom.at, abs=0.05))
    assert stress_growth(scene, 1, np.array([-9.0, 0.0, 0.0])) is None
    regions = {"bottom": {"thickness": 0.01}}
    uneven = scene.vary_sections(lambda part: {"body": {"regions": regions}})
    assert stress_growth(uneven, 1, at) is None
