"""The faults of a simulated cell, named, each at a state of the cell.

A fault is one or more verbs of docs/emulator-faults.md, with the words by which the operator has to
recognise it if the cell does not recover by itself.
"""

import asyncio
import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from .cell import Controller, SimulatedCell
from .invariants import Watch

Order = Mapping[str, Any]

SOON_S: Final = 1.5  # longest delay of a fault after its state was entered
# in place of a state: the arm stands, and the part is in its gripper
STANDING: Final = "standing with the part"
# the same with the part in the fixed gripper, whether the arm stands or moves
IN_FIXED: Final = "the part in the fixed gripper"
FIXED_S: Final = 3.0  # longest delay of a fault after the fixed gripper has the part alone
STAND_S: Final = 0.4  # time without motion after which the arm counts as standing
MOST_STANDS: Final = 4  # largest number of standstills before the one with the fault


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault.

    Attributes
    ----------
    name : short
    orders : verbs with their values, all at once
    words : regular expression of which a message about it has a match
    undone : verbs that end it after `undone_s`; none where it stays
    touches_part : a person or the fault itself moves the part
    late_s : the controller gets no turn for so long; its `Scene.may_be_late` must be set
    """

    name: str
    orders: tuple[Order, ...]
    words: str
    undone: tuple[Order, ...] = ()
    undone_s: float = 5.0
    touches_part: bool = False
    late_s: float = 0.0


def _line(device: str, **faults: Any) -> Order:  # noqa: ANN401
    return {"do": "line", "device": device, **faults}


_ARM = "arm|position|line|motor"
_GRIPPER = "gripper"
_LAMPS = "lamp|light|dimmer|relay|dark|output module"
_IO = r"I/O|interlock|\bio\b|emergency|door"
_CAMERA = "camera|picture|frame|dark"
_LATE = r"watchdog|late|I/O"
PART: Final = "part|slip|gripper|grasp|seen|table"

FAULTS: Final[Mapping[str, Fault]] = {
    fault.name: fault
    for fault in (
        Fault("estop", ({"do": "estop"},), "emergency stop|E-stop|estop"),
        Fault("door", ({"do": "door"},), "door|guard"),
        Fault("24 V lost", ({"do": "supply"},), r"24 V|supply|lamp|light|power|\bair\b"),
        Fault("drop from the arm", ({"do": "lose_part", "gripper": "arm"},), PART,
              touches_part=True),
        Fault("drop from the fixed gripper", ({"do": "lose_part", "gripper": "fixture"},), PART,
              touches_part=True),
        Fault("slip by 3 mm", ({"do": "slip", "along_mm": 3.0},), PART, touches_part=True),
        Fault("slip by 8 mm", ({"do": "slip", "along_mm": -8.0, "turn_deg": 6.0},), PART,
              touches_part=True),
        # the fingers of a grasp that misses go through the part
        Fault("missed grasp", ({"do": "miss"},), PART, touches_part=True),
        Fault("missed hand-off", ({"do": "miss", "gripper": "fixture"},), PART, touches_part=True),
        Fault("part taken by a person", ({"do": "remove"},), PART, touches_part=True),
        Fault("arm line mute", ({"do": "arm_line", "mute": True},), _ARM),
        Fault("arm line cut", ({"do": "arm_line", "unplugged": True},), _ARM),
        Fault("arm line late", ({"do": "arm_line", "reply_delay_s": 0.08},), _ARM,
              ({"do": "arm_line", "reply_delay_s": 0.0},), 2.0),
        Fault("arm byte lost", ({"do": "byte", "device": "arm", "harm": "lost"},), _ARM),
        Fault("arm byte doubled", ({"do": "byte", "device": "arm", "harm": "doubled"},), _ARM),
        Fault("arm byte flipped", ({"do": "byte", "device": "arm", "harm": "flipped", "bit": 3},),
              _ARM),
        Fault("byte to the arm flipped",
              ({"do": "byte", "device": "arm", "harm": "flipped", "direction": "to", "bit": 2},),
              _ARM),
        Fault("arm board restart", ({"do": "arm_ip", "ip": 0, "what": "restart"},), _ARM),
        Fault("motor board restart", ({"do": "arm_ip", "ip": 1, "what": "restart"},), _ARM),
        Fault("motor board restart and drop",
              ({"do": "arm_ip", "ip": 1, "what": "restart"}, {"do": "lose_part", "gripper": "arm"}),
              _ARM, touches_part=True),
        Fault("arm without power for 3 s", ({"do": "power", "device": "arm"},), _ARM,
              ({"do": "power", "device": "arm", "on": True},), 3.0),
        Fault("everything without power for 3 s",
              tuple({"do": "power", "device": one} for one in ("arm", "gripper", "io", "dimmer")),
              f"{_ARM}|{_GRIPPER}|{_LAMPS}|{_IO}",
              tuple({"do": "power", "device": one, "on": True}
                    for one in ("arm", "gripper", "io", "dimmer")), 3.0),
        Fault("arm board dead", ({"do": "arm_ip", "ip": 1, "what": "kill"},), _ARM),
        Fault("joint stall", ({"do": "arm_jam", "axis": "shoulder"},), "stall|stuck|met|moves|arm"),
        Fault("encoder jump", ({"do": "arm_jump", "axis": "elbow", "counts": 40},),
              f"{_ARM}|encoder|counts"),
        Fault("arm without power", ({"do": "power", "device": "arm"},), _ARM),
        Fault("fixed gripper jammed", ({"do": "gripper", "jammed": True},), _GRIPPER),
        Fault("fixed gripper code 0A", ({"do": "gripper_fault", "code": 10},), _GRIPPER),
        Fault("fixed gripper hot", ({"do": "gripper_fault", "code": 8},), _GRIPPER),
        Fault("fixed gripper without power", ({"do": "power", "device": "gripper"},), _GRIPPER),
        Fault("fixed gripper silent", (_line("gripper", is_deaf=True),), _GRIPPER),
        Fault("fixed gripper mute", (_line("gripper", is_mute=True),), _GRIPPER),
        Fault("fixed gripper exception", (_line("gripper", exception_code=4),), _GRIPPER),
        Fault("fixed gripper late", (_line("gripper", reply_delay_s=0.15),), _GRIPPER,
              (_line("gripper", reply_delay_s=0.0),), 2.0),
        Fault("gripper line cut", ({"do": "cut", "line": "gripper"},), _GRIPPER),
        Fault("gripper line cut for 1 s", ({"do": "cut", "line": "gripper"},), _GRIPPER,
              ({"do": "cut", "line": "gripper", "reachable": True},), 1.0),
        Fault("dimmer silent", (_line("dimmer", is_deaf=True),), _LAMPS),
        Fault("relays mute", (_line("relays", is_mute=True),), _LAMPS),
        Fault("lamps without power", ({"do": "power", "device": "dimmer"},), _LAMPS),
        Fault("station lamp dead", ({"do": "lamp", "name": "station_backlight", "dead": True},),
              f"{_LAMPS}|{PART}"),
        Fault("table lamp dead", ({"do": "lamp", "name": "table_backlight", "dead": True},),
              f"{_LAMPS}|{PART}"),
        Fault("I/O silent", (_line("io", is_deaf=True),), _IO),
        Fault("I/O line cut", ({"do": "cut", "line": "io"},), _IO),
        Fault("I/O without power", ({"do": "power", "device": "io"},), _IO),
        Fault("camera unplugged", ({"do": "unplug", "camera": "inspection"},), _CAMERA),
        Fault("table camera unplugged", ({"do": "unplug", "camera": "overhead"},), _CAMERA),
        Fault("camera frozen", ({"do": "camera", "camera": "inspection", "is_frozen": True},),
              f"{_CAMERA}|{PART}"),
        Fault("camera dark", ({"do": "camera", "camera": "inspection", "is_dark": True},),
              f"{_CAMERA}|{PART}"),
        Fault("camera stalled", ({"do": "camera", "camera": "inspection", "is_stalled": True},),
              _CAMERA),
        Fault("late frame",
              ({"do": "camera", "camera": "inspection", "late_count": 1, "late_s": 2.0},), _CAMERA),
        # SIGSTOP, a pause of the collector, a write that blocks the event loop
        Fault("controller late by 0.5 s", (), _LATE, late_s=0.5),
        Fault("controller late by 2 s", (), _LATE, late_s=2.0),
        Fault("controller late by 8 s", (), _LATE, late_s=8.0),
    )
}  # fmt: skip


def names_it(fault: Fault, message: str) -> bool:
    """Return whether a message is about a fault."""
    return re.search(fault.words, message, re.IGNORECASE) is not None


@dataclass(slots=True)
class Cause:
    """Causes faults in one cell; the watch knows which of them move the part.

    Attributes
    ----------
    caused : causes of the faults in the cell, in order
    """

    cell: SimulatedCell
    watch: Watch
    rng: random.Random
    caused: list[str] = field(default_factory=list)
    tasks: set["asyncio.Task[None]"] = field(default_factory=set)

    def now(self, fault: Fault, controller: Controller | None = None) -> None:
        """Cause a fault in the cell; a fault that does not fit the moment is noted."""
        world = self.cell.cell.world
        try:
            if fault.touches_part:
                self.watch.excuse()
            for order in fault.orders:
                self._carry_out(order)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            self.caused.append(f"{fault.name}: not now ({error})")
            return
        if fault.late_s and controller is not None:
            controller.hold_up(fault.late_s)
        self.caused.append(f"{fault.name} at {world.time_s:.1f} s")
        if fault.undone:
            self.spawn(self._undo(fault))

    def _carry_out(self, order: Order) -> None:
        values = dict(order)
        if values["do"] in ("lose_part", "slip"):
            gripper = values.get("gripper", "arm")
            if self.cell.truth()["parts"][0]["custody"] not in (gripper, "both"):
                raise ValueError(f"the {gripper} gripper holds nothing")
        self.cell.befall(values.pop("do"), **values)

    async def _undo(self, fault: Fault) -> None:
        await asyncio.sleep(fault.undone_s)
        for order in fault.undone:
            self._carry_out(order)

    def spawn(self, work: Any) -> None:  # noqa: ANN401  (a coroutine)
        """Let work of the simulation run beside the cell."""
        task = self.cell.loop.spawn(self.cell.process, work)
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)

    # --- at a state -----------------------------------------------------------------------------

    def at_state(
        self,
        controller: Controller,
        state: str,
        fault: Fault,
        then: Callable[[], None] = lambda: None,
    ) -> None:
        """Cause a fault soon after a controller enters a state for the first time.

        Parameters
        ----------
        controller : controller whose state counts
        state : as the operator sees it; or `STANDING`, or `IN_FIXED`
        fault : fault in the cell
        then : called right afterwards
        """
        if state == STANDING:
            self.spawn(self._while_standing(fault, then, controller))
            return
        if state == IN_FIXED:
            self.spawn(self._while_in_fixed(fault, then, controller))
            return
        delay_s = self.rng.uniform(0.0, SOON_S)

        def befall() -> None:
            self.now(fault, controller)
            then()

        def entered(now: str) -> None:
            if now == state:
                controller.on_state = lambda _: None
                self.spawn(self._after(delay_s, befall))

        controller.on_state = entered

    async def _while_standing(
        self, fault: Fault, then: Callable[[], None], controller: Controller
    ) -> None:
        """Cause a fault while the arm stands with the part in its gripper."""
        world, left = self.cell.cell.world, self.rng.randint(0, MOST_STANDS)
        since: float | None = None
        while True:
            await asyncio.sleep(STAND_S / 4)
            is_held = self.cell.truth()["parts"][0]["custody"] == "arm"
            moved_s = world.last_motion_s["arm"]
            if not is_held or world.time_s - moved_s < STAND_S or moved_s == since:
                continue
            since = moved_s
            if left == 0:
                break
            left -= 1
        self.now(fault, controller)
        then()

    async def _while_in_fixed(
        self, fault: Fault, then: Callable[[], None], controller: Controller
    ) -> None:
        """Cause a fault at a random moment at which the fixed gripper alone has the part."""
        delay_s = self.rng.uniform(0.0, FIXED_S)
        while delay_s > 0:
            await asyncio.sleep(STAND_S / 4)
            if self.cell.truth()["parts"][0]["custody"] == "fixture":
                delay_s -= STAND_S / 4
        self.now(fault, controller)
        then()

    async def _after(self, delay_s: float, what: Callable[[], None]) -> None:
        await asyncio.sleep(delay_s)
        what()
