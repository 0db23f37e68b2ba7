"""YAML of ours with line numbers, read within bounds; and pydantic's complaints put into words.

Read from the parser's events, so that nesting, size and aliases are bounded while reading: a text
of a kilobyte must not unfold into gigabytes.
"""

import difflib
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from ..errors import CsgCadError

Location = tuple[int | str, ...]

MOST_BYTES: Final = 200_000
MOST_DEPTH: Final = 60
MOST_PROBLEMS: Final = 10  # of one text told at once

_NUMBER = re.compile(r"[-+]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][-+]?\d{1,3})?")
_NOTHING: Final = {"", "~", "null"}
_PLAIN_WORDS: Final = {
    "model_type": "must be `key: value` pairs",
    "dict_type": "must be `name: value` pairs",
    "tuple_type": "must be a list, as in [a, b]",
    "string_type": "must be text",
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "finite_number": "must be a finite number",
}


@dataclass(slots=True)
class _Node:
    """A mapping or a list while it is being read."""

    value: dict[str, Any] | list[Any]
    location: Location
    key: str | None = None


@dataclass(frozen=True, slots=True)
class YamlText:
    """What a text says, and on which line it says it."""

    path: Path
    tree: dict[str, Any]
    lines: dict[Location, int] = field(repr=False)

    def problem(self, location: Location, told: str) -> CsgCadError:
        """Return an error that names file, line and key."""
        return CsgCadError(self.sentence(location, told))

    def sentence(self, location: Location, told: str) -> str:
        """Return a problem in words, with file, line and key."""
        known = location
        while known and known not in self.lines:
            known = known[:-1]
        where = f"{self.path}:{self.lines[known]}" if known in self.lines else f"{self.path}"
        return f"{where}: `{dotted(location)}`: {told}" if location else f"{where}: {told}"


def dotted(location: Location) -> str:
    """Return a place in the text as people write it: ``part.union[2].move``, counted from 1."""
    words = "".join(f"[{key + 1}]" if isinstance(key, int) else f".{key}" for key in location)
    return words.lstrip(".")


def read_yaml(data: bytes, path: Path) -> YamlText:
    """Return the tree of a YAML text and the line of each key.

    Raises
    ------
    CsgCadError : not text, not YAML, too long, too deep, or with anchors, aliases or tags
    """
    if len(data) > MOST_BYTES:
        raise CsgCadError(
            f"{path}: a CSG text has at most {MOST_BYTES:,} bytes; "
            "use shapes by name instead of repeating them"
        )
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise CsgCadError(
            f"{path}: byte {error.start} is no text (UTF-8); is it the right file?"
        ) from error
    try:
        return _build(YAML(typ="rt", pure=True).parse(text), path)
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}" if mark is not None else ""
        told = " ".join(str(error.problem).split())
        raise CsgCadError(f"{path}{where}: not valid YAML: {told}; mend the line") from error
    except YAMLError as error:
        told = " ".join(str(error).split())
        raise CsgCadError(f"{path}: not valid YAML: {told:.200}; mend the text") from error
    except CsgCadError:
        raise
    except Exception as error:  # a parser in pure Python has its own surprises on garbage
        raise CsgCadError(
            f"{path}: not valid YAML ({type(error).__name__}); is it the right file?"
        ) from error


