"""What programs may rely on (docs/promises.md), as one list.

python tests/surface.py > tests/data/0.2.0/surface.json     for a new version, in its own folder
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import sys
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel

from controller import interface
from controller.cell.alarms import ALARMS
from controller.cell.journal import rows
from controller.cli.app import app
from controller.config import Cell
from controller.config.recipe import Recipe
from drivers import errors, kinds

ROOT = Path(__file__).resolve().parents[1]
INHERITED = frozenset(dir(object)) | frozenset(dir(BaseException))


def surface() -> dict[str, list[str]]:
    """Return all that is promised, by topic; each entry may only be added to."""
    return {topic: sorted(set(entries)) for topic, entries in _topics().items()}


def missing(promised: dict[str, list[str]], there: dict[str, list[str]]) -> list[str]:
    """Return what was promised and is not there, as `topic: entry`."""
    return [
        f"{topic}: {entry}"
        for topic, entries in promised.items()
        for entry in sorted(set(entries) - set(there.get(topic, ())))
    ]


def _topics() -> dict[str, list[str]]:
    api = json.loads((ROOT / "docs" / "control-api.json").read_text("utf-8"))
    return {
        "commands": _commands(typer.main.get_command(app), ""),
        "recipe": _keys(Recipe, ""),
        "cell file": _keys(Cell, ""),
        "control socket": [
            *(f"{method} {path}" for path, methods in api["paths"].items() for method in methods),
            *(
                f"{name}.{key}"
                for name, schema in api["components"]["schemas"].items()
                for key in schema.get("properties", ())
            ),
        ],
        "alarms": [f"{alarm.number} {alarm.code}" for alarm in ALARMS],
        "python interface": _members_of(interface, interface.__all__),
        "driver kinds": _members_of(kinds, kinds.__all__),
        "errors of drivers": _members_of(errors, [n for n in vars(errors) if n.endswith("Error")]),
        "rows of the journal": [
            f"{kind} {name}: {key}"
            for (kind, name), model in rows.ROWS.items()
            for key in model.model_fields
        ],
    }


def _commands(command: Any, path: str) -> list[str]:
    found = [f"{path} {option}".strip() for p in command.params for option in p.opts]
    for name, below in getattr(command, "commands", {}).items():
        found += [f"{path} {name}".strip(), *_commands(below, f"{path} {name}".strip())]
    return found


def _keys(model: type[BaseModel], path: str) -> list[str]:
    """Return the keys of a file, with those below them as `above.below`."""
    schema = model.model_json_schema(by_alias=True)
    found: list[str] = []

    def visit(node: dict[str, Any], at: str, above: tuple[str, ...]) -> None:
        if (ref := node.get("$ref")) is not None:
            if ref in above:
                return
            visit(schema["$defs"][ref.rpartition("/")[2]], at, (*above, ref))
        for key, below in node.get("properties", {}).items():
            found.append(f"{at}{key}")
            visit(below, f"{at}{key}.", above)
        for key in ("anyOf", "allOf", "oneOf"):
            for below in node.get(key, ()):
                visit(below, at, above)
        for key in ("items", "additionalProperties"):
            if isinstance(node.get(key), dict):
                visit(node[key], f"{at}*.", above)

    visit(schema, path, ())
    return found


def _members_of(module: Any, names: list[str]) -> list[str]:
    found = []
    for name in names:
        thing = getattr(module, name)
        found.append(name)
        if inspect.isclass(thing):
            members = [n for n in dir(thing) if not n.startswith("_") and n not in INHERITED]
            fields = [f.name for f in dataclasses.fields(thing)] if _is_record(thing) else []
            found += [f"{name}.{member}" for member in {*members, *fields}]
        elif inspect.isfunction(thing):
            found += [f"{name}({p})" for p in inspect.signature(thing).parameters]
    return found


def _is_record(thing: type) -> bool:
    return dataclasses.is_dataclass(thing)


if __name__ == "__main__":
    json.dump(surface(), sys.stdout, indent=1, sort_keys=True)
    sys.stdout.write("\n")
