"""Fills the store from the journals of a folder of runs; reads them only, in short reads.

Nothing here belongs to a run: a command fills the store before it answers. The entry of a part is
replaced whole, in one transaction, so that filling again changes nothing and a killed filler leaves
no half part. Where store and journal disagree, the journal is right (ADR 67).
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Connection, Table, delete, func, insert, select, update

from controller.cell.journal import (
    GENESIS,
    NO_ROW,
    Head,
    JournalError,
    NewRows,
    journals_in,
    new_rows,
    row_at,
    rows,
    rows_of_parts,
    whole_up_to,
)
from controller.results.run import ResultsError, RunRecord, fold

from .rows_of import PartRows, alarm_rows, part_id, part_rows, run_row
from .sentences import without_sentences
from .store import Store
from .tables import (
    ALARMS,
    CHARACTERISTICS,
    JOURNALS,
    LEFT_OUT,
    MEASUREMENTS,
    OF_PART,
    PARTS,
    REJUDGED,
    RUNS,
)

CHUNK_COUNT: Final = 16  # parts folded at once, whose rows are in memory together


@dataclass(slots=True)
class Filled:
    """The result of filling.

    Attributes
    ----------
    part_count : parts written, new or once more
    problems : sentences on what was not stored, and why
    """

    part_count: int = 0
    problems: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Source:
    """A journal that the store is filled from.

    Attributes
    ----------
    number : in the store
    seen : the row up to which the store has it
    whole : the row up to which its chain is whole now
    is_broken : rows follow that do not fit
    """

    path: Path
    number: int
    seen: Head
    whole: Head
    is_broken: bool


def journals_by_key(runs_dir: Path) -> dict[str, Path]:
    """Return the readable journals of a folder of runs, by the key that the store has of each."""
    found = {}
    for path in journals_in(runs_dir):
        with suppress(JournalError):
            first = row_at(path, 1)
            found.update({} if first is None else {first.hash: path})
    return found


def fill(
    store: Store,
    runs_dir: Path,
    *,
    anew: bool = False,
    on_run: Callable[[str, int], None] = lambda run, parts: None,
) -> Filled:
    """Fill the store with everything new in the journals; return a summary.

    Parameters
    ----------
    store : store to fill
    runs_dir : folder of all runs
    anew : read the journals from their first row on, also one that is not as it was
    on_run : called with the id of a run that went in, and how many of its parts

    Raises
    ------
    HistoryError : the store cannot be written
    """
    filled = Filled()
    for path in journals_in(runs_dir):
        try:
            source = _source(store, path, filled, anew=anew)
            if source is not None:
                _fill_from(store, source, filled, on_run)
        except (JournalError, OSError) as error:
            filled.problems.append(f"{error}; nothing of it went in")
    with store.reading() as db:
        query = select(LEFT_OUT.c.run_id, LEFT_OUT.c.number, LEFT_OUT.c.why)
        for run, number, why in db.execute(query.order_by(LEFT_OUT.c.run_id, LEFT_OUT.c.number)):
            what = f"run {run} part {number}" if number else f"run {run}"
            filled.problems.append(f"{what} is left out: {why}")
    return filled


def folded(path: Path, run: str, parts: Sequence[int], last_seq: int | None = None) -> RunRecord:
    """Return a run with some of its parts, folded from the journal.

    Parameters
    ----------
    path : the journal
    run : its id
    parts : their numbers
    last_seq : the last row that counts; None for all

    Raises
    ------
    JournalError : the journal cannot be read
    ResultsError : a row is not what this version of cellctl writes
    """
    found = rows_of_parts(path, run, parts, last_seq)
    if not found:
        raise ResultsError(f"journal {path}: has no run {run}")
    return fold(run, path.parent / run, found, None)


def _source(store: Store, path: Path, filled: Filled, *, anew: bool) -> _Source | None:
    """Return a journal with the store's knowledge of it; None if it has no rows."""
    first = row_at(path, 1)
    if first is None:
        return None
    with store.writing() as db:
        found = db.execute(select(JOURNALS).where(JOURNALS.c.key == first.hash)).one_or_none()
        if found is None:
            values = {"key": first.hash, "file": path.name, "last_seq": 0, "last_hash": GENESIS}
            made = db.execute(insert(JOURNALS).values(values)).inserted_primary_key
            assert made is not None
            number, seen = int(made[0]), NO_ROW
        else:
            number, seen = int(found.journal_no), Head(int(found.last_seq), found.last_hash)
            if found.file != path.name:
                _at(db, number, file=path.name)
        if anew:
            seen = NO_ROW
            _at(db, number, last_seq=0, last_hash=GENESIS)
            db.execute(delete(LEFT_OUT).where(LEFT_OUT.c.journal_no == number))
    if seen.seq and row_at(path, seen.seq) != seen:
        filled.problems.append(
            f"journal {path}: its row {seen.seq} is not the one that the store was filled by; what "
            "is in the store stays, nothing new goes in (`cellctl history --refill` takes the "
            "journal as it is now)"
        )
        return None
    whole, broken = whole_up_to(path, seen)
    if broken is not None:
        filled.problems.append(
            f"journal {path}: row {broken.seq} of run {broken.run} {broken.why}; runs with rows "
            "from there on stay out (`cellctl verify`)"
        )
    source = _Source(path, number, seen, whole, broken is not None)
    if anew:
        _forget_gone(store, source)
    return source


