"""Views that resolve an ambiguity: which of several hypotheses is in the arm gripper.

Recognition may leave a part ambiguous with its mirror twin, or with a pose that looks alike from
above. Pictures of all hypotheses are predicted for the views a common grasp can reach; the cheapest
views whose pictures differ for any seat of the part in the arm gripper resolve it.
"""

from ..model import LIGHTS, HeldHypothesis, Light
from ._difference import difference
from ._identify import Identification, apart, compare, discriminate, edges_shown
from ._measured import measured_picture
from ._offer import offered_views
from ._pictures import EdgePicture, Stance, box_caster, predict
from ._rules import DisambiguationRules
from ._separate import (
    HypothesisModel,
    PredictedPictures,
    Separations,
    model_of,
    predict_view,
    separations,
)
from ._tree import (
    DecidingView,
    DisambiguationTree,
    Indistinguishable,
    cheapest_tree,
    separating_views,
)

__all__ = [
    "LIGHTS",
    "DecidingView",
    "DisambiguationRules",
    "DisambiguationTree",
    "EdgePicture",
    "HeldHypothesis",
    "HypothesisModel",
    "Identification",
    "Indistinguishable",
    "Light",
    "PredictedPictures",
    "Separations",
    "Stance",
    "apart",
    "box_caster",
    "cheapest_tree",
    "compare",
    "difference",
    "discriminate",
    "edges_shown",
    "measured_picture",
    "model_of",
    "offered_views",
    "predict",
    "predict_view",
    "separating_views",
    "separations",
]
