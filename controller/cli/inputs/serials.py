"""Serial numbers on a command line: their source, and the ones taken already."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from controller.cell.batch import Papers
from controller.cell.journal import JOURNAL_NAME, JournalError, read_rows_named, rows
from controller.cell.services.table import counted, parted, why_no_serial
from controller.config import ConfigError

from ..options import SerialOptions
from ..terminal.output import warn
from .parts_list import PartsList

MAX_NAMED = 5  # numbers that a message lists


def papers_of(
    options: SerialOptions,
    papers: Papers,
    listed: PartsList | None,
    recipe_count: int,
    part_count: int,
    runs_dir: Path,
) -> Papers:
    """Return the papers of a run with its serial numbers.

    Parameters
    ----------
    options : options of the command line
    papers : without numbers
    listed : the list of parts, None without one
    recipe_count, part_count : numbers of recipes and parts of the run
    runs_dir : folder of all runs, whose journal names the numbers that parts have

    Raises
    ------
    ConfigError : options contradict each other, a number is none, or parts have it already
    """
    _check(options, listed, recipe_count, part_count)
    first = options.counted_from or ""
    if first:
        first = _first_counted(first, part_count, runs_dir, goes_on=options.goes_on)
    labels = () if listed is None else listed.labels
    _warn_of_known([label.serial for _, label in labels if label.serial], runs_dir)
    return replace(
        papers,
        serials=tuple(options.serials or ()),
        listed=labels,
        counted_from=first,
        is_read=options.is_read,
    )


def _check(
    options: SerialOptions, listed: PartsList | None, recipe_count: int, part_count: int
) -> None:
    sources = {
        "--serial": bool(options.serials),
        "--serial-from": options.counted_from is not None,
        "--parts-list": listed is not None,
        "--scan": options.is_read,
    }
    given = [name for name, is_given in sources.items() if is_given]
    if len(given) > 1 and given != ["--parts-list", "--scan"]:
        raise ConfigError(f"{' and '.join(given)} exclude each other: each names the parts")
    if options.serials and recipe_count > 1:
        raise ConfigError(
            "--serial requires a single recipe: with several, the order of the parts is not known; "
            "give the numbers in a list with --parts-list"
        )
    for serial in options.serials or ():
        if why := why_no_serial(serial):
            raise ConfigError(f"--serial {serial!r}: {why}")
    twice = [one for one, count in Counter(options.serials).items() if count > 1]
    if twice:
        raise ConfigError(f"--serial {twice[0]}: given twice; each part needs its own")
    if (count := len(options.serials or ())) > part_count:
        raise ConfigError(
            f"{count} serial numbers for {part_count} {'part' if part_count == 1 else 'parts'}: "
            f"leave some out, or order as many parts (--count {count})"
        )
    if options.goes_on and options.counted_from is None:
        raise ConfigError("--across-runs requires --serial-from")
    if options.is_read and listed is not None:
        without = [label for _, label in listed.labels if not label.serial]
        if without:
            raise ConfigError("--scan: some parts of the list have no serial number")


def _first_counted(first: str, part_count: int, runs_dir: Path, *, goes_on: bool) -> str:
    """Return the first number to give, with no conflict with earlier runs."""
    if why := why_no_serial(first):
        raise ConfigError(f"--serial-from {first!r}: {why}")
    head, digits = parted(first)
    if not digits:
        raise ConfigError(f"--serial-from {first}: must end in a number, such as A0001")
    known = serials_in(runs_dir)
    if goes_on:
        given = map(parted, known)
        last = max((int(end) for before, end in given if before == head and end), default=-1)
        return first if last < int(digits) else counted(first, last + 1 - int(digits))
    taken = [serial for k in range(part_count) if (serial := counted(first, k)) in known]
    if taken:
        raise ConfigError(
            f"--serial-from {first}: parts of earlier runs have {_named(taken)} already; begin "
            "with another number, or go on after the last one with --across-runs"
        )
    return first


def _named(taken: Sequence[str]) -> str:
    return ", ".join(taken[:MAX_NAMED]) + (" ..." if len(taken) > MAX_NAMED else "")


def serials_in(runs_dir: Path) -> frozenset[str]:
    """Return the serial numbers of all parts in a folder of runs, by its journal.

    Raises
    ------
    ConfigError : the journal cannot be read
    """
    path = runs_dir / JOURNAL_NAME
    if not path.is_file():
        return frozenset()
    names = (rows.PartIdentified.row_name, rows.RunBegan.row_name)
    found: set[str] = set()
    try:
        for row in read_rows_named(path, names):
            found.add(str(row.body.get("serial", "")))
            found.update(str(one) for one in row.body.get("serials", ()))
    except JournalError as error:
        raise ConfigError(str(error)) from error
    return frozenset(found - {""})


def _warn_of_known(serials: Sequence[str], runs_dir: Path) -> None:
    """Name the numbers of a list that parts of earlier runs have: the list may be an old one."""
    if not serials:
        return
    known = serials_in(runs_dir)
    taken = [serial for serial in serials if serial in known]
    if taken:
        warn(f"--parts-list: parts of earlier runs have {_named(taken)}; is this the right list?")
