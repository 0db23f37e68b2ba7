"""Visibility of the bare part from each direction, on the table, and reasons for the rest."""

from ._directions import (
    SEARCHED_COUNT,
    candidate_directions,
    directions_into_wedges,
    even_sphere,
    helping_most,
    hidden_ones,
    look_out,
    most_worth,
    with_directions,
)
from ._hidden import why_hidden
from ._rules import PICTURE_MARGIN_PX, VisibilityRules, in_picture
from ._table import table_views
from ._visible import eyes_of, free_pairs, visible_from

__all__ = [
    "PICTURE_MARGIN_PX",
    "SEARCHED_COUNT",
    "VisibilityRules",
    "candidate_directions",
    "directions_into_wedges",
    "even_sphere",
    "eyes_of",
    "free_pairs",
    "helping_most",
    "hidden_ones",
    "in_picture",
    "look_out",
    "most_worth",
    "table_views",
    "visible_from",
    "why_hidden",
    "with_directions",
]
