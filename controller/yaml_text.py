"""Read YAML texts with line numbers and within bounds; reword pydantic's errors for the writer.

The text is read from the parser's events, so that nesting, size and aliases are limited while
reading: a kilobyte of text must not unfold into gigabytes. A `Dialect` defines what a kind of file
may hold, and the messages to its writer.
"""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin

from pydantic import AliasChoices, BaseModel
from pydantic.fields import FieldInfo
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

Location = tuple[int | str, ...]

# Largest number in any file. Beyond it a double no longer holds every whole number, and results
# computed from a length overflow sooner or later.
LARGEST_NUMBER: Final = 1e15
NO_NUMBER: Final = f"is no number of sense; numbers are finite, {LARGEST_NUMBER:g} at most"
UNREADABLE: Final = "\ufffd"  # replacement in a text for bytes that are no text
DECIMAL_COMMA: Final = re.compile(r"([-+]?\d+),(\d+)")
MAX_PROBLEM_COUNT: Final = 10  # problems of one text that are reported at once


class YamlTextError(ValueError):
    """A text that is unreadable or has the wrong content; names file and line."""


class WrongKeyError(ValueError):
    """A check over several keys failed; `location` is the key to name, below its section."""

    def __init__(self, location: Location, problem: str) -> None:
        super().__init__(problem)
        self.location = location


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """Schema of a kind of YAML text, and the messages to its writer.

    Attributes
    ----------
    scalar : returns the value of a plain scalar's text; raises ValueError if it has none
    max_depth, too_deep : depth of nested mappings and lists, and the message beyond it
    max_value_count, too_many : count of keys, values, mappings and lists, and the message beyond it
    not_valid : endings of the message on invalid YAML: for a line, for the whole text
    alias, twice, second_document, no_mapping : messages; ``{key}`` is filled in
    words : messages by pydantic's type of error; ``{key}`` and ``{hint}`` are filled in. For other
        types the key is followed by pydantic's own message
    key : returns a location in the writer's notation
    names_first_line : whether a message on the whole text names its first line
    sorts_keys : whether known keys are listed in alphabetical order
    """

    scalar: Callable[[str], Any]
    max_depth: int
    too_deep: str
    max_value_count: int
    too_many: str
    not_valid: tuple[str, str]
    alias: str
    twice: str
    second_document: str
    no_mapping: str
    words: Mapping[str, str]
    key: Callable[[Location], str]
    names_first_line: bool
    sorts_keys: bool


@dataclass(frozen=True, slots=True)
class YamlText:
    """The content of a text, and the line of each key.

    Attributes
    ----------
    tree : mappings, lists and scalars
    lines : lines of each key and item, counted from 1
    """

    path: Path
    dialect: Dialect
    tree: dict[str, Any]
    lines: dict[Location, int] = field(repr=False)

    def line(self, location: Location) -> int | None:
        """Return the line of a key, or of the nearest section around it if the key is missing."""
        while location and location not in self.lines:
            location = location[:-1]
        return self.lines.get(location)

    def sentence(self, location: Location, problem: str) -> str:
        """Return a message with file, line, key and problem."""
        about = f"`{self.dialect.key(location)}`: " if location else ""
        return f"{self._at(location)}: {about}{problem}"

    def problems(self, model: type[BaseModel], errors: Sequence[Mapping[str, Any]]) -> str:
        """Return one message line for each of pydantic's errors, in the order of the text.

        Parameters
        ----------
        model : against which the tree was validated
        errors : as `ValidationError.errors` returns them
        """
        found = sorted(errors, key=lambda error: self.line(tuple(error["loc"])) or 0)
        lines = [self._explain(model, error) for error in found[:MAX_PROBLEM_COUNT]]
        if len(found) > MAX_PROBLEM_COUNT:
            rest = self.dialect.words["more"].format(count=len(found) - MAX_PROBLEM_COUNT)
            lines.append(f"{self.path}: {rest}")
        return "\n".join(lines)

    def _at(self, location: Location) -> str:
        line = self.line(location)
        return f"{self.path}:{line}" if line is not None else f"{self.path}"

    def _explain(self, model: type[BaseModel], error: Mapping[str, Any]) -> str:
        location: Location = tuple(error["loc"])
        own = error.get("ctx", {}).get("error")
        if isinstance(own, WrongKeyError):
            location += own.location
        kind, words, hint = error["type"], self.dialect.words, ""
        if kind == "extra_forbidden":
            if (twin := self._twin(model, location)) is not None:
                return f"{self._at(location)}: `{self.dialect.key(location)}` {twin}"
            known = keys_at(model, location[:-1])
            known = sorted(known) if self.dialect.sorts_keys else known
            hint = _nearest(str(location[-1]), known)
        elif kind == "missing" and isinstance(location[-1], int):
            # a list that is too short lacks an item, not a key
            kind, location = "too_few", location[:-1]
        elif kind == "value_error":  # one of our own messages
            return self.sentence(location, str(own))
        if kind in ("extra_forbidden", "missing", "too_few"):
            message = words[kind].format(key=self.dialect.key(location), hint=hint)
            return f"{self._at(tuple(error['loc']))}: {message}"
        found = f"(found {error['input']!r:.60})"
        if isinstance(error["input"], str) and DECIMAL_COMMA.fullmatch(error["input"]):
            found += f"; write a decimal point: {error['input'].replace(',', '.')}"
        return self.sentence(location, f"{words.get(kind, error['msg'])} {found}")

    def _twin(self, model: type[BaseModel], location: Location) -> str | None:
        """Return the message on a key that is also given under its new name."""
        *section, key = location
        for one in _models_at(model, tuple(section)):
            for name, *old in map(_spellings, one.model_fields, one.model_fields.values()):
                line = self.lines.get((*section, name))
                if key in old and line is not None:
                    return f"is the old name of `{name}` on line {line}; leave one out"
        return None


