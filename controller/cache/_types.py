"""Turn values of annotated types into JSON and arrays, and back.

A codec is made from a type's own annotations. A value that an annotation does not allow is refused
when it is written, and again when it is read. Nothing is executed, and a file can name only the
classes that the annotation allows.
"""

import collections.abc
import enum
import types
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from math import isfinite
from typing import Annotated, Any, Literal, NewType, Union, get_args, get_origin, get_type_hints

import numpy as np

from messages import Message
from messages.form import as_json, of_json

from .file import AnyArray, ArrayReader, ArrayWriter, CacheError

Json = Any  # a tree of JSON values


@dataclass(frozen=True, slots=True)
class Codec:
    """Writes and reads values of one type.

    Attributes
    ----------
    name : the type in words
    accepts : whether a value may be of this type, as opposed to another type of a union
    write : value to JSON, its arrays put aside; raises TypeError if it is not of the type
    read : JSON to value; raises CacheError if it is not of the type
    """

    name: str
    accepts: Callable[[Any], bool]
    write: Callable[[Any, ArrayWriter], Json]
    read: Callable[[Json, ArrayReader], Any]


def make_codec(kind: object, special: Mapping[Any, Codec] | None = None) -> Codec:
    """Return the codec of a type, from its annotations.

    Parameters
    ----------
    kind : dataclass, tuple, mapping, union, literal, enum, NDArray of a dtype, bool, int, float,
        str, None, an alias of one of them
    special : codecs of types without annotations

    Raises
    ------
    TypeError : a type cannot be stored; the message says where in the tree it stands
    """
    return _make(kind, special or {}, ())


def one_of(kinds: Sequence[type], special: Mapping[Any, Codec] | None = None) -> Codec:
    """Return the codec of a base class whose values belong to one of these classes."""
    return _union([make_codec(kind, special) for kind in kinds])


