"""Parts of the store as one file for other programs: CSV, Parquet or QIF by its suffix.

CSV and Parquet are flat: a row for each characteristic of each part, and one row of a part that
has none. They are written piece by piece, so that a long history needs little memory. QIF needs
more of a part than the store keeps, so the journal is read for it.
"""

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Connection, func, select

from controller.cell.journal import JournalError
from controller.results.exports import csv_cell, qif_bytes
from controller.results.judged import JudgedPart, judged_parts
from controller.results.pages import whole_file
from controller.results.run import ResultsError

from .errors import HistoryError
from .filling import folded, journals_by_key
from .queries import Filters
from .store import Store
from .tables import CHARACTERISTICS, JOURNALS, MEASUREMENTS, PARTS, REVIEWS, RUNS

BATCH_COUNT: Final = 5000  # rows in memory together
PART_COLUMNS: Final = (
    "run", "number", "recipe", "serial", "lot", "operator", "start", "end", "emulated",
    "part_verdict", "tray", "forecast_s", "done_forecast_s", "done_actual_s", "findings",
    "recoveries", "review", "review_who", "review_why", "review_at",
)  # fmt: skip
VALUE_COLUMNS: Final = (
    "balloon", "id", "label", "kind", "unit", "nominal", "lower", "upper", "source", "measured",
    "U_k2", "verdict", "reason",
)  # fmt: skip
COLUMNS: Final = (*PART_COLUMNS, *VALUE_COLUMNS, "order_number", "cell")
AT: Final = COLUMNS.index("review_at")


def export(store: Store, filters: Filters, path: Path, runs_dir: Path) -> int:
    """Write the parts that filters select, oldest first; return the number of rows or parts.

    Parameters
    ----------
    store : store to read
    filters : parts to select
    path : its suffix is one of `FORMS`
    runs_dir : folder of the journals, for QIF

    Raises
    ------
    HistoryError : another suffix, no such part, parts of different products in QIF, a journal that
        cannot be read, or a library that is not installed
    OSError : the file cannot be written; what was there before is still there
    """
    write = FORMS.get(path.suffix.lower())
    if write is None:
        raise HistoryError(f"{path.name}: the suffix of an export is one of {', '.join(FORMS)}")
    with store.reading() as db:
        return write(db, filters, path, runs_dir)


def _rows(db: Connection, filters: Filters) -> Iterator[tuple[Any, ...]]:
    p, c, m = PARTS.c, CHARACTERISTICS.c, MEASUREMENTS.c
    last, later = REVIEWS.alias("last"), REVIEWS.alias("later")
    newest = select(func.max(later.c.ordinal)).where(later.c.part_id == p.part_id)
    is_last = (last.c.part_id == p.part_id) & (last.c.ordinal == newest.scalar_subquery())
    source = PARTS.join(RUNS).outerjoin(last, is_last)
    source = source.outerjoin(MEASUREMENTS).outerjoin(CHARACTERISTICS)
    query = (
        select(
            RUNS.c.run_id, p.number, p.recipe, p.serial, p.lot, p.operator, p.start, p.end,
            p.is_emulated, p.verdict, p.tray, p.forecast_s, p.done_forecast_s, p.done_actual_s,
            p.finding_count, p.recovery_count, p.review, last.c.who, last.c.why, last.c.at,
            c.balloon, c.id, c.label, c.kind, c.unit, c.nominal, c.lower, c.upper, c.source,
            m.measured, m.U, m.verdict, m.reason, p.order_number, RUNS.c.cell,
        )
        .select_from(source)
        .where(filters.clause())
        .order_by(p.start, p.part_id, m.ordinal)
        .execution_options(yield_per=BATCH_COUNT)
    )  # fmt: skip
    for row in db.execute(query):
        yield tuple(row)


def _csv(db: Connection, filters: Filters, path: Path, runs_dir: Path) -> int:
    count = 0
    with whole_file(path) as file:
        # marked, so that Excel reads it as UTF-8
        text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="", write_through=True)
        writer = csv.writer(text)
        writer.writerow(COLUMNS)
        for row in _rows(db, filters):
            start, end, emulated = row[6].isoformat() + "Z", row[7].isoformat() + "Z", row[8]
            decided = "" if row[AT] is None else row[AT].isoformat() + "Z"
            shown = (*row[:6], start, end, "yes" if emulated else "no", *row[9:AT], decided)
            shown += row[AT + 1 :]
            writer.writerow([csv_cell(value) for value in shown])
            count += 1
        text.detach()
    return count


def _parquet(db: Connection, filters: Filters, path: Path, runs_dir: Path) -> int:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise HistoryError(
            "Parquet needs the library pyarrow: pip install 'cellctl[parquet]', or export CSV"
        ) from error
    texts, times = pa.string(), pa.timestamp("us", tz="UTC")
    types = {
        **dict.fromkeys(COLUMNS, texts),
        **dict.fromkeys(("number", "findings", "recoveries", "balloon"), pa.int64()),
        **dict.fromkeys(("start", "end", "review_at"), times),
        **dict.fromkeys(("forecast_s", "done_forecast_s", "done_actual_s"), pa.float64()),
        **dict.fromkeys(("nominal", "lower", "upper", "measured", "U_k2"), pa.float64()),
        "emulated": pa.bool_(),
    }
    schema = pa.schema([(name, types[name]) for name in COLUMNS])
    count = 0
    with whole_file(path) as file, parquet.ParquetWriter(file, schema, compression="zstd") as out:
        for batch in _batches(_rows(db, filters)):
            columns = zip(COLUMNS, zip(*batch, strict=True), strict=True)
            arrays = [pa.array(values, types[name]) for name, values in columns]
            out.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(batch)
    return count


def _batches(found: Iterator[tuple[Any, ...]]) -> Iterator[Sequence[tuple[Any, ...]]]:
    batch: list[tuple[Any, ...]] = []
    for row in found:
        batch.append(row)
        if len(batch) == BATCH_COUNT:
            yield batch
            batch = []
    if batch:
        yield batch


def _qif(db: Connection, filters: Filters, path: Path, runs_dir: Path) -> int:
    query = (
        select(JOURNALS.c.key, RUNS.c.run_id, RUNS.c.cell, PARTS.c.number)
        .select_from(PARTS.join(RUNS).join(JOURNALS))
        .where(filters.clause())
        .order_by(RUNS.c.start, RUNS.c.run_no, PARTS.c.number)
    )
    parts: list[JudgedPart] = []
    try:
        there = journals_by_key(runs_dir)
        for (key, run, cell), rows in groupby(db.execute(query).all(), key=lambda row: row[:3]):
            if key not in there:
                raise HistoryError(
                    f"QIF is made from the journal, and that of run {run} of cell {cell} is not "
                    f"in {runs_dir}: export where that cell's runs are, or choose by --cell-name"
                )
            numbers = [int(row[3]) for row in rows]
            for i in range(0, len(numbers), QIF_CHUNK):
                parts += judged_parts(folded(there[key], run, numbers[i : i + QIF_CHUNK]))
        data = qif_bytes(parts)
    except (JournalError, ResultsError) as error:
        raise HistoryError(f"QIF is made from the journal: {error}") from error
    except ValueError as error:  # no part, or parts of different products
        raise HistoryError(
            f"{path.name}: {error} (choose by --recipe, --since, --until)"
        ) from error
    with whole_file(path) as out:
        out.write(data)
    return len(parts)


QIF_CHUNK: Final = 16
FORMS: Final[Mapping[str, Callable[[Connection, Filters, Path, Path], int]]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".qif": _qif,
}
