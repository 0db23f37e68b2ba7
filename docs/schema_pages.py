"""Writes the pages and schemas of files and replies from the models that read and write them.

``python docs/schema_pages.py`` stores `docs/recipe-keys.md`, `docs/cell-keys.md`,
`docs/view-set-keys.md`, `docs/control.md` and the JSON schemas below `docs/schemas`; a test fails
when one of them is out of date. A key's meaning comes from the docstring of its section, or from
the comment behind its field.
"""

import inspect
import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from pydantic import AliasChoices, BaseModel
from pydantic.json_schema import GenerateJsonSchema

from controller.cell.control.serving.openapi import document
from controller.config import Cell, Recipe
from controller.config.view_set import ViewSetFile

DOCS: Final = Path(__file__).parent
COMMAND: Final = "python docs/schema_pages.py"
WIDEST_DEFAULT: Final = 90  # characters of a default that a table's cell shows

Schema = dict[str, Any]


@dataclass(frozen=True, slots=True)
class FilePage:
    """A kind of file: its page, its schema, and what is said above the tables."""

    model: type[BaseModel]
    page: str
    schema: str
    head: str


FILES: Final = (
    FilePage(
        Recipe,
        "recipe-keys.md",
        "recipe.json",
        "# Keys of a recipe\n\n"
        "One product: which part, how strictly it is inspected, how it may be held. Lengths are "
        "millimetres, angles degrees. `cellctl check RECIPE` names what is wrong, with its line.",
    ),
    FilePage(
        Cell,
        "cell-keys.md",
        "cell.json",
        "# Keys of a cell file\n\n"
        "One cell: where its devices are and how it stands in the world. Lengths are millimetres, "
        "angles degrees, times seconds of the cell. `recipes/cells/emulated.yaml` is a whole one, "
        "with comments; `docs/commissioning.md` shows how each figure is found.",
    ),
    FilePage(
        ViewSetFile,
        "view-set-keys.md",
        "view-set.json",
        "# Keys of a set of views\n\n"
        "Stored pictures of one part, for `cellctl inspect`; `docs/inspect.md` has an example.",
    ),
)


class DescribedSchema(GenerateJsonSchema):
    """JSON schema with the meaning of each key, and with its old names."""

    def model_schema(self, schema: Any) -> Schema:  # noqa: ANN401 - pydantic's signature
        """Return schema of a model, with what its docstring and comments say of the keys."""
        made = super().model_schema(schema)
        model: type[BaseModel] = schema["cls"]
        made["description"] = paragraphs_of(model)
        meanings = meanings_of(model)
        properties: dict[str, Schema] = made.get("properties", {})
        for name, one in model.model_fields.items():
            key = _key_of(name, one.validation_alias)
            if key not in properties:
                continue
            if meaning := meanings.get(name):
                properties[key]["description"] = without_python(meaning)
            for old in _old_names(one.validation_alias):
                properties[old] = {
                    **properties[key],
                    "deprecated": True,
                    "description": f"old name of {key}",
                }
                if key in made.get("required", []):
                    made["required"].remove(key)
                    made.setdefault("allOf", []).append(
                        {"anyOf": [{"required": [key]}, {"required": [old]}]}
                    )
        return made


def _key_of(name: str, alias: object) -> str:
    if isinstance(alias, AliasChoices):
        return str(alias.choices[0])
    return alias if isinstance(alias, str) else name


def _old_names(alias: object) -> list[str]:
    return [str(one) for one in alias.choices[1:]] if isinstance(alias, AliasChoices) else []


def schema_of(model: type[BaseModel]) -> Schema:
    """JSON schema of a file that a model reads."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **model.model_json_schema(schema_generator=DescribedSchema, mode="validation"),
    }


def without_python(text: str) -> str:
    """Return a meaning in a file's words: there, None is a key that is left out."""
    return re.sub(r"\bNone for\b|\bNone:", "left out:", text).replace(
        "None where", "left out where"
    )


