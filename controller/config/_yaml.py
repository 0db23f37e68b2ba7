"""YAML files with line numbers, and errors a person can act on: file, line, nearest right key."""

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, Generic, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.constructor import ConstructorError, RoundTripConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    NodeEvent,
    SequenceEndEvent,
    SequenceStartEvent,
)

from .errors import ConfigError
from .files import read_text

Model = TypeVar("Model", bound=BaseModel)

# pydantic speaks of Python's types, our readers write YAML
_PLAIN_WORDS: Final = {
    "model_type": "must be a section of `key: value` lines",
    "dict_type": "must be a section of `name: value` lines",
    "tuple_type": "must be a list, as in [a, b]",
    "path_type": "must be the name of a file",
    "string_type": "must be text; put it in quotes if it looks like a number or a date",
}


MOST_DEPTH: Final = 12  # sections within sections; a cell file has four
MOST_VALUES: Final = 10_000  # and some hundreds of values
MOST_PROBLEMS: Final = 10  # of one file told at once


class Section(BaseModel):
    """What every section of our files is: frozen, and closed to unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _true_is_no_number(cls, value: object, info: ValidationInfo) -> object:
        field = cls.model_fields[info.field_name or ""]
        if isinstance(value, bool) and field.annotation is not bool:
            raise ValueError("true and false mean nothing here")  # pydantic would read 1 and 0
        return value


class WrongKeyError(ValueError):
    """What a check over several keys finds wrong, with the key below its section to name."""

    def __init__(self, location: tuple[int | str, ...], told: str) -> None:
        super().__init__(told)
        self.location = location


@dataclass(frozen=True, slots=True)
class Loaded(Generic[Model]):
    """What a file holds, and where.

    Attributes
    ----------
    line_of : of the key at a location, None where the file does not say it
    """

    value: Model
    line_of: Callable[[tuple[int | str, ...]], int | None]


class _Constructor(RoundTripConstructor):
    """Reads dates that cannot be as errors with a line, which ruamel leaves to `datetime`."""

    def construct_yaml_timestamp(self, node: Any, values: Any = None) -> Any:  # noqa: ANN401
        try:
            return super().construct_yaml_timestamp(node, values)
        except ValueError as error:
            told = f"{node.value!r:.40} is no date ({error})"
            raise ConstructorError(None, None, told, node.start_mark) from error


_Constructor.add_constructor("tag:yaml.org,2002:timestamp", _Constructor.construct_yaml_timestamp)


def load_yaml(path: Path, model: type[Model]) -> Model:
    """Read a YAML file into a model.

    Raises
    ------
    ConfigError : unreadable, not YAML, unknown or missing keys, values out of range; all
        problems of the file are told at once, each with its line
    """
    return load_with_lines(path, model).value


def load_with_lines(path: Path, model: type[Model]) -> Loaded[Model]:
    """Read a YAML file into a model, and keep the lines of its keys; see `load_yaml`."""
    tree = _tree(path, read_text(path, "a file of settings"))
    try:
        value = model.model_validate(_plain(tree))
    except ValidationError as error:
        found = sorted(error.errors(), key=lambda e: _line(tree, e["loc"]) or 0)
        problems = [_explain(path, tree, model, dict(e)) for e in found[:MOST_PROBLEMS]]
        if len(found) > MOST_PROBLEMS:
            problems.append(f"{path}: and {len(found) - MOST_PROBLEMS} more like these")
        raise ConfigError("\n".join(problems)) from error
    return Loaded(value, lambda location: _line(tree, location))


def line_in(path: Path, location: tuple[int | str, ...]) -> int | None:
    """Return the line of a key in a file that was read before, None where it is not said there."""
    return _line(_tree(path, read_text(path, "a file of settings")), location)


def _tree(path: Path, text: str) -> CommentedMap:
    """Return a file's tree, ConfigError where it is none."""
    try:
        _look_ahead(path, text)
        yaml = YAML(typ="rt", pure=True)
        yaml.Constructor = _Constructor
        tree = yaml.load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}" if mark is not None else ""
        raise ConfigError(f"{path}{where}: not valid YAML: {error.problem}") from error
    except YAMLError as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: not valid YAML: {told:.200}") from error
    except ConfigError:
        raise
    except Exception as error:  # a parser in pure Python has its own surprises on garbage
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: not valid YAML: {told:.200}; is it the right file?") from error
    if not isinstance(tree, CommentedMap):
        raise ConfigError(f"{path}: is empty or not a list of `key: value` lines")
    return tree


