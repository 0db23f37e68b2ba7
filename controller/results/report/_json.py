"""A run as JSON, for machines: schema ``cellctl.report``, version 1.

The schema's number rises when a key changes its meaning or goes; new keys may come without it.
Lengths are mm, angles degrees, areas mm2, `*_fraction` 0..1, times ISO 8601 UTC; `*_s` of steps
are cell seconds, `wall_s` is wall seconds. Unknown is null, never a made-up number.

| key | what |
|---|---|
| `schema`, `schema_version` | ``cellctl.report``, 1 |
| `run`, `start`, `end`, `wall_s`, `speed`, `speed_reached` | id, times, cell seconds per wall second: requested, and reached (null: cut off) |
| `recipe`, `cell` | as they were read, whole |
| `recipes[]` | of a run of several: `recipe`, as it was read, and `ordered`, how many parts of it; empty otherwise |
| `calibration[]` | what of the cell's calibrations did not count, in sentences; null in journals of older versions |
| `emulated`, `emulated_devices` | true if any device was not real: not a production result |
| `devices[]` | `name`, `address`, `emulated`, `identity` (null if it never answered) |
| `software` | versions by name |
| `outcome` | `end` (complete, held, stopped, aborted, broke_off, cut_off), `message`, `code`, `alarm` (its number, docs/alarms.md), `custody`, `where` |
| `verdict` | of the run: the worst of its parts; `no verdict` if one was not judged, `incomplete` if all passed that were begun and not all were |
| `ordered`, `parts[]` | how many parts were ordered; what became of those begun |
| `parts[].verdict` | `pass`, `fail`, `indeterminate` or null; with `reasons`, `covered_fraction` (of all surface, compared with the CAD), `covered_U` (its expanded uncertainty, k = 2, or null), `in_sight_fraction` (in sight, compared or not), `claim` (what was looked for on the compared surface), `found` (by kind of defect what would have been found with 90 %, docs/operating/verdicts.md), `tray`, `nest` (from 1, or null), `custody`, `unconfirmed` (null, or what was begun and never confirmed), `interrupted_run` (null, or the run that the part was taken over from) |
| `parts[].papers` | part, drawing, revision, order and gauge number by key, those that are known |
| `parts[].recipe`, `serial`, `serial_picture`, `lot`, `left_on_table[]` | name of its recipe; its number, the picture that a camera read it in, and its lot, or null; parts that could not be taken as they lay, before this one was |
| `parts[].awaits_review`, `parts[].reviews[]` | whether a person has to decide and none has; persons' verdicts, oldest first, of which the last counts: `at`, `verdict` (accept, reject), `who`, `why`, `machine` (the verdict they had before them), `findings` (by number: real, false_alarm) |
| `parts[].faces[]` | `face`, `label`, `area_mm2`, `area_fraction` (they add up to 1), `seen_fraction` (compared with the CAD), `by_check` (the same by check), `rest` (not compared, by reason), `verdict`, `views`, `reason` |
| `parts[].characteristics[]` | as in ``cellctl.result``: `balloon`, `id`, `measured`, `U`, `verdict` and more |
| `parts[].findings[]` | `number`, `view`, `kind`, `lamp`, `size_mm`, `area_mm2`, `at_px`, `box_px`, `p_part_mm`, `faces`, `pictures` (view and lamp of each that shows it), `verdict` |
| `parts[].views[]` | `view`, `evaluated` (null: never judged), `reason`, `shift_mm`, `turn_deg`, `residual_px`, `checks` (`check`, `reason` why it was not made, `compared_samples`, `size_mm`, `length_mm`), `findings` (numbers), `pictures` |
| `parts[].steps[]` | `label`, `forecast_s`, `seconds` (null: not finished), `view`, `tray` |
| `parts[].sightings[]`, `looks`, `grips_missed`, `forecast_s`, `table_pictures` | what led to the grasp; `is_taken` tells the part from what was left alone |
| `pictures.<lamp>` | `file` (in the run's folder), `sha256` (null: the file is missing, and no copy could be read), `copied_to` (address of the store of objects that has a copy) |
| `dry` | null, or of a dry run (motions without a part) its steps: `label`, `pose_index`, `motions`, `lifted_mm` (least, most), `left_out` (reasons), `seconds` |
| `stages[]` | `state`, `visits`, `wall_s` |
| `takt` | what the arm's time went into: `seconds` by use, which add up to `total_s`; `execute_s`, `busy_s`, `busy_share`, `s_a_part` (of `parts`, which have a verdict; `unjudged` have none), `forecast_s` and what that took, `clock` (`wall` in journals of older versions), `planned_ahead` (parts) (docs/operating/history.md) |
| `cautions[]` | what to know before trusting the rest |
| `journal` | `first_seq`, `last_seq`, `first_broken_row` (null: the chain of hashes is whole) |
"""  # noqa: E501 - a table row is one line

