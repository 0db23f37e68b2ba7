"""The history: one store for all runs of a cell, filled from their journals. Controls nothing.

`open_store` opens it, `fill` adds new rows of the journals, `list_parts`, `find_parts` and
`figures` read it. The journal is the evidence, the store an index of it that can be rebuilt.
"""

from .errors import HistoryError, NoSuchPartError
from .exporting import FORMS, export
from .figures import GROUPS, EventCount, Figures, Group, figures, group_json, tally_json
from .filling import Filled, fill, folded, journals_by_key
from .migrations import SCHEMA_VERSION
from .queries import REVIEWS_ASKED, SORTS, Filters, Listed, find_parts, list_parts
from .series import cells_in, characteristics_in, recipes_in, values_of
from .store import STORE_NAME, VARIABLE, Store, open_store, store_url

__all__ = [
    "FORMS",
    "GROUPS",
    "REVIEWS_ASKED",
    "SCHEMA_VERSION",
    "SORTS",
    "STORE_NAME",
    "VARIABLE",
    "EventCount",
    "Figures",
    "Filled",
    "Filters",
    "Group",
    "HistoryError",
    "Listed",
    "NoSuchPartError",
    "Store",
    "cells_in",
    "characteristics_in",
    "export",
    "figures",
    "fill",
    "find_parts",
    "folded",
    "group_json",
    "journals_by_key",
    "list_parts",
    "open_store",
    "recipes_in",
    "store_url",
    "tally_json",
    "values_of",
]