def _look_ahead(path: Path, text: str) -> None:
    """Raise ConfigError for what a small text can blow up with: depth, aliases, tags."""
    depth, values = 0, 0
    for event in YAML(typ="rt", pure=True).parse(text):
        if isinstance(event, MappingEndEvent | SequenceEndEvent):
            depth -= 1
        if not isinstance(event, NodeEvent):
            continue
        values += 1
        if isinstance(event, AliasEvent) or event.anchor:
            raise ConfigError(
                f"{_at(path, event)}: anchors (&) and aliases (*) are not read; write the value out"
            )
        if getattr(event, "tag", None):
            raise ConfigError(f"{_at(path, event)}: tags (!) are not read; write the plain value")
        if isinstance(event, MappingStartEvent | SequenceStartEvent):
            depth += 1
        if depth > MOST_DEPTH or values > MOST_VALUES:
            what = f"{MOST_VALUES} values" if values > MOST_VALUES else f"{MOST_DEPTH} levels"
            raise ConfigError(f"{_at(path, event)}: more than {what}; is it the right file?")


def _at(path: Path, event: Event) -> str:
    return f"{path}:{event.start_mark.line + 1}"


def _plain(node: Any) -> Any:  # noqa: ANN401 - a YAML tree is any value
    if isinstance(node, CommentedMap):
        return {str(k): _plain(v) for k, v in node.items()}
    if isinstance(node, CommentedSeq):
        return [_plain(v) for v in node]
    return node


def _line(tree: Any, location: tuple[int | str, ...]) -> int | None:  # noqa: ANN401
    line: int | None = None
    node = tree
    for key in location:
        if isinstance(node, CommentedMap) and key in node:
            line = node.lc.key(key)[0] + 1
            node = node[key]
        elif isinstance(node, CommentedSeq) and isinstance(key, int) and key < len(node):
            line = node.lc.item(key)[0] + 1
            node = node[key]
        else:
            break
    return line


def _keys_at(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Return the keys a section may have, following the models along a location."""
    current: Any = model
    for key in location:
        if isinstance(current, type) and issubclass(current, BaseModel):
            field = current.model_fields.get(str(key))
            if field is None:
                return []
            current = _section_in(field.annotation)
        elif get_origin(current) in (dict, tuple, list):
            current = _section_in(get_args(current)[-1])  # any name, or any number, of sections
        else:
            return []
    if isinstance(current, type) and issubclass(current, BaseModel):
        return list(current.model_fields)
    return []


def _section_in(annotation: Any) -> Any:  # noqa: ANN401 - an annotation is any value
    """Return what an optional or annotated section is without its `None` and its limits."""
    if get_origin(annotation) in (Union, UnionType, Annotated):
        for inner in get_args(annotation):
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                return inner
    return annotation


def _explain(path: Path, tree: Any, model: type[BaseModel], error: dict[str, Any]) -> str:  # noqa: ANN401
    location = tuple(error["loc"])
    own = error.get("ctx", {}).get("error")
    if isinstance(own, WrongKeyError):
        location += own.location
    line = _line(tree, location)
    where = f"{path}:{line}" if line is not None else f"{path}"
    dotted = ".".join(str(part) for part in location)
    if error["type"] == "extra_forbidden":
        key, known = str(location[-1]), _keys_at(model, location[:-1])
        near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
        hint = f"did you mean `{near[0]}`?" if near else f"known here: {', '.join(known)}"
        return f"{where}: unknown key `{dotted}`; {hint}"
    if error["type"] == "missing":
        # a list that is too short lacks a place, not a key
        if isinstance(location[-1], int):
            short = ".".join(str(part) for part in location[:-1])
            return f"{where}: `{short}` has too few values"
        return f"{where}: `{dotted}` is missing"
    about = f"`{dotted}`: " if dotted else ""
    if error["type"] == "value_error":  # one of our own sentences
        return f"{where}: {about}{error['ctx']['error']}"
    told = _PLAIN_WORDS.get(error["type"], error["msg"])
    return f"{where}: {about}{told} (found {error['input']!r:.60})"
