"""What `cellctl run --json` prints of a part."""

from __future__ import annotations

from controller.cell.batch import PartRecord
from controller.cell.machine import PartFault, Recovery
from controller.cli.running.run_output import part_json


def test_recoveries_are_named_by_the_fault() -> None:
    part = PartRecord(1, recoveries=[Recovery(PartFault.GRASP_MISSED, "closed on nothing")])
    assert part_json(part)["recoveries"] == ["grip_missed"]
