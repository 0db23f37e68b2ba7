"""The report's sentences: what a row of the journal means, and why a part got its verdict."""

import json
from collections.abc import Mapping
from typing import Any

from controller.cell.journal import rows

from ._model import LogEntry, PartReport, RunRecord

END_WORDS = {
    "complete": "complete: all parts worked through",
    "held": "held: the cell stopped where it was safe and waits for a person",
    "stopped": "stopped on request",
    "aborted": "aborted: a fault stopped the cell",
    "refused": "refused: a gripper may hold a part, so that nothing was moved",
    "broke_off": "broke off: the run could not be brought to rest",
    "cut_off": "cut off: the run has no end in the journal",
}
TRAY_OF_VERDICT = {"pass": "accept", "fail": "reject"}
DETAIL_LENGTH = 240


def say_row(entry: LogEntry) -> str:
    """Return a row of the journal in words."""
    name = entry.name.replace("_", " ")
    match entry.row:
        case rows.CellEvent() as row:
            return _transition(row)
        case rows.StepDone() as row:
            return f"step “{row.label}” done in {row.seconds} s, forecast {row.forecast_s} s"
        case rows.GraspMissed() as row:
            return f"grasp failed: {row.message}"
        case rows.CustodyChanged() as row:
            return f"custody: {name}" + (f" ({row.detail})" if row.detail else "")
        case rows.Intent():
            return f"about to {name}{_rest(entry.body)}"
        case rows.ViewJudged() as row:
            return _view(row)
        case rows.RecoveryBegun() as row:
            return f"{row.reason}; {row.action}"
        case rows.PartJudged() as row:
            return f"verdict: {row.verdict}"
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


def count_of(count: int, noun: str) -> str:
    """Return a number with its noun, as in ``1 part`` or ``2 parts``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def verdict_word(part: PartReport) -> str:
    """Return the verdict on a part, or that there is none."""
    return part.verdict.verdict if part.verdict is not None else "no verdict"


def why(record: RunRecord, part: PartReport) -> str:
    """Return in one sentence why a part has the verdict it has."""
    verdict = part.verdict
    if verdict is None:
        if record.outcome.message and part is record.parts[-1]:
            return f"The part was not judged: {_sentence(record.outcome.message, upper=False)}"
        return "The part was not judged: the run ended before its last view."
    reason = verdict.reasons[0] if verdict.reasons else "the journal gives no reason"
    more = len(verdict.reasons) - 1
    also = f" (and {count_of(more, 'more reason')}, below)" if more else ""
    return f"{reason[:1].upper()}{reason[1:]}{also}."


def headline(record: RunRecord) -> tuple[str, str]:
    """Return the run's verdict in a word or two, and why in a sentence."""
    if not record.parts:
        return "no verdict", _sentence(record.outcome.message or "no part was looked at")
    if len(record.parts) == 1 and record.ordered <= 1:
        return verdict_word(record.parts[0]), why(record, record.parts[0])
    words = [verdict_word(part) for part in record.parts]
    tally = ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))
    missing = record.ordered - len(record.parts)
    unstarted = f"; {missing} not begun" if missing > 0 else ""
    worst = next((w for w in ("fail", "no verdict", "indeterminate") if w in words), words[0])
    if worst == "pass" and missing > 0:
        worst = "incomplete"  # nobody shall read "pass" over parts that were never looked at
    sentence = f"{count_of(len(words), 'part')} of {record.ordered} ordered: {tally}{unstarted}."
    return worst, sentence


def cautions(record: RunRecord) -> list[str]:
    """Return what a reader must know before trusting the rest."""
    found = []
    if record.first_broken_row is not None:
        found.append(
            f"The journal's chain of hashes breaks at row {record.first_broken_row} (this run has "
            f"rows {record.log[0].seq} to {record.log[-1].seq}): rows were changed or taken out "
            "after they were written. This report may be wrong."
        )
    message = record.outcome.message
    if message and record.outcome.end != "complete" and message not in headline(record)[1]:
        found.append(_sentence(message))
    for part in record.parts:
        if part.in_doubt:
            found.append(f"Part {part.number}: {part.in_doubt}")
        found += [f"Part {part.number}: {message}." for message in part.grasps_missed]
        expected = part.verdict and TRAY_OF_VERDICT.get(part.verdict.verdict, "quarantine")
        if part.tray and expected and part.tray != expected:
            found.append(
                f"Part {part.number}: the verdict requires the tray {expected}, the part was put "
                f"into {part.tray}."
            )
        if part.verdict and not part.tray:
            found.append(f"Part {part.number} was judged, but not put into a tray.")
    return found


def _sentence(text: str, *, upper: bool = True) -> str:
    if upper:
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else text + "."