import hashlib
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from controller.cell.alarms import alarm_of
from controller.cell.journal.rows import PlanMade

from ..judged import characteristic_json, reviews_json
from ..run import FindingReport, PartReport, RunPictures, RunRecord, ViewReport
from ..takt import run_takt, takt_json
from ._words import cautions, headline, why_in_run

SCHEMA = "cellctl.report"
SCHEMA_VERSION = 1


def report_json(record: RunRecord) -> dict[str, Any]:
    """Return a run as plain JSON values; see the module's table for the schema."""
    word, sentence = headline(record)
    pictures = RunPictures(record.folder, record.copies)
    several = record.ordered_recipes if len(record.ordered_recipes) > 1 else ()
    body = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "run": record.run_id,
        "start": record.start.isoformat(),
        "end": record.end.isoformat(),
        "wall_s": round(record.wall_s, 3),
        "speed": record.speed,
        "speed_reached": record.speed_reached,
        "recipe": record.recipe,
        "recipes": [{"recipe": one.recipe, "ordered": one.count} for one in several],
        "cell": record.cell,
        "calibration": None if record.calibration is None else list(record.calibration),
        "emulated": bool(record.emulated_devices),
        "emulated_devices": list(record.emulated_devices),
        "emulator": record.emulator,
        "devices": [
            {
                "name": device.name,
                "address": device.address,
                "emulated": device.is_emulated,
                "identity": device.identity or None,
            }
            for device in record.devices
        ],
        "software": record.software,
        "outcome": {
            "end": record.outcome.end,
            "message": record.outcome.message,
            "code": record.outcome.code,
            "alarm": alarm_of(record.outcome.code).number if record.outcome.code else None,
            "custody": record.outcome.custody.key,
            "where": record.outcome.where,
        },
        "verdict": word,
        "why": sentence,
        "cautions": cautions(record),
        "ordered": record.ordered,
        "parts": [_part(record, part, pictures) for part in record.parts],
        "dry": None if record.dry is None else [asdict(step) for step in record.dry],
        "takt": takt_json(run_takt(record)),
        "stages": [asdict(stage) for stage in record.stages],
        "journal": {
            "first_seq": record.log[0].seq,
            "last_seq": record.log[-1].seq,
            "first_broken_row": record.first_broken_row,
        },
    }
    plain: dict[str, Any] = _plain(body)
    return plain


