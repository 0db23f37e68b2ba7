"""Help in one style: FILE instead of Python's types, texts in lower case without a full stop."""

from typing import Any

from typer.core import TyperCommand, TyperGroup


class PlainCommand(TyperCommand):
    """A command whose help shows no Python types."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401 - click's or typer's own
        """Return the words of the usage line, required arguments without braces."""
        return [
            piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)
        ]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write arguments and options."""
        _write_parameters(self, ctx, formatter)


class PlainGroup(TyperGroup):
    """A group of commands whose help is in the same style."""

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
        """Write options and commands."""
        _write_parameters(self, ctx, formatter)
        self.format_commands(ctx, formatter)


def _write_parameters(command: Any, ctx: Any, formatter: Any) -> None:  # noqa: ANN401
    """Write the sections on arguments and options."""
    rows: dict[str, list[tuple[str, str]]] = {"argument": [], "option": []}
    for parameter in command.get_params(ctx):
        record = parameter.get_help_record(ctx)
        if record is None:
            continue
        name, text = record
        if parameter.param_type_name == "argument":
            name = parameter.metavar or name  # typer appends the Python type
        if text.endswith("."):  # a text of typer's own
            text = text[0].lower() + text[1:-1]
        rows[parameter.param_type_name].append((name, text))
    for kind, entries in rows.items():
        if entries:
            with formatter.section(f"{kind.capitalize()}s"):
                formatter.write_dl(entries)
