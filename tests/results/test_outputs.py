"""What columns are, by what a response says."""

from dataclasses import replace

import numpy as np
import pytest

from pmr import Response
from pmr.results import Energy
from pmr.system.body import force_outputs, kinds_of, length_outputs, other_outputs

T = np.linspace(0.0, 1.0, 4)
RISING = np.outer(1.0 + T, np.arange(1.0, 8.0))


@pytest.fixture
def response() -> Response:
    """Of two sections, whose tips are no last columns."""
    return Response(
        t=T,
        x=np.array([6.0, 3.0, 5.0]),
        displacement=RISING[:, :3],
        energy=Energy(T, T, T),
        slider_force=RISING[:, 3:6],
        residual_position=T,
        residual_velocity=T,
        seconds=1.0,
        output_names=("base: tip z", "base: z at 3 m", "fly: tip z"),
        output_units=("m",) * 3,
        force_names=("force of fly tail top", "force of cylinder of fly", "force of base stay"),
        others=RISING[:, 6:],
        other_names=("fly: weld stress along",),
        other_units=("Pa",),
        kinds=("tip z", "beam z", "tip z", "pad", "cylinder", "support", "probe"),
        bodies=("base", "base", "fly", "fly", "fly", "base", "fly"),
    )


def test_columns_are_asked_for_by_kind_and_body(response: Response) -> None:
    assert np.array_equal(response.of("tip"), RISING[:, [0, 2]])
    assert np.array_equal(response.of("tip", body="base"), RISING[:, [0]])
    assert np.array_equal(response.of("cylinder"), RISING[:, [4]])
    assert np.array_equal(response.of("probe", body="fly"), RISING[:, [6]])
    assert response.of("pad", body="base").shape == (4, 0)
    assert np.array_equal(response.tip, RISING[:, 2])
    kinds, bodies = ("tip z", "tip z", "beam z"), ("fly", "base", "base")
    mixed = replace(
        response,
        displacement=RISING[:, [2, 0, 1]],
        kinds=(*kinds, *response.kinds[3:]),
        bodies=(*bodies, *response.bodies[3:]),
    )
    assert np.array_equal(mixed.of("tip", body="fly"), RISING[:, [2]])
    peaks = replace(response, force_peaks=2.0 * RISING[:, 3:6])
    assert np.array_equal(peaks.of("pad"), 2.0 * RISING[:, [3]])


def test_what_is_left_of_the_forces_keeps_its_kinds(response: Response) -> None:
    fewer = response.with_forces([2, 0])
    assert fewer.force_names == ("force of base stay", "force of fly tail top")
    assert np.array_equal(fewer.of("support"), RISING[:, [5]]) and np.array_equal(fewer.of("pad"), RISING[:, [3]])
    assert fewer.of("cylinder").shape == (4, 0) and np.array_equal(fewer.of("probe"), RISING[:, [6]])


def test_units_places_and_directions_stand_beside_kinds(response: Response) -> None:
    first, second, *_, force, probe = response.outputs
    assert (first.place, first.direction, first.unit) == (6.0, "z", "m") and second.kind == "beam"
    assert (force.unit, force.is_force, force.place) == ("N", True, None)
    assert (probe.unit, probe.is_force) == ("Pa", False)
    assert replace(response, kinds=(), bodies=()).outputs == ()


class Model:
    """What has outputs, of an earlier version."""

    output_positions = np.arange(5.0)
    output_names = ("z at 1 m", "tip z", "force of pad", "tip ry", "weld stress along")
    output_units = ("m", "m", "N", "rad", "Pa")
    output_kinds: tuple[str, ...] = ()


def test_kinds_decide_what_a_model_s_outputs_are() -> None:
    old, new, bare = Model(), Model(), Model()
    assert kinds_of(old) == ("beam z", "tip z", "pad", "probe", "probe")
    bare.output_names = bare.output_units = ()
    assert kinds_of(bare) == ("beam z",) * 4 + ("tip z",)
    new.output_kinds = ("probe z", "tip z", "support", "probe ry", "probe")  # a probe may be in m
    assert length_outputs(new).tolist() == [False, True, False, False, False]
    assert force_outputs(new).tolist() == [False, False, True, False, False]
    assert other_outputs(new).tolist() == [True, False, False, True, True]
