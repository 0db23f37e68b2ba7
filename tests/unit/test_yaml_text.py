"""YAML with line numbers: bounded, exact about lines, and with plain messages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import AliasChoices, BaseModel, Field, ValidationError

from controller.cad.reading import csg_text as _csg_text
from controller.config import yaml_models as config_yaml
from controller.yaml_text import Dialect, YamlTextError, keys_at, read_yaml

DIALECTS = {"settings": config_yaml.DIALECT, "csg": _csg_text.DIALECT}
PATH = Path("some.yaml")


class Leaf(BaseModel, extra="forbid"):
    size: float = 0.0
    from_: float = Field(default=0.0, alias="from")
    inner: tuple[Leaf, ...] = ()


class Root(BaseModel, extra="forbid"):
    leaf: Leaf | None = None
    named: Annotated[dict[str, Leaf], Field(max_length=9)] = {}
    rows: tuple[tuple[Leaf, Leaf], ...] | None = None


@pytest.fixture(params=DIALECTS)
def dialect(request: pytest.FixtureRequest) -> Dialect:
    return DIALECTS[request.param]


def refused(text: str, dialect: Dialect) -> str:
    with pytest.raises(YamlTextError) as caught:
        read_yaml(text, PATH, dialect)
    return str(caught.value)


def test_keys_and_items_have_the_lines_they_stand_on(dialect: Dialect) -> None:
    text = read_yaml(
        "# a note\na:\n  b: [1,\n      2]\n  c:\n  - x: 1\n  -\n    y: 2\n", PATH, dialect
    )
    assert text.tree == {"a": {"b": [1, 2], "c": [{"x": 1}, {"y": 2}]}}
    lines = {("a",): 2, ("a", "b"): 3, ("a", "b", 0): 3, ("a", "b", 1): 4, ("a", "c"): 5}
    lines |= {("a", "c", 0, "x"): 6, ("a", "c", 1, "y"): 8}
    assert {location: text.line(location) for location in lines} == lines
    assert text.line(("a", "b", 7, "z")) == 3  # the nearest that is there


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: 1\nb: &x 2", 2),
        ("a: 1\nb: *x", 2),
        ("a: 1\nb: !!python/object:os.system 2", 2),
        ("a: 1\n\na: 2", 3),
        ("a:\n  b: 1\n  b:\n    c: 1", 3),
        ("a: 1\n? [b]\n: 1", 2),
        ("a: 1\n---\nb: 2", 2),
        ("a: [1, 2", 1),
    ],
)
def test_what_is_not_read_is_refused_on_its_line(text: str, line: int, dialect: Dialect) -> None:
    assert refused(text, dialect).startswith(f"some.yaml:{line}: ")


def test_a_section_that_is_there_twice_is_not_printed(dialect: Dialect) -> None:
    assert "secret" not in refused("a: {b: secret}\na: {b: secret}", dialect)


def test_depth_and_number_are_bounded_while_reading(dialect: Dialect) -> None:
    deep = dialect.max_depth
    assert read_yaml("a: " + "[" * (deep - 1) + "]" * (deep - 1), PATH, dialect).tree
    assert dialect.too_deep in refused("a: " + "[" * deep + "]" * deep, dialect)
    # an end that never comes is not waited for
    assert dialect.too_deep in refused("a: " + "[" * 100_000, dialect)


def test_too_many_values_are_refused() -> None:
    dialect = config_yaml.DIALECT
    many = ", ".join("1" * dialect.max_value_count)
    assert dialect.too_many in refused(f"a: [{many}]", dialect)


@pytest.mark.parametrize("text", ["\0", "a: \ud800", "\x07", "%YAML 9.9\n---\na: 1", "a: \x1b"])
def test_garbage_is_a_message(text: str, dialect: Dialect) -> None:
    assert refused(text, dialect).startswith("some.yaml")


def test_a_plain_word_means_what_its_dialect_says() -> None:
    text = "[1, 0x1f, true, ~, 1e3, '1', =, <<, 2026-11-22, word]"
    settings = read_yaml(f"a: {text}", PATH, config_yaml.DIALECT).tree["a"]
    assert [*settings[:8], settings[9]] == [1, 31, True, None, 1000.0, "1", "=", "<<", "word"]
    assert settings[8].isoformat() == "2026-11-22"
    csg = read_yaml(f"a: {text}", PATH, _csg_text.DIALECT).tree["a"]
    assert csg == [1.0, "0x1f", "true", None, 1000.0, "1", "=", "<<", "2026-11-22", "word"]


@pytest.mark.parametrize(
    ("location", "expected"),
    [
        ((), ["leaf", "named", "rows"]),
        (("leaf",), ["size", "from", "inner"]),
        (("leaf", "inner", 3, "inner", 0), ["size", "from", "inner"]),
        (("named", "anything"), ["size", "from", "inner"]),
        (("named", "size"), ["size", "from", "inner"]),  # a name of somebody's own
        (("rows", 2, 1), ["size", "from", "inner"]),
        (("leaf", "size", "x"), []),
        (("unknown", "x"), []),
    ],
)
def test_the_keys_of_a_section_are_found_along_the_models(
    location: tuple[int | str, ...], expected: list[str]
) -> None:
    assert keys_at(Root, location) == expected


class Renamed(BaseModel, extra="forbid"):
    leaf: Leaf = Field(Leaf(), validation_alias=AliasChoices("leaf", "sheet"))


def test_a_renamed_key_is_known_by_both_names(dialect: Dialect) -> None:
    assert keys_at(Renamed, ()) == ["leaf", "sheet"]
    assert keys_at(Renamed, ("sheet",)) == keys_at(Renamed, ("leaf",)) == ["size", "from", "inner"]
    for text, problem in (
        ("sheet:\n  sise: 1\n", "did you mean `size`?"),
        ("sheat:\n  size: 1\n", "did you mean `sheet`?"),
        ("leaf:\n  size: 1\nsheet:\n  size: 1\n", "some.yaml:3: "),
        ("sheet:\n  size: 1\nleaf:\n  size: 1\n", "the old name of `leaf` on line 3; leave"),
    ):
        found = read_yaml(text, PATH, dialect)
        with pytest.raises(ValidationError) as caught:
            Renamed.model_validate(found.tree)
        assert problem in found.problems(Renamed, list(caught.value.errors()))


def test_problems_come_in_the_order_of_the_text_and_not_all_of_many(dialect: Dialect) -> None:
    rows = "".join(f"  n{i}: {{sise: 1}}\n" for i in range(13))
    text = read_yaml(f"named:\n{rows}", PATH, dialect)
    with pytest.raises(ValidationError) as caught:
        Root.model_validate(text.tree)
    errors: list[Any] = list(caught.value.errors())
    problems = text.problems(Root, errors[::-1]).splitlines()
    assert [problem.split(":")[1] for problem in problems[:10]] == [str(i) for i in range(2, 12)]
    assert all("did you mean `size`?" in problem for problem in problems[:10])
    assert "3 more" in problems[10]
    assert len(problems) == 11
