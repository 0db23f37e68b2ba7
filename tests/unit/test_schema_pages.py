"""Pages and JSON schemas of files and replies are what the models say, and take what they take."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import AliasChoices, Field

from controller.config import Cell, Recipe, Section, yaml_tree

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import schema_pages  # noqa: E402  (its folder comes first)

RECIPES = sorted((ROOT / "recipes").glob("*.yaml"))
CELLS = sorted((ROOT / "recipes" / "cells").glob("*.yaml"))


def errors_of(tree: dict[str, Any], model: type[Section]) -> list[str]:
    validator = jsonschema.Draft202012Validator(schema_pages.schema_of(model))
    return [error.message for error in validator.iter_errors(json.loads(json.dumps(tree)))]


@pytest.mark.parametrize("path", schema_pages.pages(), ids=lambda path: path.name)
def test_what_is_stored_is_what_the_models_say(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == schema_pages.pages()[path], (
        "run: python docs/schema_pages.py"
    )


@pytest.mark.parametrize("file", schema_pages.FILES, ids=lambda file: file.page)
def test_every_key_of_a_file_has_a_meaning(file: schema_pages.FilePage) -> None:
    schema = schema_pages.schema_of(file.model)
    book = schema_pages.Book(schema)
    silent = [
        f"{section.get('title')}.{key}"
        for section in (schema, *schema["$defs"].values())
        for key, value in schema_pages.keys_of(section)
        if not (value.get("description") or book.about(value))
    ]
    assert silent == [], "say what they mean in the docstrings of their sections"


@pytest.mark.parametrize("path", [*RECIPES, *CELLS], ids=lambda path: path.name)
def test_the_schemas_take_every_file_that_comes_with_cellctl(path: Path) -> None:
    assert errors_of(yaml_tree(path), Cell if path in CELLS else Recipe) == []


def test_a_schema_refuses_a_misspelt_key_and_a_value_out_of_range() -> None:
    tree = yaml_tree(RECIPES[0])
    tree["inspection"]["min_coverge"] = 0.5
    tree["inspection"]["max_incidence_deg"] = 95
    assert len(errors_of(tree, Recipe)) == 2


class Renamed(Section):
    """A section of which a key was renamed.

    Attributes
    ----------
    new : in its docstring; None for nothing
    low, high : both at once
    """

    new: int = Field(validation_alias=AliasChoices("new", "old"))
    low: float | None = Field(None, gt=0)
    high: float = 2.0
    size: int = Field(1, ge=0, le=7)  # behind its field


def test_a_meaning_comes_from_the_docstring_or_from_the_comment_behind_the_field() -> None:
    assert schema_pages.meanings_of(Renamed) == {
        "new": "in its docstring; None for nothing",
        "low": "both at once; with `high`",
        "high": "both at once; with `low`",
        "size": "behind its field",
    }


def test_a_renamed_key_is_taken_by_either_name_and_its_table_says_so() -> None:
    assert errors_of({"new": 1}, Renamed) == errors_of({"old": 1}, Renamed) == []
    assert errors_of({}, Renamed) != []
    schema = schema_pages.schema_of(Renamed)
    table = schema_pages.table_of(schema, schema_pages.Book({"$defs": {}, **schema}))
    assert table.splitlines()[2:] == [
        "| `new` | whole number | required | in its docstring; left out: nothing; old name `old` |",
        "| `low` | number, above 0 |  | both at once; with `high` |",
        "| `high` | number | `2` | both at once; with `low` |",
        "| `size` | whole number, 0 to 7 | `1` | behind its field |",
    ]
