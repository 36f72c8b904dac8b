from __future__ import annotations

import numpy as np

from pmr.report.columns import forces_by_group, tip_displacements
from pmr.report.subject import field_times, reach, slider_offsets


def test_the_tips_directions_are_the_last_columns(boom, make_space) -> None:
    response = boom.responses["full"]
    found = {d: what(response) for d, what in tip_displacements(boom).items()}
    assert list(found) == ["y", "z"]
    assert np.array_equal(found["y"], response.displacement[:, -2]) and np.ptp(found["y"]) < 0.0061
    assert np.array_equal(found["z"], response.tip)
    assert list(tip_displacements(make_space(body={"model": "beam2d", "box": boom.scene.body.box}))) == ["z"]


def test_forces_are_named_ring_by_ring_those_that_stay_first(boom) -> None:
    named = {ring: [(f.column, f.name) for f in pads] for ring, pads in forces_by_group(boom).items()}
    assert named == {
        "tail": [(0, "bottom right"), (1, "bottom left"), (2, "left")],
        "mouth": [(3, "bottom right"), (4, "bottom left"), (5, "top"), (6, "right")],
    }


def test_a_planar_beam_feels_no_pads_on_its_sides_and_rigid_pads_that_stay_have_no_force(boom, make_space) -> None:
    planar = forces_by_group(make_space(body={"model": "beam2d", "box": boom.scene.body.box}))
    assert [f.name for pads in planar.values() for f in pads] == ["bottom right", "bottom left"] * 2 + ["top"]
    rigid = [dict(ring, stiffness="rigid") for ring in boom.scene.model_dump()["pads"]]
    assert list(forces_by_group(make_space(pads=rigid))) == ["mouth"]


def test_places_and_times(boom) -> None:
    assert (slider_offsets(boom), reach(boom)) == ((0.0,), 6.0)
    assert np.allclose(field_times(boom, boom.body), np.linspace(0.0, 1.0, 21))  # the scene's recovery
