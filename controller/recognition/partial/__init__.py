"""Parts with an outline known in part: they touch others, or leave the picture."""

from .candidates import propose_partial
from .cluster import CELL_PX, Cluster
from .fits import GOES_ON_MM, PartialFit, fit_partial
from .parts import (
    BURIED_CELLS,
    BURIED_MM,
    BURIED_SHARE,
    Explained,
    PartialLimits,
    PartPlace,
    explain_cluster,
)
from .planar import predicted_shares, shares_met
from .together import are_one_place, best_set, by_place

__all__ = [
    "BURIED_CELLS",
    "BURIED_MM",
    "BURIED_SHARE",
    "CELL_PX",
    "GOES_ON_MM",
    "Cluster",
    "Explained",
    "PartPlace",
    "PartialFit",
    "PartialLimits",
    "are_one_place",
    "best_set",
    "by_place",
    "explain_cluster",
    "fit_partial",
    "predicted_shares",
    "propose_partial",
    "shares_met",
]
