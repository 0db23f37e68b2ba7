"""The invariants of a simulated cell under any fault; checked after every slice of the world.

Each check compares two independent sides: the world's own record of holds, releases and contacts,
and the journal of the controller.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from controller.cell.custody import CellIdentity, Custody, fold_custody, read_folded
from controller.cell.journal import (
    JournalError,
    Once,
    Row,
    first_flaw,
    is_of,
    is_once,
    read_rows,
    rows,
)

from .cell import SimulatedCell

FREE_FALL_MM: Final = 12.0  # a part released from a greater height above the table falls
PUT_DOWN_MM: Final = 1.0  # a held part pressed on the table by less is being put down
STOPPED_S: Final = 0.3  # world time in which motion comes to rest after a stop
# Motors of the world, by the controller's device.
MOTORS: Final[Mapping[str, tuple[str, ...]]] = {
    "arm": ("arm", "arm gripper"),
    "gripper": ("fixed gripper",),
}
UNDONE: Final = "undone"  # detail of an intent to open again what it had closed
EXCUSED_S: Final = 1.0  # longest time from an order to release a part to the world's event
# Which intents let one gripper go, and which let it take hold.
LETS_GO: Final[Mapping[str, frozenset[str]]] = {
    "arm": frozenset(
        {
            Once.RELEASE_ARM,
            Once.SET_DOWN,
            Once.SORT,
            Once.OPEN_ARM_GRIPPER,
            f"{Once.RECEIVE.value} {UNDONE}",
        }
    ),
    "fixture": frozenset(
        {Once.RELEASE_FIXED, Once.OPEN_FIXED_GRIPPER, f"{Once.HAND_OFF.value} {UNDONE}"}
    ),
}
TAKES: Final[Mapping[str, frozenset[str]]] = {
    "arm": frozenset({Once.GRASP, Once.RECEIVE}),
    "fixture": frozenset({Once.HAND_OFF}),
}
HOLDERS: Final = {
    Custody.NONE: {"free", "away"},
    Custody.ON_TABLE: {"free", "away"},
    Custody.IN_ARM: {"arm"},
    Custody.IN_BOTH: {"both"},
    Custody.IN_FIXED: {"fixture"},
    Custody.PLACED: {"free", "away"},
    Custody.REMOVED: {"free", "away"},
    Custody.LOST: {"free", "away"},
}


@dataclass(frozen=True, slots=True)
class Violation:
    """Something that must not happen.

    Attributes
    ----------
    rule : short name
    at_s : time in the world
    """

    rule: str
    at_s: float
    what: str

    def __str__(self) -> str:
        return f"{self.rule} at {self.at_s:.2f} s: {self.what}"


@dataclass(slots=True)
class Watch:
    """Watches one cell from its beginning.

    Attributes
    ----------
    violations : found so far
    excused_until_s : until then a part that is let go was let go by the simulation itself
    """

    cell: SimulatedCell
    violations: list[Violation] = field(default_factory=list)
    excused_until_s: float = -1.0
    is_part_touched: bool = False
    _event_count: int = 0
    _collision_count: int = 0
    _quiet_since_s: float | None = None
    _last: dict[str, float] = field(default_factory=dict)
    _known: list[tuple[int, str]] = field(default_factory=list)
    on_event: Callable[[Any], None] = lambda event: None

    def look(self) -> None:
        """Check everything that can have changed in the last slice of the world."""
        world = self.cell.cell.world
        for event in world.events[self._event_count :]:
            self._event_count += 1
            self._look_at_event(event)
            self.on_event(event)
        for one in world.collisions[self._collision_count :]:
            self._collision_count += 1
            is_put_down = (
                one.moving.startswith("part ")
                and one.other == "table"
                and one.depth_mm < PUT_DOWN_MM
            )
            if not is_put_down and not self.is_part_touched:
                words = f"{one.moving} into {one.other} by {one.depth_mm:.1f} mm"
                self._violated("contact", words)
        if self._quiet_since_s is not None:
            for name, at_s in world.last_motion_s.items():
                if at_s > max(self._quiet_since_s + STOPPED_S, self._last[name]):
                    self._violated("motion after a stop", f"{name} moves")
                    self._last[name] = at_s

    def _look_at_event(self, event: Any) -> None:  # noqa: ANN401  (of the emulated world)
        if event.is_held or event.what not in ("released", "fell_out", "torn"):
            return
        if event.at_s <= self.excused_until_s:
            return
        if event.what != "released":
            self._violated("dropped", f"{event.what} of {event.by}, {event.lowest_mm:.0f} mm up")
        elif event.lowest_mm > FREE_FALL_MM:
            self._violated("jaws opened", f"{event.by} let go {event.lowest_mm:.0f} mm up")

    def _violated(self, rule: str, what: str) -> None:
        self.violations.append(Violation(rule, self.cell.cell.world.time_s, what))

    def excuse(self) -> None:
        """Blame the simulation for whatever happens to the part, and meets it, from now on.

        A part that fell or was moved may be touched by an arm that cannot know it.
        """
        self.is_part_touched = True
        self.excused_until_s = self.cell.cell.world.time_s + EXCUSED_S

    # --- permits --------------------------------------------------------------------------------

    def stopped(self, unconfirmed: frozenset[str] = frozenset()) -> None:
        """Let nothing move from now on: the controller has said that all is at rest.

        Parameters
        ----------
        unconfirmed : devices of which it has said that their stop was not confirmed
        """
        free = {name for device in unconfirmed for name in MOTORS.get(device, ())}
        self._quiet_since_s = self.cell.cell.world.time_s
        self._last = {
            name: float("inf") if name in free else 0.0
            for name in self.cell.cell.world.last_motion_s
        }

    def permitted(self) -> None:
        """Allow motion again: a person started something."""
        self._quiet_since_s = None

    # --- the journal ----------------------------------------------------------------------------

    def remember_rows(self) -> None:
        """Record the present content of the journal; `check_journal` requires it all later."""
        path = self.cell.journal_path
        if path.exists():
            try:
                self._known = [(row.seq, row.t_utc) for row in read_rows(path)]
            except JournalError as error:
                self._violated("journal", str(error))

    def check_journal(self, *, lost_from: int | None = None) -> list[Row]:
        """Check that the journal is whole and kept all rows; return them.

        Parameters
        ----------
        lost_from : number of the first row that a power cut may have taken; None for none
        """
        path = self.cell.journal_path
        if not path.exists():
            if self._known:
                self._violated("journal", "it is gone")
            return []
        if (flaw := first_flaw(path)) is not None:
            self._violated("journal", flaw)
        found = list(read_rows(path))
        there = {(row.seq, row.t_utc) for row in found}
        for seq, t_utc in self._known:
            if (lost_from is None or seq < lost_from) and (seq, t_utc) not in there:
                self._violated("journal", f"row {seq} is lost")
        return found

    def check_once(self, found: Sequence[Row]) -> None:
        """Check that no gripper took hold or let go more often than it was meant to."""
        meant = [
            f"{row.name} {UNDONE}" if row.body.get("detail") == UNDONE else row.name
            for row in found
            if row.kind == "intent"
        ]
        world = self.cell.cell.world
        for gripper in ("arm", "fixture"):
            for what, names in (("released", LETS_GO[gripper]), ("gripped", TAKES[gripper])):
                done = sum(e.what == what and e.by == gripper for e in world.events)
                intended = sum(name in names for name in meant)
                if done > intended:
                    self._violated(
                        "once", f"{gripper} has {what} {done} times by {intended} intents"
                    )

    def check_custody(self, found: Sequence[Row]) -> None:
        """Check that the last custody of the journal is true, now that the world is at rest."""
        truth = self.cell.truth()["parts"][0]
        custody, since = Custody.NONE, 0
        for row in found:
            if row.kind == "custody":
                custody, since = Custody.of_key(row.name), row.seq
            elif is_once(row) and row.seq > since:
                custody = Custody.UNKNOWN
        if custody is Custody.UNKNOWN:
            return
        if truth["custody"] not in HOLDERS[custody] and not self.is_part_touched:
            self._violated("custody", f"{custody.value}, but it is {truth['custody']}")
        if custody is Custody.PLACED and truth["tray"] is None and not self.is_part_touched:
            self._violated("custody", "placed, but in no tray")

    def check_folded(self) -> None:
        """Check that what a start would fold names every gripper that truly holds the part."""
        path = self.cell.journal_path
        if not path.exists():
            return
        began = [r for r in read_rows(path) if is_of(r, rows.RunBegan)]
        if not began:
            return
        here = CellIdentity.of(rows.RunBegan.model_validate(began[-1].body))
        held = {
            {"arm gripper": "arm", "fixed gripper": "fixture"}[one.gripper.value]
            for one in fold_custody(read_folded(path), here)
        }
        custody = self.cell.truth()["parts"][0]["custody"]
        truly = {"both": {"arm", "fixture"}, "arm": {"arm"}, "fixture": {"fixture"}}.get(custody)
        if truly is not None and not truly <= held:
            self._violated("custody", f"it is {custody}, a start would know of {sorted(held)}")
