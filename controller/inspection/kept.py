"""Cache of results, so that a part's views need not be evaluated twice.

Each entry depends only on objects that never change: pictures, a view, a pose. A cached result
equals a recomputed one, so a part evaluated in advance, view by view, has the same result as one
judged all at once.
"""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

Made = TypeVar("Made")


class Same:
    """Part of a key that is compared by the identity of an object.

    Parameters
    ----------
    it : the object, which lives as long as the key
    """

    __slots__ = ("_it",)

    def __init__(self, it: object) -> None:
        self._it = it

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other._it is self._it

    def __hash__(self) -> int:
        return id(self._it)


class Kept:
    """Results from a part's pictures, keyed by their inputs."""

    def __init__(self) -> None:
        self._made: dict[Hashable, Any] = {}

    @property
    def count(self) -> int:
        """Number of results so far."""
        return len(self._made)

    def once(self, make: Callable[[], Made], *key: Hashable) -> Made:
        """Return the cached value of a key; compute it if there is none.

        Parameters
        ----------
        make : function that computes it; the key contains everything that it depends on
        key : objects that never change, by value or, if they have no equality, by identity
        """
        if key not in self._made:
            self._made[key] = make()
        return cast("Made", self._made[key])
