"""The store's rows of a run, made from the run as folded from the journal."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

from sqlalchemy import Table

from controller.cell.alarms import ALARMS as CATALOGUE
from controller.cell.custody import Custody
from controller.cell.journal import rows
from controller.cell.journal.rows import CharacteristicFields
from controller.results.judged import JudgedPart, judged_parts
from controller.results.run import LogEntry, RunRecord

from .tables import (
    FINDING_FACES,
    FINDINGS,
    MEASUREMENTS,
    PART_BITS,
    PARTS_MAX,
    PICTURES,
    RECOVERIES,
    REVIEWS,
    STEPS,
)

Values = dict[str, Any]
CODES: Final[Mapping[int, str]] = {alarm.number: alarm.code for alarm in CATALOGUE}
NO_VERDICT: Final = "no verdict"


@dataclass(frozen=True, slots=True)
class PartRows:
    """A part and all that hangs on it.

    Attributes
    ----------
    part : of `PARTS`, but for `run_no`, `part_id` and `read_seq`
    of_part : of the other tables, but for `part_id`; measurements name their characteristic by key
    characteristics : characteristics of `CHARACTERISTICS`, by key
    """

    number: int
    part: Values
    of_part: dict[Table, list[Values]] = field(default_factory=dict)
    characteristics: dict[str, Values] = field(default_factory=dict)


def part_id(run_no: int, number: int) -> int:
    """Return the key of a part.

    Raises
    ------
    ValueError : a run has no so many parts
    """
    if not 0 < number <= PARTS_MAX:
        raise ValueError(f"part {number}: a run has 1 to {PARTS_MAX} parts")
    return (run_no << PART_BITS) | number


def utc(at: datetime) -> datetime:
    """Return a time as the store keeps it: UTC, without a zone."""
    return at.astimezone(UTC).replace(tzinfo=None)


def run_row(record: RunRecord) -> Values:
    """Return the row of `RUNS`, but for its keys and `read_seq`."""
    files = [*record.files.values()]
    judged = judged_parts(record)
    return {
        "recipe": record.recipe_name,
        "cell": record.cell_name,
        "operator": record.operator,
        "lot": record.lot,
        "recipe_sha256": files[0][:64] if files else "",
        "cad_sha256": judged[-1].header.cad_sha256[:64] if judged else "",
        "ordered": record.ordered,
        "speed": record.speed,
        "is_dry": record.dry is not None,
        "is_emulated": bool(record.emulated_devices),
        "start": utc(record.start),
        "end": utc(record.end),
        "wall_s": record.wall_s,
        "outcome": record.outcome.end,
        "message": record.outcome.message,
        "copied_to": ["", *(copy.to for copy in record.copies.values())][-1],
    }


def part_rows(record: RunRecord) -> list[PartRows]:
    """Return the rows of a run's parts."""
    recoveries: dict[int, list[LogEntry]] = {}
    for entry in record.log:
        if entry.part and isinstance(entry.row, rows.RecoveryBegun):
            recoveries.setdefault(entry.part, []).append(entry)
    return [
        _part(record, judged, recoveries.get(judged.part.number, []))
        for judged in judged_parts(record)
    ]


