"""YAML files with line numbers, and errors a person can act on: file, line, nearest right key."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator
from ruamel.yaml import YAML
from ruamel.yaml.nodes import ScalarNode

from controller.yaml_text import (
    Dialect,
    Location,
    WrongKeyError,
    YamlText,
    YamlTextError,
    read_yaml,
)

from .errors import ConfigError
from .files import read_text

__all__ = ["Loaded", "Section", "WrongKeyError", "line_in", "load_with_lines", "load_yaml"]

Model = TypeVar("Model", bound=BaseModel)

MAX_DEPTH: Final = 12  # sections within sections; a cell file has four
MAX_VALUE_COUNT: Final = 10_000  # and some hundreds of values
# of a merge and a default, which need another key or a tag to mean anything
NO_VALUES: Final = {"tag:yaml.org,2002:merge", "tag:yaml.org,2002:value"}


@lru_cache(maxsize=1)
def _plain() -> YAML:
    return YAML(typ="safe", pure=True)


def _scalar(text: str) -> Any:  # noqa: ANN401 - a YAML value is any value
    """Return a plain scalar as YAML 1.2 has it: number, truth value, date, nothing or text."""
    yaml = _plain()
    tag = yaml.resolver.resolve(ScalarNode, text, (True, False))
    if str(tag) in NO_VALUES:
        return text
    try:
        return yaml.constructor.construct_object(ScalarNode(tag, text))
    except ValueError as error:  # what ruamel leaves to `datetime`
        raise ValueError(f"{text!r:.40} is not a date ({error})") from error


DIALECT: Final = Dialect(
    scalar=_scalar,
    max_depth=MAX_DEPTH,
    too_deep=f"more than {MAX_DEPTH} levels; is it the right file?",
    max_value_count=MAX_VALUE_COUNT,
    too_many=f"more than {MAX_VALUE_COUNT} values; is it the right file?",
    not_valid=("", ""),
    alias="write the value out",
    twice='not valid YAML: found duplicate key "{key}"',
    second_document="not valid YAML: but found another document",
    no_mapping="is empty or not a list of `key: value` lines",
    # pydantic speaks of Python's types, our readers write YAML
    words={
        "extra_forbidden": "unknown key `{key}`; {hint}",
        "missing": "`{key}` is missing",
        "too_few": "`{key}` has too few values",
        "more": "and {count} more like these",
        "model_type": "must be a section of `key: value` lines",
        "dict_type": "must be a section of `name: value` lines",
        "tuple_type": "must be a list, as in [a, b]",
        "path_type": "must be the name of a file",
        "string_type": "must be text; put it in quotes if it looks like a number or a date",
    },
    key=lambda location: ".".join(map(str, location)),
    names_first_line=False,
    sorts_keys=False,
)


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


@dataclass(frozen=True, slots=True)
class Loaded(Generic[Model]):
    """What a file holds, and where.

    Attributes
    ----------
    line_of : of the key at a location, None where the file does not say it
    """

    value: Model
    line_of: Callable[[Location], int | None]


def load_yaml(path: Path, model: type[Model]) -> Model:
    """Read a YAML file into a model.

    Raises
    ------
    ConfigError : unreadable, not YAML, unknown or missing keys, values out of range; all
        problems of the file are told at once, each with its line
    """
    return load_with_lines(path, model).value


def load_with_lines(path: Path, model: type[Model]) -> Loaded[Model]:
    """Read a YAML file into a model, and keep the lines of its keys.

    Raises
    ------
    ConfigError : as `load_yaml`
    """
    text = _text(path)
    try:
        value = model.model_validate(text.tree)
    except ValidationError as error:
        raise ConfigError(text.problems(model, [dict(e) for e in error.errors()])) from error
    return Loaded(value, text.line)


def line_in(path: Path, location: Location) -> int | None:
    """Return the line of a key in a file that was read before, None where it is not said there."""
    return _text(path).line(location)


def _text(path: Path) -> YamlText:
    try:
        return read_yaml(read_text(path, "a file of settings"), path, DIALECT)
    except YamlTextError as error:
        raise ConfigError(str(error)) from error