def read_yaml(text: str, path: Path, dialect: Dialect) -> YamlText:
    """Return the tree of a text and the line of each key.

    Parameters
    ----------
    text : text of the file
    path : named in messages
    dialect : limits of the file kind, and its words in messages

    Raises
    ------
    YamlTextError : not YAML, not a mapping, too deep, too large, or with anchors, aliases or tags
    """
    try:
        return _Builder(path, dialect).build(YAML(typ="rt", pure=True).parse(text))
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}" if mark is not None else ""
        problem = " ".join(str(error.problem).split())
        raise YamlTextError(
            f"{path}{where}: not valid YAML: {problem}{dialect.not_valid[0]}"
        ) from error
    except YAMLError as error:
        problem = " ".join(str(error).split())
        raise YamlTextError(
            f"{path}: not valid YAML: {problem:.200}{dialect.not_valid[1]}"
        ) from error
    except YamlTextError:
        raise
    except Exception as error:  # the parser may raise anything on garbage
        problem = " ".join(str(error).split())
        raise YamlTextError(
            f"{path}: not valid YAML: {problem:.200}; is it the right file?"
        ) from error


def keys_at(model: type[BaseModel], location: Location) -> list[str]:
    """Return the keys that the section at a location may have, by the models on the way to it.

    A key that was renamed has both names, the new one first.
    """
    return list(dict.fromkeys(key for one in _models_at(model, location) for key in _fields(one)))