def _at(db: Connection, journal_no: int, **values: object) -> None:
    db.execute(update(JOURNALS).where(JOURNALS.c.journal_no == journal_no).values(**values))


def _fill_from(
    store: Store, source: _Source, filled: Filled, on_run: Callable[[str, int], None]
) -> None:
    new = new_rows(source.path, source.seen.seq, source.whole.seq)
    beyond = {one.run for one in new_rows(source.path, source.whole.seq)}
    by_run: dict[str, list[NewRows]] = {}
    for one in new:
        if not (source.is_broken and one.run in beyond):
            by_run.setdefault(one.run, []).append(one)
    # runs that write at the same time have their rows between each other's
    waiting = sorted(by_run, key=lambda run: by_run[run][0].first_seq)
    for i, run in enumerate(waiting):
        _fill_run(store, source, run, by_run[run], filled)
        on_run(run, sum(one.part is not None for one in by_run[run]))
        rest = [by_run[later][0].first_seq for later in waiting[i + 1 :]]
        _note_seen(store, source, min(rest) - 1 if rest else source.whole.seq)
    if not waiting:
        _note_seen(store, source, source.whole.seq)


def _forget_gone(store: Store, source: _Source) -> None:
    """Delete runs and parts of a journal that it no longer has; the rest is written once more."""
    there = new_rows(source.path, 0, source.whole.seq)
    runs = {one.run for one in there}
    parts = {(one.run, one.part) for one in there}
    with store.writing() as db:
        of_journal = RUNS.c.journal_no == source.number
        known = db.execute(select(RUNS.c.run_no, RUNS.c.run_id).where(of_journal)).all()
        numbers = [int(run_no) for run_no, _ in known]
        for run_no, run in known:
            ids = db.execute(
                select(PARTS.c.part_id, PARTS.c.number).where(PARTS.c.run_no == run_no)
            )
            gone = [int(key) for key, number in ids.all() if (run, number) not in parts]
            _delete_parts(db, gone)
            db.execute(delete(REJUDGED).where(REJUDGED.c.part_id.in_(gone)))
            if run not in runs:
                db.execute(delete(ALARMS).where(ALARMS.c.run_no == run_no))
                db.execute(delete(RUNS).where(RUNS.c.run_no == run_no))
        # what was read of a journal that was longer then must not stand against this one
        for number in numbers:
            db.execute(update(PARTS).where(PARTS.c.run_no == number).values(read_seq=0))
        db.execute(update(RUNS).where(of_journal).values(read_seq=0))


def _delete_parts(db: Connection, keys: Collection[int]) -> None:
    for table in (*OF_PART, PARTS) if keys else ():
        db.execute(delete(table).where(table.c.part_id.in_(keys)))


def _note_seen(store: Store, source: _Source, seq: int) -> None:
    """Note the last row of a journal that the store has; never an earlier one than noted."""
    head = row_at(source.path, seq)
    if head is None or seq <= source.seen.seq:
        return
    with store.writing() as db:
        db.execute(
            update(JOURNALS)
            .where(JOURNALS.c.journal_no == source.number, JOURNALS.c.last_seq < seq)
            .values(last_seq=seq, last_hash=head.hash)
        )


def _fill_run(
    store: Store, source: _Source, run: str, new: Sequence[NewRows], filled: Filled
) -> None:
    numbers = {one.part for one in new if one.part is not None}
    is_run = (RUNS.c.run_id == run) & (RUNS.c.journal_no == source.number)
    with store.reading() as db:
        still_open = select(PARTS.c.number).join(RUNS).where(is_run, PARTS.c.is_open)
        numbers |= {int(number) for number in db.execute(still_open).scalars()}
        last = db.execute(select(func.max(PARTS.c.number)).join(RUNS).where(is_run))
        # the run's end is told by its last part
        numbers |= {int(number) for number in last.scalars() if number is not None}
    ordered = sorted(numbers)
    chunks = [ordered[i : i + CHUNK_COUNT] for i in range(0, len(ordered), CHUNK_COUNT)] or [[]]
    for chunk in chunks:
        for record, why in _records(source, run, chunk):
            if isinstance(record, RunRecord):
                filled.part_count += _write(store, source, record)
            else:
                _leave_out(store, source, run, record, why)


def _records(
    source: _Source, run: str, chunk: Sequence[int]
) -> Iterator[tuple[RunRecord | int, str]]:
    """Yield a run with parts of it, and the number and reason of each part that is unreadable."""
    try:
        yield folded(source.path, run, chunk, source.whole.seq), ""
    except ResultsError as error:
        if len(chunk) == 0:
            yield 0, str(error)
        for number in chunk if len(chunk) > 1 else ():
            yield from _records(source, run, [number])
        if len(chunk) == 1:
            yield chunk[0], str(error)


