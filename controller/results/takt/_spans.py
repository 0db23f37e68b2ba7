"""Division of a run into spans of one use each, by its rows.

Every instant between two rows goes into exactly one use, so that the uses add up to the whole. Time
without a rule is `TimeUse.REST`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from controller.cell.journal import Body, rows
from controller.cell.machine import RESETTING, Mode, mode_of, work_of

from ..run import LogEntry
from .uses import TimeUse

# Purpose of a state while neither the arm nor its jaws move.
_OF_WORK: Final = {
    "acquiring": TimeUse.TABLE_PICTURES,
    "recognising": TimeUse.RECOGNITION,
    "planning": TimeUse.PLANNING,
    "inspecting": TimeUse.EVALUATION,
    # Between paths, jaws are opened and holds checked, without rows of their own.
    "grasping": TimeUse.JAWS,
    "handing": TimeUse.JAWS,
    "lowering": TimeUse.JAWS,
    "placing": TimeUse.JAWS,
    # The path home is being computed.
    "withdrawing": TimeUse.PLANNING,
    "recovering": TimeUse.PLANNING,
}
_OF_STATE: Final = {"holding": TimeUse.PERSON, "held": TimeUse.PERSON}


@dataclass(frozen=True, slots=True)
class Span:
    """A span of time of one use [s].

    Attributes
    ----------
    start_s, end_s : instants on the clock of `instants`
    is_execute : the machine was in Execute
    """

    use: TimeUse
    start_s: float
    end_s: float
    is_execute: bool


def instants(log: Sequence[LogEntry]) -> tuple[tuple[float, ...], bool]:
    """Return an instant [cell s] for each row, and whether the cell's own clock gave them.

    Rows without one get theirs by the wall from those beside them. Journals that know only the wall
    give wall seconds.

    Parameters
    ----------
    log : rows of a run in order
    """
    known = [(entry.t_s, entry.cell_s) for entry in log if entry.cell_s is not None]
    if not known:
        return tuple(entry.t_s for entry in log), False
    found: list[float] = []
    place = 0
    for entry in log:
        if entry.cell_s is not None:
            found.append(entry.cell_s)
            continue
        while place + 1 < len(known) and known[place + 1][0] <= entry.t_s:
            place += 1
        (t0_s, cell0_s), (t1_s, cell1_s) = known[place], known[min(place + 1, len(known) - 1)]
        share = 0.0 if t1_s <= t0_s else min(max((entry.t_s - t0_s) / (t1_s - t0_s), 0.0), 1.0)
        found.append(cell0_s + share * (cell1_s - cell0_s))
    # Two threads may write rows in a different order from their clock readings.
    for k in range(1, len(found)):
        found[k] = max(found[k], found[k - 1])
    return tuple(found), True


class _Teller:
    """Finder of the use of the time from each row to the next."""

    def __init__(self, *, has_presses: bool) -> None:
        self._has_presses = has_presses
        self._state = ""
        self._on_path = False
        self._jaws_count = 0
        self._question_count = 0
        # of a view: between the end of its path and its pictures
        self._at_view = ""

    @property
    def is_execute(self) -> bool:
        return mode_of(self._state) is Mode.EXECUTE and work_of(self._state) != RESETTING

    @property
    def is_open(self) -> bool:
        """True if only a later row determines the use of this time."""
        return self._at_view == "waits" and self.use is TimeUse.SHOWING

    @property
    def use(self) -> TimeUse:
        """The use of the time from here on."""
        mode, work = mode_of(self._state), work_of(self._state)
        if mode in (Mode.SUSPENDED, Mode.UNSUSPENDING):
            return TimeUse.PAUSE
        if self._question_count:
            return TimeUse.PERSON
        if mode is None:
            return _OF_STATE.get(self._state, TimeUse.REST)
        if work == RESETTING:
            return TimeUse.HOMING
        if self._on_path:
            return TimeUse.MOVING
        if self._jaws_count:
            return TimeUse.JAWS
        if work == "presenting":
            return {"presses": TimeUse.JAWS, "waits": TimeUse.SHOWING}.get(
                self._at_view, TimeUse.REST
            )
        return _OF_WORK.get(work or "", TimeUse.REST)

    def take(self, row: Body | None) -> None:
        match row:
            case rows.CellEvent() if row.answer == "handled":
                if row.target != self._state:
                    self._state = row.target
                    if mode_of(row.target) is Mode.EXECUTE and row.source != row.target:
                        self._settle(row)
            case rows.PathBegun():
                self._on_path, self._at_view = True, ""
            case rows.PathEnded():
                self._on_path = False
                self._at_view = "presses" if self._has_presses else "waits"
            case rows.HoldPressed():
                self._at_view = "waits" if self._at_view else ""
            case rows.ViewPicturesTaken():
                self._at_view = ""
            case rows.Intent():
                self._jaws_count = 1
            case rows.OnceDone():
                self._jaws_count = 0
            case rows.QuestionRaised():
                self._question_count += 1
            case rows.QuestionAnswered():
                self._question_count = max(0, self._question_count - 1)

    def _settle(self, row: rows.CellEvent) -> None:
        """Forget the open use of an action that ended without a row of its own."""
        if work_of(row.source) != work_of(row.target):
            self._on_path, self._jaws_count, self._at_view = False, 0, ""


def spans(log: Sequence[LogEntry], at_s: Sequence[float]) -> Iterator[Span]:
    """Yield the spans of a run in order, without gaps; the k-th ends at row k + 1.

    Parameters
    ----------
    log : rows of a run in order
    at_s : an instant for each
    """
    teller = _Teller(has_presses=any(isinstance(entry.row, rows.HoldPressed) for entry in log))
    open_spans: list[Span] = []
    for k, entry in enumerate(log[:-1]):
        was_open = teller.is_open
        teller.take(entry.row)
        if was_open and open_spans and not teller.is_open:
            # The arm waited before the camera, for its pictures or for results of earlier views.
            use = (
                TimeUse.SHOWING
                if isinstance(entry.row, rows.ViewPicturesTaken)
                else TimeUse.EVALUATION
            )
            yield from (Span(use, s.start_s, s.end_s, s.is_execute) for s in open_spans)
            open_spans = []
        span = Span(teller.use, at_s[k], at_s[k + 1], teller.is_execute)
        if teller.is_open:
            open_spans.append(span)
        else:
            yield from open_spans
            open_spans = []
            yield span
    yield from open_spans
