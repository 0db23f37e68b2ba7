"""Columns of values as arrays, one class per kind of type.

A codec works on whole columns: all strokes of all loops of all views are one array of starts, one
of ends, and so on, so that reading ten thousand small objects costs a few dozen array look-ups and
one constructor call each.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from itertools import accumulate, chain, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

AnyArray = NDArray[Any]
Tree = list[Any]  # what of a column goes into the header: numbers of arrays, words, lists of these


class CodecError(Exception):
    """What is read is not what its type says."""


class Writer:
    """Collects arrays; a tree refers to them by number."""

    def __init__(self) -> None:
        self.arrays: list[AnyArray] = []

    def put(self, array: AnyArray) -> int:
        """Take an array and return its number."""
        self.arrays.append(np.ascontiguousarray(array).reshape(np.shape(array)))
        return len(self.arrays) - 1


class Reader:
    """Hands out arrays by number, each checked before it is used.

    Parameters
    ----------
    is_finite : refuse arrays that hold an infinity or what is no number
    """

    def __init__(self, arrays: Sequence[AnyArray], *, is_finite: bool = False) -> None:
        self._arrays = arrays
        self._is_finite = is_finite

    def get(self, number: object, dtype: str, count: int) -> AnyArray:
        """Return a flat array of a known type and length."""
        array = self.any(number)
        if array.dtype != np.dtype(dtype) or array.shape != (count,):
            raise CodecError(f"array {number}: {array.dtype} {array.shape}, {dtype} {count} asked")
        return array

    def any(self, number: object) -> AnyArray:
        """Return an array as it was put."""
        if type(number) is not int or not 0 <= number < len(self._arrays):
            raise CodecError(f"no array {number!r}")
        array = self._arrays[number]
        if self._is_finite and array.dtype.kind == "f" and not np.isfinite(array).all():
            raise CodecError(f"array {number} holds values that are no numbers")
        return array


class Codec(ABC):
    """Writes and reads columns of one type.

    Attributes
    ----------
    says : the type in words; two types that are stored alike say the same
    """

    says: str

    @abstractmethod
    def accepts(self, value: object) -> bool:
        """Tell whether a value may be of this type, told apart from its neighbours in a union."""

    @abstractmethod
    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        """Store a column; TypeError where a value is not of the type."""

    @abstractmethod
    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        """Return a column of ``count`` values; CodecError where it is not there."""


def _refuse(value: object, says: str) -> TypeError:
    return TypeError(f"{type(value).__name__} {value!r:.80} where {says} is declared")


def parts_of(tree: object, count: int) -> list[Any]:
    """Return a tree's branches, CodecError where it has not as many."""
    if not isinstance(tree, list) or len(tree) != count:
        raise CodecError(f"a list of {count} is asked")
    return tree


class Scalars(Codec):
    """Numbers and truths, as one flat array."""

    def __init__(self, kind: type, stored: str, taken: tuple[type, ...]) -> None:
        self.says = kind.__name__
        self._kind = kind
        self._stored = stored
        self._taken = taken

    def accepts(self, value: object) -> bool:
        is_truth = isinstance(value, bool | np.bool_)
        return isinstance(value, self._taken) and is_truth == (self._kind is bool)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not self.accepts(value):
                raise _refuse(value, self.says)
        try:
            return [to.put(np.array(column, dtype=self._stored))]
        except OverflowError as error:
            raise TypeError(f"{self.says} of more than 64 bits") from error

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        (number,) = parts_of(tree, 1)
        return list(of.get(number, self._stored, count).tolist())


class Words(Codec):
    """Text, in the header."""

    says = "str"

    def accepts(self, value: object) -> bool:
        return isinstance(value, str)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not isinstance(value, str):
                raise _refuse(value, self.says)
        return [str(value) for value in column]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        words = parts_of(tree, count)
        if not all(type(word) is str for word in words):
            raise CodecError("words are asked")
        return words


