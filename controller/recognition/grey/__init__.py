"""Grey chain: lines, corners and circles of a grey picture, and which view they may be of.

The paper (references.md P3.2): for tables that are not backlit, and for what silhouettes cannot
decide.
"""

from ._arcs import Circles
from ._corners import Corners, Junctions
from ._features import Edgelets, ImageFeatures, image_features
from ._hypotheses import Hypothesis, propose, rate
from ._index import FeatureIndex, feature_index
from ._matches import Matches, matches
from ._model import ModelFeatures, model_features
from ._tolerances import GreyTolerances

__all__ = [
    "Circles",
    "Corners",
    "Edgelets",
    "FeatureIndex",
    "GreyTolerances",
    "Hypothesis",
    "ImageFeatures",
    "Junctions",
    "Matches",
    "ModelFeatures",
    "feature_index",
    "image_features",
    "matches",
    "model_features",
    "propose",
    "rate",
]
