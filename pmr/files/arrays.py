"""Types that all rooms use in signatures: of arrays, and of what summaries hold."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
#: Content of a file of JSON such as summary.json, or of a table in it: numbers, texts, lists and tables by their keys.
Summary = Mapping[str, Any]
