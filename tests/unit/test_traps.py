"""Traps: a fault changes its pictures alone, and what is for its sake is counted as that."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import bench_traps
from trap_pictures import FAULTS, LAMPS


def row(kind: str, verdict: str) -> dict[str, object]:
    return {"specimen": "dev/s0001", "kind": kind, "verdict": verdict}


def test_a_fail_is_for_the_faults_sake_where_the_untouched_set_has_none() -> None:
    faults = [row("hair", "fail"), row("hair", "pass")]
    counts, sums = bench_traps.report([row(bench_traps.UNTOUCHED, "pass"), *faults])
    assert [one["for its sake"] for one in counts] == [0, 1]
    assert (sums["n"], sums["pass"], sums["fail"], sums["for its sake"]) == (2, 1, 1, 1)
    _, sums = bench_traps.report([row(bench_traps.UNTOUCHED, "fail"), *faults])
    assert (sums["fail"], sums["for its sake"]) == (1, 0)


@pytest.mark.parametrize("kind", FAULTS)
def test_every_fault_changes_pictures_and_leaves_what_it_was_given(kind: str) -> None:
    rng = np.random.default_rng(3)
    panel = np.full((240, 320), 220, np.uint8)
    panel[60:180, 80:240] = 10
    lit = [rng.integers(20, 180, panel.shape, np.uint8) for _ in range(9)]
    names = {LAMPS[0]: 0, LAMPS[1]: 1, LAMPS[2]: 2}
    before = [
        {lamp: panel - np.uint8(v) if i == 0 else lit[3 * v + i] for lamp, i in names.items()}
        for v in range(3)
    ]
    kept = [{lamp: p.copy() for lamp, p in view.items()} for view in before]
    other = [{lamp: np.full_like(panel, 90) for lamp in LAMPS} for _ in range(2)]
    after = [dict(view) for view in before]
    json.dumps(FAULTS[kind](after, np.random.default_rng(1), other), default=float)
    assert all((a[k] == b[k]).all() for a, b in zip(before, kept, strict=True) for k in LAMPS)
    changed = [
        (i, lamp) for i, view in enumerate(before) for lamp in LAMPS
        if lamp not in after[i] or (after[i][lamp] != view[lamp]).any()
    ]  # fmt: skip
    assert changed
    if kind.endswith("_one"):
        assert len({i for i, _ in changed}) == 1
    for view in after:
        for picture in view.values():
            assert picture.dtype == np.uint8
            assert picture.shape == panel.shape
