"""A person's changes of a recipe at the page: the new text, its diff, the file written.

Comments, order and quotes of the file stay, by ruamel's round trip. Nothing is written that the
model of recipes does not accept, or that changes more than was asked for.
"""

from __future__ import annotations

import difflib
import hashlib
import io
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError
from ruamel.yaml.util import load_yaml_guess_indent

from controller.config import ConfigError, load_recipe, yaml_tree
from controller.config.files import write_whole

from .folder import RecipeFile

MAX_CHANGE_COUNT: Final = 500
WIDE: Final = 4096  # a width at which ruamel breaks no line
SAME_LIMITS: Final = ("plus", "minus", "fit")  # other ways to state limits
LIMITS: Final = ("lower", "upper")
NAMES: Final = ("id", "faces", "kind")

Size = Annotated[float, Field(ge=0, le=5000)]


class NotAsShownError(Exception):
    """The file, or the text to write, differs from the one the person has seen."""


class _Words(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class CharacteristicChange(_Words):
    """Changes of one characteristic; None removes a statement.

    Attributes
    ----------
    id : id of the characteristic
    nominal, lower, upper, critical, ignore : as in a recipe; only those that are given are changed
    """

    id: str = Field(min_length=1, max_length=120)
    nominal: Size | None = None
    lower: Size | None = None
    upper: Size | None = None
    critical: bool | None = None
    ignore: str | None = Field(default=None, min_length=4, max_length=200)


class InspectionChange(_Words):
    """Changes of the section `inspection`; only the given keys are changed."""

    required: Literal["all", "stated"] = "all"
    tolerance_class: Literal["f", "m", "c", "v"] = "m"
    min_coverage: float = 0.95
    max_incidence_deg: float = 70.0
    smallest_defect_mm: float = 3.0


class RecipeChanges(_Words):
    """All changes at once.

    Attributes
    ----------
    sha256 : SHA-256 of the file that the person has before them
    """

    sha256: str = Field(min_length=64, max_length=64)
    inspection: InspectionChange = InspectionChange()
    characteristics: tuple[CharacteristicChange, ...] = Field(
        default=(), max_length=MAX_CHANGE_COUNT
    )


@dataclass(frozen=True, slots=True)
class Draft:
    """The changed recipe.

    Attributes
    ----------
    text : text of the file
    sha256 : SHA-256 of the text
    diff : lines of a unified diff from the file to it; empty where nothing changes
    """

    text: str
    sha256: str
    diff: tuple[str, ...]


def drafted(file: RecipeFile, changes: RecipeChanges) -> Draft:
    """Return the recipe with changes; nothing is written.

    Parameters
    ----------
    file : file of the recipe
    changes : changes to make

    Raises
    ------
    ConfigError : the changed recipe would be wrong; the message has file and line
    NotAsShownError : the file is another one than the person has before them
    """
    data = file.read()
    if hashlib.sha256(data).hexdigest() != changes.sha256:
        raise NotAsShownError(
            f"{file.path.name} was changed by somebody else meanwhile; load it anew"
        )
    load_recipe(file.path)  # bounds what ruamel is given
    old = data.decode("utf-8-sig")
    new = _changed(file, old, changes)
    load_recipe(file.path, new)
    _require_no_more(file, old, new)
    name = file.path.name
    diff = difflib.unified_diff(
        old.splitlines(), new.splitlines(), name, f"{name} (changed)", lineterm=""
    )
    return Draft(new, hashlib.sha256(new.encode()).hexdigest(), tuple(diff))


def save(file: RecipeFile, changes: RecipeChanges, seen_sha256: str) -> Draft:
    """Write a recipe with changes, whole or not at all; return the text written.

    Parameters
    ----------
    file : file of the recipe
    changes : changes to make
    seen_sha256 : SHA-256 of the draft whose diff the person has seen

    Raises
    ------
    ConfigError : as in `drafted`, or the file cannot be written
    NotAsShownError : as in `drafted`, or the draft is another one than the person has seen
    """
    if not file.is_own:
        raise ConfigError(f"{file.path.name} comes with cellctl and is not changed; copy it")
    if file.path.is_symlink():
        raise ConfigError(f"{file.path.name} is a link to another file, which is not changed here")
    draft = drafted(file, changes)
    if draft.sha256 != seen_sha256:
        raise NotAsShownError("what would be written is not what was shown; look at it again")
    write_whole(file.path, draft.text)
    return draft


def _changed(file: RecipeFile, text: str, changes: RecipeChanges) -> str:
    try:
        _, indent, offset = load_yaml_guess_indent(text)
        if offset is None:  # there is no list in the file
            indent, offset = 4, 2
        yaml = YAML(typ="rt")
        yaml.preserve_quotes = True
        yaml.width = WIDE
        yaml.indent(mapping=2, sequence=max(indent or 0, offset + 2), offset=offset)
        tree = yaml.load(text)
        _apply(tree, changes)
        written = io.StringIO()
        yaml.dump(tree, written)
    except YAMLError as error:
        problem = " ".join(str(error).split())
        raise ConfigError(f"{file.path.name}: cannot be changed here: {problem:.200}") from error
    new = written.getvalue()
    return new.replace("\n", "\r\n") if "\r\n" in text else new


def _apply(tree: CommentedMap, changes: RecipeChanges) -> None:
    section = tree.get("inspection")
    is_new = section is None
    if section is None:
        section = CommentedMap()
    for key in sorted(changes.inspection.model_fields_set):
        _set(section, key, getattr(changes.inspection, key))
    entries = section.get("characteristics")
    if entries is None:
        entries = CommentedSeq()
    for change in changes.characteristics:
        _apply_one(entries, change)
    if not entries:
        section.pop("characteristics", None)
    elif "characteristics" not in section:
        section["characteristics"] = entries
    if is_new and section:
        tree["inspection"] = section


def _apply_one(entries: CommentedSeq, change: CharacteristicChange) -> None:
    """Change the entry of one characteristic, add one, or take one away that states nothing."""
    wanted = " ".join(change.id.lower().split())
    at = next(
        (
            i
            for i, one in enumerate(entries)
            if " ".join(str(one.get("id", "")).lower().split()) == wanted and "kind" not in one
        ),
        None,
    )
    entry = CommentedMap({"id": change.id}) if at is None else entries[at]
    given = {key: getattr(change, key) for key in change.model_fields_set if key != "id"}
    if given.get("ignore") is not None:
        for key in [key for key in entry if key not in NAMES]:
            del entry[key]
        given = {"ignore": given["ignore"]}
    elif any(given.get(key) is not None for key in LIMITS):
        for key in SAME_LIMITS:
            entry.pop(key, None)
    for key in ("nominal", *LIMITS, "critical", "ignore"):
        if key not in given:
            continue
        if given[key] is None or given[key] is False:
            entry.pop(key, None)
        else:
            _set(entry, key, given[key])
    states_nothing = all(key in NAMES for key in entry)
    if at is None and not states_nothing:
        entries.append(entry)
    elif at is not None and states_nothing:
        del entries[at]


def _set(section: CommentedMap, key: str, value: object) -> None:
    """Set a value unless it is there already: `60` is not rewritten as `60.0`."""
    if key not in section or section[key] != value:
        section[key] = value


def _require_no_more(file: RecipeFile, old: str, new: str) -> None:
    """Check that nothing has changed outside the edited keys.

    Raises
    ------
    ConfigError : the round trip has changed something else
    """
    before, after = (_rest(yaml_tree(file.path, text)) for text in (old, new))
    if before != after:
        raise ConfigError(f"{file.path.name}: cannot be changed here without loss; edit the file")


def _rest(tree: dict[str, Any]) -> dict[str, Any]:
    """Return a recipe without the keys edited here."""
    inspection = dict(tree.get("inspection") or {})
    for key in (*InspectionChange.model_fields, "characteristics"):
        inspection.pop(key, None)
    return {**{key: value for key, value in tree.items() if key != "inspection"}, "_": inspection}
