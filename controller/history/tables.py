"""The tables of the store, the same in SQLite and PostgreSQL.

A part is `run_no` and its number in one integer, so that filling again writes the same keys.
Times are UTC without a zone. Changes of these tables need a step in `migrations.py`.
"""

from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    DateTime,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    false,
    true,
)

METADATA: Final = MetaData()
PART_BITS: Final = 20  # bits of `part_id` for the number of the part in its run
PARTS_MAX: Final = 2**PART_BITS - 1

VERSION: Final = Table(
    "store_version",
    METADATA,
    Column("one", Integer, primary_key=True),
    Column("version", Integer, nullable=False),
)
JOURNALS: Final = Table(
    "journals",
    METADATA,
    Column("journal_no", Integer, primary_key=True),
    Column("key", String(64), nullable=False, unique=True),  # the hash of its first row
    Column("file", Text, nullable=False),
    Column("last_seq", BigInteger, nullable=False),
    Column("last_hash", String(64), nullable=False),
)
LEFT_OUT: Final = Table(
    "left_out",
    METADATA,
    Column("journal_no", ForeignKey("journals.journal_no"), primary_key=True),
    Column("run_id", String(200), primary_key=True),
    Column("number", Integer, primary_key=True),  # of the part; 0 for the run
    Column("why", Text, nullable=False),
)
RUNS: Final = Table(
    "runs",
    METADATA,
    Column("run_no", Integer, primary_key=True),
    Column("run_id", String(200), nullable=False),
    Column("journal_no", ForeignKey("journals.journal_no"), nullable=False),
    Column("recipe", Text, nullable=False),
    Column("cell", Text, nullable=False),
    Column("operator", Text, nullable=False),
    Column("lot", Text, nullable=False),
    Column("recipe_sha256", String(64), nullable=False),
    Column("cad_sha256", String(64), nullable=False),
    Column("ordered", Integer, nullable=False),
    Column("speed", Double, nullable=False),
    Column("is_dry", Boolean, nullable=False),
    Column("is_emulated", Boolean, nullable=False),
    Column("start", DateTime, nullable=False),
    Column("end", DateTime, nullable=False),
    Column("wall_s", Double, nullable=False),
    Column("outcome", Text, nullable=False),
    Column("message", Text, nullable=False),
    Column("read_seq", BigInteger, nullable=False),  # the journal as it was read for this row
    # since version 8: address of the store of objects with copies of its pictures
    Column("copied_to", Text, nullable=False, server_default=""),
    UniqueConstraint("run_id", "cell", name="runs_of_cell"),  # since version 6
)
PARTS: Final = Table(
    "parts",
    METADATA,
    Column("part_id", BigInteger, primary_key=True, autoincrement=False),
    Column("run_no", ForeignKey("runs.run_no"), nullable=False),
    Column("number", Integer, nullable=False),
    Column("recipe", Text, nullable=False),
    Column("serial", Text, nullable=False),
    Column("lot", Text, nullable=False),
    Column("operator", Text, nullable=False),
    Column("verdict", Text, nullable=False),
    Column("reason", Text, nullable=False),
    Column("tray", Text, nullable=False),
    Column("custody", Text, nullable=False),
    Column("start", DateTime, nullable=False),
    Column("end", DateTime, nullable=False),
    Column("day", String(10), nullable=False),
    Column("wall_s", Double, nullable=False),
    Column("forecast_s", Double),  # of the whole plan [cell s]
    Column("done_forecast_s", Double, nullable=False),  # of the steps that were done and forecast
    Column("done_actual_s", Double, nullable=False),  # the same steps, as they were
    Column("compared_fraction", Double),
    Column("looks", Integer, nullable=False),
    Column("recovery_count", Integer, nullable=False),
    Column("finding_count", Integer, nullable=False),
    Column("is_emulated", Boolean, nullable=False),
    Column("is_open", Boolean, nullable=False),  # its rows may go on
    Column("read_seq", BigInteger, nullable=False),
    # since version 3
    Column("nest", Integer),
    Column("awaits_review", Boolean, nullable=False, server_default=false()),
    Column("review", String(10), nullable=False, server_default=""),  # accept, reject, or none
    # since version 4
    Column("is_counted", Boolean, nullable=False, server_default=true()),  # this is its record
    Column("followed_by", Text, nullable=False, server_default=""),  # the run that has it since
    # since version 5
    Column("order_number", Text, nullable=False, server_default=""),
    Index("parts_start", "start", "part_id"),
    Index("parts_recipe", "recipe", "start", "part_id"),
    Index("parts_verdict", "verdict", "start", "part_id"),
    Index("parts_serial", "serial", "recipe", "start"),
    Index("parts_lot", "lot", "start"),
    Index("parts_order", "order_number", "start"),
    Index("parts_operator", "operator", "start"),
    Index("parts_run", "run_no", "number"),
    Index("parts_awaiting", "awaits_review", "start", "part_id"),
    Index("parts_review", "review", "start", "part_id"),
)


