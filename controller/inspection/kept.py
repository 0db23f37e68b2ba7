"""Kept results, so that a part's views need not be evaluated twice.

Each entry follows from objects that never change, and from nothing else: pictures, a view, a pose.
What is kept is what working it out again would give, so that a part that was worked on ahead, view
by view, comes to the same as one that is judged all at once.
"""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

Made = TypeVar("Made")


class Same:
    """An object as part of a key, compared by identity.

    Parameters
    ----------
    it : the object; it lives as long as the key
    """

    __slots__ = ("_it",)

    def __init__(self, it: object) -> None:
        self._it = it

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same) and other._it is self._it

    def __hash__(self) -> int:
        return id(self._it)


class Kept:
    """Results from a part's pictures, by their inputs."""

    def __init__(self) -> None:
        self._made: dict[Hashable, Any] = {}

    @property
    def count(self) -> int:
        """Number of results so far."""
        return len(self._made)

    def once(self, make: Callable[[], Made], *key: Hashable) -> Made:
        """Return the value kept for a key; make it if there is none.

        Parameters
        ----------
        make : makes it; whatever it depends on is in the key
        key : objects that never change, by value or, if they do not compare, by identity
        """
        if key not in self._made:
            self._made[key] = make()
        return cast("Made", self._made[key])