class Choices(Codec):
    """One of a few values known by the type: literals, members of an enum, None."""

    def __init__(self, says: str, choices: Sequence[Any]) -> None:
        self._choices = tuple(choices)
        self._numbers = {(type(choice), choice): i for i, choice in enumerate(self._choices)}
        self.says = says

    def accepts(self, value: object) -> bool:
        try:
            return (type(value), value) in self._numbers
        except TypeError:  # not hashable, so none of them
            return False

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not self.accepts(value):
                raise _refuse(value, self.says)
        numbers = [self._numbers[type(value), value] for value in column]
        return [to.put(np.array(numbers, dtype=np.int32))]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        (number,) = parts_of(tree, 1)
        numbers = of.get(number, "int32", count)
        if count and not 0 <= numbers.min() <= numbers.max() < len(self._choices):
            raise CodecError(f"no such choice of {self.says}")
        return [self._choices[i] for i in numbers.tolist()]


class Alternatives(Codec):
    """A union: which of its types each value is, then a column per type."""

    def __init__(self, codecs: Sequence[Codec]) -> None:
        self._codecs = tuple(codecs)
        self.says = "(" + " | ".join(codec.says for codec in codecs) + ")"

    def accepts(self, value: object) -> bool:
        return any(codec.accepts(value) for codec in self._codecs)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        tags, runs = [], [[] for _ in self._codecs]  # type: tuple[list[int], list[list[Any]]]
        for value in column:
            fits = [i for i, codec in enumerate(self._codecs) if codec.accepts(value)]
            if not fits:
                raise _refuse(value, self.says)
            tags.append(fits[0])
            runs[fits[0]].append(value)
        inner = [codec.write(run, to) for codec, run in zip(self._codecs, runs, strict=True)]
        return [to.put(np.array(tags, dtype=np.int8)), *inner]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        number, *inner = parts_of(tree, 1 + len(self._codecs))
        tags = of.get(number, "int8", count)
        if count and not 0 <= tags.min() <= tags.max() < len(self._codecs):
            raise CodecError(f"no such alternative of {self.says}")
        each = np.bincount(tags, minlength=len(self._codecs)).tolist()
        runs = [
            iter(codec.read(part, n, of))
            for codec, part, n in zip(self._codecs, inner, each, strict=True)
        ]
        return [next(runs[tag]) for tag in tags.tolist()]


class Runs(Codec):
    """Tuples of any length: all their items as one column, and how many each has."""

    def __init__(self, item: Codec) -> None:
        self._item = item
        self.says = f"tuple[{item.says}, ...]"

    def accepts(self, value: object) -> bool:
        return isinstance(value, tuple)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not isinstance(value, tuple):
                raise _refuse(value, self.says)
        lengths = np.array([len(value) for value in column], dtype=np.int64)
        return [to.put(lengths), self._item.write(list(chain.from_iterable(column)), to)]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        number, inner = parts_of(tree, 2)
        marks = _marks(of.get(number, "int64", count))
        items = self._item.read(inner, marks[-1], of)
        return [tuple(items[a:b]) for a, b in pairwise(marks)]


class Mappings(Codec):
    """Mappings of any length: all their keys as one column, all their values as another."""

    def __init__(self, key: Codec, value: Codec) -> None:
        self._key = key
        self._value = value
        self.says = f"mapping[{key.says}, {value.says}]"

    def accepts(self, value: object) -> bool:
        return isinstance(value, Mapping)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not isinstance(value, Mapping):
                raise _refuse(value, self.says)
        lengths = np.array([len(value) for value in column], dtype=np.int64)
        keys = [key for value in column for key in value]
        values = [item for value in column for item in value.values()]
        return [to.put(lengths), self._key.write(keys, to), self._value.write(values, to)]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        number, keys, values = parts_of(tree, 3)
        marks = _marks(of.get(number, "int64", count))
        items = list(
            zip(
                self._key.read(keys, marks[-1], of),
                self._value.read(values, marks[-1], of),
                strict=True,
            )
        )
        found = [dict(items[a:b]) for a, b in pairwise(marks)]
        if sum(map(len, found)) != len(items):
            raise CodecError("a mapping has a key twice")
        return found


