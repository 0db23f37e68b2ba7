"""Help in one style: commands and options in groups, every line whole within 80 columns.

Groups are typer's help panels, drawn as plain sections. A text shows FILE, not a Python type; a
default or a limit stands in brackets at its end. `controller.cli.reference` writes the same rows
as a page of the documentation.
"""

import re
from typing import Any

from typer.core import TyperCommand, TyperGroup

# Widest first column [characters]: a longer option has a line of its own, so that the texts beside
# all others keep two thirds of 80 columns.
MAX_FIRST_COLUMN = 24

Rows = list[tuple[str, str]]


class PlainCommand(TyperCommand):
    """A command whose help shows no Python types; its epilog is one example a line."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401 - click's or typer's own
        """Return the words of the usage line, required arguments without braces."""
        return [
            piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)
        ]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write arguments and options."""
        _write_sections(parameter_sections(self, ctx), formatter)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write the examples; a command line is never wrapped."""
        if found := examples(self):
            with formatter.section("Example" if len(found) == 1 else "Examples"):
                for line in found:
                    formatter.write(f"{'':>{formatter.current_indent}}{line}\n")


class PlainGroup(TyperGroup):
    """A group of commands whose help is in the same style."""

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write commands and options."""
        _write_sections(command_sections(self, ctx), formatter)
        _write_sections(parameter_sections(self, ctx), formatter)


def summary(command: Any) -> str:  # noqa: ANN401
    """Return the first line of a command's help: one sentence."""
    return str(command.help).strip().partition("\n")[0]


def details(command: Any) -> str:  # noqa: ANN401
    """Return a command's help after its summary: paragraphs with empty lines between; or none."""
    return str(command.help).strip().partition("\n")[2].strip()


def examples(command: Any) -> list[str]:  # noqa: ANN401
    """Return command lines to copy."""
    return (command.epilog or "").splitlines()


def command_sections(group: Any, ctx: Any) -> dict[str, Rows]:  # noqa: ANN401
    """Return name and summary of each command, by the title of its section."""
    sections: dict[str, Rows] = {}
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        if command is not None and not command.hidden:
            title = command.rich_help_panel or "Commands"
            sections.setdefault(title, []).append((name, summary(command)))
    return sections


def parameter_sections(command: Any, ctx: Any) -> dict[str, Rows]:  # noqa: ANN401
    """Return names and texts of arguments and options, by the title of their section."""
    sections: dict[str, Rows] = {"Arguments": [], "Options": []}
    for parameter in command.get_params(ctx):
        record = parameter.get_help_record(ctx)
        if record is None:
            continue
        name, text = record
        if parameter.param_type_name == "argument":
            name = parameter.metavar or name  # typer appends the Python type
            title = "Arguments"
        else:
            title = getattr(parameter, "rich_help_panel", None) or "Options"
        sections.setdefault(title, []).append((name, _plain(text)))
    return {title: rows for title, rows in sections.items() if rows}


def _plain(text: str) -> str:
    """Text of a parameter with typer's ``[default: 1.0; 0.1<=x<=100]`` in words."""
    body, _, added = text.partition("  [")
    if body.endswith("."):  # a text of typer's own
        body = body[0].lower() + body[1:-1]
    facts = [words for fact in added.removesuffix("]").split("; ") if (words := _in_words(fact))]
    if body.endswith(")") and (own := body.rfind(" (default: ")) >= 0:
        body, facts = body[:own], [body[own + 2 : -1], *facts]
    return f"{body} ({'; '.join(facts)})" if facts else body


def _in_words(fact: str) -> str:
    """Write a default or a limit as a person does; empty if any count is allowed."""
    if fact in ("x>=0", "x>=1"):
        return ""
    if between := re.fullmatch(r"(\S+)<=x<=(\S+)", fact):
        return f"{between[1]} to {between[2]}"
    return re.sub(r"^x>=", "at least ", re.sub(r"^(default: \d+)\.0$", r"\1", fact))


def _write_sections(sections: dict[str, Rows], formatter: Any) -> None:  # noqa: ANN401
    names = [name for rows in sections.values() for name, _ in rows]
    width = max((min(len(name), MAX_FIRST_COLUMN) for name in names), default=0)
    for title, rows in sections.items():
        with formatter.section(title):
            formatter.write_dl(
                [(name.ljust(width), text) for name, text in rows], col_max=MAX_FIRST_COLUMN
            )
