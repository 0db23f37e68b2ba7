"""Grey chain: lines, corners and circles of a grey picture, and the views they may be of.

The paper (references.md P3.2): for tables that are not backlit, and for cases that silhouettes
cannot decide.
"""

from ._tolerances import GreyTolerances
from .features.arcs import Circles
from .features.corners import Corners, Junctions
from .features.extract import Edgelets, ImageFeatures, image_features
from .matching.hypotheses import ViewHypothesis, propose, rate
from .matching.index import FeatureIndex, feature_index
from .matching.model import ModelFeatures, model_features
from .matching.sweep import swept

__all__ = [
    "Circles",
    "Corners",
    "Edgelets",
    "FeatureIndex",
    "GreyTolerances",
    "ImageFeatures",
    "Junctions",
    "ModelFeatures",
    "ViewHypothesis",
    "feature_index",
    "image_features",
    "model_features",
    "propose",
    "rate",
    "swept",
]
