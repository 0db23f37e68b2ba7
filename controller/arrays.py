"""Names for arrays by what they hold; each function says their shape, unit and frame."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
IndexArray = NDArray[np.intp]  # of another array
Grey = NDArray[np.uint8]  # a picture, (height, width)
