"""Orders to a running cell through its control socket, and their output."""

import sys
from pathlib import Path

from controller.cell.control import (
    MAX_KEY,
    MAX_WHO,
    MAX_WHY,
    AnswerOrder,
    DecisionReply,
    NoRunError,
    NotServedError,
    Order,
    PauseOrder,
    ResumeOrder,
    RunningCell,
    StandingReply,
    StatusReply,
    facts,
    standing_of,
)
from controller.cell.machine import PAUSE_WORDS, PauseKind
from controller.config import ConfigError

from ..terminal.output import emit, print_line, warn

# Shown for a cell that was paused while it computes; the first motion is shown once it is known.
NOT_KNOWN_YET = "not known yet: the cell is still computing the next motion"


def show_status(runs_dir: Path, *, as_json: bool) -> int:
    """Print the status of a cell; return 0.

    Without a run to ask, it is what journal and lock tell.

    Parameters
    ----------
    runs_dir : folder of all runs, by whose lock the run is found
    as_json : print one JSON object instead of a sentence

    Raises
    ------
    ControlError : the run does not answer
    JournalError : there is none to ask, and the journal cannot be read
    """
    try:
        found = RunningCell(runs_dir).status()
    except (NoRunError, NotServedError):
        if not runs_dir.is_dir():  # a name mistyped is no free cell
            raise
        return _show_standing(standing_of(runs_dir), as_json=as_json)
    if as_json:
        emit({"event": "status", **facts(found)})
        return 0
    for line in status_lines(found):
        print_line(line)
    return 0


def _show_standing(found: StandingReply, *, as_json: bool) -> int:
    if as_json:
        emit({"event": "status", **facts(found)})
        return 0
    print_line("no run to ask" if found.state == "taken" else "no run at this cell")
    if found.message:
        print_line(f"  message  {found.message}")
    if found.run:
        why = f": {found.end_message}" if found.end_message else ""
        print_line(f"  last run {found.run}, {found.end.replace('_', ' ')}{why}")
    return 0


def status_lines(found: StatusReply) -> list[str]:
    """Return a status as lines for people."""
    holder = found.holder
    step = f", step {found.step} of {found.step_count}" if found.step_count else ""
    left = "" if found.seconds_left is None else f", about {found.seconds_left:.0f} s left"
    doing = f": {found.label}" if found.label else ""
    lines = [
        f"run {found.run}",
        f"  by       {holder.user} on {holder.host}, process {holder.pid}, since {holder.since}",
        f"  state    {found.state}{doing}{step}{left}",
        f"  part     {found.custody}" + (f", serial number {found.serial}" if found.serial else ""),
    ]
    if len(found.done) > 1:
        each = (f"{name} {done} of {count}" for name, (done, count) in found.done.items())
        lines.append(f"  done     {', '.join(each)}")
    if found.safe_point:
        lines.append(f"  stands   {found.safe_point}")
    if found.message:
        lines.append(f"  message  {found.message}")
    lines += [f"  alarm    {alarm}" for alarm in found.alarms]
    if found.pausing:
        words = PAUSE_WORDS[PauseKind(found.pausing)]
        lines.append(f"  pausing  {words}, {_within(found.pause_seconds.get(found.pausing))}")
    elif found.state.startswith("suspended"):
        first = found.first_motion
        if found.barred:
            lines.append(f"  not yet  {found.barred}")
        lines.append(f"  resume   {NOT_KNOWN_YET if first is None else first.words}")
    elif found.question is None:
        lines += [
            f"  pause    {kind.value:5}{PAUSE_WORDS[kind]}: "
            f"{_within(found.pause_seconds.get(kind.value))}"
            for kind in PauseKind
            if kind.value in found.pause_seconds
        ]
    if found.question is not None:
        lines += [f"question {found.question.number}: {found.question.text}"]
        for choice in found.question.choices:
            first_words = f" (first: {choice.first})" if choice.first else ""
            lines.append(f"  cellctl answer {choice.key:6} {choice.words}{first_words}")
        if found.question.entry:
            lines.append(f"  cellctl answer {found.question.entry.upper().replace(' ', '-')}")
    return lines


def _within(seconds: float | None) -> str:
    return "time unknown" if seconds is None else f"stands within {seconds:.0f} s"