def given(value: object) -> Codec:
    """Return the codec of a value that is not stored, since the reader already has it."""
    kind = type(value)

    def write(other: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if type(other) is not kind:
            raise _refusal(other, kind.__name__)

    return Codec(kind.__name__, lambda other: type(other) is kind, write, lambda tree, of: value)


def converted(
    kind: type, stored: Codec, take: Callable[[Any], Any], make: Callable[[Any], Any]
) -> Codec:
    """Return the codec of a class that is stored as a value of another type.

    Parameters
    ----------
    kind : the class
    stored : codec of what is stored in its place
    take, make : value to what is stored, and back; `make` raises CacheError if no value fits
    """

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if type(value) is not kind:
            raise _refusal(value, kind.__name__)
        return stored.write(take(value), to)

    return Codec(
        kind.__name__,
        lambda value: type(value) is kind,
        write,
        lambda tree, of: make(stored.read(tree, of)),
    )


def _make(kind: object, special: Mapping[Any, Codec], path: tuple[object, ...]) -> Codec:
    def inner(item: object) -> Codec:
        return _make(item, special, (*path, kind))

    if kind in path:
        raise TypeError(f"{kind}: holds itself; only trees can be stored")
    if isinstance(kind, Hashable) and kind in special:
        return special[kind]
    if kind is None or kind is type(None):
        return _choice("None", {None: None})
    if kind in (bool, int, float, str):
        return _SCALARS[kind]
    if isinstance(kind, NewType):
        return inner(kind.__supertype__)
    origin, args = get_origin(kind), get_args(kind)
    if hasattr(kind, "__value__"):
        return inner(_unaliased(kind if origin is None else origin, args))
    if origin is Annotated:
        return inner(args[0])
    if origin is Literal:
        return _choice(f"Literal{list(args)}", {value: value for value in args})
    if origin in (Union, types.UnionType):
        return _union([inner(arg) for arg in args])
    if origin is tuple and len(args) == 2 and args[1] is Ellipsis:
        return _run(inner(args[0]))
    if origin is tuple:
        return _row([inner(arg) for arg in args])
    if origin is collections.abc.Mapping:
        return _mapping(_row([inner(args[0]), inner(args[1])]))
    if origin is np.ndarray:
        return _array(_dtype_of(args[1]))
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return _choice(kind.__name__, {member.name: member for member in kind})
    if isinstance(kind, type) and is_dataclass(kind):
        if any(not field.init for field in fields(kind)):
            raise TypeError(f"{kind.__name__}: has fields its constructor does not take")
        hints = get_type_hints(kind, include_extras=True)
        return _record(kind, {field.name: inner(hints[field.name]) for field in fields(kind)})
    where = " in ".join(getattr(k, "__name__", str(k)) for k in reversed((*path, kind)))
    raise TypeError(f"{where}: cannot be stored")


def _unaliased(alias: Any, args: tuple[object, ...]) -> object:  # noqa: ANN401 - two classes are it
    """Return the type behind an alias of PEP 695, such as NumPy's `NDArray` from 2.5 on.

    Parameters
    ----------
    alias : alias of `typing` or of typing_extensions
    args : contents of its brackets; empty if it has none
    """
    value = alias.__value__
    if not args:
        return value
    of = dict(zip(alias.__type_params__, args, strict=True))
    named = tuple(of[parameter] for parameter in getattr(value, "__parameters__", ()))
    return value[named] if named else value


def _dtype_of(annotation: object) -> np.dtype[Any] | None:
    (scalar,) = get_args(annotation)
    if not (isinstance(scalar, type) and issubclass(scalar, np.generic)):
        return None  # NDArray[Any]
    return np.dtype(scalar)


def _refusal(value: object, name: str) -> TypeError:
    return TypeError(f"{type(value).__name__} {value!r:.80} where {name} is declared")


def _unexpected(tree: object, name: str) -> CacheError:
    return CacheError(f"{tree!r:.60} where {name} is expected")


def _scalar(kind: type, accepted: tuple[type, ...], is_stored: Callable[[Any], bool]) -> Codec:
    name = kind.__name__

    def accepts(value: object) -> bool:
        is_truth = isinstance(value, bool | np.bool_)
        return isinstance(value, accepted) and is_truth == (kind is bool)

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if not accepts(value):
            raise _refusal(value, name)
        try:
            stored = kind(value)
        except OverflowError as error:
            raise _refusal(value, name) from error
        if not is_stored(stored):
            raise _refusal(value, f"{name} of 64 bits")
        return stored

    def read(tree: Json, of: ArrayReader) -> Any:  # noqa: ANN401 - and gives one
        if type(tree) is not kind or not is_stored(tree):
            raise _unexpected(tree, name)
        if of.is_finite and isinstance(tree, float) and not isfinite(tree):
            raise _unexpected(tree, "a finite number")
        return tree

    return Codec(name, accepts, write, read)


def _text() -> Codec:
    """Return the codec of texts; a sentence is stored as its key and values."""

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if not isinstance(value, str):
            raise _refusal(value, "str")
        return as_json(value) if isinstance(value, Message) and value.values else str.__str__(value)

    def read(tree: Json, of: ArrayReader) -> str:
        if type(tree) is str:
            return tree
        if type(tree) is not dict:
            raise _unexpected(tree, "str")
        try:
            return of_json(tree)
        except ValueError as error:
            raise _unexpected(tree, "a sentence") from error

    return Codec("str", lambda value: isinstance(value, str), write, read)


_SCALARS: dict[Any, Codec] = {
    bool: _scalar(bool, (bool, np.bool_), lambda value: True),
    int: _scalar(int, (int, np.integer), lambda value: -(2**63) <= value < 2**63),
    float: _scalar(float, (float, int, np.floating, np.integer), lambda value: True),
    str: _text(),
}


def _choice(name: str, choices: Mapping[Any, Any]) -> Codec:
    """Return the codec of a type with a few known values: literals, members of an enum, None."""
    stored = {(type(value), value): key for key, value in choices.items()}
    values = {(type(key), key): value for key, value in choices.items()}

    def accepts(value: object) -> bool:
        return isinstance(value, Hashable) and (type(value), value) in stored

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if not accepts(value):
            raise _refusal(value, name)
        return stored[type(value), value]

    def read(tree: Json, of: ArrayReader) -> Any:  # noqa: ANN401 - and gives one
        if not isinstance(tree, Hashable) or (type(tree), tree) not in values:
            raise _unexpected(tree, name)
        return values[type(tree), tree]

    return Codec(name, accepts, write, read)


def _union(codecs: Sequence[Codec]) -> Codec:
    """Return the codec of a union, which stores the type of a value and the value."""
    name = " | ".join(codec.name for codec in codecs)

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        for number, codec in enumerate(codecs):
            if codec.accepts(value):
                return [number, codec.write(value, to)]
        raise _refusal(value, name)

    def read(tree: Json, of: ArrayReader) -> Any:  # noqa: ANN401 - and gives one
        if type(tree) is not list or len(tree) != 2 or type(tree[0]) is not int:
            raise _unexpected(tree, name)
        number, inner = tree
        if not 0 <= number < len(codecs):
            raise _unexpected(tree, name)
        return codecs[number].read(inner, of)

    return Codec(name, lambda value: any(codec.accepts(value) for codec in codecs), write, read)


def _run(item: Codec) -> Codec:
    """Return the codec of tuples of any length."""
    name = f"tuple[{item.name}, ...]"

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if not isinstance(value, tuple):
            raise _refusal(value, name)
        return [item.write(one, to) for one in value]

    def read(tree: Json, of: ArrayReader) -> tuple[Any, ...]:
        if type(tree) is not list:
            raise _unexpected(tree, name)
        return tuple([item.read(one, of) for one in tree])

    return Codec(name, lambda value: isinstance(value, tuple), write, read)


def _row(items: Sequence[Codec]) -> Codec:
    """Return the codec of tuples of fixed length."""
    name = f"tuple[{', '.join(item.name for item in items)}]"

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if type(value) is not tuple or len(value) != len(items):
            raise _refusal(value, name)
        return [item.write(one, to) for item, one in zip(items, value, strict=True)]

    def read(tree: Json, of: ArrayReader) -> tuple[Any, ...]:
        if type(tree) is not list or len(tree) != len(items):
            raise _unexpected(tree, name)
        return tuple([item.read(one, of) for item, one in zip(items, tree, strict=True)])

    return Codec(name, lambda value: type(value) is tuple, write, read)


def _mapping(pair: Codec) -> Codec:
    """Return the codec of mappings of any length."""
    name = f"mapping of {pair.name}"

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if not isinstance(value, Mapping):
            raise _refusal(value, name)
        return [pair.write(item, to) for item in value.items()]

    def read(tree: Json, of: ArrayReader) -> dict[Any, Any]:
        if type(tree) is not list:
            raise _unexpected(tree, name)
        found = dict(pair.read(item, of) for item in tree)
        if len(found) != len(tree):
            raise CacheError("a mapping has a key twice")
        return found

    return Codec(name, lambda value: isinstance(value, Mapping), write, read)


def _record(kind: type, items: Mapping[str, Codec]) -> Codec:
    """Return the codec of a dataclass."""

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if type(value) is not kind:
            raise _refusal(value, kind.__name__)
        return {name: item.write(getattr(value, name), to) for name, item in items.items()}

    def read(tree: Json, of: ArrayReader) -> Any:  # noqa: ANN401 - and gives one
        if type(tree) is not dict or tree.keys() != items.keys():
            raise _unexpected(tree, kind.__name__)
        return kind(**{name: item.read(tree[name], of) for name, item in items.items()})

    return Codec(kind.__name__, lambda value: type(value) is kind, write, read)


def _array(dtype: np.dtype[Any] | None) -> Codec:
    """Return the codec of arrays of a dtype; None stands for any dtype of numbers."""
    name = f"array of {dtype or 'numbers'}"

    def write(value: Any, to: ArrayWriter) -> Json:  # noqa: ANN401 - a codec takes any value
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf":
            raise _refusal(value, name)
        return to.put(_widened(np.asarray(value), dtype))

    def read(tree: Json, of: ArrayReader) -> AnyArray:
        array = of.get(tree)
        if dtype is not None and array.dtype != dtype:
            raise _unexpected(tree, name)
        return array

    return Codec(name, lambda value: isinstance(value, np.ndarray), write, read)


def _widened(array: AnyArray, dtype: np.dtype[Any] | None) -> AnyArray:
    """Return an array in the declared dtype; raise TypeError if that changes a value."""
    if dtype is None or array.dtype == dtype:
        return array
    cast = array.astype(dtype)
    is_same_kind = np.can_cast(array.dtype, dtype, "same_kind")
    if not (is_same_kind and np.array_equal(cast, array, equal_nan=array.dtype.kind == "f")):
        raise TypeError(f"an array of {array.dtype} where {dtype} is declared")
    return cast
