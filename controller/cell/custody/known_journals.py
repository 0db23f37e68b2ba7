"""Find all journals that record a cell's grippers, and prove that each is the one it was.

With another `--runs`, or from another working directory, a run writes another journal, but the part
in a gripper is the same. So the journal of every cell whose grippers outlive the run is noted,
together with the cell's identity, in the user's folder for state. Beside each note is a second head
of that journal, which names its last secured row, and so the last change of custody. A journal
without that row is not the noted one: its folder was deleted, its disk is not mounted, or an older
copy or another file is in its place. Its record of the grippers is then lost, and a person has to
decide before any journal is made, including the one of this run.
"""

import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from messages import key, say

from ..errors import CellError
from ..journal import (
    HOST_STAMPS,
    CellJournal,
    Head,
    HeadError,
    Journal,
    JournalError,
    Row,
    Stamps,
    first_flaw,
    is_of,
    open_cell_journal,
    put_on_disk,
    read_head_file,
    read_rows,
    row_at,
)
from ..journal.rows import JournalNotReadable, RunBegan
from ..lock import state_dir
from .fold import CellIdentity, read_folded

FOLDER: Final = "journals"
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
# Fields of a run's first row that identify its cell.
_IDENTITY: Final = {"devices", "emulated_devices", "emulator", "clock"}

log = logging.getLogger(__name__)


class JournalLostError(CellError):
    """The journal noted at a path is missing; nothing has moved, and no other one was made."""


@dataclass(frozen=True, slots=True)
class _Note:
    """A note that a journal records a cell.

    Attributes
    ----------
    path : path of the note
    journal : the file
    began : statement of the cell in the first row of its latest run; None if the note is unreadable
    order_us : order of that run
    head : its last secured row; None if that is not known
    flaw : reason why the note cannot be read; empty if it can
    """

    path: Path
    journal: Path
    began: RunBegan | None
    order_us: int
    head: Head | None
    flaw: str = ""

    def concerns(self, here: CellIdentity, clock: str | None) -> bool:
        """Return whether the note is, or may be, about a cell."""
        if self.began is None:
            return clock is None
        cell = CellIdentity.of(self.began)
        return self.began.clock == clock and any(here.shares(one, cell) for one in here.grippers)

    @property
    def why_gone(self) -> str:
        """Why there is no journal; empty if there is one."""
        if not self.journal.exists():
            return key("it is gone: it was deleted or moved, or its disk is not mounted")
        is_empty = self.journal.is_file() and self.journal.stat().st_size == 0
        return key("its file is empty") if is_empty else ""

    @property
    def why_lost(self) -> str:
        """The reason why the file there is not the noted journal; empty if it is."""
        if self.began is None:
            return self.flaw
        if (why := self.why_gone) or self.head is None:
            return why
        found = row_at(self.journal, self.head.seq)
        if found is None:
            return say(
                "it lacks row {seq}, which this cell has secured: it is an older "
                "copy, or another file",
                seq=self.head.seq,
            )
        if found.hash != self.head.hash:
            return say("its row {seq} is not the one that this cell has secured", seq=self.head.seq)
        return ""


def open_noted_journal(
    path: Path,
    run: str,
    began: RunBegan | None = None,
    stamps: Stamps = HOST_STAMPS,
    *,
    may_begin_anew: bool = False,
) -> CellJournal:
    """Return a cell's journal, checked, unless the one noted at its path is lost.

    Parameters
    ----------
    path : path of the file
    run : run that is about to write
    began : the body of its first row; None for a command that has none
    stamps : the clocks that rows are stamped by
    may_begin_anew : a person vouches for the grippers. The journal then says first that what the
        lost one knew is unknown

    Raises
    ------
    JournalLostError : the noted journal is lost; none was made
    JournalError : it cannot be written; nothing may move without it
    """
    lost = why_lost(path, began)
    if lost and not may_begin_anew:
        raise JournalLostError(lost_words(path, lost))
    opened = open_cell_journal(path, run, stamps)
    if not lost:
        return opened
    opened.journal.write_synced(JournalNotReadable(why=lost))
    notice = say(
        "The journal {path} is not the one that was noted there: {lost}. A new one begins.",
        path=path,
        lost=lost,
    )
    return CellJournal(
        opened.journal,
        say("{of_journal} {of_copy}", of_journal=opened.notice, of_copy=notice).strip(),
    )


