"""What `cellctl run --json` prints of a part."""

from __future__ import annotations

from controller.cell.batch import PartRecord, Progress
from controller.cell.machine import PartFault, Recovery
from controller.cli.running.run_output import part_json, progress_line


def test_recoveries_are_named_by_the_fault() -> None:
    part = PartRecord(1, recoveries=[Recovery(PartFault.GRASP_MISSED, "closed on nothing")])
    assert part_json(part)["recoveries"] == ["grip_missed"]


def test_a_state_without_a_label_is_a_line_of_its_own() -> None:
    shown = Progress(state="grasping", step=1, step_count=9, remaining_s=80.0)
    assert progress_line(shown) == "grasping 1/9 (80 s left)"
    shown.label = "pick it up"
    assert progress_line(shown) == "grasping 1/9: pick it up (80 s left)"
