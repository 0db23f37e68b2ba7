"""Help of every command on a terminal of 80 columns, and docs/commands.md, which is made of it."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from controller.cli import main
from controller.cli.app import app
from controller.cli.reference import commands_page
from controller.cli.terminal.help import command_sections, examples, parameter_sections, summary

ROOT = Path(__file__).parents[2]
TERMINAL_COLUMNS = 80
SCREEN_LINES = 50  # of a terminal of half a screen's height
COMPLETION = ("--install-completion", "--show-completion")  # typer's own texts
TOP: Any = typer.main.get_command(app)


def context_of(command: Any, name: str, parent: Any = None) -> Any:
    return command.context_class(command, info_name=name, parent=parent, **command.context_settings)


def commands(group: Any = TOP, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield " ".join((*path, name)), command


COMMANDS = dict(commands())


def help_of(path: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("COLUMNS", str(TERMINAL_COLUMNS))
    assert main([*path.split(), "--help"]) == 0
    return capsys.readouterr().out


def sections_of(path: str) -> dict[str, set[str]]:
    """Options of each section, by their long name."""
    command = COMMANDS[path]
    sections = parameter_sections(command, context_of(command, path))
    return {
        title: {word.strip(",") for name, _ in rows for word in name.split() if "--" in word}
        for title, rows in sections.items()
    }


def test_every_command_is_in_a_section_on_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = help_of("", capsys, monkeypatch).splitlines()
    sections = command_sections(TOP, context_of(TOP, "cellctl"))
    assert "Commands" not in sections  # where those without a section of their own would be
    assert set(TOP.commands) == {name for rows in sections.values() for name, _ in rows}
    for title, rows in sections.items():
        start = lines.index(f"{title}:") + 1
        shown = [line.split(maxsplit=1) for line in lines[start : start + len(rows)]]
        assert shown == [list(row) for row in rows]


@pytest.mark.parametrize("path", ["", *COMMANDS])
def test_every_line_of_help_is_whole_within_80_columns(
    path: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = help_of(path, capsys, monkeypatch)
    usage, _, body = shown.partition("\n\n")
    assert max(map(len, shown.splitlines())) <= TERMINAL_COLUMNS
    assert usage.startswith("Usage: ")
    assert "..." not in re.sub(r"\]\.\.\.", "]", body)  # `[RECIPE[=COUNT]...` is a metavar
    assert not re.search(r"\w-$", body, re.MULTILINE), "an option is broken at its hyphen"


def test_the_help_of_run_fits_two_screens(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(help_of("run", capsys, monkeypatch).splitlines()) <= 2 * SCREEN_LINES


def test_what_only_the_emulated_cell_has_is_a_section_of_its_own() -> None:
    # who starts the emulator alone gives the same options
    emulate = {option for options in sections_of("emulate").values() for option in options}
    ours = sections_of("run")
    shared = emulate & {option for options in ours.values() for option in options}
    assert shared - {"--cell", "--json", "--help"} == ours["Emulated cell"] & emulate
    assert {"--speed", "--seed", "--lay", "--on-table", "--empty"} <= ours["Emulated cell"]
    assert not ours["Emulated cell"] & {"--count", "--dry", "--step", "--wait", "--json"}


@pytest.mark.parametrize("path", COMMANDS)
def test_every_command_has_json_and_examples_that_its_parser_takes(path: str) -> None:
    command = COMMANDS[path]
    assert examples(command)
    for line in examples(command):
        words = shlex.split(line)
        name = path.split()
        assert words[: len(name) + 1] == ["cellctl", *name]
        command.make_context(name[-1], words[len(name) + 1 :])  # exits where it is wrong
    assert any("--json" in options for options in sections_of(path).values())


@pytest.mark.parametrize("path", COMMANDS)
def test_a_default_is_told_once(path: str) -> None:
    command = COMMANDS[path]
    for rows in parameter_sections(command, context_of(command, path)).values():
        for name, text in rows:
            assert text.count("default: ") <= 1, (name, text)
            assert "x<=" not in text, (name, text)
            assert "x>=" not in text, (name, text)


def test_the_page_of_commands_is_what_the_commands_tell() -> None:
    stored = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    advice = "run: python -m controller.cli.reference > docs/commands.md"
    assert stored == commands_page(), advice
    for path, command in COMMANDS.items():
        assert f"### cellctl {path}\n\n{summary(command)}\n" in stored


def documents() -> list[Path]:
    pages = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", *(ROOT / "docs").rglob("*.md")]
    return [page for page in pages if page.parent.name not in {"adr", "protocols"}]


def test_documents_name_commands_and_options_that_there_are() -> None:
    """What stands in documents as `cellctl COMMAND --option` can be typed."""
    options = {
        path: {word for found in sections_of(path).values() for word in found} for path in COMMANDS
    }
    wrong, count = [], 0
    for page in documents():
        for typed in re.findall(r"cellctl ([a-z][a-z-]*[^`\n|;&]*)", code_of(page)):
            if typed in TOP.commands and typed not in COMMANDS:
                continue  # a group alone
            words = typed.split()
            path = next((p for p in COMMANDS if words[: len(p.split())] == p.split()), None)
            if path is None:
                wrong.append((page.name, typed))
                continue
            for word in words:
                option = re.match(r"--[a-z][a-z-]*", word)
                if option and not any(
                    option[0] in known.split("/") for known in options[path] | {"--verbose"}
                ):
                    wrong.append((page.name, typed))
            count += 1
    assert count > 100
    assert wrong == []


def code_of(page: Path) -> str:
    """What stands in a page as code, each on its line."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    rest = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    return "\n".join([*blocks, *re.findall(r"`([^`\n]+)`", rest)])