def _leave_out(store: Store, source: _Source, run: str, number: int, why: str) -> None:
    with store.writing() as db:
        _leave_out_in(db, source, run, number, why)


def _leave_out_in(db: Connection, source: _Source, run: str, number: int, why: str) -> None:
    _take_back(db, source, run, number)
    values = {"journal_no": source.number, "run_id": run[:200], "number": number, "why": why}
    db.execute(insert(LEFT_OUT).values(values))


def _take_back(db: Connection, source: _Source, run: str, *numbers: int) -> None:
    """Forget that parts, or a run, were left out."""
    db.execute(
        delete(LEFT_OUT).where(
            LEFT_OUT.c.journal_no == source.number,
            LEFT_OUT.c.run_id == run[:200],
            LEFT_OUT.c.number.in_(numbers),
        )
    )


def _write(store: Store, source: _Source, record: RunRecord) -> int:
    """Write a run and parts of it; return the number of parts."""
    if not any(isinstance(entry.row, rows.RunBegan) for entry in record.log):
        return 0  # an acknowledgement, or a report noted later: no run of its own
    found = part_rows(record)
    with store.writing() as db:
        run_no = _write_run(db, source, record)
        if run_no is None:
            _leave_out_in(
                db,
                source,
                record.run_id,
                0,
                f"cell {record.cell_name} has it from another journal: this is a copy, or two "
                "cells have one name (`name:` in the cell file)",
            )
            return 0
        _take_back(db, source, record.run_id, 0, *(part.number for part in found))
        return _write_parts(db, source, run_no, found)


def _write_run(db: Connection, source: _Source, record: RunRecord) -> int | None:
    """Write the row of a run and its alarms; return its number, None if another journal has it."""
    (row,) = without_sentences(db, [run_row(record)])
    values = {**row, "journal_no": source.number, "read_seq": source.whole.seq}
    is_run = (RUNS.c.cell == record.cell_name) & (RUNS.c.run_id == record.run_id)
    known = db.execute(select(RUNS).where(is_run)).one_or_none()
    if known is None:
        made = db.execute(insert(RUNS).values(run_id=record.run_id, **values)).inserted_primary_key
        assert made is not None
        run_no = int(made[0])
    elif known.journal_no != source.number:
        return None  # a copy of a journal: the first one that was read has it
    else:
        run_no = int(known.run_no)
        if known.read_seq <= source.whole.seq:
            db.execute(update(RUNS).where(RUNS.c.run_no == run_no).values(**values))
    alarms = alarm_rows(record)
    if alarms:
        seqs = [alarm["seq"] for alarm in alarms]
        db.execute(delete(ALARMS).where(ALARMS.c.run_no == run_no, ALARMS.c.seq.in_(seqs)))
        _insert(db, ALARMS, [{"run_no": run_no, **alarm} for alarm in alarms])
    return run_no


def _write_parts(db: Connection, source: _Source, run_no: int, found: Sequence[PartRows]) -> int:
    """Write parts of a run, all rows of a table at once; return their number."""
    by_key = {part_id(run_no, part.number): part for part in found}
    known = select(PARTS.c.part_id, PARTS.c.read_seq).where(PARTS.c.part_id.in_(by_key))
    read = {int(key): int(seq) for key, seq in db.execute(known)}
    # of those left out here, another process has read more of the journal meanwhile
    written = {k: part for k, part in by_key.items() if read.get(k, 0) <= source.whole.seq}
    _delete_parts(db, written.keys() & read.keys())
    keys = {"run_no": run_no, "read_seq": source.whole.seq}
    _insert(db, PARTS, [{"part_id": k, **keys, **part.part} for k, part in written.items()])
    numbers = _characteristics(db, written.values())
    for table in OF_PART:
        values = [
            {"part_id": k, **one} for k, part in written.items() for one in part.of_part[table]
        ]
        if table is MEASUREMENTS:
            for one in values:
                one["characteristic_no"] = numbers[one["characteristic_no"]]
        _insert(db, table, values)
    return len(written)


def _insert(db: Connection, table: Table, values: list[dict[str, Any]]) -> None:
    if values:
        db.execute(insert(table), without_sentences(db, values))


def _characteristics(db: Connection, found: Iterable[PartRows]) -> dict[str, int]:
    """Return the number of each characteristic by its key; new ones are written."""
    wanted = {key: values for part in found for key, values in part.characteristics.items()}
    if not wanted:
        return {}
    c = CHARACTERISTICS.c
    known = {
        str(key): int(number)
        for key, number in db.execute(
            select(c.key, c.characteristic_no).where(c.key.in_(list(wanted)))
        )
    }
    new = [{"key": key, **values} for key, values in wanted.items() if key not in known]
    if new:
        made = insert(CHARACTERISTICS).returning(c.key, c.characteristic_no)
        written = db.execute(made, without_sentences(db, new))
        known |= {str(key): int(number) for key, number in written}
    return known
