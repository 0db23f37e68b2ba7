"""The parts of an archive that are to be judged anew: chosen in the store, found in the journal."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from sqlalchemy import ColumnElement, and_, exists, func, select

from controller.catalogue import software_key
from controller.cell.journal import JournalError, is_of, rows, rows_of_parts
from controller.config import Recipe, find_recipe, load_recipe
from controller.config.files import file_sha256
from controller.results.run import ResultsError, copies_in

from ..errors import HistoryError
from ..filling import CHUNK_COUNT, journals_by_key
from ..queries import Filters
from ..rows_of import NO_VERDICT
from ..store import Store
from ..tables import JOURNALS, PARTS, REJUDGED, RUNS
from .task import ArchivedPart

SOURCE: Final = PARTS.join(RUNS).join(JOURNALS)
# the oldest first, in any store: keys of the store are in the order in which it was filled
IN_ORDER: Final = (PARTS.c.start, RUNS.c.run_id, PARTS.c.number)

OF_FILES: Final = tuple(
    row.row_name for row in (rows.PartInspected, rows.FilesStored, rows.PicturesCopied)
)


@dataclass(frozen=True, slots=True)
class NewJudging:
    """What the archive is judged by: a result is of exactly this.

    Attributes
    ----------
    recipe, path : the recipe and its file
    recipe_sha256 : of the file
    learned_sha256 : of the file of what good parts look like; empty for none
    software : version and hash of cellctl's source and libraries
    """

    recipe: Recipe
    path: Path
    recipe_sha256: str
    learned_sha256: str
    software: str

    @property
    def key(self) -> dict[str, str]:
        """The key of its rows of `REJUDGED`, but for the part."""
        return {
            "recipe_sha256": self.recipe_sha256,
            "learned_sha256": self.learned_sha256,
            "software": self.software,
        }

    @property
    def rows(self) -> ColumnElement[bool]:
        """The condition on `REJUDGED` for rows of it."""
        return and_(*(REJUDGED.c[name] == value for name, value in self.key.items()))


@dataclass(frozen=True, slots=True)
class Archive:
    """A selection of parts of a folder of runs, and what they are judged by.

    Attributes
    ----------
    store : filled
    runs_dir : folder of all runs
    judging : what they are judged by
    filters : the parts
    """

    store: Store
    runs_dir: Path
    judging: NewJudging
    filters: Filters

    @property
    def clause(self) -> ColumnElement[bool]:
        """The condition on `PARTS`, `RUNS` and `JOURNALS` for the parts."""
        return and_(
            replace(self.filters, recipe=self.judging.recipe.name).clause(),
            PARTS.c.verdict != NO_VERDICT,
            JOURNALS.c.key.in_(journals_by_key(self.runs_dir)),
        )


def judging_by_recipe(recipe: Path) -> NewJudging:
    """Return what parts are judged by, with a recipe.

    Parameters
    ----------
    recipe : a recipe file, or the name of a recipe that comes with cellctl

    Raises
    ------
    ConfigError : it, or what it names, is wrong
    """
    path = find_recipe(recipe).absolute()
    found = load_recipe(path)
    learned = found.inspection.learned
    return NewJudging(
        found,
        path,
        file_sha256(path),
        "" if learned is None else file_sha256(learned),
        software_key(),
    )


def counts(archive: Archive) -> tuple[int, int, int]:
    """Return how many parts are chosen, judged so already, and of runs in other folders.

    Parameters
    ----------
    archive : the parts

    Raises
    ------
    HistoryError : the store cannot be read
    """
    everywhere = and_(
        replace(archive.filters, recipe=archive.judging.recipe.name).clause(),
        PARTS.c.verdict != NO_VERDICT,
    )
    asked = (archive.clause, and_(archive.clause, _is_kept(archive)), everywhere)
    with archive.store.reading() as db:
        chosen, kept, all_of_them = (
            int(db.execute(select(func.count()).select_from(SOURCE).where(one)).scalar_one())
            for one in asked
        )
    return chosen, kept, all_of_them - chosen


def parts_left(archive: Archive) -> Iterator[ArchivedPart]:
    """Yield the parts that are not judged so yet, oldest first, with their files by the journal.

    Parameters
    ----------
    archive : the parts

    Raises
    ------
    HistoryError : store or journal cannot be read
    """
    with archive.store.reading() as db:
        found = db.execute(
            select(PARTS.c.part_id, PARTS.c.number, RUNS.c.run_id, JOURNALS.c.key)
            .select_from(SOURCE)
            .where(archive.clause, ~_is_kept(archive))
            .order_by(*IN_ORDER)
        ).all()
    journals = journals_by_key(archive.runs_dir)
    for (key, run), of_run in groupby(found, key=lambda row: (row.key, row.run_id)):
        parts = list(of_run)
        for i in range(0, len(parts), CHUNK_COUNT):
            yield from _with_files(archive, journals[key], run, parts[i : i + CHUNK_COUNT])


def _with_files(
    archive: Archive, journal: Path, run: str, parts: Sequence[Any]
) -> Iterator[ArchivedPart]:
    try:
        numbers = [part.number for part in parts]
        found = rows_of_parts(journal, run, numbers, names=OF_FILES)
    except (JournalError, ResultsError) as error:
        raise HistoryError(str(error)) from error
    views: dict[int | None, str] = {}
    hashes: dict[int | None, dict[str, str]] = {}
    for row in found:
        if is_of(row, rows.PartInspected):
            views[row.part] = str(row.body["views"])
        elif is_of(row, rows.FilesStored):
            hashes.setdefault(row.part, {}).update(row.body)
    copies = copies_in(found)
    for part in parts:
        yield ArchivedPart(
            part.part_id,
            archive.runs_dir.absolute() / run,
            views.get(part.number, ""),
            hashes.get(part.number, {}),
            archive.judging.recipe,
            archive.judging.path,
            {file: one for file, one in copies.items() if file in hashes.get(part.number, {})},
        )


def _is_kept(archive: Archive) -> ColumnElement[bool]:
    return exists().where(REJUDGED.c.part_id == PARTS.c.part_id, archive.judging.rows)
