"""Sentences of the report: the end of a run, the reason for a verdict, the cautions."""

from controller.cell.alarms import alarm_of
from controller.cell.journal.rows import PartFollowed
from controller.inspection.detection import WORDS

from ..run import PartReport, RunRecord
from ..wording import count_of, utc

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


def defect_words(kind: str) -> str:
    """Return a kind of defect in words."""
    return WORDS.get(kind, kind)


def verdict_word(part: PartReport) -> str:
    """Return the verdict on a part as a word, also where there is none."""
    return part.verdict.verdict if part.verdict is not None else "no verdict"


def why(part: PartReport, message: str = "") -> str:
    """Return the reason for a part's verdict, in one sentence.

    Parameters
    ----------
    part : the part
    message : reason why the run ended while this part was in work; empty if it did not
    """
    verdict = part.verdict
    if part.followed is not None and not part.is_counted:
        return f"Run {part.followed.run} has taken the part over, and has its record."
    if verdict is None:
        if message:
            return f"The part was not judged: {_sentence(message, upper=False)}"
        return "The part was not judged: the run ended before its last view."
    reason = verdict.reasons[0] if verdict.reasons else "no reason is given"
    more = len(verdict.reasons) - 1
    also = f" (and {count_of(more, 'more reason')}, below)" if more > 0 else ""
    return f"{reason[:1].upper()}{reason[1:]}{also}."


def review_words(part: PartReport) -> str:
    """Return the person's verdict that counts, as a sentence; empty if none is needed."""
    review = part.review
    if review is None:
        return "awaits a person's verdict" if part.awaits_review else ""
    named = [f"#{number} {word.replace('_', ' ')}" for number, word in review.findings.items()]
    findings = f"; findings: {', '.join(named)}" if named else ""
    return f"{review.verdict} by {review.who}, {utc(review.at)}: {review.why}{findings}"


def why_in_run(record: RunRecord, part: PartReport) -> str:
    """Return the reason for the verdict on a part of a run."""
    return why(part, record.outcome.message if part is record.parts[-1] else "")


def end_words(record: RunRecord) -> str:
    """Return the end of a run, in words."""
    if record.dry is not None and record.outcome.end == "complete":
        return "complete: all motions driven"
    return END_WORDS[record.outcome.end]


def headline(record: RunRecord) -> tuple[str, str]:
    """Return a run's verdict in a word or two, and its reason in a sentence."""
    if record.dry is not None:
        seconds = sum(step.seconds for step in record.dry)
        motions = sum(step.motions for step in record.dry)
        return "no verdict", (
            f"A dry run: {count_of(motions, 'motion')} without a part, lifted, in {seconds:.0f} s. "
            "Nothing was inspected."
        )
    if not record.parts:
        return "no verdict", _sentence(record.outcome.message or "no part was looked at")
    if len(record.parts) == 1 and record.ordered <= 1:
        return verdict_word(record.parts[0]), why_in_run(record, record.parts[0])
    words = [verdict_word(part) for part in record.parts]
    tally = ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))
    missing = record.ordered - len(record.parts)
    unstarted = f"; {missing} not begun" if missing > 0 else ""
    worst = next((w for w in ("fail", "no verdict", "indeterminate") if w in words), words[0])
    if worst == "pass" and missing > 0:
        worst = "incomplete"  # a report with parts never inspected must not read "pass"
    sentence = f"{count_of(len(words), 'part')} of {record.ordered} ordered: {tally}{unstarted}."
    return worst, sentence


def cautions(record: RunRecord) -> list[str]:
    """Return the cautions to read before trusting the rest of the report."""
    found = []
    if record.first_broken_row is not None:
        found.append(
            f"The journal's chain of hashes breaks at row {record.first_broken_row} (this run has "
            f"rows {record.log[0].seq} to {record.log[-1].seq}): rows were changed or taken out "
            "after they were written. This report may be wrong."
        )
    found += [_sentence(why) for why in record.calibration or ()]
    found += [
        f"Part {part.number} {_went(part.followed)}."
        for part in record.parts
        if part.followed is not None
    ]
    message = record.outcome.message
    if message and record.outcome.end != "complete" and message not in headline(record)[1]:
        number = f" (alarm {alarm_of(record.outcome.code).number})" if record.outcome.code else ""
        found.append(_sentence(f"{message}{number}"))
    for part in record.parts:
        if part.resumed is not None:
            found.append(
                f"Part {part.number} was taken over from run {part.resumed.run}, which was "
                "interrupted; its views are judged again from their pictures"
            )
        if part.unconfirmed:
            found.append(f"Part {part.number}: {part.unconfirmed}")
        found += [f"Part {part.number}: {message}." for message in part.grasps_missed]
        expected = part.verdict and TRAY_OF_VERDICT.get(part.verdict.verdict, "quarantine")
        if part.tray and expected and part.tray != expected:
            found.append(
                f"Part {part.number}: the verdict requires the tray {expected}, the part was put "
                f"into {part.tray}."
            )
        if part.verdict and not part.tray and part.followed is None:
            found.append(f"Part {part.number} was judged, but not put into a tray.")
    return found


def _went(followed: PartFollowed) -> str:
    """Return the fate of a part after its run, as the end of a sentence."""
    if followed.custody:
        return f"was taken out by the operator, as run {followed.run} says"
    return f"was taken over by run {followed.run}, which has its record: it does not count here"


def _sentence(text: str, *, upper: bool = True) -> str:
    if upper:
        text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "!", "?")) else text + "."
