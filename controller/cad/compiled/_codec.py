"""Trees of dataclasses as columns of arrays, and back; knows types, not parts.

A codec is made from a type's own annotations. What an annotation does not allow is refused when it
is written, and again when it is read: nothing is executed, and no class is named by a file.
"""

import collections.abc
import enum
import types
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import (
    Annotated,
    Any,
    Literal,
    NewType,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from ._columns import Alternatives, Arrays, Choices, Codec, Mappings, Records, Runs, Scalars, Words

SCALARS: dict[Any, Callable[[], Codec]] = {
    bool: lambda: Scalars(bool, "bool", (bool, np.bool_)),
    int: lambda: Scalars(int, "int64", (int, np.integer)),
    float: lambda: Scalars(float, "float64", (float, int, np.floating, np.integer)),
    str: Words,
    None: lambda: Choices("None", (None,)),
    type(None): lambda: Choices("None", (None,)),
}


def make_codec(kind: object, special: Mapping[Any, Codec] | None = None) -> Codec:
    """Return the codec of a type, from its annotations.

    Parameters
    ----------
    kind : dataclass, tuple, mapping, union, literal, enum, NDArray of a dtype, bool, int, float,
        str, None
    special : codecs of types that have no annotations to go by

    Raises
    ------
    TypeError : a type that cannot be stored, and where in the tree it stands
    """
    return _make(kind, special or {}, ())


def one_of(kinds: Sequence[type], special: Mapping[Any, Codec] | None = None) -> Codec:
    """Return the codec of a base class: a value is of one of these classes."""
    return Alternatives([make_codec(kind, special) for kind in kinds])


def _make(kind: object, special: Mapping[Any, Codec], way: tuple[object, ...]) -> Codec:
    def inner(item: object) -> Codec:
        return _make(item, special, (*way, kind))

    if kind in way:
        raise TypeError(f"{kind}: holds itself; only trees can be stored")
    if isinstance(kind, Hashable) and kind in special:
        return special[kind]
    if kind in SCALARS:
        return SCALARS[kind]()
    if isinstance(kind, NewType):
        return inner(kind.__supertype__)
    origin, args = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return inner(args[0])
    if origin is Literal:
        return Choices(f"Literal{list(args)}", args)
    if origin in (Union, types.UnionType):
        return Alternatives([inner(arg) for arg in args])
    if origin is tuple and len(args) == 2 and args[1] is Ellipsis:
        return Runs(inner(args[0]))
    if origin is tuple:
        return Records("tuple", tuple, [inner(arg) for arg in args], tuple, lambda *row: row)
    if origin is collections.abc.Mapping:
        return Mappings(inner(args[0]), inner(args[1]))
    if origin is np.ndarray:
        return Arrays(_dtype_of(args[1]))
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        names = ", ".join(f"{member.name}={member.value!r}" for member in kind)
        return Choices(f"{kind.__name__}[{names}]", list(kind))
    if isinstance(kind, type) and is_dataclass(kind):
        return _make_record(kind, inner)
    where = " in ".join(getattr(k, "__name__", str(k)) for k in reversed((*way, kind)))
    raise TypeError(f"{where}: cannot be stored")


def _dtype_of(annotation: object) -> np.dtype[Any] | None:
    (scalar,) = get_args(annotation)
    if not (isinstance(scalar, type) and issubclass(scalar, np.generic)):
        return None  # NDArray[Any]
    return np.dtype(scalar)


def _make_record(kind: type, inner: Callable[[Any], Codec]) -> Codec:
    if any(not field.init for field in fields(kind)):
        raise TypeError(f"{kind.__name__}: has fields its constructor does not take")
    hints = get_type_hints(kind, include_extras=True)
    names = [field.name for field in fields(kind)]

    def by_name(*row: object) -> object:
        return kind(**dict(zip(names, row, strict=True)))

    is_in_order = not any(field.kw_only for field in fields(kind))
    return Records(
        f"{kind.__name__}[{' '.join(names)}]",
        kind,
        [inner(hints[name]) for name in names],
        lambda value: [getattr(value, name) for name in names],
        kind if is_in_order else by_name,
    )
