"""Rows of the journal in words."""

import json
from collections.abc import Mapping
from typing import Any

from controller.cell.custody import Custody
from controller.cell.journal import rows

from ..wording import count_of
from .model import LogEntry

DETAIL_LENGTH = 240


def row_words(entry: LogEntry) -> str:
    """Return a row of the journal in words."""
    name = entry.name.replace("_", " ")
    match entry.row:
        case rows.CellEvent() as row:
            return _transition(row)
        case rows.StepDone() as row:
            return f"step “{row.label}” done in {row.seconds} s, forecast {row.forecast_s} s"
        case rows.DryStepDone() as row:
            return f"step “{row.label}” driven without a part in {row.seconds} s"
        case rows.GraspMissed() as row:
            return f"grasp failed: {row.message}"
        case rows.CustodyChanged() as row:
            where = Custody.of_key(entry.name)
            return f"custody: {where.value}" + (f" ({row.detail})" if row.detail else "")
        case rows.Intent():
            rest = {key: value for key, value in entry.body.items() if key != "retreat"}
            return f"about to {name}{_rest(rest)}"
        case rows.PathBegun() as row:
            back = " back" if row.is_back else ""
            return f"about to move{back} along {count_of(len(row.waypoints), 'waypoint')}"
        case rows.PathEnded():
            return "the arm is at the end of its path"
        case rows.HomingBegun():
            return "about to home with the arm gripper shut"
        case rows.HomedWithPart() as row:
            return f"homed with the arm gripper shut, at {row.opening_mm:.1f} mm"
        case rows.StoodFree():
            return "the arm stands free of everything"
        case rows.HoldNoted() as row:
            will = "is about to hold" if row.is_expected else "holds"
            return f"the {row.gripper} gripper {will} the part by grasp {row.grasp.id}"
        case rows.ViewJudged() as row:
            return _view(row)
        case rows.RecoveryBegun() as row:
            return f"{row.reason}; {row.action}"
        case rows.PartIdentified() as row:
            number = f", serial number {row.serial}" if row.serial else ""
            read = f"; its code in {row.code.picture} reads {row.code.text}" if row.code else ""
            return f"the part is one of recipe {row.name}{number}{read}"
        case rows.PartLeft() as row:
            return f"{row.part} at x {row.x_mm:.0f}, y {row.y_mm:.0f} mm is left: {row.reason}"
        case rows.PartJudged() as row:
            return f"verdict: {row.verdict}"
        case rows.PartReviewed() as row:
            return f"reviewed by {row.who}: {row.verdict}, {row.why}"
        case rows.PartFollowed(custody="") as row:
            return f"run {row.run} has taken the part over"
        case rows.PartFollowed() as row:
            return f"the part was taken out by the operator, as run {row.run} says"
        case rows.RunBegan():
            return "run began"
        case rows.AtRest() as row:
            return f"at rest: {row.state}"
    done = ": done" if entry.kind == "outcome" else ""
    return f"{name}{done}{_rest(entry.body)}"


def _transition(row: rows.CellEvent) -> str:
    if row.answer != "handled":
        return f"{row.name}: {row.answer} in {row.source}; {row.reason}"
    message = f": {row.message}" if row.message else ""
    return f"{row.name}: {stage_words(row.source)} → {stage_words(row.target)}{message}"


def _view(row: rows.ViewJudged) -> str:
    if not row.evaluated:
        return f"view {row.view}: not evaluated, {row.reason}"
    count = len(row.findings)
    return f"view {row.view}: {count_of(count, 'finding') if count else 'no finding'}"


def _rest(body: Mapping[str, Any]) -> str:
    if not body:
        return ""
    text = ", ".join(
        f"{key} {value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)}"
        for key, value in body.items()
    )
    return ": " + (text if len(text) <= DETAIL_LENGTH else text[: DETAIL_LENGTH - 1] + "…")


def stage_words(state: str) -> str:
    """Return a state of the cell as people read it."""
    return state.removeprefix("execute_")