def _part(record: RunRecord, judged: JudgedPart, recoveries: Iterable[LogEntry]) -> PartRows:
    part, verdict = judged.part, judged.part.verdict
    begun = [
        (entry.at, row) for entry in recoveries if isinstance(row := entry.row, rows.RecoveryBegun)
    ]
    found = PartRows(part.number, _part_values(record, judged, len(begun)))
    keys = [_characteristic(found, judged.header.part, c) for c in part.characteristics]
    labels = {face.face: face.label for face in (verdict.faces if verdict else ())}
    shown = [("", lamp, file) for lamp, file in part.table_pictures.items()]
    shown += [(one.view, lamp, file) for one in part.views for lamp, file in one.pictures.items()]
    found.of_part[MEASUREMENTS] = _numbered(
        {
            "characteristic_no": key,
            "measured": c.measured,
            "U": c.U,
            "verdict": c.verdict,
            "reason": c.reason,
        }
        for key, c in zip(keys, part.characteristics, strict=True)
    )
    found.of_part[FINDINGS] = [
        {
            "ordinal": f.number,
            "kind": f.kind,
            "view": f.view,
            "lamp": f.lamp,
            "size_mm": f.size_mm,
            "area_mm2": f.area_mm2,
            **dict(zip(("x_mm", "y_mm", "z_mm"), (*f.p_part_mm, None, None, None), strict=False)),
            "verdict": f.verdict,
            "review": part.review.findings.get(f.number, "") if part.review else "",
        }
        for f in part.findings
    ]
    found.of_part[FINDING_FACES] = _numbered(
        {"finding": f.number, "face": face, "label": labels.get(face, f"F{face}")}
        for f in part.findings
        for face in f.faces
    )
    found.of_part[STEPS] = _numbered(
        {"label": s.label, "view": s.view, "forecast_s": s.forecast_s, "actual_s": s.actual_s}
        for s in part.steps
    )
    found.of_part[PICTURES] = _numbered(
        {"view": view, "lamp": lamp, "file": file, "sha256": record.stored.get(file, "")[:64]}
        for view, lamp, file in shown
    )
    found.of_part[RECOVERIES] = _numbered(
        {
            "at": utc(at),
            "fault": row.fault,
            "action": row.action,
            "reason": row.reason,
            "custody": row.custody,
            "alarm": row.alarm,
        }
        for at, row in begun
    )
    found.of_part[REVIEWS] = _numbered(
        {
            "at": utc(one.at),
            "verdict": one.verdict,
            "machine": one.machine,
            "who": one.who,
            "why": one.why,
            "findings": " ".join(f"{number}={word}" for number, word in one.findings.items()),
        }
        for one in part.reviews
    )
    return found


def _numbered(found: Iterable[Values]) -> list[Values]:
    """Return rows of one part with their place among them, from 1."""
    return [{"ordinal": i, **one} for i, one in enumerate(found, 1)]


def _part_values(record: RunRecord, judged: JudgedPart, recovery_count: int) -> Values:
    header, part, verdict = judged.header, judged.part, judged.part.verdict
    timed = [s for s in part.steps if s.actual_s is not None and s.forecast_s is not None]
    start, end = utc(header.start), utc(header.end)
    return {
        "number": part.number,
        "recipe": header.part,
        "serial": header.serial,
        "lot": header.lot,
        "order_number": header.papers.get("order_number", ""),
        "operator": header.operator,
        "verdict": judged.verdict,
        "reason": judged.reasons[0] if judged.reasons else "",
        "tray": part.tray or "",
        "custody": part.custody.key,
        "start": start,
        "end": end,
        "day": start.date().isoformat(),
        "wall_s": (end - start).total_seconds(),
        "forecast_s": part.plan.forecast_s if part.plan else None,
        "done_forecast_s": sum(s.forecast_s for s in timed if s.forecast_s is not None),
        "done_actual_s": sum(s.actual_s for s in timed if s.actual_s is not None),
        "compared_fraction": verdict.compared_fraction if verdict else None,
        "looks": part.looks,
        "recovery_count": recovery_count,
        "finding_count": len(part.findings),
        "is_emulated": bool(record.emulated_devices),
        # its custody may still be made certain by how the run ends
        "is_open": (part.custody is not Custody.PLACED or bool(part.unconfirmed))
        and part.followed is None,
        "nest": part.nest,
        "awaits_review": part.awaits_review and part.is_counted and record.dry is None,
        "review": part.review.verdict if part.review else "",
        "is_counted": part.is_counted,
        "followed_by": part.followed.run if part.followed else "",
    }


def _characteristic(found: PartRows, recipe: str, c: CharacteristicFields) -> str:
    values: Values = {
        "recipe": recipe,
        "id": c.id,
        "balloon": c.balloon,
        "label": c.label,
        "kind": c.kind,
        "unit": c.unit,
        "nominal": c.nominal,
        "lower": c.lower,
        "upper": c.upper,
        "source": c.source,
        "is_critical": c.is_critical,
    }
    key = hashlib.sha256(json.dumps(values).encode()).hexdigest()
    found.characteristics[key] = values
    return key


def alarm_rows(record: RunRecord) -> list[Values]:
    """Return the rows of `ALARMS`, but for `run_no`.

    The alarm at the end of a run has a row of its own only if no event has it.
    """
    found = []
    of_events = set()
    for entry in record.log:
        alarm = rows.told_alarm(entry.row)
        if alarm is None or (alarm.is_repeated and alarm.number in of_events):
            continue
        of_events.add(alarm.number)
        found.append(
            {
                "seq": entry.seq,
                "part": entry.part or None,
                "at": utc(entry.at),
                "alarm": alarm.number,
                "code": CODES.get(alarm.number, str(alarm.number)),
                "device": alarm.device,
            }
        )
    return found
