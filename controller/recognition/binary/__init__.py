"""The paper's binary chain: boundary codes, corners, strings of primitives, their correlation."""

from ._chain import Chain, chain_code, curvature_code
from ._corners import BoundaryCorners, corner_table, find_corners, triangular
from ._correlate import StringMatch, correlate
from ._size import Size, chain_length_px, size_of_chains, size_of_string
from ._stretches import STRETCHES_MM, StretchIndex, like, observed_stretches, stretch_index
from ._strings import BoundaryString, NoOutlineError, boundary_string, model_string
from ._tolerances import BinaryTolerances

__all__ = [
    "STRETCHES_MM",
    "BinaryTolerances",
    "BoundaryCorners",
    "BoundaryString",
    "Chain",
    "NoOutlineError",
    "Size",
    "StretchIndex",
    "StringMatch",
    "boundary_string",
    "chain_code",
    "chain_length_px",
    "corner_table",
    "correlate",
    "curvature_code",
    "find_corners",
    "like",
    "model_string",
    "observed_stretches",
    "size_of_chains",
    "size_of_string",
    "stretch_index",
    "triangular",
]
