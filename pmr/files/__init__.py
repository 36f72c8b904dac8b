"""Files that are written completely or not at all, and readers that treat every file as data of unknown origin.

Also the types of arrays that all rooms above use in signatures.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
