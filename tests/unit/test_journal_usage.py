"""What runs have made of calibrations, from the rows of their journals."""

from collections.abc import Mapping
from typing import Any

import pytest

from controller.cell.journal import Body, Row, rows
from controller.cell.journal.usage import usage_of, views_off_mm

ARM, CAMERA = "a" * 64, "b" * 64


def row(run: str, body: Body) -> Row:
    return Row(
        seq=1,
        t_utc="2026-03-12T00:00:00+00:00",
        t_mono_s=0.0,
        run=run,
        part=None,
        kind=body.kind,
        name=body.row_name,
        body=body.model_dump(mode="json", by_alias=True),
    )


def began(run: str, used: Mapping[str, str]) -> Row:
    cell: dict[str, Any] = {"calibration": {name: {"sha256": h} for name, h in used.items()}}
    return row(run, rows.RunBegan(cell=cell))


def posed(*views: tuple[int, float]) -> rows.ViewsPosed:
    return rows.ViewsPosed(
        views=tuple(
            rows.ViewOffFields(view=f"v{i}", grasp=grasp, off_mm=off, off_deg=0.0)
            for i, (grasp, off) in enumerate(views)
        )
    )


def test_the_figure_of_a_part_is_of_grasps_that_were_looked_at_three_times() -> None:
    looked_at_often = [(0, 0.3), (0, 0.4), (0, 0.0)]
    assert views_off_mm(posed(*looked_at_often, (1, 7.0), (1, 7.0))) == pytest.approx(
        (0.25 / 3) ** 0.5
    )
    assert views_off_mm(posed((0, 7.0), (0, 7.0))) is None


def test_runs_are_counted_and_parts_kept_by_the_file_that_they_used() -> None:
    part = posed((0, 0.2), (0, 0.2), (0, 0.2))
    found = [
        began("1", {"arm": ARM, "inspection": CAMERA}),
        row("1", part),
        row("1", posed((0, 0.4), (0, 0.4), (0, 0.4))),
        began("2", {"inspection": CAMERA}),
        row("2", part),
        row("3", part),  # a run whose beginning is not in the journal
    ]
    usage = usage_of(found)
    assert usage[ARM].run_count == 1
    assert usage[ARM].off_mm == pytest.approx((0.2, 0.4))
    assert usage[CAMERA].run_count == 2
    assert usage[CAMERA].off_mm == pytest.approx((0.2, 0.4, 0.2))
    assert set(usage) == {ARM, CAMERA}