def _build(events: Any, path: Path) -> YamlText:  # noqa: ANN401 - ruamel's generator is untyped
    lines: dict[Location, int] = {}
    open_nodes: list[_Node] = []
    root: Any = None
    documents = 0
    for event in events:
        if isinstance(event, DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise CsgCadError(f"{_at(path, event)}: a second document; a file is one part")
        if isinstance(event, MappingEndEvent | SequenceEndEvent):
            open_nodes.pop()
            continue
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise CsgCadError(
                f"{_at(path, event)}: anchors (&) and aliases (*) are not read; "
                "name a shape under `shapes:` and say `use: its_name`"
            )
        if not isinstance(event, ScalarEvent | MappingStartEvent | SequenceStartEvent):
            continue
        parent = open_nodes[-1] if open_nodes else None
        if parent is not None and isinstance(parent.value, dict) and parent.key is None:
            _take_key(parent, event, lines, path)
            continue
        value = _value(event, path)
        location = _put(parent, value)
        lines.setdefault(location, event.start_mark.line + 1)
        if parent is None:
            root = value
        if isinstance(value, dict | list):
            if len(open_nodes) >= MOST_DEPTH:
                raise CsgCadError(
                    f"{_at(path, event)}: nested deeper than {MOST_DEPTH}; "
                    "name inner shapes under `shapes:`"
                )
            open_nodes.append(_Node(value, location))
    if not isinstance(root, dict):
        raise CsgCadError(f"{path}: is empty or not a list of `key: value` lines; see docs/csg.md")
    return YamlText(path, root, lines)


def _at(path: Path, event: Event) -> str:
    return f"{path}:{event.start_mark.line + 1}"


def _take_key(parent: _Node, event: Event, lines: dict[Location, int], path: Path) -> None:
    if not isinstance(event, ScalarEvent):
        raise CsgCadError(f"{_at(path, event)}: a key must be a word; is a `:` too many?")
    key = str(event.value)
    if key in parent.value:
        raise CsgCadError(f"{_at(path, event)}: `{key:.40}` is there twice; leave one")
    parent.key = key
    lines[(*parent.location, key)] = event.start_mark.line + 1


def _put(parent: _Node | None, value: Any) -> Location:  # noqa: ANN401 - a YAML value is any value
    if parent is None:
        return ()
    if isinstance(parent.value, dict):
        key, parent.key = str(parent.key), None
        parent.value[key] = value
        return (*parent.location, key)
    parent.value.append(value)
    return (*parent.location, len(parent.value) - 1)


def _value(event: Event, path: Path) -> Any:  # noqa: ANN401 - a YAML value is any value
    if getattr(event, "tag", None):
        raise CsgCadError(f"{_at(path, event)}: tags (!) are not read; write the plain value")
    if isinstance(event, MappingStartEvent):
        return {}
    if isinstance(event, SequenceStartEvent):
        return []
    if not isinstance(event, ScalarEvent):
        return None
    text = str(event.value)
    if event.style is not None:  # in quotes
        return text
    if text.lower() in _NOTHING:
        return None
    return float(text) if _NUMBER.fullmatch(text) else text


def explain(text: YamlText, model: type[BaseModel], errors: list[Any]) -> CsgCadError:
    """Return pydantic's complaints as one error, a line each, in the order of the text."""
    told = [(_line(text, e["loc"]), _explain(text, model, e)) for e in errors]
    told.sort(key=lambda pair: pair[0])
    shown = [sentence for _, sentence in told[:MOST_PROBLEMS]]
    if len(told) > MOST_PROBLEMS:
        shown.append(f"{text.path}: and {len(told) - MOST_PROBLEMS} more")
    return CsgCadError("\n".join(shown))


def _line(text: YamlText, location: Location) -> int:
    while location and location not in text.lines:
        location = location[:-1]
    return text.lines.get(location, 0)


def _explain(text: YamlText, model: type[BaseModel], error: Any) -> str:  # noqa: ANN401
    location: Location = tuple(error["loc"])
    if error["type"] == "extra_forbidden":
        known = sorted(keys_at(model, location[:-1]))
        near = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        hint = f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}"
        return text.sentence(location, f"unknown key; {hint}")
    if error["type"] == "missing":
        if isinstance(location[-1], int):
            return text.sentence(location[:-1], "has too few values")
        return text.sentence(location, "is missing; see docs/csg.md")
    if error["type"] == "value_error":  # one of our own sentences
        return text.sentence(location, str(error["ctx"]["error"]))
    told = _PLAIN_WORDS.get(error["type"], error["msg"])
    return text.sentence(location, f"{told} (found {error['input']!r:.60})")


def keys_at(model: type[BaseModel], location: Location) -> list[str]:
    """Return the keys a section may have, following the models along a location."""
    current: type[BaseModel] | None = model
    for key in location:
        if current is None or isinstance(key, int):
            continue
        found = current.model_fields.get(key)
        if found is None:
            continue  # a name of somebody's own under `shapes`
        current = _model_in(found.annotation)
    return [] if current is None else [f.alias or n for n, f in current.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:  # noqa: ANN401 - an annotation is any value
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        if (found := _model_in(inner)) is not None:
            return found
    return None