def why_lost(path: Path, began: RunBegan | None = None) -> str:
    """Return why the journal noted at a path is lost; empty if it exists or none was noted.

    Parameters
    ----------
    path : path of the file
    began : the body of a run's first row; None to ask only whether there is a file

    Raises
    ------
    JournalError : the notes cannot be read
    """
    file = path.resolve()
    for note in _notes_of_living():
        if note.journal != file:
            continue
        if why := note.why_gone:
            return why
        if began is not None and note.concerns(CellIdentity.of(began), began.clock):
            with suppress(JournalError):  # a damaged one is set aside by whoever opens it
                if why := note.why_lost:
                    return why
    return ""


def lost_words(path: Path, why: str) -> str:
    """Return the consequences of a lost journal and the remedies, as sentences.

    Parameters
    ----------
    path : path of the file
    why : it is lost
    """
    return say(
        "{path}: a journal of this cell is noted there, but {why}. What "
        "the grippers hold is unknown. Nothing has moved, and no other "
        "journal was begun. Mount its disk, or put the folder back, then "
        "start again. If it is lost for good, look at both grippers. To "
        "take a part out: `cellctl recover --cell CELL --open arm`, or "
        "`--open fixed`, opens that gripper while you hold the part. Then "
        "start with --part-removed, which begins a new journal",
        path=path,
        why=why,
    )


def lost_rows(path: Path, why: str) -> list[Row]:
    """Return the rows that stand in for a lost journal until a new one is begun.

    Parameters
    ----------
    path : path of the file
    why : it is lost
    """
    return [_unknown(f"in {path}", datetime.now(UTC), why)]


def after_known(began: RunBegan) -> RunBegan:
    """Return the body of a run's first row, ordered after all starts that are noted.

    Clocks of computers are set back, and yet journals of several folders have to be ordered in
    time: each start notes a time later than all that it knows of (a hybrid logical clock;
    docs/references.md [L31]).

    Parameters
    ----------
    began : condition before it

    Raises
    ------
    JournalError : the notes cannot be read
    """
    if not CellIdentity.of(began).outlives_the_run:
        return began
    known = [note.order_us for note in _notes()]
    return began.model_copy(update={"after_us": max(known) + 1}) if known else began


def note_journal(journal: Journal, began: RunBegan) -> None:
    """Note that a journal records a cell; done before anything moves.

    From then on its last secured row is kept beside the note. A cell whose grippers end with the
    run is not noted.

    Parameters
    ----------
    journal : journal of the run, with the run's first row on the disk
    began : the body of that row

    Raises
    ------
    JournalError : the note cannot be written
    """
    here = CellIdentity.of(began)
    if not here.outlives_the_run:
        return
    file = journal.path.resolve()
    kept = began.model_dump(mode="json", include=_IDENTITY)
    kept["cell"] = {"name": began.cell.get("name")}
    path = _note_path(file, here, began.clock)
    first = next(row for row in read_rows(journal.path, journal.run) if is_of(row, RunBegan))
    body = {"journal": str(file), "began": kept, "order_us": _order_us(first)}
    new = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        journal.keep_head(_head_of(path))
        new.write_text(json.dumps(body), encoding="utf-8")
        put_on_disk(new)
        new.replace(path)
        put_on_disk(path.parent)
    except OSError as error:
        raise JournalError(
            say(
                "{path}: {strerror}. The next start needs this note to find this "
                "run's journal. Nothing has moved. Set XDG_STATE_HOME to a folder "
                "that can be written",
                path=path,
                strerror=error.strerror,
            )
        ) from error


def _note_path(journal: Path, cell: CellIdentity, clock: str | None) -> Path:
    """Return the path of the note that a journal records a cell; one journal may record several."""
    which = json.dumps([cell.name, sorted(cell.grippers.items()), clock])
    names = [sha256(one).hexdigest()[:24] for one in (bytes(journal), which.encode())]
    return state_dir() / FOLDER / f"{'-'.join(names)}.json"


def _head_of(note: Path) -> Path:
    return note.with_suffix(".head")


