"""Writes docs/commands.md from the commands themselves: their help, as one page.

``python -m controller.cli.reference > docs/commands.md`` stores it; a test fails when the page and
the commands differ.
"""

import re
import sys
from collections.abc import Iterator
from typing import Any

import typer

from controller.config.shipped import shipped_recipes

from .app import app
from .terminal.help import (
    Rows,
    command_sections,
    details,
    examples,
    parameter_sections,
    summary,
)

INTRODUCTION = """\
# Commands

<!-- made by `python -m controller.cli.reference > docs/commands.md`; do not edit -->

`cellctl COMMAND --help` shows the same texts in a terminal.

- RECIPE is a file, or the name of a recipe that comes with cellctl: {recipes}. Without one,
  cellctl takes `recipe.yaml` in the current folder, else `featuretype`.
- `--json` prints one JSON object per line on stdout; everything else goes to stderr.
- {codes}
- `cellctl --install-completion` teaches your shell to complete commands and options.
  `_CELLCTL_COMPLETE=source_bash cellctl` prints the script (also `source_zsh`, `source_fish`).
"""


def commands_page() -> str:
    """Return docs/commands.md: a table of all commands by section, then each in full."""
    top: Any = typer.main.get_command(app)
    context = _context(top, "cellctl")
    recipes = ", ".join(f"`{name}`" for name in shipped_recipes())
    parts = [INTRODUCTION.format(recipes=recipes, codes=top.epilog)]
    sections = command_sections(top, context)
    for title, rows in sections.items():
        linked = [(f"[`cellctl {name}`](#{_anchor(name)})", text) for name, text in rows]
        parts.append(_table((title, ""), linked))
    for title, rows in sections.items():
        parts.append(f"## {title}\n")
        for name, _ in rows:
            parts += _described(top.get_command(context, name), context, f"cellctl {name}")
    return "\n".join(parts)


def _described(command: Any, parent: Any, path: str) -> Iterator[str]:  # noqa: ANN401
    """Blocks of Markdown on a command, and on its subcommands."""
    context = _context(command, path.rpartition(" ")[2], parent)
    usage = " ".join([path, *command.collect_usage_pieces(context)])
    yield f"### {path}\n"
    yield f"{summary(command)}\n"
    if hasattr(command, "list_commands"):
        for name in command.list_commands(context):
            yield from _described(command.get_command(context, name), context, f"{path} {name}")
        return
    yield f"```text\n{usage}\n```\n"
    if more := details(command):
        yield f"{_as_code(more)}\n"
    for title, rows in parameter_sections(command, context).items():
        yield _table((title, ""), [(f"`{name}`", _as_code(text)) for name, text in rows])
    if lines := examples(command):
        yield "```sh\n" + "\n".join(lines) + "\n```\n"


def _context(command: Any, name: str, parent: Any = None) -> Any:  # noqa: ANN401
    """Context in which a command tells its usage, with the names of the help option."""
    return command.context_class(command, info_name=name, parent=parent, **command.context_settings)


def _anchor(name: str) -> str:
    return f"cellctl-{name}"


def _as_code(text: str) -> str:
    """Help text in Markdown: options and placeholders of the command line as code."""
    parts = text.split("`")
    parts[::2] = [re.sub(r"(?<![\w`-])(--?[a-z][\w-]*)", r"`\1`", part) for part in parts[::2]]
    return "`".join(parts)


def _table(head: tuple[str, str], rows: Rows) -> str:
    """Table of two columns; a | within a cell is escaped."""
    lines = [f"| {head[0]} | {head[1]} |", "|---|---|"]
    lines += [
        "| " + " | ".join(cell.replace("|", r"\|").replace("\n", " ") for cell in row) + " |"
        for row in rows
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(commands_page())