def pause_cell(runs_dir: Path, kind: str, who: str, why: str, *, as_json: bool) -> int:
    """Have a running cell pause; return 0 if it does, 1 if it refuses.

    Parameters
    ----------
    runs_dir : folder of all runs, by whose lock the run is found
    kind : step, safe or now
    who, why : the person beside the user's name, and the reason
    as_json : print one JSON object instead of a sentence

    Raises
    ------
    ConfigError : a text is too long
    ControlError : no run has this cell, or it does not answer
    """
    _check(who, why)
    cell = RunningCell(runs_dir)
    order = PauseOrder.model_validate({"kind": kind, "who": who, "why": why})
    before = cell.status()
    reply = cell.order("pause", order)
    seconds = before.pause_seconds.get(order.kind)
    words = f"pausing {PAUSE_WORDS[PauseKind(kind)]}, {_within(seconds)}"
    return print_decision(reply, words, as_json=as_json)


def resume_cell(runs_dir: Path, who: str, why: str, *, is_confirmed: bool, as_json: bool) -> int:
    """Have a paused cell continue; return 0 if it does, 1 if it refuses or nobody confirms it.

    Parameters
    ----------
    runs_dir : folder of all runs, by whose lock the run is found
    who, why : the person beside the user's name, and the reason
    is_confirmed : the first motion is right; do not wait for a `yes`
    as_json : print one JSON object instead of a sentence

    Raises
    ------
    ConfigError : a text is too long
    ControlError : no run has this cell, or it does not answer
    """
    _check(who, why)
    cell = RunningCell(runs_dir)
    found = cell.status()
    words = None if found.first_motion is None else found.first_motion.words
    if found.state.startswith("suspended") and not as_json:
        warn(f"first: {words or NOT_KNOWN_YET}")
        if not is_confirmed and sys.stdin.isatty():
            warn("Type `yes` if that is right:")
            if sys.stdin.readline().strip() != "yes":
                warn("cellctl: the cell stays paused")
                return 1
    reply = cell.order("resume", ResumeOrder(who=who, why=why, first=words))
    return print_decision(reply, "going on", as_json=as_json)


def order_plainly(runs_dir: Path, name: str, who: str, why: str, *, as_json: bool) -> int:
    """Give an order that consists of its name alone; return 0, or 1 if it is refused.

    Parameters
    ----------
    runs_dir : folder of all runs, by whose lock the run is found
    name : stop, abort or step
    who, why : the person beside the user's name, and the reason
    as_json : print one JSON object instead of a sentence

    Raises
    ------
    ConfigError : a text is too long
    ControlError : no run has this cell, or it does not answer
    """
    _check(who, why)
    reply = RunningCell(runs_dir).order(name, Order(who=who, why=why))
    return print_decision(reply, f"{name}: taken", as_json=as_json)


def answer_question(
    runs_dir: Path, key: str, number: int | None, who: str, why: str, *, as_json: bool
) -> int:
    """Answer the open question of a running cell; return 0, or 1 if the answer does not count.

    Parameters
    ----------
    runs_dir : folder of all runs, by whose lock the run is found
    key : one of its choices
    number : number of the question that was read; None for the open one
    who, why : the person beside the user's name, and the reason
    as_json : print one JSON object instead of a sentence

    Raises
    ------
    ConfigError : a text is too long or empty
    ControlError : no run has this cell, or it does not answer
    """
    _check(who, why)
    if not 0 < len(key) <= MAX_KEY:
        raise ConfigError(
            f"ANSWER must be one word, or a serial number, of at most {MAX_KEY} characters"
        )
    order = AnswerOrder(key=key, number=number, who=who, why=why)
    return print_decision(RunningCell(runs_dir).order("answer", order), "answered", as_json=as_json)


def _check(who: str, why: str) -> None:
    for option, text, most in (("--who", who, MAX_WHO), ("--why", why, MAX_WHY)):
        if len(text) > most:
            raise ConfigError(f"{option}: {len(text)} characters; at most {most} are allowed")


def print_decision(reply: DecisionReply, words: str, *, as_json: bool) -> int:
    """Print the cell's decision on an order; return the exit code.

    Parameters
    ----------
    reply : the cell's decision
    words : printed where it took the order
    as_json : print one JSON object instead
    """
    if as_json:
        emit({"event": "decision", **facts(reply)})
    elif reply.decision == "handled":
        print_line(f"{words} (state: {reply.state})")
    elif reply.decision == "ignored":
        print_line(f"nothing to do: {reply.reason} (state: {reply.state})")
    else:
        warn(f"cellctl: refused in {reply.state}: {reply.reason}")
    return 1 if reply.decision == "refused" else 0
