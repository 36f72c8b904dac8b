"""Numbers as they are printed: significant digits, SI prefixes, per cent."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, isfinite, log10

SPACE = "\u00a0"  # between a number and its unit, where no line may break
MINUS = "\u2212"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXES = {1e9: "G", 1e6: "M", 1e3: "k", 1.0: "", 1e-3: "m", 1e-6: "µ", 1e-9: "n", 1e-12: "p"}


#: A fraction below which figures are no measure of anything.
TINY = 1e-8
#: Of the largest of its kind: what is less is nothing to look at, and printed as 0.
NOTHING = 1e-4


@dataclass(frozen=True)
class Unit:
    """A unit with its prefix: values in the base unit are divided by `size`."""

    size: float
    name: str


def unit_for(largest: float, base: str) -> Unit:
    """The prefix with which the value `largest`, given in the unit `base`, reads as 1 to 1000.

    Lengths stay below km, and units that hold a quotient, or a product other than a moment's, are left as they are.
    """
    if largest == 0.0 or not isfinite(largest) or not (base.isalpha() or base == "N m"):
        return Unit(1.0, base)
    sizes = [size for size in _PREFIXES if size <= 1.0 or base not in ("m", "s")]
    size = next((size for size in sizes if abs(largest) >= 0.9995 * size), sizes[-1])
    return Unit(size, _PREFIXES[size] + base)


def power_of_ten(exponent: int) -> str:
    """10 with a superscript, for scales and numbers that are very large or small."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def significant(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits, as a decimal number or times a power of ten."""
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


def plain(value: float) -> str:
    """`value` as an input was written: no digits added, none taken away."""
    text = f"{value:.10g}"
    if 1e4 <= abs(value) < 1e9 and "." not in text and "e" not in text:
        return f"{int(value):,}".replace(",", "\u202f").replace("-", MINUS)
    if "e" in text:
        mantissa, exponent = text.split("e")
        scale = power_of_ten(int(exponent))
        return scale if mantissa == "1" else f"{mantissa}{SPACE}·{SPACE}{scale}".replace("-", MINUS)
    return text.replace("-", MINUS)


def with_sign(value: float) -> str:
    """`value` with its sign before it, apart."""
    return f"{MINUS if value < 0.0 else '+'} {plain(abs(value))}"


def percent(fraction: float, digits: int = 3) -> str:
    """A fraction in per cent; below `TINY` only that it is less, for its digits are those of round-off."""
    if 0.0 < abs(fraction) < TINY:
        return f"less than {power_of_ten(round(log10(100.0 * TINY)))}{SPACE}%"
    return f"{significant(100.0 * fraction, digits)}{SPACE}%"


def quantity(value: float, base: str, digits: int = 3) -> str:
    """A value with the prefix that suits it, such as ``47.9 mm``."""
    unit = unit_for(value, base)
    return f"{significant(value / unit.size, digits)}{SPACE}{unit.name}"


def length(value: float, digits: int = 3) -> str:
    """A length: in mm from 0.01 mm to 1 m, so that small and large ones read side by side."""
    if 1e-5 <= abs(value) < 1.0:
        return f"{significant(1e3 * value, digits)}{SPACE}mm"
    return quantity(value, "m", digits)


def in_unit(value: float, unit: str) -> str:
    """A value with its unit in a table: shares (``%``) in per cent, Hz and kg without prefix, numbers (``–``) bare."""
    if unit == "%":
        return percent(value)
    if unit == "m":
        return length(value)
    if unit in ("Hz", "kg"):
        return f"{significant(value, 4)}{SPACE}{unit}"
    return significant(value, 4).replace(SPACE, "") if unit == "–" else quantity(value, unit)


def round_number(largest: float) -> float:
    """The largest of ... 0.1, 0.2, 0.5, 1, 2, 5, 10 ... that is not above `largest`."""
    decade = 10.0 ** floor(log10(largest))
    return next(step * decade for step in (5.0, 2.0, 1.0) if step * decade <= largest * (1.0 + 1e-12))


def enlargement(largest: float, wanted: float) -> float:
    """How many times its size a displacement is drawn whose `largest` value takes `wanted` at most: a round number."""
    return round_number(wanted / largest) if largest > 0.0 else 1.0


def share_captured(kappa: float, count: int) -> str:
    """Share that `count` vectors hold; close to 1 the missing part says more than a row of nines."""
    missing = 1.0 - kappa
    if missing < 1e-15:
        return f"1 {MINUS} κ({count}) < {power_of_ten(-15)}"
    if missing < 1e-6:
        return f"1 {MINUS} κ({count}) = {significant(missing, 2)}"
    return f"κ({count}) = {kappa:.6f}"


def times_the_true_error(estimate: float, true: float | None) -> str:
    """How an estimate of the motion stands to its known error; empty below 1e-6, where round-off is part of both."""
    return f"{significant(estimate / true, 3)} times the true error" if true and true > 1e-6 else ""