class Records(Codec):
    """Tuples of fixed length, and anything made of fields: a column per field."""

    def __init__(
        self,
        says: str,
        kind: type,
        codecs: Sequence[Codec],
        take: Callable[[Any], Sequence[Any]],
        make: Callable[..., Any],
    ) -> None:
        self._kind = kind
        self._codecs = tuple(codecs)
        self._take = take
        self._make = make
        self.says = f"{says}({', '.join(codec.says for codec in codecs)})"

    def accepts(self, value: object) -> bool:
        return type(value) is self._kind

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not self.accepts(value):
                raise _refuse(value, self._kind.__name__)
        rows = [self._take(value) for value in column]
        if any(len(row) != len(self._codecs) for row in rows):
            raise TypeError(f"a tuple of another length than {self.says}")
        columns = list(zip(*rows, strict=True)) if rows else [()] * len(self._codecs)
        return [codec.write(part, to) for codec, part in zip(self._codecs, columns, strict=True)]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        inner = parts_of(tree, len(self._codecs))
        if not self._codecs:
            return [self._make() for _ in range(count)]
        columns = (
            codec.read(part, count, of) for codec, part in zip(self._codecs, inner, strict=True)
        )
        return list(map(self._make, *columns))


class Arrays(Codec):
    """Numpy arrays: as one array with how long each is, or one by one where they differ more."""

    def __init__(self, dtype: np.dtype[Any] | None) -> None:
        self._dtype = dtype
        self.says = f"array[{dtype or 'any'}]"

    def accepts(self, value: object) -> bool:
        return isinstance(value, np.ndarray)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        arrays = [self._taken(value) for value in column]
        shapes = {array.shape for array in arrays}
        dtypes = {array.dtype for array in arrays}
        if len(dtypes) == 1 and len(shapes) == 1:
            return ["alike", to.put(np.stack(arrays))]
        if len(dtypes) == 1 and () not in shapes and len({shape[1:] for shape in shapes}) == 1:
            lengths = np.array([len(array) for array in arrays], dtype=np.int64)
            return ["joined", to.put(lengths), to.put(np.concatenate(arrays))]
        return ["single", *(to.put(array) for array in arrays)]

    def _taken(self, value: object) -> AnyArray:
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            raise _refuse(value, self.says)
        array = np.asarray(value)
        if self._dtype is None or array.dtype == self._dtype:
            return array
        cast = array.astype(self._dtype)
        is_same_kind = np.can_cast(array.dtype, self._dtype, "same_kind")
        if not (is_same_kind and np.array_equal(cast, array, equal_nan=array.dtype.kind == "f")):
            raise TypeError(f"an array of {array.dtype} where {self.says} is declared")
        return cast

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        if not isinstance(tree, list) or not tree:
            raise CodecError("an array is asked")
        match tree:
            case ["alike", number]:
                stack = self._checked(number, of)
                # before it falls apart: a stack of empty arrays takes no room, its parts do
                if not stack.ndim or len(stack) != count:
                    raise CodecError(f"{count} arrays are asked, {stack.shape} is there")
                # of 0-dimensional ones, what falls apart are numpy's scalars
                arrays = list(stack) if stack.ndim > 1 else [np.asarray(one) for one in stack]
            case ["joined", lengths, number] if (joined := self._checked(number, of)).ndim:
                marks = _marks(of.get(lengths, "int64", count))
                if marks[-1] != len(joined):
                    raise CodecError("joined arrays are longer or shorter than their parts")
                arrays = [joined[a:b] for a, b in pairwise(marks)]
            case ["single", *numbers]:
                arrays = [self._checked(number, of) for number in numbers]
            case _:
                raise CodecError(f"arrays stored as {tree[0]!r:.20}")
        if len(arrays) != count:
            raise CodecError(f"{count} arrays are asked, {len(arrays)} are there")
        return arrays

    def _checked(self, number: object, of: Reader) -> AnyArray:
        array = of.any(number)
        if self._dtype is not None and array.dtype != self._dtype:
            raise CodecError(f"{self.says} is asked")
        return array


class Given(Codec):
    """What the reader has already: it is not stored, and every value read is this one."""

    def __init__(self, value: object) -> None:
        self.says = f"given {type(value).__name__}"
        self._value = value

    def accepts(self, value: object) -> bool:
        return type(value) is type(self._value)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        return []

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        return [self._value] * count


def _marks(lengths: AnyArray) -> list[int]:
    """Return where each of some runs starts, and the last one's end."""
    if len(lengths) and lengths.min() < 0:
        raise CodecError("a length below zero")
    return list(accumulate(lengths.tolist(), initial=0))
