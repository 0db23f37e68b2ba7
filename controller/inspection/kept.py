"""Cache of results, so that a part's views need not be evaluated twice.

A function marked as a `stage` is computed once for its arguments. They never change: pictures, a
view, a pose. A cached result equals a recomputed one, so a part evaluated in advance, view by view,
has the same result as one judged all at once.
"""

from collections.abc import Callable, Hashable
from functools import partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

Made = TypeVar("Made")
Arguments = ParamSpec("Arguments")


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
        self._count = 0

    @property
    def count(self) -> int:
        """Number of results computed so far, those that were dropped included."""
        return self._count

    def once(self, make: Callable[[], Made], *key: Hashable) -> Made:
        """Return the cached value of a key; compute it if there is none.

        Parameters
        ----------
        make : function that computes it; the key contains everything that it depends on
        key : objects that never change, by value or, if they have no equality, by identity
        """
        if key not in self._made:
            self._made[key] = make()
            self._count += 1
        return cast("Made", self._made[key])

    def forget(self, *key: Hashable) -> None:
        """Drop the value of a key, of a stage and its arguments, if there is one."""
        self._made.pop(key, None)


def stage(
    function: Callable[Concatenate[Kept, Arguments], Made],
) -> Callable[Concatenate[Kept, Arguments], Made]:
    """Return a function as a stage: what it has made of the same arguments is kept.

    Parameters
    ----------
    function : its first argument is the cache; the others never change, and are compared by value
        or, if they have no equality, by identity
    """

    @wraps(function)
    def once(kept: Kept, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Made:
        assert not kwargs, "arguments of a stage are its key, in order"
        return kept.once(partial(function, kept, *args, **kwargs), once, *args)

    return once


def stage_of(
    make: Callable[Arguments, Made],
) -> Callable[Concatenate[Kept, Arguments], Made]:
    """Return a function that asks for no other stage as a stage, the cache before its arguments.

    Parameters
    ----------
    make : its arguments never change; see `stage`
    """

    @stage
    @wraps(make)
    def made(kept: Kept, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Made:
        return make(*args, **kwargs)

    return made
