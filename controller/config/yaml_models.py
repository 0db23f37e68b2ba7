"""Read YAML files into models; errors name the file, the line and the nearest right key."""

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

__all__ = [
    "Loaded",
    "Section",
    "WrongKeyError",
    "line_in",
    "load_with_lines",
    "load_yaml",
    "yaml_tree",
]

Model = TypeVar("Model", bound=BaseModel)

MAX_DEPTH: Final = 12  # sections within sections; a cell file has four
MAX_VALUE_COUNT: Final = 10_000  # a cell file has some hundreds
# The tags of merge (`<<`) and default (`=`), which mean nothing here and are read as text.
NO_VALUES: Final = {"tag:yaml.org,2002:merge", "tag:yaml.org,2002:value"}


@lru_cache(maxsize=1)
def _plain() -> YAML:
    return YAML(typ="safe", pure=True)


def _scalar(text: str) -> Any:  # noqa: ANN401 - a YAML value is any value
    """Return a plain scalar by YAML 1.2's rules: number, truth value, date, null or text."""
    yaml = _plain()
    tag = yaml.resolver.resolve(ScalarNode, text, (True, False))
    if str(tag) in NO_VALUES:
        return text
    try:
        # a document of its own: the constructor keeps every node of one until its end
        return yaml.constructor.construct_document(ScalarNode(tag, text))
    except ValueError as error:  # ruamel leaves the check of a date to `datetime`
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
    # pydantic's messages name Python's types, but our readers write YAML
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
    """The base of every section of our files: frozen, and closed to unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _true_is_no_number(cls, value: object, info: ValidationInfo) -> object:
        field = cls.model_fields[info.field_name or ""]
        if isinstance(value, bool) and field.annotation is not bool:
            raise ValueError("true and false are not allowed here")  # pydantic would read 1 and 0
        return value


@dataclass(frozen=True, slots=True)
class Loaded(Generic[Model]):
    """The model that a file holds, and the lines of its keys.

    Attributes
    ----------
    line_of : the line of the key at a location, None if the file does not have the key
    """

    value: Model
    line_of: Callable[[Location], int | None]


def load_yaml(path: Path, model: type[Model]) -> Model:
    """Return a YAML file as a model.

    Raises
    ------
    ConfigError : unreadable, not YAML, unknown or missing keys, values out of range; all
        problems of the file are reported at once, each with its line
    """
    return load_with_lines(path, model).value


def load_with_lines(path: Path, model: type[Model], draft: str | None = None) -> Loaded[Model]:
    """Return a YAML file as a model, with the lines of its keys.

    Parameters
    ----------
    path : the file
    model : model of what it must hold
    draft : a text that may become the file's; None for what the file holds

    Raises
    ------
    ConfigError : as in `load_yaml`
    """
    text = _text(path, draft)
    try:
        value = model.model_validate(text.tree)
    except ValidationError as error:
        raise ConfigError(text.problems(model, [dict(e) for e in error.errors()])) from error
    return Loaded(value, text.line)


def line_in(path: Path, location: Location) -> int | None:
    """Return the line of a key in a file that was read before, None if the key is not there.

    A set of views, which may hold a recipe, is JSON and has no lines to name.
    """
    return None if path.suffix.lower() == ".json" else _text(path).line(location)


def yaml_tree(path: Path, draft: str | None = None) -> dict[str, Any]:
    """Return the content of a YAML file as mappings, lists and values, whatever its keys.

    Parameters
    ----------
    path : the file
    draft : a text that may become the file's; None for what the file holds

    Raises
    ------
    ConfigError : unreadable, or not YAML
    """
    return _text(path, draft).tree


def _text(path: Path, draft: str | None = None) -> YamlText:
    try:
        text = read_text(path, "a file of settings", is_lenient=True) if draft is None else draft
        return read_yaml(text, path, DIALECT)
    except YamlTextError as error:
        raise ConfigError(str(error)) from error
