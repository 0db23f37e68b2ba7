"""Tallies of a device in words."""

import dataclasses
from typing import TYPE_CHECKING

from messages import key

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def tally_words(before: "DataclassInstance", after: "DataclassInstance") -> str:
    """Return in words what was counted between two states of tallies, as ``3 stale, 1 short``.

    Parameters
    ----------
    before, after : two states of one dataclass of counts, whose names end in ``_count``
    """
    counted = [
        f"{count} {field.name.removesuffix('_count').replace('_', ' ')}"
        for field in dataclasses.fields(after)
        if (count := getattr(after, field.name) - getattr(before, field.name))
    ]
    return ", ".join(counted) if counted else key("no frame came at all")
