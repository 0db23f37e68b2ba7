"""A list of parts (CSV) that a person sends: its recipes become those that the page may start.

The run itself reports further errors in a list before anything moves. The file for the run is
written here: its recipes are files of the project or names of shipped recipes, so that a list can
name no other file.
"""

import csv
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from controller.config import ConfigError
from controller.config.files import read_text
from controller.config.parts_list import COLUMNS, ListReader
from controller.launching import Choices, Launcher, RecipeChoice
from messages import say

from ..frame.screens import RequestRefusedError
from ..frame.uploads import Uploaded

LIST_MAX_BYTES: Final = 2_000_000
LIST_MAX_COUNT: Final = 20_000  # parts
TEXT_MAX: Final = 200


def write_list(sent: Path, to: Path, choices: Choices, project_dir: Path) -> Mapping[str, Any]:
    """Write a list as `cellctl run --parts-list` takes it; return its parts by recipe, as JSON.

    Parameters
    ----------
    sent : CSV with a line of titles, comma or semicolon between values
    to : file to write
    choices : choices for a start
    project_dir : folder of the project

    Raises
    ------
    RequestRefusedError : it cannot be read, or names a recipe that may not be started
    """
    parts = _parts(sent)
    found: dict[str, RecipeChoice] = {}
    for name in dict.fromkeys(part["recipe"] for part in parts):
        found[name] = _recipe(name, choices)
    with to.open("x", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for part in parts:
            key = found[part["recipe"]].key
            own = project_dir / key
            place = str(own) if own.is_file() else key
            writer.writerow([place, part.get("serial", ""), part.get("lot", "")])
    counts = Counter(found[part["recipe"]].key for part in parts)
    return {"parts": len(parts), "recipes": list(counts.items())}


async def keep_sent(launcher: Launcher, sent: Uploaded, project_dir: Path) -> dict[str, Any]:
    """Keep a list of parts sent by a person; return its key and its content, as JSON.

    Parameters
    ----------
    launcher : starts runs by it
    sent : CSV
    project_dir : folder of the project

    Raises
    ------
    RequestRefusedError : it cannot be read, or names a recipe that may not be started
    LaunchRefusedError : it cannot be kept
    """
    key, found = await launcher.keep_list(
        sent.name, lambda path, choices: write_list(sent.path, path, choices, project_dir)
    )
    return {"key": key, "name": sent.name, **found}


def _parts(sent: Path) -> list[dict[str, str]]:
    try:
        text = read_text(sent, "a list of parts", LIST_MAX_BYTES)
    except ConfigError as error:
        raise RequestRefusedError(422, "the list is no text in UTF-8") from error
    reader = ListReader(text)
    parts: list[dict[str, str]] = []
    try:
        titles = reader.titles()
        strange = sorted(set(titles) - set(COLUMNS))
        if "recipe" not in titles or strange or len(set(titles)) < len(titles):
            raise RequestRefusedError(
                422, "a list has the columns recipe, serial, lot; recipe is needed"
            )
        for row in reader.rows(titles):
            if row is None or max(map(len, row.values())) > TEXT_MAX:
                raise RequestRefusedError(
                    422, say("line {line} of the list does not fit", line=reader.line)
                )
            if len(parts) == LIST_MAX_COUNT:
                raise RequestRefusedError(
                    422,
                    say("a list has {list_max_count} parts at most", list_max_count=LIST_MAX_COUNT),
                )
            parts.append({title: value.strip() for title, value in row.items()})
    except csv.Error as error:
        raise RequestRefusedError(
            422, say("line {line} of the list does not fit", line=reader.line)
        ) from error
    if not parts:
        raise RequestRefusedError(422, "the list has no parts")
    return parts


def _recipe(name: str, choices: Choices) -> RecipeChoice:
    """Return the recipe that a list names by its key, its file or its file without the ending."""
    by_file = [one for one in choices.recipes if name in (Path(one.key).name, Path(one.key).stem)]
    exact = choices.recipe(name)
    found = exact or (by_file[0] if len(by_file) == 1 else None)
    if found is None:
        raise RequestRefusedError(
            422, say("`{name}`: there is no such file in the project", name=name)
        )
    if found.problem:
        raise RequestRefusedError(422, found.problem)
    return found
