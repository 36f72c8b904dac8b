from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError

BOOM = Path(__file__).parents[2] / "workflows" / "boom.toml"
MODELS = ("beam3d", "shell", "solid")
REST = "pads=[{{name='tail',{tail}}},{{name='mouth',moving=true,{mouth}}}]"
FITS = {"tail": "at=0.15,faces={bottom=[0.11],left=[-0.16]}", "mouth": "faces={top=[0.0],right=[0.0]}"}


def refused(model: str, *changes: str) -> str:
    with pytest.raises(InputError) as error:
        scenes.load(BOOM, [f"body.model={model}", *changes])
    return str(error.value)


def pads(**changed: str) -> str:
    return REST.format(**(FITS | changed))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("at", "reach"), [("15.0", "14.85 to 15.15"), ("-0.2", "-0.35 to -0.05"),
                                           ("6.2", "6.05 to 6.35"), ("0.149", "-0.001 to 0.299")])  # fmt: skip
def test_a_pad_off_or_partly_off_the_ends_is_refused(model: str, at: str, reach: str) -> None:
    said = refused(model, pads(tail=f"at={at},faces={{bottom=[0.0]}}"))
    assert f"pads[0].at = {float(at)}: the pad tail bottom reaches from {reach} m along the axis" in said
    assert "the face bottom offers 0 to 6 m" in said


@pytest.mark.parametrize("model", MODELS)
def test_a_pad_off_or_partly_off_the_sides_is_refused(model: str) -> None:
    said = refused(model, pads(tail="at=0.15,faces={bottom=[-1.0,1.0]}"))
    assert "pads[0].faces.bottom = -1.0: the pad tail bottom right reaches from -1.04 to -0.96 m across" in said
    assert "the flat face bottom offers -0.15 to 0.15 m" in said
    assert "left offers -0.2 to 0.2 m" in refused(model, pads(tail="at=0.15,faces={left=[0.17]}"))
    assert "bottom offers -0.1 to 0.1 m" in refused(model, pads(), "body.box.radius=0.05")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("path", "reach"), [("7.0,8.0", "6.85 to 8.15"), ("3.0,5.9", "2.85 to 6.05"),
                                             ("0.1,3.0", "-0.05 to 3.15")])  # fmt: skip
def test_a_path_that_takes_a_pad_off_is_refused(model: str, path: str, reach: str) -> None:
    said = refused(model, pads(), f"slider.path={{kind='smooth_ramp',times=[1.0,5.0],values=[{path}]}}")
    assert f"slider.path: the pad mouth top reaches from {reach} m along the axis as s goes from" in said


@pytest.mark.parametrize("model", MODELS)
def test_pads_that_touch_the_rims_of_their_faces_fit(model: str) -> None:
    whole = "slider.path={kind='smooth_ramp',times=[1.0,5.0],values=[0.15,5.85]}"
    assert scenes.load(BOOM, [f"body.model={model}", pads(), whole]).title
