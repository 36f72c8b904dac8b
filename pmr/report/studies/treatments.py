"""The three treatments of the supports' rows, in words."""

from __future__ import annotations

NAMES = {
    "round_off": "rows left to round-off, as published",
    "last": "rows holding the last two",
    "dropped": "rows dropped",
}
EXPLAINED = (
    "Basis vectors vanish at the pin, so its two rows say nothing, except for their round-off. Left in, as the "
    "publication does to judge by its figures, they hold two combinations of coordinates that round-off decides on: of "
    "the last ones where the singular values fall quickly, of any where they fall slowly. Made to hold the last two, "
    "they do the least harm. Dropped, they leave all coordinates free."
)
