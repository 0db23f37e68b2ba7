"""Options of a command are the fields of the dataclasses it takes, each declared once."""

import ast
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from controller.cli.options import from_fields

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    lamp: Annotated[str, typer.Option("--lamp", help="lamp")] = "panel"
    level: Annotated[float, typer.Option("--level", min=0, max=1, help="level")] = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    file: Annotated[Path, typer.Argument(metavar="FILE", help="file")]
    frame_count: Annotated[int, typer.Option("--count", help="count")]
    light: Light = field(default_factory=Light)
    names: Annotated[list[str] | None, typer.Option("--name", help="name")] = None


def run(*words: str) -> tuple[int, str, list[Shot]]:
    taken: list[Shot] = []

    def shoot(options: Shot) -> None:
        """Shoot."""
        taken.append(options)

    app = typer.Typer(rich_markup_mode=None)
    app.command()(from_fields(shoot))
    ended = CliRunner().invoke(app, list(words))
    return ended.exit_code, ended.output, taken


def test_each_field_is_an_option_and_those_of_a_group_stand_in_its_place() -> None:
    code, shown, _ = run("--help")
    assert code == 0
    order = [shown.index(word) for word in ("--count", "--lamp", "--level", "--name")]
    assert order == sorted(order)


def test_a_command_gets_its_options_as_the_dataclass_has_them() -> None:
    code, _, taken = run("a.png", "--count", "2", "--level", "0.25", "--name", "x")
    assert code == 0
    light = Light(lamp="panel", level=0.25)
    assert taken == [Shot(file=Path("a.png"), frame_count=2, light=light, names=["x"])]


@pytest.mark.parametrize("words", [("a.png",), ("a.png", "--count", "2", "--level", "3")])
def test_an_option_that_is_missing_or_out_of_range_ends_the_command(words: tuple[str, ...]) -> None:
    code, _, taken = run(*words)
    assert (code, taken) == (2, [])


def test_each_option_that_is_a_field_has_a_help_text() -> None:
    calls = [
        (path, call)
        for path in (ROOT / "controller/cli").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.AnnAssign)
        for call in ast.walk(node.annotation)
        if isinstance(call, ast.Call)
    ]
    assert len(calls) > 20
    wrong = [
        (path, call.lineno) for path, call in calls if "help" not in {k.arg for k in call.keywords}
    ]
    assert wrong == []
