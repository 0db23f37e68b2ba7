"""Parts with an outline known in part: they touch others, or leave the picture."""

from .candidates import propose_partial
from .cluster import CELL_PX, Cluster
from .depths import BURIED_CELLS, Depths, leaving_depths, lines_in_both
from .fits import PartialFit, fit_partial
from .parts import Explained, PartPlace, explain_cluster
from .planar import predicted_shares
from .together import are_one_place, best_set, by_place

__all__ = [
    "BURIED_CELLS",
    "CELL_PX",
    "Cluster",
    "Depths",
    "Explained",
    "PartPlace",
    "PartialFit",
    "are_one_place",
    "best_set",
    "by_place",
    "explain_cluster",
    "fit_partial",
    "leaving_depths",
    "lines_in_both",
    "predicted_shares",
    "propose_partial",
]
