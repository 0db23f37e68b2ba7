"""Writes journals as a run writes them: the real `Journal`, the real describe functions."""

from __future__ import annotations

import asyncio
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from controller import inspection as inspecting
from controller.cell.batch import Papers, RunOrder, who_and_what
from controller.cell.batch.run import JOURNAL_NAME
from controller.cell.custody import Custody
from controller.cell.devices import resolve
from controller.cell.devices.clocks import FoundClock, Speed
from controller.cell.journal import Body, Journal, rows
from controller.cell.services.records import sightings_row, verdict_row, view_row
from controller.config import load_cell, load_recipe
from controller.config.cell.connect import ConnectSection
from controller.recognition import Sighting

ROOT = Path(__file__).resolve().parents[2]
RECIPE = ROOT / "recipes" / "featuretype.yaml"
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
OFFERED = {
    "arm": "/dev/pts/7",
    "gripper": {"host": "127.0.0.1", "port": 1502, "unit": 9},
    "lights": {"host": "127.0.0.1", "port": 1502},
    "io": {"host": "127.0.0.1", "port": 1503},
    "overhead": "/dev/video7",
    "inspection": "/dev/video8",
}
SIZE_PX = (1280, 1024)
PART_PX = (500, 380, 800, 640)  # x0, y0, x1, y1 of the part in every picture of a view
STEPS = ("pick with grasp G1", "show with grasp G1", "show with grasp G1, square to F0 plane")
FORECASTS_S = (9.0, 4.0, 4.0)


def rectangle_border(box: tuple[int, int, int, int]) -> np.ndarray:
    """Return all border pixels of a box in order round it, (n, 2)."""
    x0, y0, x1, y1 = box
    top = [(x, y0) for x in range(x0, x1)]
    right = [(x1, y) for y in range(y0, y1)]
    bottom = [(x, y1) for x in range(x1, x0, -1)]
    left = [(x0, y) for y in range(y1, y0, -1)]
    return np.array(top + right + bottom + left, dtype=float)


def finding(
    kind: inspecting.FindingKind = inspecting.FindingKind.MISSING,
    lamp: str = "backlit",
    box: tuple[int, int, int, int] = (700, 400, 740, 430),
    faces: tuple[int, ...] = (1,),
    size_mm: float = 9.4,
) -> inspecting.Finding:
    return inspecting.Finding(
        kind=kind,
        lamp=lamp,
        area_mm2=41.25,
        size_mm=size_mm,
        at_px=((box[0] + box[2]) / 2, (box[1] + box[3]) / 2),
        box_px=box,
        p_part_mm=np.array([12.5, -3.25, 30.0]),
        face_ids=faces,
    )


def view(
    view_id: str, *findings: inspecting.Finding, reason: str = "", seen: int = 40
) -> inspecting.ViewResult:
    return inspecting.ViewResult(
        view_id=view_id,
        evaluated=not reason,
        reason=reason,
        T_world_part_expected=np.eye(4),
        T_world_part_measured=np.eye(4),
        shift_mm=0.0 if reason else 0.73,
        turn_rad=0.0 if reason else float(np.radians(0.41)),
        residual_px=float("inf") if reason else 0.187,
        findings=tuple(findings),
        compared=np.arange(60) < seen,
        outline_px=np.zeros((0, 2)) if reason else rectangle_border(PART_PX),
    )


def face(
    face_id: int,
    label: str,
    area_mm2: float = 1000.0,
    seen: float = 1.0,
    verdict: inspecting.Verdict = inspecting.Verdict.PASS,
    reason: str = "",
) -> inspecting.FaceVerdict:
    return inspecting.FaceVerdict(face_id, label, area_mm2, seen, verdict, ("G1-V0",), reason)


def verdict(
    word: inspecting.Verdict = inspecting.Verdict.PASS,
    reasons: Sequence[str] = ("97.0 % of the surface compared in 2 views: no difference found",),
    faces: Sequence[inspecting.FaceVerdict] | None = None,
) -> inspecting.PartVerdict:
    if faces is None:
        # thirds: each share is 33.33 %, which as shown would add up to 99.99 %
        faces = (
            face(0, "F0 plane"),
            face(1, "F1 bore 8.0 mm", seen=0.91, reason="hidden by the jaws in every view"),
            face(2, "F2 plane"),
        )
    return inspecting.PartVerdict(word, tuple(reasons), tuple(faces), 0.97, ())


