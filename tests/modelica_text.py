"""Read arrays back from text in Modelica."""

import json
import re

import numpy as np
from numpy.typing import NDArray


def declared_array(text: str, name: str) -> NDArray[np.float64]:
    """Array that the text declares under a name, checked against its declared sizes."""
    sizes, values = re.findall(rf" {name}\[([\d, ]+)\](?:\([^()]*\))? =\s+([^;\"]+)", text)[0]
    shape = tuple(map(int, sizes.split(",")))
    if values.startswith("zeros("):
        return np.zeros(shape)
    found = np.array(json.loads(values.replace("{", "[").replace("}", "]")))
    assert found.shape == shape
    return found
