"""Changes that people, editors and other programs make to plain data: tables, lists, numbers, text."""

import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from datetime import date
from typing import Any

import numpy as np

Random = np.random.Generator
Place = tuple[Any, Any]  # a table or a list, and a key in it

STRANGE = (
    *(
        "",
        " ",
        "[/red]",
        "root:x:0",
        ":smile:",
        "$x^2$",
        r"$\frac{",
        "a\nb",
        "\x00",
        "\x1b[31m",
        "\u202e",
        "F²",
        "漢字",
    ),
    *('"""', "'''", "{0}", "%s", "../../etc/passwd", "/dev/null", "/", ".", "<b>&amp;", "_F", "x" * 3000, "nan", "1e5"),
)
NUMBERS = (
    *(0, 0.0, -0.0, 1, -1, 1.0, -1.0, 2, 7, 1e-300, 5e-324, 1e-12, 1e-6, 1e-3, 1e3, 1e6, 1e12, 1e30, 1e150, 1e300),
    *(1.7976931348623157e308, -1e300, math.nan, math.inf, -math.inf, 2**31, 2**63 - 1, -(2**63), 10**6, 600, 50),
)
UNITS = (1e-6, 1e-3, 1e-2, 1e2, 1e3, 1e6, 9.80665, math.pi / 180.0, -1.0)


def mutated(data: dict[str, Any], rng: Random, most: int = 3) -> dict[str, Any]:
    """Copy data with one to `most` changes."""
    changed = deepcopy(data)
    for _ in range(int(rng.integers(1, most + 1))):
        kinds = list(MUTATIONS)
        MUTATIONS[kinds[int(rng.integers(len(kinds)))]](changed, rng)
    return changed


def places(data: Any) -> Iterator[Place]:
    """Yield every value in a tree, as its table or list and its key there."""
    for key in data if isinstance(data, dict) else range(len(data)):
        yield data, key
        if isinstance(data[key], dict | list):
            yield from places(data[key])


def somewhere(data: Any, rng: Random, fits: Callable[[Any], bool] = lambda value: True) -> Place | None:
    """Choose a random value that `fits`, as its table or list and its key there; None if there is none."""
    found = [(holder, key) for holder, key in places(data) if fits(holder[key])]
    return found[int(rng.integers(len(found)))] if found else None


def is_number(value: Any) -> bool:
    """Whether a value is a number and no truth value."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def strange(rng: Random) -> Any:
    """Random value of any type."""
    choices = [
        lambda: STRANGE[int(rng.integers(len(STRANGE)))],
        lambda: NUMBERS[int(rng.integers(len(NUMBERS)))],
        lambda: bool(rng.integers(2)),
        lambda: [],
        lambda: {},
        lambda: [1.0, "a", {}],
        lambda: {"kind": "constant", "amount": 1.0},
        lambda: {"kind": STRANGE[int(rng.integers(len(STRANGE)))]},
        lambda: date(2024, 2, 29),
        lambda: nested(int(rng.integers(2, 300))),
        lambda: rng.standard_normal(int(rng.integers(1, 400))).tolist(),
        lambda: sorted(rng.uniform(0.0, 10.0, int(rng.integers(2, 50))).tolist()),
    ]
    return choices[int(rng.integers(len(choices)))]()


def nested(depth: int) -> Any:
    """Tables and lists within each other, `depth` deep."""
    found: Any = 1.0
    for _ in range(depth):
        found = [found] if depth % 2 else {"terms": found, "kind": "sum"}
    return found


def _delete(data: Any, rng: Random) -> None:
    """Delete a value."""
    if place := somewhere(data, rng):
        del place[0][place[1]]


def _rename(data: Any, rng: Random) -> None:
    """Rename a key."""
    found = [(holder, key) for holder, key in places(data) if isinstance(holder, dict)]
    if found:
        holder, key = found[int(rng.integers(len(found)))]
        new = str(key)[:-1] if rng.random() < 0.5 else STRANGE[int(rng.integers(len(STRANGE)))]
        holder[new] = holder.pop(key)


def _double(data: Any, rng: Random) -> None:
    """Append the first entries of a list to it."""
    if place := somewhere(data, rng, lambda value: isinstance(value, list)):
        held = place[0][place[1]]
        held.extend(deepcopy(held[: int(rng.integers(1, 3))]))


def _swap(data: Any, rng: Random) -> None:
    """Swap two values."""
    one, two = somewhere(data, rng), somewhere(data, rng)
    if one and two:
        first, second = deepcopy(one[0][one[1]]), deepcopy(two[0][two[1]])
        one[0][one[1]] = second
        if two[1] in two[0] if isinstance(two[0], dict) else two[1] < len(two[0]):
            two[0][two[1]] = first


def _replace(data: Any, rng: Random) -> None:
    """Replace a value by one of any type."""
    if place := somewhere(data, rng):
        place[0][place[1]] = strange(rng)


def _number(data: Any, rng: Random) -> None:
    """Replace a number by an extreme one."""
    if place := somewhere(data, rng, is_number):
        place[0][place[1]] = NUMBERS[int(rng.integers(len(NUMBERS)))]


def _unit(data: Any, rng: Random) -> None:
    """Convert a number to a wrong unit."""
    if place := somewhere(data, rng, is_number):
        place[0][place[1]] = float(place[0][place[1]] * UNITS[int(rng.integers(len(UNITS)))])


def _nudge(data: Any, rng: Random) -> None:
    """Replace a number by one of a similar size, as people do."""
    if place := somewhere(data, rng, is_number):
        value = place[0][place[1]]
        size = float(np.exp(rng.uniform(-1.5, 1.5)))
        place[0][place[1]] = max(1, round(value * size)) if isinstance(value, int) else value * size


def _flip(data: Any, rng: Random) -> None:
    """Flip a truth value."""
    if place := somewhere(data, rng, lambda value: isinstance(value, bool)):
        place[0][place[1]] = not place[0][place[1]]


def _text(data: Any, rng: Random) -> None:
    """Replace a text by a strange one."""
    if place := somewhere(data, rng, lambda value: isinstance(value, str)):
        place[0][place[1]] = STRANGE[int(rng.integers(len(STRANGE)))]


def _order(data: Any, rng: Random) -> None:
    """Shuffle a list."""
    if place := somewhere(data, rng, lambda value: isinstance(value, list) and len(value) > 1):
        rng.shuffle(place[0][place[1]])


MUTATIONS: dict[str, Callable[[Any, Random], None]] = {
    "delete": _delete, "rename": _rename, "double": _double, "swap": _swap, "replace": _replace, "number": _number,
    "another number": _number, "unit": _unit, "nudge": _nudge, "nudge again": _nudge, "and again": _nudge,
    "flip": _flip, "text": _text, "order": _order,
}  # fmt: skip


def scratched(content: bytes, rng: Random, most: int = 6) -> bytes:
    """Copy bytes with some flipped, removed, inserted or cut off."""
    found = bytearray(content)
    for _ in range(int(rng.integers(1, most + 1))):
        at, kind = int(rng.integers(max(len(found), 1))), int(rng.integers(5))
        if not found:
            break
        if kind == 0:
            found[at] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            del found[at : at + int(rng.integers(1, 40))]
        elif kind == 2:
            found[at:at] = bytes(rng.integers(0, 256, int(rng.integers(1, 20)), dtype=np.uint8))
        elif kind == 3:
            found[at] = b'0123456789-+.eE"[]{},= \n\x00\xff'[int(rng.integers(26))]
        elif rng.random() < 0.3:
            del found[at:]
    return bytes(found)