def sighting(part: str | None = "featuretype", x_mm: float = 360.0) -> Sighting:
    return Sighting(
        part=part,
        pose_index=2 if part else -1,
        R=np.eye(3) if part else None,
        x_mm=x_mm,
        y_mm=0.0,
        theta_rad=float(np.radians(30.0)),
        T_world_part=np.eye(4) if part else None,
        score=0.987,
        # variances of 0.03 and 0.04 mm, and of 0.1 deg
        covariance=np.diag([0.03**2, 0.04**2, np.radians(0.1) ** 2]) if part else None,
        residual_px=0.21 if part else float("inf"),
        ambiguous_with=(),
        area_mm2=8000.0,
        box_px=(560, 430, 720, 590),
        reason="" if part else "fits no part of the recipe",
    )


class RunWriter:
    """Writes one run step by step, in the order and with the bodies a run has."""

    def __init__(
        self,
        runs_dir: Path,
        run_id: str = "20260301-120000-000-featuretype",
        *,
        name: str = "featuretype",
        count: int = 1,
        real: bool = False,
        speed: float = 10.0,
        unit: str | None = "mm",
        papers: Papers = Papers(),  # noqa: B008 - frozen
        cell_name: str = "",
        connect: ConnectSection | None = None,
    ) -> None:
        self.runs_dir, self.run_id = runs_dir, run_id
        self.folder = runs_dir / run_id
        (self.folder / "pictures").mkdir(parents=True)
        self.journal = Journal(runs_dir / JOURNAL_NAME, run_id)
        # a test may leave its run open, as a killed process does, but not the file
        weakref.finalize(self, self.journal.close).atexit = False
        self.number = 0
        cell = load_cell(CELL)
        cell = cell.model_copy(update={"name": cell_name or cell.name, "connect": connect})
        recipe = load_recipe(RECIPE).model_copy(update={"name": name, "unit": unit})
        order = RunOrder(
            recipe_path=RECIPE,
            cell_path=CELL,
            recipe=recipe,
            cell=cell,
            count=count,
            speed=speed,
            emulated={"devices": OFFERED},
            clock=FoundClock(),
            runs_dir=runs_dir,
            run_id=run_id,
            papers=papers,
        )
        began = who_and_what(order, resolve(cell, OFFERED))
        if real:
            devices = {name: {**one, "emulated": False} for name, one in began.devices.items()}
            began = began.model_copy(update={"emulated_devices": (), "devices": devices})
        self.write(began)
        self.write(rows.Connected({"arm": "UMI RTX, IP0 ROM 1.5", "io": "Moxa E1214"}))
        self.moved("reset", "stopped", "resetting")
        self.write(rows.Homed())
        self.moved("start", "idle", "execute_acquiring")

    def write(self, row: Body) -> None:
        self.journal.write(row, self.number or None)

    def moved(self, event: str, source: str, target: str, **more: str) -> None:
        self.journal.write(
            rows.CellEvent(name=event, answer="handled", source=source, target=target, **more)
        )

    def custody(self, custody: Custody, detail: str = "") -> None:
        row = rows.CustodyChanged(name=custody.key, detail=detail)
        asyncio.run(self.journal.write_secured(row, self.number))

    def picture(self, name: str, level: int = 200) -> str:
        image = np.full((SIZE_PX[1], SIZE_PX[0]), level, np.uint8)
        x0, y0, x1, y1 = PART_PX
        image[y0:y1, x0:x1] = 20 if level > 100 else 150
        path = f"pictures/part{self.number:03d}_{name}.png"
        assert cv2.imwrite(str(self.folder / path), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        return path

    def look(self, *sightings: Sighting, is_new: bool = True) -> None:
        self.number += is_new
        lamps = (("table_backlight", 210), ("table_ring", 40))
        names = {lamp: self.picture(lamp, level) for lamp, level in lamps}
        self.write(rows.TablePictures(names))
        self.moved("picture_taken", "execute_acquiring", "execute_recognising")
        self.write(sightings_row(sightings))

    def plan(self, *labels: str) -> None:
        labels = labels or STEPS
        unseen = rows.UnseenFields(face=1, area_fraction=0.03, reason="in the jaws' shadow")
        self.write(
            rows.PlanMade(
                steps=(*labels, "place in tray reject", "park"),
                seconds=(*FORECASTS_S[: len(labels)], 12.0, 3.0),
                forecast_s=32.0,
                covered_fraction=0.97,
                reachable_fraction=0.99,
                unseen=(unseen,),
            )
        )

    def step(self, label: str, forecast_s: float, seconds: float, **more: Any) -> None:
        self.write(rows.StepDone(label=label, forecast_s=forecast_s, seconds=seconds, **more))

    def once(self, name: str, *, is_done: bool = True) -> None:
        intent = rows.Intent(name=name, expected_mm=30.0)
        asyncio.run(self.journal.write_secured(intent, self.number))
        if is_done:
            self.write(rows.OnceDone(name=name))

    def grasp(self, seconds: float = 9.5) -> None:
        self.once("grip")
        self.custody(Custody.IN_ARM, "jaws at 30.1 mm")
        self.step(STEPS[0], 9.0, seconds, jaw_mm=30.1, expected_mm=30.0)

    def show(self, label: str, result: inspecting.ViewResult, seconds: float) -> None:
        lamps = (("station_backlight", 210), ("station_ring", 40), ("station_side", 40))
        names = {lamp: self.picture(f"{result.view_id}_{lamp}", level) for lamp, level in lamps}
        self.write(rows.ViewPicturesTaken(view=result.view_id, pictures=names, q=(0.0,) * 6))
        self.step(label, 4.0, seconds, view=result.view_id)

    def judge_view(self, result: inspecting.ViewResult) -> None:
        self.write(view_row(result))

    def judge(self, verdict: inspecting.PartVerdict) -> None:
        self.write(verdict_row(verdict))

    def place(self, tray: str) -> None:
        self.once("sort")
        self.custody(Custody.PLACED, tray)
        self.step(f"place in tray {tray}", 11.0, 12.25, tray=tray)
        self.write(rows.PartDone(tray=tray))

    def end(
        self, state: str = "complete", message: str = "", code: str = "", custody: str = "PLACED"
    ) -> None:
        self.journal.write(rows.AtRest(state=state, message=message, code=code, custody=custody))
        speed = rows.SpeedReached(**Speed(10.0, 6.34).as_json())
        self.journal.write(
            rows.RunEnded(end=state, message=message, parts=self.number, speed=speed)
        )
        self.close()

    def close(self) -> None:
        self.journal.close()

    def whole_part(
        self,
        views: Sequence[inspecting.ViewResult],
        verdict: inspecting.PartVerdict,
        tray: str,
    ) -> None:
        """Take a part all the way; the second view takes 2.5 s longer than forecast."""
        self.look(sighting())
        self.plan()
        self.grasp()
        for label, result, seconds in zip(STEPS[1:], views, (4.2, 6.5), strict=True):
            self.show(label, result, seconds)
            self.judge_view(result)
        self.judge(verdict)
        self.place(tray)


def good_run(runs_dir: Path, run_id: str = "20260301-120000-000-featuretype", **kw: Any) -> Path:
    """Write a run with one part that passes; return its folder."""
    writer = RunWriter(runs_dir, run_id, **kw)
    writer.whole_part((view("G1-V0"), view("G1-V3")), verdict(), "accept")
    writer.end()
    return writer.folder


def bad_run(runs_dir: Path, run_id: str = "20260302-120000-000-featuretype", **kw: Any) -> Path:
    """Write a run with one part that fails: two findings in one view, one view not evaluated."""
    writer = RunWriter(runs_dir, run_id, **kw)
    first = view(
        "G1-V0",
        finding(),
        finding(inspecting.FindingKind.SURFACE, "station_ring", (600, 500, 640, 560), (2, 1)),
    )
    faces = (
        face(0, "F0 plane", 5000.0),
        face(1, "F1 bore 8.0 mm", 250.0, 0.9, inspecting.Verdict.FAIL, "differs from the CAD"),
        face(2, "F2 plane", 750.0, 0.2, inspecting.Verdict.NOT_EVALUATED, "faces the jaws"),
    )
    why = "missing material at F1 bore 8.0 mm: 9.4 mm across, 41 mm2, view G1-V0, backlit"
    writer.whole_part(
        (first, view("G1-V3", reason="outline off by 3.10 px, 1.20 px is allowed")),
        verdict(inspecting.Verdict.FAIL, (why,), faces),
        "reject",
    )
    writer.end()
    return writer.folder
