"""The step `grippers` in the simulated cell: what it finds, and what it does about bad inputs."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stories import play

from controller.bring_up import CommissioningSession, CommissionOrder, Errand
from controller.bring_up.gauges import touching
from controller.bring_up.person import HELPER
from controller.bring_up.procedure import CommissioningFolder, StepEnd, StepRecord
from controller.bring_up.steps import grippers
from controller.cell.devices.clocks import FoundClock
from controller.cell.operator import Answer, Question
from controller.config import load_cell
from controller.config.calibrations import FixedGripperCalibration, read_calibration
from emulators.gripper_modbus import JawScale, RobotiqConfig
from simulation.cell import BEAT_S, SimulatedCell
from simulation.loop import SimulatedLoop, SimulatedProcess

# The fixed gripper stands here in the world (recipes/cells/emulated.yaml) ...
TRUE_MM = np.array([150.0, -330.0, 430.0])
TRUE_NORMAL = np.array([0.0, 0.0, 1.0])
TRUE = "pose: {position: [150, -330, 430], x_axis: [0, 1, 0], y_axis: [0, 0, 1]}"
# ... and there by the cell file: 3 mm too high, tilted by 0.8 degrees
NORMAL = np.array([0.006, 0.0125, 1.0]) / np.linalg.norm([0.006, 0.0125, 1.0])
ALONG = np.cross(NORMAL, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(NORMAL, [1.0, 0.0, 0.0]))
DRAWN = (
    f"pose: {{position: [151, -331.5, 433], x_axis: {ALONG.round(9).tolist()}, "
    f"y_axis: {NORMAL.round(9).tolist()}}}"
)


class Hands:
    """Answers for a person and does errands; something befalls the cell at a question."""

    def __init__(self, cell: SimulatedCell) -> None:
        self.cell = cell
        self.texts: list[str] = []
        self.idle_at = ""
        self.at: dict[str, Callable[[], None]] = {}

    async def decide(self, question: Question) -> Answer:
        self.texts.append(question.text)
        for code in [code for code in self.at if code in question.text]:
            self.at.pop(code)()
        return Answer(question.choices[0].key, HELPER)

    async def do(self, errand: Errand) -> None:
        if errand.code == self.idle_at:
            return
        for order in errand.orders:
            given = dict(order)
            self.cell.befall(given.pop("do"), **given)


class Story:
    """A simulated cell and visits of the step on it."""

    def __init__(self, loop: SimulatedLoop, cell: SimulatedCell, out: Path) -> None:
        self.loop, self.cell = loop, cell
        text = cell.cell_path.read_text(encoding="utf-8")
        assert TRUE in text
        self.drawn = cell.cell_path.with_name("drawn.yaml")
        self.drawn.write_text(text.replace(TRUE, DRAWN), encoding="utf-8")
        self.order = CommissionOrder(self.drawn, CommissioningFolder(out), "a tester")
        self.hands = Hands(cell)
        self.lines: list[str] = []
        self.number = 0
        self.at: dict[str, Callable[[], None]] = {}
        self.session = self.new_session()

    def new_session(self) -> CommissioningSession:
        controller = self.cell.controller()
        return CommissioningSession(
            self.order,
            {},
            FoundClock(monotonic=self.loop.time, beat_wall_s=BEAT_S),
            self.hands,
            self.hands,  # type: ignore[arg-type]  # hands without a port
            self.show,
            controller._devices,
        )

    def show(self, line: str) -> None:
        self.lines.append(line)
        for text in [text for text in self.at if text in line]:
            self.at.pop(text)()

    async def run(self) -> StepRecord:
        self.number += 1
        process = SimulatedProcess(f"session {self.number}")
        records = self.session.run(("grippers",), lambda record: None)
        (record,) = await self.loop.spawn(process, records)
        self.session = self.new_session()
        return record


def tell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, story: Callable[[Story], Any]) -> None:
    """Run a story on a loop of its own; its cameras take no pictures of boards."""

    async def no_shake(*_: object) -> None:
        return None

    monkeypatch.setattr(grippers, "shake", no_shake)
    # fewer and quicker touches than in earnest: the world is computed step by step
    monkeypatch.setattr(touching, "stations_mm", lambda layout, end_mm: (80.0, 34.0))
    monkeypatch.setattr(touching, "TOUCH_SPEED", 0.6)
    play(tmp_path, Story, story)


def test_touches_find_the_jaws_plane_and_gauges_the_openings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(one: Story) -> None:
        # thinner fingertips, and a stroke a little longer than by design
        one.cell.cell.gripper._config = RobotiqConfig(  # type: ignore[union-attr]
            scale=JawScale(wider_mm=0.4, stretch=1.008)
        )
        record = await one.run()
        assert (record.outcome, record.message) == (StepEnd.PASSED, "")
        assert one.cell.cell.world.collisions == []
        assert one.cell.cell.jaws.opening_mm > 84.0  # as the next start wants to find it
        file = one.order.folder.path / "calibrations" / "fixed_gripper.json"
        found = read_calibration(file, "fixed_gripper")
        assert isinstance(found, FixedGripperCalibration)
        T = np.array(found.T_world_tcp)
        off_mm = abs(float((T[:3, 3] - TRUE_MM) @ TRUE_NORMAL))
        off_deg = degrees(float(np.arccos(min(1.0, float(T[:3, 1] @ TRUE_NORMAL)))))
        assert off_mm < min(0.5, 2 * found.u_mm)
        assert off_deg < min(0.3, 2 * found.u_deg)
        assert set(found.observed) == {"y_mm", "rx_rad", "rz_rad"}
        # a count is 85 mm / 227; both gauges are read within half of one
        count_mm = 85.0 / 227.0
        assert abs(found.opening_scale - 1.008) < 1.1 * count_mm / 60.0
        for true_mm in (10.0, 40.0, 70.0):
            found_mm = found.opening_zero_mm + found.opening_scale * (true_mm - 0.4) / 1.008
            assert abs(found_mm - true_mm) < 0.55 * count_mm
        cell = load_cell(one.order.folder.path / "cell.yaml")
        assert cell.fixed_gripper.opening_scale == found.opening_scale
        np.testing.assert_allclose(cell.fixed_gripper.pose.build(), T, atol=1e-9)

    tell(tmp_path, monkeypatch, story)


@pytest.mark.parametrize(
    ("idle_at", "words"),
    [
        ("give_arm", "the arm gripper closed to 0.0 mm, the gauge is 10 mm thick: hold it"),
        ("give_fixture", "the fixed gripper closed to 0.0 mm, the gauge is 10 mm thick: hold it"),
    ],
)
def test_a_gauge_that_nobody_holds_there_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, idle_at: str, words: str
) -> None:
    async def story(one: Story) -> None:
        one.hands.idle_at = idle_at
        record = await one.run()
        assert record.outcome is StepEnd.FAILED
        assert words in record.message

    tell(tmp_path, monkeypatch, story)


@pytest.mark.slow
def test_a_plate_that_falls_out_half_way_is_missed_and_the_arm_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(one: Story) -> None:
        one.at["touch 1.1"] = lambda: one.cell.befall("lose_part", gripper="fixture")
        record = await one.run()
        assert record.outcome is StepEnd.FAILED
        assert "the plate is no longer in the fixed gripper" in record.message
        park = load_cell(one.drawn).arm.park_deg  # type: ignore[union-attr]
        q = one.cell.cell.arm.joints()
        assert abs(degrees(q.shoulder_rad) - park.shoulder) < 1.0
        assert abs(degrees(q.pitch_rad) - park.pitch) < 1.0

    tell(tmp_path, monkeypatch, story)


@pytest.mark.slow
def test_a_stop_between_touches_keeps_the_plate_and_names_it_at_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(one: Story) -> None:
        one.at["touch 1.1"] = lambda: one.session.request_stop("Ctrl-C", "stop")
        record = await one.run()
        assert record.outcome is StepEnd.BROKEN_OFF
        assert "Ctrl-C" in record.message
        assert one.cell.cell.world.fixed_gripper.hold is not None
        again = await one.run()
        assert again.outcome is StepEnd.FAILED
        assert "fixed gripper holds a part" in again.message
        assert "recover --cell CELL --open fixed" in again.message

    tell(tmp_path, monkeypatch, story)


@pytest.mark.slow
def test_a_gripper_that_is_lost_half_way_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(one: Story) -> None:
        one.at["touch 1.1"] = lambda: one.cell.befall("power", device="gripper")
        record = await one.run()
        assert record.outcome in (StepEnd.FAILED, StepEnd.BROKEN_OFF)
        assert "gripper" in record.message

    tell(tmp_path, monkeypatch, story)
