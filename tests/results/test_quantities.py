"""The table of quantities, beside the columns of a response, a scene's keys and numbers by hand."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from pmr import Response
from pmr.compare.drives import luffing_part
from pmr.results import Energy
from pmr.results.quantities import LIMITED, QUANTITIES, Columns, matches_pattern, support_names
from pmr.results.response import KINDS, Extreme, Extremes, Output
from pmr.scene import load_any
from pmr.scene.mechanism import CYLINDER
from pmr.scene.run_settings import OutputKind


def response() -> Response:
    """Two displacements, a pad that lifts off, a cylinder and a reaction over three times."""
    t = np.array([0.0, 1.0, 2.0])
    return Response(
        t=t,
        x=np.array([1.0, 2.0]),
        displacement=np.array([[0.0, 0.0], [1e-3, -2e-3], [2e-3, -4e-3]]),
        energy=Energy(t, t, t),
        slider_force=np.array([[5.0, -7.0], [3.0, -8.0], [0.0, 4.0]]),
        residual_position=t,
        residual_velocity=t,
        seconds=1.0,
        output_names=("z at 1 m", "tip z"),
        output_units=("m", "m"),
        force_names=("force of pad", "force of cylinder of fly"),
        force_peaks=np.array([[5.0, -7.0], [6.0, -8.0], [0.0, 4.0]]),
        others=t[:, None],
        other_names=("reaction of base z",),
        other_units=("N",),
        kinds=("beam z", "tip z", "pad", "cylinder", "reaction"),
        bodies=("base", "fly", "fly", "fly", "base"),
    )


def test_each_quantity_stands_once_and_is_of_kinds_that_responses_have() -> None:
    assert [quantity.key for quantity in QUANTITIES.values()] == list(QUANTITIES)
    labels = [quantity.label for quantity in QUANTITIES.values()]
    assert len(set(labels)) == len(labels) and all(labels)
    assert {kind for quantity in QUANTITIES.values() for kind in quantity.kinds} <= set(KINDS)
    assert set(get_args(OutputKind)) <= QUANTITIES.keys()
    limits = [quantity.limit for quantity in QUANTITIES.values() if quantity.limit]
    assert sorted(limit.key for limit in limits) == sorted(LIMITED)


@pytest.mark.parametrize(
    ("body", "name", "contact"),
    [
        ("base", "base luffing cylinder", "base luffing cylinder"),
        ("base", "reaction of base: pivot x", "base pivot x"),
        ("base", "base: force of lift z", "base lift z"),
        ("", "reaction of pin x", "pin x"),
    ],
)
def test_a_support_has_the_name_of_its_contact_with_its_body_once(body: str, name: str, contact: str) -> None:
    columns = Columns((name,), ("support",), ("N",), (body,))
    assert support_names(columns, 0) == (name, contact)


@pytest.mark.parametrize(("name", "supports"), [("paper_simple", 4), ("crane", 1)])
def test_what_the_machine_bears_is_no_support(name: str, supports: int) -> None:
    """Without a frame these are supports that are called so: their forces and limits were missing."""
    outputs = [Output(f"reaction of {of} x", "reaction", "", unit="N") for of in ("pin", "pivot", "ground", "machine")]
    columns = Columns.of_outputs(load_any(name), outputs)
    assert columns.support_columns() == list(range(supports))


def test_a_probe_may_have_the_word_stress_in_its_name() -> None:
    """Its displacement was taken for a component of stress, and a chart that limits stresses failed."""
    names = ("high stress spot displacement z", "high stress spot stress axial")
    columns = Columns(names, ("probe", "probe"), ("mm", "Pa"), ("", ""))
    assert columns.stress_columns() == {"high stress spot": {"axial": 1}}


def test_a_probe_may_be_called_as_the_luffing_cylinder() -> None:
    """Its displacement was taken for a column of a cylinder that drives the angle, and the run failed at its end."""
    made = response()
    others = {"other_names": (CYLINDER, "luffing cylinder lug displacement z"), "other_units": ("N", "mm")}
    kinds = {"kinds": (*made.kinds, "probe"), "bodies": (*made.bodies, "base")}
    probed = replace(made, others=np.column_stack([made.t, made.t]), **others, **kinds)
    figures = luffing_part(load_any("crane"), probed).figures["luffing_cylinder"]
    assert figures["force"]["max"] == 2.0 and {*figures} == {"force", "length", "speed", "power"}


@pytest.mark.parametrize(
    ("key", "columns"),
    [
        ("beam", {"z at 1 m": [0.0, 1e-3, 2e-3], "tip z": [0.0, -2e-3, -4e-3]}),
        ("tip", {"tip z": [0.0, -2e-3, -4e-3]}),
        ("pad_force", {"force of pad": [5.0, 6.0, 0.0]}),
        ("cylinder_force", {"force of cylinder of fly": [-7.0, -8.0, 4.0]}),
        ("reaction", {"reaction of base z": [0.0, 1.0, 2.0]}),
        ("frequency", {}),
    ],
)
def test_its_histories_are_the_columns_of_its_kinds_with_the_peaks_of_forces(
    key: str, columns: dict[str, list[float]]
) -> None:
    histories = QUANTITIES[key].histories(response())
    assert {name: values.tolist() for name, values in histories.items()} == columns


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("cylinder_force", Extreme(-8.0, 1.0, 20.0)),
        ("stress", Extreme(4.0, 2.0, 30.0)),
        ("frequency", Extreme(-8.0, 1.0, 20.0)),
    ],
)
def test_the_extreme_that_is_reported_has_its_sign_time_and_place(key: str, value: Extreme) -> None:
    extremes = Extremes.from_history(
        np.array([-7.0, -8.0, 4.0]), np.array([0.0, 1.0, 2.0]), np.array([10.0, 20.0, 30.0])
    )
    assert QUANTITIES[key].reported_extreme(extremes) == value and extremes.size == 8.0


def test_forces_below_a_billionth_of_the_largest_are_round_off() -> None:
    """The largest of contacts and supports: a level boom's cylinder has round-off of what its base carries."""
    assert response().force_floor == pytest.approx(8e-9, rel=1e-12)
    held = replace(response(), others=np.array([[0.0], [4e4], [1.0]]))
    assert held.force_floor == pytest.approx(4e-5, rel=1e-12)
    assert held.clear_round_off(np.array([0.0, 3.36e-5, 0.0])).tolist() == [0.0] * 3
    assert held.clear_round_off(np.array([0.0, 4.1e-5, 0.0])).tolist() == [0.0, 4.1e-5, 0.0]


@pytest.mark.parametrize(
    ("pattern", "name", "fits"),
    [
        ("jib *", "jib pad 1", True),
        ("*pad 1", "jib pad 1", True),
        ("jib [1]", "jib [1]", True),
        ("jib [1]", "jib 1", False),
        ("jib ?", "jib 2", False),
    ],
)
def test_a_star_alone_stands_for_any_text_in_a_pattern(pattern: str, name: str, fits: bool) -> None:
    assert matches_pattern([pattern], name) is fits
