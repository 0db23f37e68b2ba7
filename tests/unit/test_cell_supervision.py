"""Links at rest: who is asked when, what is reported, and what is passed over."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from config_text import CELL_TEXT

from controller.cell.batch.watching import ArmWatcher, LoopWatcher, ModbusWatcher
from controller.cell.devices.in_use import InUse, counted
from controller.cell.devices.stopping import Stopping
from controller.cell.journal import Journal, read_rows
from controller.cell.machine import Event
from controller.cell.services import Retries, fault_policy
from controller.cell.services.records import BatchRecord, RunProgress
from controller.config import ConfigError, FaultsSection, load_cell
from drivers.attendance import Attendance
from drivers.clock import CellClock
from drivers.errors import BadReplyError, DeviceError, LinkError, PositionLostError, SilentLineError
from drivers.kinds import Stop
from simulation.loop import SimulatedLoop

FAST = 1000.0


class Reports(list[tuple[str, str]]):
    """Takes what watchers report: message and code."""

    def __call__(self, event: Event, message: str = "", code: str = "") -> None:
        assert event is Event.FAULT
        self.append((message, code))


class Arm:
    """Answers as it is told to, reading by reading; silent once the answers are used up."""

    def __init__(self, *answers: DeviceError | None, is_homed: bool = True) -> None:
        self.answers = list(answers)
        self.is_homed = is_homed
        self.asked = 0

    async def read_opening_mm(self) -> float:
        self.asked += 1
        answer = self.answers.pop(0) if self.answers else SilentLineError("arm: no byte came back")
        if answer is not None:
            raise answer
        return 20.0


async def watched(arm: Any, clock: CellClock | None = None) -> Reports:
    clock = clock or CellClock(FAST)
    device, in_use = counted(arm, clock)
    reports = Reports()
    async with asyncio.timeout(60):
        await ArmWatcher(device, in_use, 0.1, clock).run(reports)
    return reports


async def test_an_arm_that_falls_silent_at_rest_is_reported_once() -> None:
    arm = Arm(None, None, None)
    assert await watched(arm) == [("at rest: arm: no byte came back", "silent_line")]
    assert arm.asked == 4


async def test_one_reading_that_makes_no_sense_is_passed_over_and_two_in_a_row_are_not() -> None:
    odd = BadReplyError("arm: 00")
    assert await watched(Arm(odd, None, odd, odd)) == [("at rest: arm: 00", "bad_reply")]


async def test_an_arm_that_restarted_at_rest_is_reported_at_once() -> None:
    lost = PositionLostError("arm: an IP has restarted")
    assert await watched(Arm(lost)) == [("at rest: arm: an IP has restarted", "position_lost")]


class Ticking(CellClock):
    """A clock on which only its sleepers let time pass."""

    def __init__(self) -> None:
        super().__init__(FAST)
        object.__setattr__(self, "at_s", 0.0)
        object.__setattr__(self, "ticked", asyncio.Event())

    def now_s(self) -> float:
        return float(self.at_s)  # type: ignore[attr-defined]

    async def sleep(self, duration_s: float) -> None:
        object.__setattr__(self, "at_s", self.now_s() + duration_s)
        self.ticked.set()  # type: ignore[attr-defined]
        await asyncio.sleep(0)

    async def reached(self, instant_s: float) -> None:
        while self.now_s() < instant_s:
            self.ticked.clear()  # type: ignore[attr-defined]
            await self.ticked.wait()  # type: ignore[attr-defined]


async def test_an_arm_in_use_is_not_asked_and_one_that_was_is_asked_a_beat_later() -> None:
    clock = Ticking()
    done = asyncio.Event()

    class Moving(Arm):
        async def move_joints(self, q: object) -> None:
            await done.wait()

    arm: Any = Moving()
    device, in_use = counted(arm, clock)
    move = asyncio.create_task(device.move_joints(None))
    reports = Reports()
    watcher = asyncio.create_task(ArmWatcher(device, in_use, 0.1, clock).run(reports))
    await clock.reached(5.0)
    assert (arm.asked, in_use.idle_s()) == (0, 0.0)
    done.set()
    await move
    ended_s = clock.now_s()
    await watcher
    assert arm.asked == 1
    # FAST beats of 0.1 s are stretched to the host's own pause
    assert clock.now_s() - ended_s <= 2 * 0.02 * FAST


async def test_a_stop_does_not_count_as_use() -> None:
    class Stopped:
        async def stop(self) -> None: ...

    in_use = InUse(Stopped(), Ticking())
    await in_use._clock.sleep(3.0)
    await in_use.stop()
    assert in_use.idle_s() == 3.0


async def test_an_arm_that_is_not_homed_is_left_alone() -> None:
    arm = Arm(is_homed=False)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.1):
            await ArmWatcher(arm, InUse(arm, CellClock(FAST)), 0.1, CellClock(FAST)).run(Reports())  # type: ignore[arg-type]
    assert arm.asked == 0


@pytest.fixture
def record(tmp_path: Path) -> Iterator[BatchRecord]:
    journal = Journal(tmp_path / "journal.sqlite", "run")
    yield BatchRecord(journal, RunProgress(), lambda: None)
    journal.close()


def modbus(record: BatchRecord, readings: list[Any]) -> ModbusWatcher:
    """Return a watcher of a gripper that answers so; the last answer is repeated."""

    async def status() -> Any:
        answer = readings.pop(0) if len(readings) > 1 else readings[0]
        if isinstance(answer, Exception):
            raise answer
        return SimpleNamespace(is_activated=answer)

    async def connect() -> None: ...

    clock = CellClock(FAST)
    policy = fault_policy(
        FaultsSection.model_validate({"gripper": [{"do": "retry", "times": 2}, {"do": "abort"}]})
    )
    device: Any = SimpleNamespace(status=status)
    lights: Any = SimpleNamespace(connect=connect)
    return ModbusWatcher(device, lights, Retries(record, lambda: policy, clock), 1.0, clock)


async def test_a_cut_connection_that_comes_back_is_a_retry_and_one_that_stays_a_fault(
    record: BatchRecord, tmp_path: Path
) -> None:
    cut = LinkError("gripper: not connected")
    reports = Reports()
    async with asyncio.timeout(60):
        await modbus(record, [True, cut, cut, True, cut]).run(reports)
    assert reports == [("gripper: not connected", "link")]
    rows = [r.body for r in read_rows(tmp_path / "journal.sqlite") if r.name == "device_retried"]
    assert [row["number"] for row in rows] == [1, 2, 1, 2]


async def test_a_fixed_gripper_that_lost_its_power_is_reported(record: BatchRecord) -> None:
    reports = Reports()
    async with asyncio.timeout(60):
        await modbus(record, [False, True, False]).run(reports)
    ((message, code),) = reports
    assert code == "position_lost"
    assert "may have let go" in message


async def test_a_late_loop_is_recorded_with_its_number_and_stops_nothing(
    record: BatchRecord, tmp_path: Path
) -> None:
    walls = iter(range(1000))  # every look at the wall clock finds it a second later

    def late() -> Attendance:
        return Attendance(lambda: float(next(walls)))

    reports = Reports()
    watching = asyncio.create_task(
        LoopWatcher(record, 0.05, CellClock(FAST / 10), late).run(reports)
    )
    rows: list[Any] = []
    while not rows:  # the guard of a test that hangs is pytest's
        assert not watching.done()
        await asyncio.sleep(0.01)
        rows = [r.body for r in read_rows(tmp_path / "journal.sqlite") if r.name == "loop_late"]
    watching.cancel()
    await asyncio.gather(watching, return_exceptions=True)
    assert reports == []
    assert rows[0]["longest_s"] > 0.9
    assert rows[0]["alarm"] == 910


def test_devices_that_never_answer_a_stop_are_given_up_within_the_time_allowed() -> None:
    loop = SimulatedLoop(1)
    loop.run_until_complete(_give_up(CellClock(monotonic=loop.time)))
    loop.bury()
    loop.close()


async def _give_up(clock: CellClock) -> None:
    never = asyncio.Event()
    dead: Any = SimpleNamespace(stop=lambda *_: never.wait(), all_off=never.wait)
    stopping = Stopping(dead, dead, dead, clock, confirm_s=1.0)
    began_s = clock.now_s()
    await asyncio.gather(stopping.halt_arm(), stopping.stop_others())
    failures = await stopping.stop_all(Stop.DEAD)
    assert set(failures) == {"arm", "gripper", "lights"}
    assert clock.now_s() - began_s == pytest.approx(1.0, abs=1e-3)


def test_a_beat_that_leaves_no_time_for_an_answer_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(f"{CELL_TEXT}\ndetection: {{arm_silent_s: 0.5, arm_beat_s: 0.4}}\n")
    with pytest.raises(ConfigError, match=r"arm_beat_s.*0.4 s leave too little of arm_silent_s"):
        load_cell(path)