def _models_at(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    """Return the possible models of the section at a location."""
    here: list[Any] = [model]
    for key in location:
        here = [section for one in here for section in _below(one, key)]
    return [one for one in here if _is_model(one)]


def _below(section: Any, key: int | str) -> list[Any]:  # noqa: ANN401 - a type is any value
    """Return the possible types of the value under a key of a section."""
    if _is_model(section):
        found = _fields(section).get(str(key))
        return [] if found is None else _types_in(found)
    if get_origin(section) in (dict, tuple, list):
        of = get_args(section)
        return _types_in(of[0] if len(of) == 1 else of[-1])
    return []


def _is_model(section: Any) -> bool:  # noqa: ANN401 - as above
    return isinstance(section, type) and issubclass(section, BaseModel)


def _fields(model: type[BaseModel]) -> dict[str, Any]:
    """Return the annotations of a model's fields, by their names in a text."""
    return {
        spelling: found.annotation
        for name, found in model.model_fields.items()
        for spelling in _spellings(name, found)
    }


def _spellings(name: str, field: FieldInfo) -> list[str]:
    """Return the names that a field may have in a text, the one in use first."""
    if isinstance(field.validation_alias, AliasChoices):
        return [str(choice) for choice in field.validation_alias.choices]
    return [field.alias or name]


def _types_in(annotation: Any) -> list[Any]:  # noqa: ANN401 - an annotation is any value
    """Return the types that an annotation allows, without their limits."""
    if get_origin(annotation) in (Union, UnionType):
        return [one for inner in get_args(annotation) for one in _types_in(inner)]
    if get_origin(annotation) is Annotated:
        return _types_in(get_args(annotation)[0])
    if get_args(annotation)[-1:] == (Ellipsis,):
        return [list[get_args(annotation)[0]]]  # type: ignore[misc]  # a type made at run time
    return [annotation]


def _nearest(key: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}"


@dataclass(slots=True)
class _Node:
    """A mapping or a list while it is being read."""

    value: dict[str, Any] | list[Any]
    location: Location
    key: str | None = None


class _Builder:
    """Builds one text's tree from the parser's events."""

    def __init__(self, path: Path, dialect: Dialect) -> None:
        self._path = path
        self._dialect = dialect
        self._open: list[_Node] = []
        self._root: Any = None
        self._lines: dict[Location, int] = {}

    def build(self, events: Iterable[Event]) -> YamlText:
        document_count, value_count = 0, 0
        for event in events:
            if isinstance(event, DocumentStartEvent):
                document_count += 1
                if document_count > 1:
                    raise self._problem(event, self._dialect.second_document)
            if isinstance(event, MappingEndEvent | SequenceEndEvent):
                self._open.pop()
            if not isinstance(event, NodeEvent):
                continue
            if isinstance(event, AliasEvent) or event.anchor:
                raise self._problem(
                    event, f"anchors (&) and aliases (*) are not read; {self._dialect.alias}"
                )
            if getattr(event, "tag", None):
                raise self._problem(event, "tags (!) are not read; write the plain value")
            value_count += 1
            if value_count > self._dialect.max_value_count:
                raise self._problem(event, self._dialect.too_many)
            self._take(event)
        if not isinstance(self._root, dict):
            raise YamlTextError(f"{self._path}: {self._dialect.no_mapping}")
        return YamlText(self._path, self._dialect, self._root, self._lines)

    def _problem(self, event: Event, problem: str) -> YamlTextError:
        return YamlTextError(f"{self._path}:{event.start_mark.line + 1}: {problem}")

    def _take(self, event: NodeEvent) -> None:
        """Put a node's value in its place, or note it as the key of the next value."""
        is_collection = isinstance(event, MappingStartEvent | SequenceStartEvent)
        if is_collection and len(self._open) >= self._dialect.max_depth:
            raise self._problem(event, self._dialect.too_deep)
        parent = self._open[-1] if self._open else None
        if isinstance(event, ScalarEvent) and UNREADABLE in str(event.value):
            raise self._problem(
                event, f"{event.value!s:.60} is not text in UTF-8; save the file as UTF-8"
            )
        if parent is not None and isinstance(parent.value, dict) and parent.key is None:
            if not isinstance(event, ScalarEvent):
                raise self._problem(event, "a key must be a word; is a `:` too many?")
            parent.key = str(event.value)
            if parent.key in parent.value:
                raise self._problem(event, self._dialect.twice.format(key=parent.key))
            self._lines[*parent.location, parent.key] = event.start_mark.line + 1
            return
        value = self._value(event)
        if (
            isinstance(event, ScalarEvent)
            and isinstance(value, int | float)
            and LARGEST_NUMBER < abs(value) < float("inf")
        ):
            key = f"`{parent.key}`: " if parent is not None and parent.key is not None else ""
            raise self._problem(event, f"{key}{value!s:.40} {NO_NUMBER}")
        location = self._put(parent, value)
        if parent is not None or self._dialect.names_first_line:
            self._lines.setdefault(location, event.start_mark.line + 1)
        if isinstance(value, dict | list):
            self._open.append(_Node(value, location))

    def _put(self, parent: _Node | None, value: Any) -> Location:  # noqa: ANN401
        if parent is None:
            self._root = value
            return ()
        if isinstance(parent.value, list):
            parent.value.append(value)
            return (*parent.location, len(parent.value) - 1)
        key, parent.key = str(parent.key), None
        parent.value[key] = value
        return (*parent.location, key)

    def _value(self, event: NodeEvent) -> Any:  # noqa: ANN401 - a YAML value is any value
        if isinstance(event, MappingStartEvent):
            return {}
        if isinstance(event, SequenceStartEvent):
            return []
        if not isinstance(event, ScalarEvent):
            return None
        text = str(event.value)
        if event.style is not None:  # in quotes
            return text
        try:
            return self._dialect.scalar(text)
        except ValueError as error:
            raise self._problem(event, f"not valid YAML: {error}") from error
