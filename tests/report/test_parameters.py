"""What was asked for, in words."""

from __future__ import annotations

from pydantic import TypeAdapter

from pmr.report import provenance
from pmr.report.blocks import Table
from pmr.report.machine import describe_signal
from pmr.scene.signals import Signal


def test_the_degree_of_a_ramp_has_no_unit() -> None:
    ramp = TypeAdapter(Signal).validate_python({"kind": "smooth_ramp", "times": [0.5, 4.5], "values": [0.8, 3.8]})
    assert describe_signal(ramp, "m") == "smooth ramp, times (0.5, 4.5)\u00a0s, values (0.8, 3.8)\u00a0m, degree 5"


def test_tables_stand_side_by_side_whole_in_their_order_and_as_short_as_can_be() -> None:
    """With a title of two lines: 5, 6 | 3, 4, 3 | 7 at most, 11, as 5 | 6, 3, 4 | 3, 7 has 13; what wraps is longer."""
    tables = [Table(name, (("a", "b"),) * rows) for name, rows in zip("abcdef", (3, 4, 1, 2, 1, 5), strict=True)]
    columns = provenance.side_by_side([*tables[:2], Table("empty", ()), *tables[2:]])
    assert [table for column in columns for table in column] == tables and len(columns) == provenance.COLUMNS
    assert columns[0] == tables[:2]
    y, z, w = (Table(name, (("a", "b"),)) for name in "yzw")
    long = Table("long", (("a", 73 * "b"),))
    assert provenance.side_by_side([y, z, w, long]) == [[y], [z, w], [long]]
