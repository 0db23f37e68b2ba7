"""State of a run for the page, folded row by row from its journal. No I/O, no clock."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final

from controller.cell.alarms import BY_NUMBER
from controller.cell.custody import Custody
from controller.cell.journal import Row, read_row, rows
from messages import key, say

SIZE_PX: Final = (1280, 1024)  # size where the journal does not have it
VIEW_COUNT: Final = 6
ALARM_COUNT: Final = 12
ACT_COUNT: Final = 12
DONE_COUNT: Final = 50
# Largest number of points of a predicted outline.
OUTLINE_POINT_COUNT: Final = 240

# A plan is forecast for a good part; the row of the finished step has the actual tray.
PLACE: Final = "place in tray"
# what was answered, by its choice; any other is named as it is, such as a serial number
ANSWERED: Final = {
    "look": key("answer look"),
    "out": key("answer out"),
    "stop": key("answer stop"),
    "go_on": key("answer go on"),
    "refuse": key("answer refuse"),
}
# The last step of a plan. It is no step of the part, which lies in its tray, and has no row: it is
# the arm's motion after the last step of the part.
PARK: Final = "park"

IN_ARM: Final = (Custody.IN_ARM, Custody.IN_BOTH)


@dataclass(frozen=True, slots=True)
class Path:
    """A joint path that the arm has begun.

    Attributes
    ----------
    start : joints where it began, None where nobody knows
    waypoints : joints it goes through
    began_s : UTC, seconds since 1970
    """

    start: tuple[float, ...] | None
    waypoints: tuple[tuple[float, ...], ...]
    began_s: float


@dataclass(slots=True)
class JournaledArm:
    """The arm as the journal has it: its position, or its path.

    Attributes
    ----------
    q : joints at which it stood last, None before the first row that has some
    path : None while it stands
    """

    q: tuple[float, ...] | None = None
    path: Path | None = None


@dataclass(slots=True)
class HeldPart:
    """Where the part is.

    Attributes
    ----------
    custody : gripper, tray or table that has it
    number : number of the part in the run, 0 before the first
    T_world_part : pose in which it was seen last
    let_go : joints at which the arm gripper let go of it, and how it had held it
    T_part_tcp : grasp of the arm gripper
    arm_mm, fixed_mm : openings of the grippers, None for open
    """

    custody: Custody = Custody.NONE
    number: int = 0
    T_world_part: Sequence[Sequence[float]] | None = None
    T_part_tcp: Sequence[Sequence[float]] | None = None
    arm_mm: float | None = None
    fixed_mm: float | None = None
    let_go: tuple[tuple[float, ...], Sequence[Sequence[float]]] | None = None


@dataclass(slots=True)
class RunFold:
    """A run, as far as its rows were taken.

    Attributes
    ----------
    run : its name
    seq : number of the last row taken
    began : its first row, None before it
    pictures : files of the run's folder that the page may show
    inputs : SHA-256 of the files that the run was started with
    others : other objects on the table
    state, arm, part : states of cell, arm and part
    is_at_rest : the run has come to rest; what is left of it is its report
    compared : numbers of samples of each face of the current part: compared so far, and in all
    began_utc : start time
    """

    run: str
    seq: int = 0
    began: rows.RunBegan | None = None
    began_utc: str = ""
    state: str = ""
    is_at_rest: bool = False
    arm: JournaledArm = field(default_factory=JournaledArm)
    part: HeldPart = field(default_factory=HeldPart)
    compared: dict[int, tuple[int, int]] = field(default_factory=dict)
    others: list[dict[str, Any]] = field(default_factory=list)
    pictures: list[str] = field(default_factory=list)
    inputs: dict[str, str] = field(default_factory=dict)
    _steps: list[dict[str, Any]] = field(default_factory=list)
    _plan: dict[str, Any] = field(default_factory=dict)
    _done: int = 0
    _placed_s: float | None = None
    _recipe_number: int = 0
    _label: rows.PartIdentified | None = None
    _views: dict[str, dict[str, Any]] = field(default_factory=dict)
    _table: list[dict[str, Any]] = field(default_factory=list)
    _verdict: dict[str, Any] | None = None
    _parts: deque[dict[str, Any]] = field(default_factory=lambda: deque(maxlen=DONE_COUNT))
    _counts: dict[str, int] = field(default_factory=dict)
    _alarms: deque[dict[str, Any]] = field(default_factory=lambda: deque(maxlen=ALARM_COUNT))
    _acts: deque[dict[str, Any]] = field(default_factory=lambda: deque(maxlen=ACT_COUNT))
    _end: dict[str, Any] | None = None

    def take(self, row: Row) -> None:
        """Take the next row; one that this version cannot read changes nothing."""
        self.seq = row.seq
        try:
            body = read_row(row.kind, row.name, row.body)
        except ValueError:
            return
        if row.part and row.part != self.part.number:
            self._next_part(row.part)
        self._take_course(row, body)
        self._take_part(row, body)
        self._take_people(row, body)

    @property
    def speed(self) -> float:
        """Cell seconds per second that the run was started with."""
        return 1.0 if self.began is None else self.began.speed

    @property
    def recipe(self) -> Mapping[str, Any]:
        """The recipe of the part that was recognised last; the run's first one before any was."""
        return {} if self.began is None else self.began.ordered[self._recipe_number].recipe

    @property
    def recipe_name(self) -> str:
        """Its name; empty without one."""
        return str(self.recipe.get("name", ""))

    @property
    def _at_hand(self) -> dict[str, str]:
        """Recipe and serial number of the current part, each empty while unknown."""
        label, began = self._label, self.began
        if label is not None:
            return {"recipe": label.name, "serial": label.serial}
        is_only_one = began is not None and len(began.ordered) == 1
        return {"recipe": self.recipe_name if is_only_one else "", "serial": ""}

    @property
    def _size(self) -> list[int]:
        """Width and height of the inspection camera's pictures [px]."""
        cameras = {} if self.began is None else self.began.cell.get("cameras", {})
        size = cameras.get("inspection", {}).get("size_px", SIZE_PX)
        return [int(size[0]), int(size[1])]

    def coverage(self) -> dict[str, Any]:
        """Return the share of each face compared so far, as JSON."""
        return {
            "run": self.run,
            "part": self.part.number,
            "recipe": self.recipe_name,
            "views": sum(bool(view.get("judged")) for view in self._views.values()),
            "faces": [[face, count, of] for face, (count, of) in self.compared.items()],
        }

    def facts(self) -> dict[str, Any]:
        """Return its data for the page, as JSON."""
        began = self.began
        return {
            "run": self.run,
            "began": self.began_utc,
            "recipe": self.recipe_name,
            "operator": "" if began is None else began.operator,
            "lot": "" if began is None else began.lot,
            "order_number": "" if began is None else began.order_number,
            "count": None if began is None else began.count,
            "emulated": [] if began is None else list(began.emulated_devices),
            "speed": self.speed,
            "size": self._size,
            "state": self.state,
            "custody": self.part.custody.value,
            "part": self.part.number,
            "at_hand": self._at_hand,
            "verdict": self._verdict,
            "plan": {**self._plan, "steps": self._steps, "done": self._done},
            "views": list(self._views.values())[-VIEW_COUNT:],
            "table": self._table,
            "parts": list(self._parts),
            "counts": self._counts,
            "alarms": list(self._alarms)[::-1],
            "acts": list(self._acts)[::-1],
            "end": self._end,
        }

    def _next_part(self, number: int) -> None:
        self.part = HeldPart(number=number)
        self._label = None
        self.others, self._steps, self._plan, self._done = [], [], {}, 0
        self._views, self._table, self._verdict = {}, [], None
        self.compared = {}

    def _take_course(self, row: Row, body: rows.Body | None) -> None:
        """Take a row about the run or the arm."""
        match body:
            case rows.RunBegan():
                self.began, self.began_utc = body, row.t_utc
            case rows.FilesStored():
                self.inputs |= {
                    name: sha256 for name, sha256 in body.root.items() if name.startswith("inputs/")
                }
            case rows.PathBegun() if body.waypoints:  # without any, the arm was there already
                began_s = datetime.fromisoformat(row.t_utc).timestamp()
                self.arm.path = Path(self.arm.q, body.waypoints, began_s)
            case rows.PathEnded():
                if self.arm.path is not None:
                    self.arm.q, self.arm.path = self.arm.path.waypoints[-1], None
                self._park(row)
            case rows.StoodFree() | rows.HomedWithPart() | rows.PositionsTakenOver():
                self.arm.q, self.arm.path = body.q, None
            case rows.ViewPicturesTaken() if body.q:
                self.arm.q, self.arm.path = body.q, None
            case rows.Stopped():
                self.arm.path = None
            case rows.AtRest():
                self.state, self.is_at_rest = body.state, True
            case rows.RunEnded():
                self._end = {"end": body.end, "message": body.message, "parts": body.parts}
            case _:
                pass

    def _take_part(self, row: Row, body: rows.Body | None) -> None:
        """Take a row about the current part."""
        match body:
            case rows.PartIdentified():
                self._recipe_number, self._label = body.recipe, body
            case rows.TablePictures():
                self._table = self._shown(row.body)
            case rows.Sightings():
                taken, others = body.parted()
                if taken is not None and taken.T_world_part is not None:
                    self.part.T_world_part, self.part.let_go = taken.T_world_part, None
                    self.part.custody = Custody.ON_TABLE
                self.others = [
                    {"part": one.part, "x": one.x_mm, "y": one.y_mm, "T": one.T_world_part}
                    for one in others
                ]
            case rows.PlanMade():
                self._steps = [
                    {"label": _open(label), "forecast_s": round(seconds, 2), "seconds": None}
                    for label, seconds in zip(body.steps, body.seconds, strict=False)
                ]
                self._done = 0
                self._plan = {
                    "forecast_s": body.forecast_s,
                    "covered": body.covered_fraction,
                    "reachable": body.reachable_fraction,
                }
            case rows.StepDone():
                if self._done < len(self._steps):
                    self._steps[self._done] |= {"label": body.label, "seconds": body.seconds}
                self._done += 1
                self._placed_s = row.cell_s
            case rows.HoldNoted():
                if body.gripper == "arm":
                    self.part.T_part_tcp, self.part.arm_mm = body.T_part_tcp, body.opening_mm
                else:
                    self.part.fixed_mm = body.opening_mm
            case rows.CustodyChanged():
                was, now = self.part.custody, Custody.of_key(row.name)
                q, T = self.arm.q, self.part.T_part_tcp
                if was in IN_ARM and now not in IN_ARM and q is not None and T is not None:
                    self.part.let_go = (q, T)
                self.part.custody = now
            case rows.ViewPicturesTaken():
                self._views[body.view] = {"view": body.view, "pictures": self._shown(body.pictures)}
            case rows.ViewJudged():
                view = self._views.setdefault(body.view, {"view": body.view, "pictures": []})
                view |= _judged(body)
                if body.faces:
                    self.compared = {face: (count, of) for face, count, of in body.faces}
            case rows.PartJudged():
                self._verdict = {"verdict": body.verdict, "reasons": list(body.reasons)}
            case rows.PartDone():
                done = {"part": self.part.number, "verdict": body.verdict, "tray": body.tray}
                self._parts.append({**done, **self._at_hand})
                self._counts[body.verdict] = self._counts.get(body.verdict, 0) + 1
            case _:
                pass

    def _take_people(self, row: Row, body: rows.Body | None) -> None:
        """Take a row about a person's action or a notice to a person."""
        if (alarm := rows.told_alarm(body)) is not None:
            self._alarm(row, alarm)
        match body:
            case rows.RunBegan() if body.operator:
                self._act(row, "start", body.operator, "", "handled")
            case rows.CellEvent():
                if body.answer == "handled":
                    self.state = body.target
                if body.who:
                    self._act(row, row.name, body.who, body.why, body.answer)
            case rows.QuestionAnswered():
                answered = ANSWERED.get(body.choice) or say("answer {choice}", choice=body.choice)
                self._act(row, answered, body.who, body.why, "handled")
            case rows.Acknowledged():
                self._act(row, "ack", body.who, body.why, "handled")
            case _:
                pass

    def _park(self, row: Row) -> None:
        """Tick off the path to park, which has ended with this row."""
        last = len(self._steps) - 1
        began_s, now_s = self._placed_s, row.cell_s
        if self._done == last and self._steps[last]["label"] == PARK and began_s and now_s:
            self._steps[last]["seconds"] = round(now_s - began_s, 2)

    def _shown(self, pictures: Mapping[str, str]) -> list[dict[str, Any]]:
        found = []
        for lamp, name in pictures.items():
            found.append({"lamp": lamp, "picture": len(self.pictures)})
            self.pictures.append(name)
        return found

    def _alarm(self, row: Row, told: rows.ToldAlarm) -> None:
        alarm = BY_NUMBER.get(told.number)
        if alarm is None:
            return
        if self._alarms and self._alarms[-1]["number"] == told.number:
            same = self._alarms[-1]
            if same["message"] == told.message:
                same["times"] += 1
                same["at"] = row.t_utc
                return
        self._alarms.append(
            {
                "number": told.number,
                "severity": alarm.severity.value,
                "words": alarm.words,
                "message": told.message,
                "device": told.device or alarm.device,
                "unknown": alarm.unknown,
                "todo": alarm.action,
                "at": row.t_utc,
                "times": 1,
            }
        )

    def _act(self, row: Row, name: str, who: str, why: str, answer: str) -> None:
        self._acts.append({"at": row.t_utc, "act": name, "who": who, "why": why, "answer": answer})


def _open(label: str) -> str:
    """Return the label of a planned step without the tray, which only the verdict decides."""
    return PLACE if label.startswith(f"{PLACE} ") else label


def _judged(body: rows.ViewJudged) -> dict[str, Any]:
    every = max(1, -(-len(body.outline_px) // OUTLINE_POINT_COUNT))
    return {
        "judged": True,
        "evaluated": body.evaluated,
        "reason": body.reason,
        "outline": [list(point) for point in body.outline_px[::every]],
        "findings": [
            {
                "kind": one.kind,
                "lamp": one.lamp,
                "size_mm": round(one.size_mm, 2),
                "box": list(one.box_px),
                "faces": list(one.faces),
            }
            for one in body.findings
        ],
    }