def _of_part(name: str, *columns: Column[Any]) -> Table:
    """Return a table whose rows belong to a part, in their order."""
    part: Column[int] = Column(
        "part_id", ForeignKey("parts.part_id"), primary_key=True, autoincrement=False
    )
    ordinal = Column("ordinal", Integer, primary_key=True, autoincrement=False)
    return Table(name, METADATA, part, ordinal, *columns, sqlite_with_rowid=False)


CHARACTERISTICS: Final = Table(
    "characteristics",
    METADATA,
    Column("characteristic_no", Integer, primary_key=True),
    Column("key", String(64), nullable=False, unique=True),  # the hash of all that follows
    Column("recipe", Text, nullable=False),
    Column("id", Text, nullable=False),
    Column("balloon", Integer, nullable=False),
    Column("label", Text, nullable=False),
    Column("kind", Text, nullable=False),
    Column("unit", Text, nullable=False),
    Column("nominal", Double, nullable=False),
    Column("lower", Double, nullable=False),
    Column("upper", Double, nullable=False),
    Column("source", Text, nullable=False),
    Column("is_critical", Boolean, nullable=False),
)
MEASUREMENTS: Final = _of_part(
    "measurements",
    Column("characteristic_no", ForeignKey("characteristics.characteristic_no"), nullable=False),
    Column("measured", Double),
    Column("U", Double),
    Column("verdict", Text, nullable=False),
    Column("reason", Text, nullable=False),
)
FINDINGS: Final = _of_part(
    "findings",
    Column("kind", Text, nullable=False),
    Column("view", Text, nullable=False),
    Column("lamp", Text, nullable=False),
    Column("size_mm", Double, nullable=False),
    Column("area_mm2", Double),
    Column("x_mm", Double),
    Column("y_mm", Double),
    Column("z_mm", Double),
    Column("verdict", Text, nullable=False),
    Column("review", String(12), nullable=False, server_default=""),  # since version 3
)
FINDING_FACES: Final = _of_part(
    "finding_faces",
    Column("finding", Integer, nullable=False),  # its `ordinal`
    Column("face", Integer, nullable=False),
    Column("label", Text, nullable=False),
)
# since version 2
STEPS: Final = _of_part(
    "steps",
    Column("label", Text, nullable=False),
    Column("view", Text, nullable=False),
    Column("forecast_s", Double),
    Column("actual_s", Double),
)
RECOVERIES: Final = _of_part(
    "recoveries",
    Column("at", DateTime, nullable=False),
    Column("fault", Text, nullable=False),
    Column("action", Text, nullable=False),
    Column("reason", Text, nullable=False),
    Column("custody", Text, nullable=False),
    Column("alarm", Integer, nullable=False),
)
REVIEWS: Final = _of_part(  # since version 3; the last one of a part counts
    "reviews",
    Column("at", DateTime, nullable=False),
    Column("verdict", String(10), nullable=False),
    Column("machine", Text, nullable=False),
    Column("who", Text, nullable=False),
    Column("why", Text, nullable=False),
    Column("findings", Text, nullable=False),  # as 1=real 2=false_alarm
)
PICTURES: Final = _of_part(  # since version 8: of the table, then of the views
    "pictures",
    Column("view", Text, nullable=False),  # empty: of the table
    Column("lamp", Text, nullable=False),
    Column("file", Text, nullable=False),
    Column("sha256", String(64), nullable=False),
)
ALARMS: Final = Table(
    "alarms",
    METADATA,
    Column("run_no", ForeignKey("runs.run_no"), primary_key=True, autoincrement=False),
    Column("seq", BigInteger, primary_key=True, autoincrement=False),  # of the row in the journal
    Column("part", Integer),
    Column("at", DateTime, nullable=False),
    Column("alarm", Integer, nullable=False),
    Column("code", Text, nullable=False),
    Column("device", Text, nullable=False),
    sqlite_with_rowid=False,
)
# Judged anew by another recipe or another cellctl; since version 7. Not of the journal, so filling
# the store leaves it alone, and no foreign key binds it to a row that filling replaces.
REJUDGED: Final = Table(
    "rejudged",
    METADATA,
    Column("part_id", BigInteger, primary_key=True, autoincrement=False),
    Column("recipe_sha256", String(64), primary_key=True),
    Column("learned_sha256", String(64), primary_key=True),  # empty for none
    Column("software", String(80), primary_key=True),
    Column("verdict", Text, nullable=False),
    Column("reasons", Text, nullable=False),  # JSON
    Column("characteristics", Text, nullable=False),  # JSON, as in the journal
    Column("lines_sha256", String(64), nullable=False),
    Column("seconds", Double, nullable=False),
)
# Key and values of each sentence of the other tables, which have its English; since version 9.
SENTENCES: Final = Table(
    "sentences",
    METADATA,
    Column("key", String(64), primary_key=True),  # the hash of its English
    Column("said", Text, nullable=False),  # JSON, as in the journal
    sqlite_with_rowid=False,
)
OF_PART: Final = (MEASUREMENTS, FINDINGS, FINDING_FACES, STEPS, RECOVERIES, REVIEWS, PICTURES)
