"""Names for arrays by what they hold; each function says their shape, unit and frame."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]
ByteArray = NDArray[np.uint8]
BoolArray = NDArray[np.bool_]
# Numbers of places in another array.
IndexArray = NDArray[np.intp]
# A picture, (height, width).
Grey = NDArray[np.uint8]
# A picture in colour, (height, width, 3).
Picture = NDArray[np.uint8]
