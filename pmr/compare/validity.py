"""Where the theory that all models share ends, and what was hardly meant: materials in other units than SI."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from pmr.results import Response
from pmr.scene.structures import Material

#: What structures are made of, from soft rubber and foam to diamond and osmium, with the unit and the value of steel.
USUAL = {"young": (1e6, 2e12, "Pa", "210e9"), "density": (20.0, 25e3, "kg/m^3", "7850")}
SMALL = 0.1  # of the body's length: a tip's path is then shortened by about half a per cent of it


def large_motion(length: float, responses: Iterable[Response]) -> list[str]:
    """A line where a body of this length in m moves by more than `SMALL` of it, which no linear model describes."""
    largest = max(float(np.abs(response.displacement).max(initial=0.0)) for response in responses)
    if not largest > SMALL * length:
        return []
    return [
        f"the largest displacement, {largest:.3g} m, is {largest / length:.2g} times the body's length: "
        f"beyond {SMALL:g} times the theory of small motions does not hold"
    ]


def unusual(materials: Mapping[str, Material]) -> list[str]:
    """A line for each property, by the key of its material, that nothing has which is built with: a unit, mostly."""
    said = []
    for key, material in materials.items():
        for name, (low, high, unit, steel) in USUAL.items():
            value = getattr(material, name)
            if not low <= value <= high:
                said.append(
                    f"{key}.{name} = {value:g} {unit}: no structure is of such a material; is it in {unit}? "
                    f"Steel has {steel}"
                )
    return said
