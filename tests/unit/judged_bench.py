"""Judged parts for tests: an inspection made by hand, with a characteristic of every kind."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np

from controller.inspection import PartFinding, PartInspection, Verdict
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    EdgeLine,
    EdgePairGeometry,
    Geometry,
    Look,
    Measured,
    Rim,
    RimGeometry,
)
from controller.results.judged import Header, JudgedPart
from controller.results.judged.inspected import judged_part
from tests.unit import results_bench

START = datetime(2026, 3, 1, 12, 0, 0, tzinfo=UTC)
END = datetime(2026, 3, 1, 12, 1, 30, tzinfo=UTC)
CAD_SHA = "c" * 64
SIZE_PX = (640, 480)


def rim(x_mm: float, radius_mm: float = 4.0, *, is_hole: bool = True) -> RimGeometry:
    return RimGeometry(
        (
            Rim(
                np.array([x_mm, 0.0, 10.0]),
                np.array([0.0, 0.0, 1.0]),
                radius_mm,
                np.array([1.0, 0.0, 0.0]),
                2 * math.pi,
                1,
                0,
                is_hole,
            ),
        )
    )


def pair(x0_mm: float, x1_mm: float) -> EdgePairGeometry:
    def edge(x_mm: float) -> EdgeLine:
        return EdgeLine(np.array([x_mm, -5.0, 10.0]), np.array([x_mm, 5.0, 10.0]), (0, 2))

    return EdgePairGeometry((edge(x0_mm),), (edge(x1_mm),), np.array([1.0, 0.0, 0.0]), 2, 3)


def measured(
    balloon: int,
    kind: CharacteristicKind,
    nominal: float,
    half: float,
    value: float | None,
    verdict: Verdict,
    geometry: Geometry,
    *,
    U: float | None = 0.02,
    label: str = "",
    reason: str = "",
    is_critical: bool = False,
) -> Measured:
    is_form = nominal == 0
    asked = Characteristic(
        id=f"{kind.value} {balloon}",
        balloon=balloon,
        kind=kind,
        label=label or f"{kind.value} of feature {balloon}",
        nominal_mm=nominal,
        lower_mm=0.0 if is_form else nominal - half,
        upper_mm=nominal + half,
        source="ISO 2768-m",
        geometry=geometry,
        faces=(1,),
        is_critical=is_critical,
    )
    looks = ()
    if value is not None:
        turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        shape = np.column_stack([320 + 60 * np.cos(turn), 240 + 60 * np.sin(turn)])
        accepted = np.ones(24, dtype=int)
        accepted[5] = 0
        points = shape.copy()
        points[5] += 9.0
        looks = (
            Look("G1-V0", "backlit", value + 0.001, 0.006, "", {"edge": 0.002, "scale": 0.005},
                 points, accepted, shape),
            Look("G1-V1", "station_ring", value - 0.002, 0.007, "", {"edge": 0.003}),
        )  # fmt: skip
    return Measured(
        asked,
        value,
        None if value is None else U,
        verdict,
        ("G1-V0", "G1-V1") if value is not None else (),
        reason,
        looks,
    )


def all_kinds() -> tuple[Measured, ...]:
    kind, ok = CharacteristicKind, Verdict.PASS
    return (
        measured(1, kind.DIAMETER, 8.0, 0.2, 8.031, ok, rim(0.0), label="bore", is_critical=True),
        measured(2, kind.POSITION, 0.0, 0.15, 0.041, ok, rim(0.0)),
        measured(3, kind.DISTANCE, 40.0, 0.3, 40.29, Verdict.INDETERMINATE, pair(-20, 20),
                 reason="0.010 mm from the upper limit, U is 0.020 mm"),
        measured(4, kind.LENGTH, 60.0, 0.3, 60.71, Verdict.FAIL, pair(-30, 30),
                 reason="0.410 mm beyond the upper limit"),
        measured(5, kind.WIDTH, 6.0, 0.1, 5.98, ok, pair(-3, 3)),
        measured(6, kind.RADIUS, 2.5, 0.2, 2.44, ok, rim(12.0, 2.5, is_hole=False)),
        measured(7, kind.ANGLE, math.radians(90), math.radians(0.5), math.radians(90.1), ok,
                 pair(-1, 1), U=math.radians(0.03)),
        measured(8, kind.STRAIGHTNESS, 0.0, 0.1, 0.02, ok, pair(-8, 8)),
        measured(9, kind.ROUNDNESS, 0.0, 0.1, None, Verdict.NOT_EVALUATED, rim(0.0),
                 reason="no view shows the rim at less than 30 deg"),
    )  # fmt: skip


def header(**changes: object) -> Header:
    made = Header(
        part="bracket",
        serial="SN-0042",
        lot="L7",
        operator="R. Meyer",
        recipe="bracket.yaml",
        recipe_sha256="a" * 64,
        cad="bracket.step",
        cad_sha256=CAD_SHA,
        cell="emulated",
        cell_sha256="b" * 64,
        calibrated={"inspection": "2026-02-20"},
        software={"cellctl": "0.1.0"},
        start=START,
        end=END,
        run_id="20260301-120000-000-bracket",
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def inspection(
    measured: tuple[Measured, ...] | None = None,
    findings: tuple[PartFinding, ...] = (),
    verdict: Verdict = Verdict.PASS,
    reasons: tuple[str, ...] = ("all characteristics fit, no difference found",),
) -> PartInspection:
    return PartInspection(
        verdict,
        reasons,
        (results_bench.view("G1-V0"), results_bench.view("G1-V1")),
        all_kinds() if measured is None else measured,
        findings,
        results_bench.verdict(verdict, reasons),
    )


def chip() -> PartFinding:
    square = np.array([[400.0, 200.0], [430.0, 200.0], [430.0, 225.0], [400.0, 225.0]])
    return PartFinding(
        "chip", "G1-V1", "station_ring", np.array([1.0, 2.0, 3.0]), 3.25, (1,), Verdict.FAIL,
        (400, 200, 430, 225), square,
    )  # fmt: skip


def judged(folder: Path, made: PartInspection | None = None, **changes: object) -> JudgedPart:
    """Return a judged part with pictures in a folder."""
    names: dict[str, dict[str, str]] = {}
    for view in ("G1-V0", "G1-V1"):
        for lamp, level in (("station_backlight", 200), ("station_ring", 60)):
            picture = np.full(SIZE_PX[::-1], level, np.uint8)
            cv2.circle(picture, (320, 240), 60, 20 if level > 100 else 150, -1)
            name = f"{view}_{lamp}.png"
            assert cv2.imwrite(str(folder / name), picture)
            names.setdefault(view, {})[lamp] = name
    return judged_part(made or inspection(), header(**changes), folder, names)
