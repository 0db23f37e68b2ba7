"""YAML files with line numbers, and errors a person can act on: file, line, nearest right key."""

import difflib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, YAMLError

Model = TypeVar("Model", bound=BaseModel)


class ConfigError(Exception):
    """A file or a command line is wrong; the message names the file, the line and the mend."""


class Section(BaseModel):
    """What every section of our files is: frozen, and closed to unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


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
        raise ConfigError(f"{path}: not valid YAML: {error}") from error
    if not isinstance(tree, CommentedMap):
        raise ConfigError(f"{path}: is empty or not a list of `key: value` lines")
    try:
        return model.model_validate(_plain(tree))
    except ValidationError as error:
        problems = [_explain(path, tree, model, dict(e)) for e in error.errors()]
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
        if not (isinstance(current, type) and issubclass(current, BaseModel)):
            return []
        field = current.model_fields.get(str(key))
        if field is None:
            return []
        current = field.annotation
        for inner in getattr(current, "__args__", ()):
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                current = inner
    if isinstance(current, type) and issubclass(current, BaseModel):
        return list(current.model_fields)
    return []


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
        return f"{where}: `{dotted}` is missing"
    return f"{where}: `{dotted}`: {error['msg']} (found {error['input']!r:.60})"
