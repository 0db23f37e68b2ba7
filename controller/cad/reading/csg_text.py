"""CSG texts as YAML (docs/csg.md): limits on size and depth, scalars, messages."""

import re
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from controller.config.files import text_of
from controller.yaml_text import Dialect, Location, YamlText, YamlTextError, read_yaml

from ..errors import CsgCadError
from ._csg_models import CsgText

MAX_BYTES: Final = 200_000
MAX_DEPTH: Final = 60

_NUMBER = re.compile(r"[-+]?(\d{1,30}(\.\d{0,30})?|\.\d{1,30})([eE][-+]?\d{1,3})?")
_NOTHING: Final = {"", "~", "null"}


def _scalar(text: str) -> Any:  # noqa: ANN401 - a YAML value is any value
    """Return a plain scalar: a number, nothing, or else text."""
    if text.lower() in _NOTHING:
        return None
    return float(text) if _NUMBER.fullmatch(text) else text


def _key(location: Location) -> str:
    """Return a place in the text as people write it: ``part.union[2].move``, from 1."""
    words = "".join(f"[{key + 1}]" if isinstance(key, int) else f".{key}" for key in location)
    return words.lstrip(".")


DIALECT: Final = Dialect(
    scalar=_scalar,
    max_depth=MAX_DEPTH,
    too_deep=f"nested deeper than {MAX_DEPTH}; name inner shapes under `shapes:`",
    max_value_count=MAX_BYTES,
    too_many="too many values; use shapes by name instead of repeating them",
    not_valid=("; mend the line", "; mend the text"),
    alias="name a shape under `shapes:` and write `use: its_name`",
    twice="`{key:.40}` is there twice; leave one",
    second_document="a second document; a file is one part",
    no_mapping="is empty or not a list of `key: value` lines; see docs/csg.md",
    words={
        "extra_forbidden": "`{key}`: unknown key; {hint}",
        "missing": "`{key}`: is missing; see docs/csg.md",
        "too_few": "`{key}`: has too few values",
        "more": "and {count} more",
        "model_type": "must be `key: value` pairs",
        "dict_type": "must be `name: value` pairs",
        "tuple_type": "must be a list, as in [a, b]",
        "string_type": "must be text",
        "float_type": "must be a number",
        "float_parsing": "must be a number",
        "finite_number": "must be a finite number",
    },
    key=_key,
    names_first_line=True,
    sorts_keys=True,
)


def read_csg_text(data: bytes, path: Path) -> tuple[CsgText, YamlText]:
    """Return the contents of a CSG text, and the text with the lines of its entries.

    Raises
    ------
    CsgCadError : not text, not YAML, too long, too deep, or not what docs/csg.md says
    """
    if len(data) > MAX_BYTES:
        raise CsgCadError(
            f"{path}: a CSG text has at most {MAX_BYTES:,} bytes; "
            "use shapes by name instead of repeating them"
        )
    try:
        text = read_yaml(text_of(data, path, is_lenient=True), path, DIALECT)
        return CsgText.model_validate(text.tree), text
    except YamlTextError as error:
        raise CsgCadError(str(error)) from error
    except ValidationError as error:
        problems = text.problems(CsgText, [dict(e) for e in error.errors()])
        raise CsgCadError(problems) from error
