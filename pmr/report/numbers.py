"""Numbers as text: significant digits, SI prefixes, per cent; and longer texts of pages, macros of `prose.txt`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from math import floor, isfinite, log10, pi
from typing import Any

SPACE = "\u00a0"  # space between a number and its unit, at which no line may break
MINUS = "\u2212"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXES = {1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n", 1e-12: "p"}


#: Relative error up to which an error is mere round-off.
TINY = 1e-8
#: Share of the largest value of a table or figure below which a value is printed as 0.
NOTHING = 1e-4


@dataclass(frozen=True)
class Unit:
    """Unit with a prefix: a value in the unit without prefix is divided by `size` and printed with the text `name`."""

    size: float
    name: str

    def after(self, text: str) -> str:
        """Return a number, as `text`, with the unit after it; only a degree sign follows without a space."""
        gap = "" if self.name.startswith("°") else SPACE
        return f"{text}{gap}{self.name}".rstrip(SPACE)

    def axis_label(self, quantity: str) -> str:
        """Return the label of an axis with a quantity in this unit: ``Force in kN``, or ``Share (–)`` without unit."""
        return f"{quantity} in {self.name}" if self.name else f"{quantity} (–)"


#: Units without prefixes in which quantities are printed, by their own units; ``strain`` is that of a strain.
FIXED = {
    "m^3": Unit(1e-3, "l"),
    "m^3/s": Unit(1e-3 / 60.0, "l/min"),
    "rad": Unit(pi / 180.0, "°"),
    "rad/s": Unit(pi / 180.0, "°/s"),
    "degrees": Unit(1.0, "°"),
    "degrees/s": Unit(1.0, "°/s"),
    "strain": Unit(1e-6, "µm/m"),
    "mm": Unit(1.0, "mm"),
    "kg": Unit(1.0, "kg"),
    "Hz": Unit(1.0, "Hz"),
    "%": Unit(0.01, "%"),
    "–": Unit(1.0, ""),
    "1": Unit(1.0, ""),
}


#: Units of stiffnesses from a million on.
MILLIONS = {"N/m": Unit(1e6, "kN/mm"), "N m/rad": Unit(1e6, "MN m/rad")}


def unit_for(largest: float, base: str) -> Unit:
    """Return the unit with the prefix by which the value `largest`, given in the unit `base`, is printed as 1 to 1000.

    Some units get no such prefix:

    - A unit in `FIXED` is always printed in the unit that stands there.
    - A unit in `MILLIONS` is printed in the unit that stands there from 1e6 on.
    - Lengths in m and times in s get no prefix above 1, such as k.
    - Quotients such as N/m, and products other than N m, get no prefix at all.
    - No unit gets a prefix if `largest` is 0 or not finite.
    """
    if base in FIXED:
        return FIXED[base]
    if base in MILLIONS and 1e6 <= abs(largest) < float("inf"):
        return MILLIONS[base]
    if largest == 0.0 or not isfinite(largest) or not (base.isalpha() or base == "N m"):
        return Unit(1.0, base)
    sizes = [size for size in _PREFIXES if size <= 1.0 or base not in ("m", "s")]
    size = next((size for size in sizes if abs(largest) >= 0.9995 * size), sizes[-1])
    return Unit(size, _PREFIXES[size] + base)


def decimals_of(value: float) -> int:
    """Number of decimals of a value in its shortest form: 2 for 0.25, 0 for a whole number."""
    return max(-int(Decimal(repr(value)).normalize().as_tuple().exponent), 0)


def power_of_ten(exponent: int) -> str:
    """Format a power of ten as 10 with `exponent` in superscript."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def significant(value: float, digits: int = 3) -> str:
    """Format a value with `digits` significant digits: from 1e-4 to 1e6 as a decimal number, else with a power of ten.

    NaN and infinity are printed as ``not finite``.
    """
    if value == 0.0:
        return "0"
    if not isfinite(value):
        return "not finite"
    sign = MINUS if value < 0.0 else ""
    mantissa, exponent = f"{abs(value):.{digits - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power < 6:
        return sign + f"{float(f'{mantissa}e{power}'):.{max(digits - 1 - power, 0)}f}"
    return f"{sign}{mantissa}{SPACE}·{SPACE}{power_of_ten(power)}"


def format_input(value: float, unit: str = "") -> str:
    """Format an input value with the digits with which it was written, at most ten, and with its `unit`.

    An empty `unit` is left out.  Whole numbers from 10 000 on are written in groups of three digits.
    """
    text, end = f"{value:.10g}", f"{SPACE}{unit}" if unit else ""
    if abs(value) >= 1e9 and "e" not in text:
        mantissa, exponent = f"{value:.9e}".split("e")
        text = f"{mantissa.rstrip('0').rstrip('.')}e{exponent}"
    if 1e4 <= abs(value) < 1e9 and "." not in text and "e" not in text:
        text = f"{int(value):,}".replace(",", "\u202f")
    if "e" in text:
        mantissa, exponent = text.split("e")
        scale = power_of_ten(int(exponent))
        text = scale if mantissa == "1" else f"{mantissa}{SPACE}·{SPACE}{scale}"
    return text.replace("-", MINUS) + end


