"""Grey chain: short pieces of edges in a grey picture, and the views they may be of.

The paper (references.md P3.2) goes from edge points to lines, corners and hypotheses by a line
between two corners. Here edge points propose views at once (docs/paper.md): for tables that are not
backlit, and for cases that silhouettes cannot decide.
"""

from ._edgelets import Edgelets, picture_edgelets
from ._index import EdgeletIndex, edgelet_index
from ._model import view_edgelets
from ._sweep import PlacedView, swept

__all__ = [
    "EdgeletIndex",
    "Edgelets",
    "PlacedView",
    "edgelet_index",
    "picture_edgelets",
    "swept",
    "view_edgelets",
]
