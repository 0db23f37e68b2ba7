"""The sentence that carries its key and its values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from string import Formatter
from types import MappingProxyType
from typing import Final, SupportsIndex, Union

Value = Union["Message", str, int, float]

COUNT: Final = "count"  # name of the value that decides between one and many


class Message(str):
    """A sentence in English, with the key and the values that it was made of. Immutable.

    Equal to its English, and hashed as it is. `str()`, `+`, pickling and copying keep key and
    values; an f-string, `join` and slicing make plain English.

    Attributes
    ----------
    key : English template, with named blanks as `str.format` has them; the sentence itself where
        there are no values
    values : content of the blanks: figures, names, or sentences in their turn
    many : template for other counts than one, by the value `count`; empty for a single template
    """

    __slots__ = ("key", "many", "values")
    key: str
    values: Mapping[str, Value]
    many: str

    def __new__(
        cls, key: str, values: Mapping[str, Value] | None = None, many: str = ""
    ) -> Message:
        """Make the sentence.

        Parameters
        ----------
        key, values, many : as the attributes

        Raises
        ------
        ValueError : a blank without its value, or a value that its format does not fit
        """
        content = MappingProxyType(dict(values or {}))
        template = many if many and content[COUNT] != 1 else key
        made = super().__new__(cls, filled(template, content) if content else template)
        made.key, made.values, made.many = key, content, many
        return made

    def __str__(self) -> Message:
        """Return the sentence with its key, so that `str()` of an error keeps both."""
        return self

    def __add__(self, other: str) -> Message:
        """Return this sentence with a text behind it."""
        return joined("", (self, other))

    def __radd__(self, other: str) -> Message:
        """Return this sentence with a text before it."""
        return joined("", (other, self))

    def __reduce_ex__(self, _: SupportsIndex) -> tuple[Callable[..., Message], tuple[object, ...]]:
        """Return how pickle makes it again."""
        return Message, (self.key, dict(self.values), self.many)

    def __copy__(self) -> Message:
        """Return itself."""
        return self

    def __deepcopy__(self, _: object) -> Message:
        """Return itself."""
        return self


def filled(
    template: str,
    values: Mapping[str, Value],
    written: Callable[[Value, str], str] = format,
) -> str:
    """Return a template with its blanks filled in.

    Parameters
    ----------
    template : as `str.format` has it
    values : by name of the blank
    written : returns a value as text, by its format; by default as English has it

    Raises
    ------
    ValueError : a blank without its value, or a value that its format does not fit
    """
    pieces = []
    for text, name, spec, _ in Formatter().parse(template):
        pieces.append(text)
        if name is not None:
            if name not in values:
                raise ValueError(f"{template!r} has no value `{name}`")
            pieces.append(written(values[name], spec or ""))
    return "".join(pieces)


def say(template: str, /, **values: object) -> Message:
    """Return a sentence; `pybabel extract` finds its template by the name of this function.

    Parameters
    ----------
    template : in English; a blank is `{name}`, or `{name:.3f}` with the format of its figure
    values : content of the blanks. Figures and sentences stay what they are; anything else, such
        as a path or an error, becomes its text
    """
    return Message(template, {name: _kept(value) for name, value in values.items()})


def key(text: str) -> str:
    """Return a template, or a text without values, unchanged: `pybabel extract` finds it so."""
    return text


def say_counted(one: str, many: str, /, *, count: int, **values: object) -> Message:
    """Return a sentence about a number of things.

    Parameters
    ----------
    one, many : templates for one thing, and for any other number, with the blank `{count}`
    count : number of things
    values : content of the other blanks
    """
    return Message(one, {COUNT: count} | {n: _kept(value) for n, value in values.items()}, many)


def joined(separator: str, texts: Iterable[str]) -> Message:
    """Return sentences with a separator between them; each is put into words on its own."""
    every = tuple(texts)
    if len(every) == 1 and isinstance(every[0], Message):
        return every[0]
    between = separator.replace("{", "{{").replace("}", "}}")
    return Message(
        between.join(f"{{{k}}}" for k in range(len(every))),
        {str(k): _kept(text) for k, text in enumerate(every)},
    )


def _kept(value: object) -> Value:
    if isinstance(value, Message):
        return value
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, bool):
        return str(value)
    if isinstance(value, int):
        return int(value)
    if getattr(value, "ndim", None) == 0 and callable(item := getattr(value, "item", None)):
        return _kept(item())  # a scalar of numpy
    if isinstance(value, float):
        return float(value)
    return str(value)