def format_time(t: float) -> str:
    """Format the time `t` in s of an event: rounded to 0.01 s, or to 0.001 s before 1 s."""
    return format_input(round(t, 2 if abs(t) >= 1.0 else 3), "s")


def with_sign(value: float) -> str:
    """Format a value as its sign, a space and its absolute value."""
    return f"{MINUS if value < 0.0 else '+'} {format_input(abs(value))}"


def format_percent(fraction: float, digits: int = 3) -> str:
    """Format a fraction in per cent with `digits` digits.

    An absolute value above 0 and below `TINY` is round-off: it is printed as less than `TINY` in per cent.
    """
    if 0.0 < abs(fraction) < TINY:
        return f"less than {power_of_ten(round(log10(100.0 * TINY)))}{SPACE}%"
    return f"{significant(100.0 * fraction, digits)}{SPACE}%"


def format_quantity(value: float, base: str, digits: int = 3) -> str:
    """Format a value, given in the unit `base`, with the prefix that suits it and `digits` digits, as ``47.9 mm``."""
    unit = unit_for(value, base)
    return unit.after(significant(value / unit.size, digits))


def format_length(value: float, digits: int = 3) -> str:
    """Format the length `value` in m with `digits` digits: in mm from 0.01 mm to 1 m, so that lengths compare easily.

    Lengths of 1 m or more are in m.  Lengths below 0.01 mm are in the unit that suits them, such as µm.
    """
    if 1e-5 <= abs(value) < 1.0:
        return f"{significant(1e3 * value, digits)}{SPACE}mm"
    return format_quantity(value, "m", digits)


def format_in_unit(value: float, unit: str) -> str:
    """Format a value with its unit for a table, with three digits, or four in Hz and kg and for plain numbers.

    Fractions (unit ``%``) are printed in per cent, values in Hz and kg without prefix, plain numbers (unit ``–``)
    without unit, and lengths as by `format_length`.
    """
    if unit in ("m", "%"):
        return format_length(value) if unit == "m" else format_percent(value)
    return format_quantity(value, unit, 4 if unit in ("Hz", "kg", "–") else 3)


def round_number(largest: float) -> float:
    """Largest of the numbers ..., 0.1, 0.2, 0.5, 1, 2, 5, 10, ... that does not exceed `largest`.

    `largest` has to be positive.
    """
    decade = 10.0 ** floor(log10(largest))
    return next(step * decade for step in (5.0, 2.0, 1.0) if step * decade <= largest * (1.0 + 1e-12))


def enlargement(largest: float, target: float) -> float:
    """Factor, a round number, by which displacements are drawn so that the largest has at most the length `target`.

    `largest` and `target` have the same unit.  The factor is below 1 if `largest` exceeds `target`, and 1 if `largest`
    is 0.
    """
    return round_number(target / largest) if largest > 0.0 else 1.0


def share_captured(kappa: float, count: int) -> str:
    """Format the share kappa (0 to 1) that `count` vectors capture.

    If the missing share 1 - kappa is below 1e-6, the missing share is formatted in place of kappa.
    """
    missing = 1.0 - kappa
    if missing < 1e-15:
        return f"1 {MINUS} κ({count}) < {power_of_ten(-15)}"
    if missing < 1e-6:
        return f"1 {MINUS} κ({count}) = {significant(missing, 2)}"
    return f"κ({count}) = {kappa:.6f}"


def times_the_true_error(estimate: float, true: float | None) -> str:
    """Words for the ratio of an estimate to the true error.

    The text is empty if the true error is None, which means unknown, or at most 1e-6, which is mostly round-off.
    """
    return f"{significant(estimate / true, 3)} times the true error" if true and true > 1e-6 else ""


def prose(macro: str, /, **values: Any) -> str:
    """Return the text of a macro for its arguments `values`, on one line, as plain text."""
    text = getattr(_macros(), macro)(**values)
    return re.sub(r"[ \n]+", " ", str(text)).strip()


def format_digits(value: float, digits: int, unit: str = "") -> str:
    """Format a value with at most `digits` significant digits, and with its `unit`."""
    return f"{value:.{digits}g}{SPACE if unit else ''}{unit}"


@cache
def _macros() -> Any:
    """Macros of `prose.txt` as functions; imports Jinja, which only pages need."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("pmr.report"), undefined=StrictUndefined)
    environment.globals["nbsp"] = SPACE
    environment.filters |= {
        "digits": format_digits,
        "input": format_input,
        "percent": format_percent,
        "quantity": format_quantity,
        "significant": significant,
        "time": format_time,
    }
    return environment.get_template("prose.txt").module