def _part(record: RunRecord, part: PartReport, pictures: RunPictures) -> dict[str, Any]:
    verdict = part.verdict
    faces = verdict.faces if verdict else ()
    total = sum(face.area_mm2 for face in faces) or 1.0
    serial, lot = record.label_of(part)
    return {
        "part": part.number,
        "recipe": str(record.recipe_of(part).recipe.get("name", "unknown")),
        "serial": serial or None,
        "serial_picture": part.serial_picture or None,
        "lot": lot or None,
        "papers": dict(record.papers_of(part)),
        "verdict": verdict.verdict if verdict else None,
        "why": why_in_run(record, part),
        "reasons": verdict.reasons if verdict else (),
        "covered_fraction": verdict.compared_fraction if verdict else None,
        "covered_U": verdict.compared_U if verdict else None,
        "in_sight_fraction": verdict.in_sight_fraction if verdict else None,
        "claim": verdict.claim if verdict else None,
        "found": [one.model_dump() for one in (verdict.found if verdict else ())],
        "tray": part.tray,
        "nest": part.nest,
        "custody": part.custody.key,
        "awaits_review": part.awaits_review,
        "reviews": reviews_json(part.reviews),
        "in_doubt": part.unconfirmed or None,
        "followed_by": None if part.followed is None else part.followed.run,
        "is_counted": part.is_counted,
        "interrupted_run": None if part.resumed is None else part.resumed.run,
        "looks": part.looks,
        "grips_missed": part.grasps_missed,
        "left_on_table": [one.as_json() for one in part.left],
        "table_pictures": _pictures(pictures, part.table_pictures),
        "sightings": [asdict(sighting) for sighting in part.sightings],
        "forecast_s": part.plan.forecast_s if part.plan else None,
        "plan": _plan(part.plan) if part.plan else None,
        "steps": [
            {
                "label": step.label,
                "forecast_s": step.forecast_s,
                "seconds": step.actual_s,
                "view": step.view or None,
                "tray": step.tray or None,
                "jaw_mm": step.jaw_mm,
                "expected_mm": step.expected_mm,
            }
            for step in part.steps
        ],
        "views": [_view(pictures, view) for view in part.views],
        "characteristics": [characteristic_json(c) for c in part.characteristics],
        "findings": [_finding(finding) for finding in part.findings],
        "faces": [
            {
                "face": face.face,
                "label": face.label,
                "area_mm2": face.area_mm2,
                "area_fraction": face.area_mm2 / total,
                "seen_fraction": face.compared_fraction,
                "by_check": face.by_check,
                "rest": face.rest,
                "verdict": face.verdict,
                "views": face.views,
                "reason": face.reason,
            }
            for face in faces
        ],
    }


def _plan(plan: PlanMade) -> dict[str, Any]:
    return {
        "labels": plan.steps,
        "seconds": plan.seconds,
        "forecast_s": plan.forecast_s,
        "covered_fraction": plan.covered_fraction,
        "reachable_fraction": plan.reachable_fraction,
        "unseen": [
            {"face_id": piece.face, "area_fraction": piece.area_fraction, "reason": piece.reason}
            for piece in plan.unseen
        ],
    }


def _view(pictures: RunPictures, view: ViewReport) -> dict[str, Any]:
    return {
        "view": view.view,
        "evaluated": view.evaluated,
        "reason": view.reason,
        "shift_mm": view.shift_mm,
        "turn_deg": view.turn_deg,
        "residual_px": view.residual_px,
        "checks": [check.model_dump(exclude={"misfit"}) for check in view.checks],
        "findings": [finding.number for finding in view.findings],
        "pictures": _pictures(pictures, view.pictures),
    }


def _finding(finding: FindingReport) -> dict[str, Any]:
    return {
        "number": finding.number,
        "view": finding.view,
        "kind": finding.kind,
        "lamp": finding.lamp,
        "size_mm": finding.size_mm,
        "area_mm2": finding.area_mm2,
        "at_px": finding.at_px,
        "box_px": finding.box_px,
        "p_part_mm": finding.p_part_mm,
        "faces": finding.faces,
        "verdict": finding.verdict or None,
        "pictures": finding.pictures,
    }


def _pictures(pictures: RunPictures, names: Mapping[str, str]) -> dict[str, Any]:
    return {lamp: {"file": name, **_found(pictures, name)} for lamp, name in names.items()}


def _found(pictures: RunPictures, name: str) -> dict[str, Any]:
    data = pictures.read(name)
    digest = None if isinstance(data, str) else hashlib.sha256(data).hexdigest()
    copy = pictures.copies.get(name)
    return {"sha256": digest, **({} if copy is None else {"copied_to": copy.to})}


def _plain(value: Any) -> Any:  # noqa: ANN401 - any JSON value
    """Return a value as plain JSON: lists for tuples, null for NaN."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