def rows_of_all_journals(own: Path, began: RunBegan) -> list[Row]:
    """Return the rows that `fold_custody` needs, from all journals of a cell, in order.

    A lost or damaged journal may have recorded a part, so a row in its place reports that it cannot
    be read.

    Parameters
    ----------
    own : the journal of this run, which exists
    began : the body of this run's first row

    Raises
    ------
    JournalError : the own journal, or the notes, cannot be read
    """
    rows = list(read_folded(own))
    here = CellIdentity.of(began)
    if not here.outlives_the_run:
        return rows
    ordered = list(_in_order(rows))
    others = {
        note.journal: note
        for note in sorted(_notes_of_living(), key=lambda one: one.order_us)
        if note.journal != own.resolve() and note.concerns(here, began.clock)
    }
    for note in others.values():
        ordered += _in_order(_rows_of(note), note.order_us)
    return [row for _, row in sorted(ordered, key=lambda one: one[0])]


def _in_order(rows: Sequence[Row], order_us: int = 0) -> Iterator[tuple[int, Row]]:
    """Yield the rows of one journal, each with the order of its run among those of all journals."""
    latest = 0
    for row in rows:
        if is_of(row, RunBegan):
            latest = max(latest, _order_us(row))
        elif row.seq == 0:  # it stands for a journal
            latest = order_us
        # a run from before starts were ordered
        yield latest or _since_epoch_us(datetime.fromisoformat(row.t_utc)), row


def _order_us(first: Row) -> int:
    """Return the order of a run, by its first row, among those of all journals."""
    begun_us = _since_epoch_us(datetime.fromisoformat(first.t_utc))
    return max(begun_us, int(first.body.get("after_us", 0)))


def _since_epoch_us(at: datetime) -> int:
    return (at - EPOCH) // timedelta(microseconds=1)


def _rows_of(note: _Note) -> list[Row]:
    try:
        flaw = note.why_lost or first_flaw(note.journal)
        if not flaw:
            return list(read_folded(note.journal))
    except (JournalError, OSError) as error:
        flaw = str(error)
    noted = EPOCH + timedelta(microseconds=note.order_us)
    return [
        _unknown(
            f"in {note.journal}", noted, say("its journal knew of this cell, but {flaw}", flaw=flaw)
        )
    ]


def _unknown(run: str, at: datetime, why: str) -> Row:
    row = JournalNotReadable(why=why)
    since = at.isoformat(timespec="microseconds")
    return Row(0, since, 0.0, run, None, row.kind, row.row_name, row.as_json())


def _notes_of_living() -> Iterator[_Note]:
    """Yield the notes; those of ended emulators are deleted, with their parts."""
    for note in _notes():
        clock = None if note.began is None else note.began.clock
        if clock is None or Path(clock).exists():
            yield note
        else:
            note.path.unlink(missing_ok=True)
            _head_of(note.path).unlink(missing_ok=True)


def _notes() -> Iterator[_Note]:
    folder = state_dir() / FOLDER
    try:
        paths = sorted(folder.iterdir())  # a glob would pass over a folder that cannot be read
    except FileNotFoundError:
        return
    except OSError as error:
        raise JournalError(
            say(
                "{folder}: {strerror}. It lists the journals of this cell, and "
                "nothing moves without it. Make it readable",
                folder=folder,
                strerror=error.strerror,
            )
        ) from error
    for path in paths:
        if path.suffix == ".json":
            yield _read_note(path)


def _read_note(path: Path) -> _Note:
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        began: Mapping[str, Any] = body["began"]
        return _Note(
            path,
            Path(body["journal"]),
            RunBegan.model_validate({k: v for k, v in began.items() if v is not None}),
            int(body.get("order_us", 0)) or _noted_us(path),
            read_head_file(_head_of(path)),
        )
    except (OSError, HeadError, ValueError, KeyError, TypeError, AttributeError) as error:
        # it may have been about this cell, and about a part in a gripper
        why = say("{path} notes a journal and cannot be read ({error})", path=path, error=error)
        return _Note(path, path, None, _noted_us(path), None, why)


def _noted_us(path: Path) -> int:
    with suppress(OSError):
        return int(path.stat().st_mtime * 1e6)
    return 0
