"""Find all journals that record a cell's grippers, whatever folder each run wrote to.

With another `--runs`, or from another working directory, a run writes another journal, but the part
in a gripper is the same. So the journal of every cell whose grippers outlive the run is noted,
together with the cell's identity, in the user's folder for state. A start reads them all.
"""

import json
import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Final

from ..devices.lock import state_dir
from ..journal import JournalError, Row, first_flaw
from ..journal.rows import JournalNotReadable, RunBegan
from .fold import CellIdentity, read_folded

FOLDER: Final = "journals"

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class _Entry:
    """A journal that records a cell; `began` is the body of the first row of its latest run."""

    path: Path
    journal: Path
    began: RunBegan
    noted_utc: str

    @property
    def clock(self) -> str | None:
        """The clock of the emulator that the cell belongs to, None for real devices."""
        return self.began.clock


def note_journal(journal: Path, began: RunBegan) -> None:
    """Note that a journal records a cell; done before anything moves.

    A cell whose grippers end with the run is not noted.

    Parameters
    ----------
    journal : its file
    began : the body of the run's first row

    Raises
    ------
    JournalError : the note cannot be written
    """
    if not _outlives_the_run(began):
        return
    path = state_dir() / FOLDER / f"{sha256(bytes(journal.resolve())).hexdigest()[:24]}.json"
    kept = began.model_dump(
        mode="json", include={"devices", "emulated_devices", "emulator", "clock"}
    )
    kept["cell"] = {"name": began.cell.get("name")}
    new = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with new.open("w", encoding="utf-8") as file:
            json.dump({"journal": str(journal.resolve()), "began": kept}, file)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except OSError as error:
        raise JournalError(
            f"{path}: {error.strerror}. The next start needs this note to find this run's journal. "
            "Nothing has moved. Set XDG_STATE_HOME to a folder that can be written"
        ) from error


def rows_of_all_journals(own: Path, began: RunBegan) -> list[Row]:
    """Return the rows that `fold_custody` needs, of all journals of a cell, in order of time.

    A journal that is gone or damaged may have recorded a part, so a row stands for it that says it
    cannot be read.

    Parameters
    ----------
    own : the journal of this run
    began : the body of this run's first row

    Raises
    ------
    JournalError : the own journal cannot be read
    """
    rows = list(read_folded(own))
    if not _outlives_the_run(began):
        return rows
    others = [row for entry in _others(own, began) for row in _rows_of(entry)]
    return sorted((*others, *rows), key=lambda row: row.t_utc) if others else rows


def _outlives_the_run(began: RunBegan) -> bool:
    here = CellIdentity.of(began)
    return set(here.grippers) != set(here.emulated)


def _others(own: Path, began: RunBegan) -> Sequence[_Entry]:
    here, clock = CellIdentity.of(began), began.clock
    found = []
    for entry in _entries():
        if entry.clock is not None and not Path(entry.clock).exists():
            entry.path.unlink(missing_ok=True)  # that emulator has ended, and its parts with it
        elif entry.journal != own.resolve() and entry.clock == clock:
            cell = CellIdentity.of(entry.began)
            if any(here.shares(gripper, cell) for gripper in here.grippers):
                found.append(entry)
    return found


def _rows_of(entry: _Entry) -> list[Row]:
    try:
        flaw = first_flaw(entry.journal) if entry.journal.exists() else "it is gone"
        if flaw is None:
            return list(read_folded(entry.journal))
    except (JournalError, OSError) as error:
        flaw = str(error)
    row = JournalNotReadable(why=f"its journal knew of this cell, but {flaw}")
    run = f"in {entry.journal}"
    return [Row(0, entry.noted_utc, 0.0, run, None, row.kind, row.row_name, row.as_json())]


def _entries() -> Iterator[_Entry]:
    for path in sorted((state_dir() / FOLDER).glob("*.json")):
        try:
            body = json.loads(path.read_text(encoding="utf-8"))
            noted = datetime.fromtimestamp(path.stat().st_mtime, UTC)
            began = RunBegan.model_validate(
                {key: value for key, value in body["began"].items() if value is not None}
            )
            yield _Entry(
                path,
                Path(body["journal"]),
                began,
                noted.isoformat(timespec="microseconds"),
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            log.warning("%s is not the note of a journal (%s) and is ignored", path, error)
