"""The TCP from pictures of the fingers, drawn as polygons from a truth of their own."""

from __future__ import annotations

import cv2
import kinematic_cells as cells
import numpy as np
import pytest

from controller.calibration.grippers import (
    FingersError,
    FingerShape,
    TcpFit,
    locate_tcp,
    look_at_fingers,
)
from controller.calibration.kinematics import CellFit, calibrate_cell, tcp_poses, tcp_uncertainty
from drivers.umi_scara.model import kinematics

SHAPE = FingerShape(78.0, 12.0, 8.0)
OPENING_MM = 30.0
FINE = 8  # sub-pixels of the drawing


def before_the_panel(count: int, seed: int) -> list[np.ndarray]:
    """Joints that show the fingers at the station, the approach across the line of sight."""
    rng = np.random.default_rng(seed)
    out: list[np.ndarray] = []
    while len(out) < count:
        # approach along -x or down a little, at any roll
        pitch, heading = rng.uniform(-1.0, 0.0), rng.choice([0.0, 0.4, -0.4])
        x = np.array(
            [np.cos(heading) * np.cos(pitch), np.sin(heading) * np.cos(pitch), np.sin(pitch)]
        )
        y = np.cross(rng.standard_normal(3), x)
        y /= np.linalg.norm(y)
        if abs(y[1]) > 0.7:  # the fingers would hide each other
            continue
        tip = [rng.uniform(425, 470), rng.uniform(-40, 40), rng.uniform(430, 470)]
        rows, legal = kinematics.inverse(cells.pose(np.column_stack([x, y, np.cross(x, y)]), tip))
        rows = rows[legal]
        if len(rows):
            out.append(kinematics.counts_to_q(kinematics.q_to_counts(rows[0])))
    return out


def drawn(cell: cells.TrueCell, q: np.ndarray, opening_mm: float) -> np.ndarray:
    """The fingers dark before a bright panel, in the true camera."""
    camera = cell.cameras["inspection"]
    T = cell.T_world_tcp(q + cell.joint_std * cell.rng.standard_normal(6))
    width, height = camera.size_px
    hulls = []
    for side in (-1, 1):
        x, y, z = np.meshgrid(
            [-SHAPE.length_mm, 0],
            side * (opening_mm / 2 + np.array([0, SHAPE.thickness_mm])),
            [-SHAPE.width_mm / 2, SHAPE.width_mm / 2],
        )
        box = np.column_stack([x.ravel(), y.ravel(), z.ravel()]).astype(float)
        pixels = camera.project(box @ T[:3, :3].T + T[:3, 3])
        hulls.append(cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2).astype(float))
    everything = np.vstack(hulls)
    low = np.maximum(0, np.floor(everything.min(axis=0)).astype(int) - 2)
    high = np.minimum([width, height], np.ceil(everything.max(axis=0)).astype(int) + 3)
    w, h = high - low
    fine = np.zeros((h * FINE, w * FINE), np.uint8)
    for hull in hulls:
        at = (hull + 0.5 - low) * FINE - 0.5
        cv2.fillConvexPoly(fine, np.rint(at * 256).astype(np.int32), 1, shift=8)
    grey = np.full((height, width), 215.0)
    share = fine.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
    grey[low[1] : high[1], low[0] : high[0]] -= 190.0 * share
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8) + cell.rng.normal(0, 1.0, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def calibrated(seed: int) -> tuple[cells.TrueCell, CellFit]:
    cell = cells.true_cell(seed)
    return cell, calibrate_cell(cells.prior(), cells.pictures(cell, 14, seed))


def found_by_fingers(
    cell: cells.TrueCell, fit: CellFit, jaw_zero_mm: float, count: int = 10
) -> TcpFit:
    looks = [
        look_at_fingers(
            drawn(cell, q, OPENING_MM + jaw_zero_mm), fit, "inspection", q, OPENING_MM, SHAPE
        )
        for q in before_the_panel(count, 5)
    ]
    return locate_tcp(fit, "inspection", looks)


def test_tool_roll_and_opening_are_found_within_their_stated_uncertainty() -> None:
    cell, fit = calibrated(71)
    found = found_by_fingers(cell, fit, 0.4)
    assert found.jaw_zero_mm == pytest.approx(0.4, abs=2.5 * found.u_mm)
    assert found.u_mm < 0.05
    true = {"tool_mm": cell.arm.tool_mm, "tool_off_z_mm": cell.arm.tool_off_mm[1]}
    for name, value in true.items():
        i = fit.layout.index(f"arm.{name}")
        assert found.fit.arm[name] == pytest.approx(value, abs=3 * found.fit.std[i]), name
        assert found.fit.std[i] < 0.35 * fit.std[i], name
    q = np.array(before_the_panel(3, 9))
    stated = zip(q, tcp_poses(found.fit, q), tcp_uncertainty(found.fit, q), strict=True)
    for one, T, u in stated:
        assert np.linalg.norm(T[:3, 3] - cell.T_world_tcp(one)[:3, 3]) < 2.5 * u.u_mm
        assert u.u_mm < 0.4
    assert found.faults() == ()


def test_missing_pads_are_named() -> None:
    cell, fit = calibrated(72)
    found = found_by_fingers(cell, fit, 3.0, count=5)
    assert [f.kind for f in found.faults()] == ["pads_missing"]
    assert found.jaw_zero_mm == pytest.approx(3.0, abs=0.2)


def test_too_few_looks_and_an_empty_picture_are_refused() -> None:
    _, fit = calibrated(73)
    q = before_the_panel(4, 5)
    empty = np.full((1024, 1280), 215, np.uint8)
    nothing = [look_at_fingers(empty, fit, "inspection", one, OPENING_MM, SHAPE) for one in q]
    with pytest.raises(FingersError, match="points of the fingers' edges"):
        locate_tcp(fit, "inspection", nothing)
    with pytest.raises(FingersError, match="3 looks"):
        locate_tcp(fit, "inspection", nothing[:3])
