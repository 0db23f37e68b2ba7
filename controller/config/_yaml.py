"""YAML files with line numbers, and errors a person can act on: file, line, nearest right key."""

import difflib
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

Model = TypeVar("Model", bound=BaseModel)

# pydantic speaks of Python's types, our readers write YAML
_PLAIN_WORDS: Final = {
    "model_type": "must be a section of `key: value` lines",
    "dict_type": "must be a section of `name: value` lines",
    "tuple_type": "must be a list, as in [a, b]",
    "path_type": "must be the name of a file",
    "string_type": "must be text; put it in quotes if it looks like a number or a date",
}


class ConfigError(Exception):
    """A file or a command line is wrong; the message names the file, the line and the mend."""


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


def load_yaml(path: Path, model: type[Model]) -> Model:
    """Read a YAML file into a model.

    Raises
    ------
    ConfigError : unreadable, not YAML, unknown or missing keys, values out of range; all
        problems of the file are told at once, each with its line
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not a text file (UTF-8); is it the right file?") from error
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}; check the path") from error
    try:
        tree = YAML(typ="rt").load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark
        where = f":{mark.line + 1}" if mark is not None else ""
        raise ConfigError(f"{path}{where}: not valid YAML: {error.problem}") from error
    except YAMLError as error:
        told = " ".join(str(error).split())
        raise ConfigError(f"{path}: not valid YAML: {told}") from error
    if not isinstance(tree, CommentedMap):
        raise ConfigError(f"{path}: is empty or not a list of `key: value` lines")
    try:
        return model.model_validate(_plain(tree))
    except ValidationError as error:
        found = sorted(error.errors(), key=lambda e: _line(tree, e["loc"]) or 0)
        problems = [_explain(path, tree, model, dict(e)) for e in found]
        raise ConfigError("\n".join(problems)) from error


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
