"""An arm by its links alone: as it was made, whatever lengths it was drawn with."""

from dataclasses import dataclass

from ..chain import Chain


@dataclass(frozen=True, slots=True, eq=False)
class MadeShape:
    """An arm of any kind.

    Attributes
    ----------
    chain : its links
    """

    chain: Chain