def paragraphs_of(model: type[BaseModel]) -> str:
    """Return what a docstring says before its first section of names."""
    text = inspect.cleandoc(model.__doc__ or "")
    return " ".join(re.split(r"\n\w+\n-{3,}\n", text)[0].split()).replace("``", "`")


def meanings_of(model: type[BaseModel]) -> dict[str, str]:
    """Return what each field means: by the docstrings of its classes, else by its comment."""
    found: dict[str, str] = {}
    for owner in model.__mro__:
        if not (issubclass(owner, BaseModel) and owner is not BaseModel):
            continue
        for name, text in (*_in_docstring(owner), *_in_comments(owner)):
            found.setdefault(name, text.replace("``", "`"))
    return found


def _in_docstring(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    text = inspect.cleandoc(model.__dict__.get("__doc__") or "")
    listed = re.search(r"\nAttributes\n-+\n(.*?)(?=\n\n\w+\n-|\Z)", text, re.DOTALL)
    for entry in re.split(r"\n(?=\w)", listed[1]) if listed else ():
        names, colon, meaning = entry.partition(" : ")
        if not colon:
            raise ValueError(f"{model.__name__}: no ' : ' in {entry!r}")
        shared = names.split(", ")
        for name in shared:
            others = [f"`{one}`" for one in shared if one != name]
            with_whom = f"; with {', '.join(others)}" if others else ""
            yield name, " ".join(meaning.split()) + with_whom


def _in_comments(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    above: list[str] = []
    for line in inspect.getsource(model).splitlines():
        if comment := re.match(r" {4}# (.+)", line):
            above.append(comment[1])
            continue
        if named := re.match(r" {4}(\w+): [^#]+?(?:  # (.+))?$", line):
            text = " ".join([*above, *filter(None, [named[2]])])
            if text and not text.startswith(("noqa", "type:")):
                yield named[1], text
        above = []


@dataclass
class Book:
    """The sections of a file in the order in which a reader meets them.

    Attributes
    ----------
    schema : of the whole file
    paths : by definition, the keys that lead to it; the first is its heading
    """

    schema: Schema
    paths: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Walk the file, broad first."""
        waiting = [("", self.schema)]
        while waiting:
            path, section = waiting.pop(0)
            for key, one in keys_of(section):
                at = f"{path}.{key}".lstrip(".")
                for name, suffix in refs_in(one):
                    known = self.paths.setdefault(name, [])
                    if not known:
                        waiting.append((at + suffix, self.schema["$defs"][name]))
                    if at + suffix not in known:  # one key may have a section of several kinds
                        known.append(at + suffix)

    def text(self) -> str:
        """Tables of all sections."""
        tables = [table_of(self.schema, self)]
        for name, paths in self.paths.items():
            section = self.schema["$defs"][name]
            if "properties" not in section:
                continue
            also = ", ".join(f"`{path}`" for path in paths[1:])
            text = sentence(section.get("description", ""))
            if also:
                text = f"{text} Also {also}.".strip()
            body = table_of(section, self)
            tables.append(f"## {paths[0]}\n\n{text}\n\n{body}")
        return "\n".join(tables)

    def words(self, value: Schema) -> str:
        """Return what a key's value may be, in words."""
        if "$ref" in value:
            name = value["$ref"].rsplit("/", 1)[1]
            target = self.schema["$defs"][name]
            if "properties" not in target:
                return self.words(target)
            heading = self.paths[name][0]
            return f"section [{heading}](#{anchor_of(heading)})"
        if "const" in value:
            return f"`{value['const']}`"
        if "enum" in value:
            return ", ".join(f"`{one}`" for one in value["enum"])
        if choices := value.get("anyOf") or value.get("oneOf"):
            given = [one for one in choices if one.get("type") != "null"]
            return ", or ".join(dict.fromkeys(self.words(one) for one in given))
        if "allOf" in value and len(value["allOf"]) == 1:
            return self.words(value["allOf"][0])
        return self._of_type(value)

    def about(self, value: Schema) -> str:
        """Return what the section is that a key leads to; empty for none or several."""
        found = {name for name, _ in refs_in(value)}
        if len(found) != 1:
            return ""
        text = str(self.schema["$defs"][found.pop()].get("description", ""))
        first = text.split(". ")[0].removesuffix(".")
        return first[:1].lower() + first[1:] if first[1:2].islower() else first

    def _of_type(self, value: Schema) -> str:
        kind = value.get("type")
        if kind in ("number", "integer"):
            return ("whole number" if kind == "integer" else "number") + limits_of(value)
        if kind == "boolean":
            return "`true`, `false`"
        if kind == "array":
            return self._list(value)
        if kind == "object":
            inner = value.get("additionalProperties")
            if isinstance(inner, dict):
                names = value.get("propertyNames", {}).get("enum")
                each = self.words({"enum": names}) if names else "name"
                return f"for each {'of ' if names else ''}{each}: {self.words(inner)}"
            return "names with values"
        if kind == "string":
            return {"path": "file", "date": "date", "date-time": "time"}.get(
                value.get("format", ""), "text"
            )
        return "any"

    def _list(self, value: Schema) -> str:
        if items := value.get("prefixItems"):
            kinds = list(dict.fromkeys(self.words(one) for one in items))
            if len(kinds) == 1:
                return f"list of {len(items)}: {kinds[0]}"
            return f"list: {', '.join(kinds)}"
        return f"list: {self.words(value.get('items', {}))}"


def keys_of(section: Schema) -> Iterator[tuple[str, Schema]]:
    """Return the keys of a section, without old names."""
    for key, value in section.get("properties", {}).items():
        if not value.get("deprecated"):
            yield key, value


def refs_in(value: Schema) -> Iterator[tuple[str, str]]:
    """Definitions that a key's value leads to, with what the path has for lists and names."""
    if "$ref" in value:
        yield value["$ref"].rsplit("/", 1)[1], ""
    for choice in ("anyOf", "oneOf", "allOf"):
        for one in value.get(choice, ()):
            yield from refs_in(one)
    for one in (value.get("items"), *value.get("prefixItems", ())):
        if isinstance(one, dict):
            yield from ((name, f"[]{suffix}") for name, suffix in refs_in(one))
    if isinstance(value.get("additionalProperties"), dict):
        inner = refs_in(value["additionalProperties"])
        yield from ((name, f".NAME{suffix}") for name, suffix in inner)


def table_of(section: Schema, book: Book) -> str:
    """Return the keys of a section as a table; old names stand beside the new ones."""
    properties = section.get("properties", {})
    old = {
        one["description"].removeprefix("old name of "): name
        for name, one in properties.items()
        if one.get("deprecated")
    }
    required = {*section.get("required", ())}
    for rule in section.get("allOf", ()):
        required |= {key for one in rule.get("anyOf", ()) for key in one.get("required", ())}
    lines = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, value in keys_of(section):
        meaning = value.get("description") or book.about(value)
        if key in old:
            meaning = f"{meaning}; old name `{old[key]}`".removeprefix("; ")
        default = "required" if key in required else default_of(value, book.schema)
        cells = (f"`{key}`", book.words(value), default, meaning)
        lines.append("| " + " | ".join(_cell(one) for one in cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def default_of(value: Schema, whole: Schema) -> str:
    """Return a key's default as the file would have it; empty for a section's own defaults."""
    default = value.get("default")
    if default is None or isinstance(default, dict) or default in ([], ""):
        return ""
    written = flow(default, value, whole)
    return f"`{written}`" if len(written) <= WIDEST_DEFAULT else ""


def flow(value: object, schema: Schema, whole: Schema) -> str:
    """Return a value in one line of YAML, without keys that have their default."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        inner = schema.get("items") or {}
        return f"[{', '.join(flow(one, inner, whole) for one in value)}]"
    if isinstance(value, Mapping):
        target = whole["$defs"].get(schema.get("$ref", "").rsplit("/", 1)[-1], {})
        usual = {key: one.get("default") for key, one in target.get("properties", {}).items()}
        kept = {key: one for key, one in value.items() if usual.get(key) != one}
        return f"{{{', '.join(f'{key}: {flow(one, {}, whole)}' for key, one in kept.items())}}}"
    return str(value)


def limits_of(value: Schema) -> str:
    """Limits of a number, in words."""
    low, high = value.get("minimum"), value.get("maximum")
    above, below = value.get("exclusiveMinimum"), value.get("exclusiveMaximum")
    words = []
    if above is not None:
        words.append(f"above {above:g}")
    if low is not None and high is not None:
        words.append(f"{low:g} to {high:g}")
    elif low is not None:
        words.append(f"{low:g} or more")
    elif high is not None:
        words.append(f"up to {high:g}")
    if below is not None:
        words.append(f"below {below:g}")
    return "".join(f", {word}" for word in words)


def anchor_of(heading: str) -> str:
    """Return the anchor that a Markdown reader gives a heading."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def sentence(text: str) -> str:
    """Return a text that ends as a sentence does."""
    return text if not text or text.endswith((".", ":")) else f"{text}."


def file_page(one: FilePage, schema: Schema) -> str:
    """Page of a kind of file."""
    return (
        f"{one.head}\n\n<!-- made by `{COMMAND}`; do not edit -->\n\n"
        f"Editors that know JSON schemas complete and verify the file by "
        f"[{one.schema}](schemas/{one.schema}). Sections are headed by the keys that lead to them; "
        f"`NAME` is any name, `[]` each entry of a list.\n\n{Book(schema).text()}"
    )


def control_page() -> str:
    """Page of the control socket, from its OpenAPI description."""
    described = document()
    schemas = described["components"]["schemas"]
    whole: Schema = {"$defs": schemas}
    text = json.dumps(schemas).replace("#/components/schemas/", "#/$defs/")
    whole["$defs"] = json.loads(text)
    book = Book(whole, {name: [name] for name in schemas})
    rows = []
    for path, methods in described["paths"].items():
        for method, one in methods.items():
            takes = _model_in(one.get("requestBody", {}))
            returns = _model_in(one["responses"]["200"])
            rows.append(f"| `{method.upper()} {path}` | {one['summary']} | {takes} | {returns} |")
    return (
        "# Control socket\n\n"
        f"<!-- made by `{COMMAND}`; do not edit -->\n\n"
        f"{described['info']['description']}\n\n"
        "The whole description is [control-api.json](control-api.json) (OpenAPI 3.1).\n\n"
        "| request | what it does | takes | returns |\n|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n\n"
        + "\n".join(
            f"## {name}\n\n{sentence(paragraph(one))}\n\n{table_of(one, book)}"
            for name, one in whole["$defs"].items()
            if "properties" in one
        )
    )


def paragraph(schema: Schema) -> str:
    """Return what a schema's description says before its first section of names."""
    text = re.split(r"\n\w+\n-{3,}\n", schema.get("description", ""))[0]
    return " ".join(text.split()).replace("``", "`")


def _model_in(body: Schema) -> str:
    for content in body.get("content", {}).values():
        reference = content.get("schema", {}).get("$ref", "")
        if name := reference.rsplit("/", 1)[-1]:
            return f"[{name}](#{anchor_of(name)})"
    return ""


def pages() -> dict[Path, str]:
    """All that is stored, by its file."""
    made = {DOCS / "control.md": control_page()}
    for one in FILES:
        schema = schema_of(one.model)
        made[DOCS / one.page] = file_page(one, schema)
        made[DOCS / "schemas" / one.schema] = json.dumps(schema, indent=1) + "\n"
    return made


def main() -> int:
    """Store all pages and schemas."""
    for path, text in pages().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
