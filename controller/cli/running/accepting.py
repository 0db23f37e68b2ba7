"""`cellctl recover --accept`: go on with the part of an interrupted run by that run's recipe."""

import getpass
import os
import shutil
import socket
from dataclasses import dataclass
from pathlib import Path

from controller.cell.batch import GO_ON
from controller.cell.custody import CellIdentity, Held, fold_custody
from controller.cell.custody.known_journals import (
    JournalLostError,
    lost_words,
    rows_of_all_journals,
    why_lost,
)
from controller.cell.devices import resolve
from controller.cell.devices.clocks import find_clock
from controller.cell.journal import JOURNAL_NAME, read_rows, rows
from controller.cell.operator import Answer, Question
from controller.cell.recovery import Interrupted, fold_interrupted
from controller.cell.services.records import RECIPE_COPY, inputs_of
from controller.config import STEP_FORMATS, Cell, ConfigError, load_cell, split_cad
from controller.config.files import file_sha256

from ..terminal.output import warn
from .arguments import RunOptions
from .recipe_run import run_recipe


@dataclass(frozen=True, slots=True)
class AcceptingOperator:
    """A person who has accepted the cell's proposal on the command line.

    Attributes
    ----------
    why : reason as stated by the person
    """

    why: str

    async def decide(self, question: Question) -> Answer | None:
        """Print the accepted question; return the answer that the cell is to go on.

        Every other question gets None.
        """
        if GO_ON not in {choice.key for choice in question.choices}:
            return None
        warn(question.text)
        who = f"{getpass.getuser()} on {socket.gethostname()}, with --accept"
        return Answer(GO_ON, who, self.why)


def go_on_with_part(cell_path: Path, runs_dir: Path, why: str, *, as_json: bool) -> int:
    """Bring the part of an interrupted run to its tray; return the exit code of that run.

    Parameters
    ----------
    cell_path : cell file
    runs_dir : folder of all runs
    why : stated by whoever accepts
    as_json : print one JSON object a line

    Raises
    ------
    ConfigError : no part was left, or the interrupted run's recipe or part are gone
    JournalLostError : the journal that is noted there is lost
    """
    held = _left(load_cell(cell_path), runs_dir)
    if not held or held[0].part is None:
        raise ConfigError(
            f"{runs_dir}: no run has left a part in a gripper of {cell_path}; nothing to recover"
        )
    left = _interrupted(runs_dir, held[0].run, held[0].part)
    began = left.began
    options = RunOptions(
        recipes=[str(recipe_of(left, runs_dir / held[0].run))],
        cell_path=cell_path,
        count=1,
        operator=began.operator,
        lot=began.lot,
        order_number=began.order_number,
        part_temperature_c=began.part_temperature_c,
        empty=True,
        runs_dir=runs_dir,
        as_json=as_json,
    )
    return run_recipe(options, AcceptingOperator(why))


def _left(cell: Cell, runs_dir: Path) -> tuple[Held, ...]:
    here = rows.RunBegan(
        cell=cell.model_dump(mode="json", by_alias=True),
        devices=resolve(cell, {}),
        emulated_devices=tuple(cell.emulated_devices),
        clock=_clock_of(cell),
    )
    journal = runs_dir / JOURNAL_NAME
    if lost := why_lost(journal, here):
        raise JournalLostError(lost_words(journal, lost))
    if not journal.is_file():
        return ()
    return fold_custody(rows_of_all_journals(journal, here), CellIdentity.of(here))


def _clock_of(cell: Cell) -> str | None:
    path = find_clock(cell, {}).path
    return None if path is None else str(path)


def _interrupted(runs_dir: Path, run: str, part: int) -> Interrupted:
    left = fold_interrupted(read_rows(runs_dir / JOURNAL_NAME, run), run, part)
    if left is None:
        raise ConfigError(
            f"run {run} is in the journal of another folder of runs; name it with --runs"
        )
    return left


def recipe_of(left: Interrupted, folder: Path) -> Path:
    """Return the recipe file of a part, unchanged: the file itself, or the run's own copy of it.

    Parameters
    ----------
    left : the part
    folder : folder of the run that left it

    Raises
    ------
    ConfigError : neither is there as it was
    """
    began, recipe = left.began, Path(left.recipe.file)
    part = split_cad(Path(str(left.recipe.recipe.get("part", "")))).file
    inputs = folder / inputs_of(left.recipe_number)
    stored = {recipe: inputs / RECIPE_COPY, part: inputs / part.name}
    if learned := (left.recipe.recipe.get("inspection") or {}).get("learned"):
        stored[Path(learned)] = inputs / Path(learned).name
    for path in map(Path, began.files):  # what a STEP file of several files is made of
        if path.suffix.lower() in STEP_FORMATS and path.is_relative_to(part.parent):
            copy = inputs / path.relative_to(part.parent)
            stored |= {path: copy} if copy.is_file() else {}
    wanted = {path: began.files.get(str(path)) for path in stored}
    if all(_digest(path) == digest for path, digest in wanted.items()):
        return recipe
    if any(_digest(stored[path]) != digest for path, digest in wanted.items()):
        raise ConfigError(f"{recipe}: it has changed since, and {inputs} has no copy")
    again = inputs / "again"
    for path in stored:
        target = again / os.path.relpath(path, recipe.parent)
        if again.resolve() not in target.resolve().parents:
            raise ConfigError(f"{path}: it is not in the folder of {recipe}")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(stored[path], target)
    return again / recipe.name


def _digest(path: Path) -> str:
    return file_sha256(path) if path.is_file() else ""
