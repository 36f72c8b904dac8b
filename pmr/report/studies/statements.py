"""What is published beside what a study finds: one line of a table each, with a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any, Protocol

from pmr.report.marks import DIFFERENT, SAME, ErrorTable, Mark, Row, mark_for, signed_deviation
from pmr.report.numbers import SPACE, length, percent, plain, quantity, significant
from pmr.studies.engine.task import Scalar, number
from pmr.studies.study import Statement


class Compared(Protocol):
    """Figures of a study or an experiment, and what is published of them."""

    @property
    def figures(self) -> Mapping[str, Scalar]: ...
    @property
    def published(self) -> Sequence[Statement]: ...
    @property
    def summary(self) -> Mapping[str, Any]: ...


def comparison(study: Compared) -> ErrorTable:
    """Table of published statements beside the study's figures, without those whose figure the study does not have."""
    rows, reasons = [], list[str]()
    for statement in study.published:
        figure = study.figures.get(statement.figure)
        if figure is None:
            continue
        rows.append(_row(statement, figure))
        if statement.why and statement.why not in reasons:
            reasons.append(statement.why)
    source = str(study.summary["source"]) or "publication"
    return ErrorTable(f"Published: {source}.", rows, [*reasons, *study.summary["remarks"]])


def format_figure(value: Scalar, kind: str) -> str:
    """A figure as its quantity is printed."""
    if isinstance(value, str):
        return combination(value)
    return {
        "share": lambda x: percent(x),
        "length": lambda x: length(x),
        "energy": lambda x: quantity(x, "J"),
        "seconds": lambda x: quantity(x, "s"),
        "ratio": lambda x: f"{significant(x, 2)}{SPACE}×",
        "number": lambda x: plain(round(x, 9)),
    }[kind](number(value))


def combination(key: str) -> str:
    """``"5x6"`` as (5,6); other texts as they are."""
    first, _, second = key.partition("x")
    return f"({first},{second})" if first.isdigit() and second.isdigit() else key


def _row(statement: Statement, figure: Scalar) -> Row:
    shown = format_figure(figure, statement.quantity)
    if statement.value is None:
        return Row(statement.text, "", shown, statement.words or None)
    printed = statement.words or format_figure(statement.value, statement.quantity)
    mark, deviation = _verdict(statement, figure)
    return Row(statement.text, "", shown, printed, deviation, mark)


def _verdict(statement: Statement, figure: Scalar) -> tuple[Mark, str | None]:
    if isinstance(statement.value, str) or isinstance(figure, str):
        return (SAME if figure == statement.value else DIFFERENT), None
    published, value = number(statement.value), number(figure)
    if value == published or not statement.words and round(value, _decimals(published)) == published:
        return SAME, None
    return mark_for(value, published, statement.is_error), signed_deviation(value, published)


def _decimals(value: float) -> int:
    """Decimals to which a figure is stated."""
    return max(-int(Decimal(repr(value)).normalize().as_tuple().exponent), 0)
