"""A dry run in the simulated cell: it drives, holds nothing, judges nothing, and can be stopped."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest
from stories import play

from controller.bring_up.dry import DryOrder, DryPlan, DrySession, LiftedStep
from controller.bring_up.procedure import StepEnd, StepRecord
from controller.cell.devices.clocks import FoundClock
from controller.cell.journal import JOURNAL_NAME, read_rows
from controller.cell.operator import NOBODY
from controller.config import load_cell
from controller.results.report import report_json
from controller.results.run import load_run
from controller.results.writing import write_html
from controller.setup.layout import build_layout
from emulators.umi_scara import Axis
from simulation.cell import BEAT_S, SimulatedCell
from simulation.loop import SimulatedLoop, SimulatedProcess

RUN = "20300101-000000-000-holder-dry"


class Story:
    """A simulated cell and dry runs in it."""

    def __init__(self, loop: SimulatedLoop, cell: SimulatedCell, out: Path) -> None:
        self.loop, self.cell, self.out = loop, cell, out
        out.mkdir()
        self.is_driving = asyncio.Event()

    def session(self, *degrees: float) -> DrySession:
        """Return a dry run whose steps turn the shoulder, each from the park and back to it."""
        cell = load_cell(self.cell.cell_path)
        park = np.asarray(build_layout(cell).park_q, dtype=float)
        steps = tuple(
            LiftedStep(
                f"turn by {deg:g}",
                (park - np.radians(deg) * np.eye(6)[0], park),
                (100.0, 150.0),
                ("turn: no lift of x 1 y 2 z 3 mm is free and within reach",) if deg < 10 else (),
            )
            for deg in degrees
        )
        return DrySession(
            DryOrder(
                recipe=self.cell.recipe,
                cell=cell,
                files={},
                plans=(DryPlan(2, steps),),
                emulated={},
                clock=FoundClock(monotonic=self.loop.time, beat_wall_s=BEAT_S),
                runs_dir=self.out,
                run_id=RUN,
                by="a tester",
                is_stepwise=False,
            ),
            NOBODY,
            self.show,
            self.cell.controller()._devices,
        )

    def show(self, line: str) -> None:
        if "stable pose" in line:
            self.is_driving.set()

    async def run(self, session: DrySession) -> StepRecord:
        record: StepRecord = await self.loop.spawn(SimulatedProcess("dry"), session.run())
        return record

    def counts(self) -> dict[Axis, float]:
        return {axis: motor.position for axis, motor in self.cell.cell.arm.axes.items()}


def test_a_dry_run_drives_its_steps_opens_both_grippers_and_has_no_verdict(tmp_path: Path) -> None:
    async def story(one: Story) -> None:
        record = await one.run(one.session(12.0, 5.0))
        assert (record.outcome, record.message) == (StepEnd.PASSED, "")
        cell = load_cell(one.cell.cell_path)
        # open jaws, as the world has them, to a count of each gripper
        assert one.counts()[Axis.GRIPPER] > 0
        rows = [(row.kind, row.name, row.body) for row in read_rows(one.out / JOURNAL_NAME)]
        names = [name for _, name, _ in rows]
        assert rows[0][1] == "run_began"
        assert rows[0][2]["is_dry"] is True
        driven = [body for _, name, body in rows if name == "dry_step"]
        assert [body["label"] for body in driven] == ["turn by 12", "turn by 5"]
        # at the full speed of the shoulder a turn of 12 degrees and back takes half a second:
        # a tenth of it makes more than five
        assert driven[0]["seconds"] > 5.0
        assert not {"grasp", "release", "view_judged", "verdict", "sightings"} & set(names)
        assert not any(kind == "custody" for kind, _, _ in rows)
        found = load_run(one.out, RUN)
        body = report_json(found)
        assert body["verdict"] == "no verdict"
        assert body["parts"] == []
        assert body["why"].startswith("A dry run: 4 motions without a part")
        assert [step["left_out"] for step in body["dry"]] == [[], list(driven[1]["left_out"])]
        page = write_html(found, tmp_path / "report.html").read_text()
        assert "Dry run" in page
        assert "Inspection report" not in page
        assert "both grippers are empty" not in page
        assert cell.name in page

    play(tmp_path, Story, story)


@pytest.mark.parametrize("what", ["stop", pytest.param("door", marks=pytest.mark.slow)])
def test_a_dry_run_that_is_stopped_halts_above_tray_and_says_so(tmp_path: Path, what: str) -> None:
    async def story(one: Story) -> None:
        session = one.session(60.0)

        def befall() -> None:
            if what == "stop":
                session.request_stop("stopped by the operator (Ctrl-C)", "stop")
            else:
                one.cell.befall("door", closed=False)

        async def soon() -> None:
            await one.is_driving.wait()
            await asyncio.sleep(4.0)  # of virtual time: on the way to 60 degrees at a tenth
            befall()

        waiting = asyncio.create_task(soon())
        record = await one.run(session)
        await waiting
        assert record.outcome is StepEnd.BROKEN_OFF
        assert {"stop": "Ctrl-C", "door": "door"}[what] in record.message
        before = one.counts()
        one.cell.catch_up()
        assert one.counts() == before
        found = load_run(one.out, RUN)
        assert found.dry == ()
        assert found.outcome.end == "broke_off"
        assert report_json(found)["verdict"] == "no verdict"

    play(tmp_path, Story, story)
