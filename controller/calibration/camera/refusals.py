"""Refuse views that do not determine a camera; each case has its own advice."""

from collections.abc import Sequence

import cv2
import numpy as np

from controller.arrays import FloatArray

from ._types import (
    CalibratedCamera,
    CalibrationError,
    CalibrationLimits,
    PlacedBoard,
    View,
    ViewResidual,
    WorldFrame,
)

_TILT_MORE = "add pictures of the board tilted by 15 to 30 deg, each in another direction"


def hull_of(views: Sequence[View]) -> FloatArray:
    """Return the convex hull (n, 2) of all corners [px]."""
    corners = np.vstack([view.board.pixels for view in views]).astype(np.float32)
    return np.asarray(cv2.convexHull(corners), dtype=np.float64).reshape(-1, 2)


def area_px(hull_px: FloatArray) -> float:
    """Return the area of a hull (n, 2)."""
    return float(cv2.contourArea(hull_px.astype(np.float32)))


def check_views(
    views: Sequence[View], size_px: tuple[int, int], world: WorldFrame, limits: CalibrationLimits
) -> None:
    """Check before any fit that the boards are enough, flat and tilted, all over the picture.

    Parameters
    ----------
    views : boards found, one for each picture
    size_px : (width, height) size of the pictures
    world : names the view that fixes the world's frame
    limits : limits on the content of the views

    Raises
    ------
    ValueError : the world is fixed by no flat view, or two views have one name
    CalibrationError : too few boards, none tilted, or all in one part of the picture
    """
    if len({view.name for view in views}) < len(views):
        raise ValueError("two views have the same name")
    flat = [view.name for view in views if view.placed is PlacedBoard.FLAT]
    if world.name not in flat:
        raise ValueError(f"the world is fixed by {world.name}, which is not a flat view")
    for view in views:
        if len(view.board.pixels) < limits.corners_min:
            raise CalibrationError(
                f"{view.name} shows {len(view.board.pixels)} corners of the board, "
                f"{limits.corners_min} are needed; take the picture again or leave it out"
            )
    if len(views) < limits.boards_min:
        raise CalibrationError(
            f"boards found in {len(views)} pictures, {limits.boards_min} are needed and ten are "
            "better; take more"
        )
    tilted_count = len(views) - len(flat)
    if tilted_count < limits.tilted_min:
        raise CalibrationError(
            f"{tilted_count} of the boards found are tilted, at least {limits.tilted_min} are "
            "required: on flat boards alone, a long lens and a high camera look the same; "
            f"{_TILT_MORE}"
        )
    coverage = area_px(hull_of(views)) / (size_px[0] * size_px[1])
    if coverage < limits.coverage_min:
        u, v = np.vstack([view.board.pixels for view in views]).mean(axis=0) / size_px
        raise CalibrationError(
            f"the boards cover {100 * coverage:.0f} % of the picture, {_where(u, v)}; "
            f"{100 * limits.coverage_min:.0f} % are needed, since the lens is a guess elsewhere; "
            "put boards into the empty areas"
        )


def check_placed(
    views: Sequence[View], T_cam_boards: Sequence[FloatArray], limits: CalibrationLimits
) -> None:
    """Check that flat boards lie flat, and that tilted ones do not.

    Parameters
    ----------
    views : boards found, with how each was placed
    T_cam_boards : (4, 4) pose of each view, fitted one by one
    limits : limits on how far a board may be from flat

    Raises
    ------
    CalibrationError : a flat board is tilted, or too few of the tilted ones are
    """
    normals = np.array([T[:3, 2] for T in T_cam_boards])
    is_flat = np.array([view.placed is PlacedBoard.FLAT for view in views])
    up = np.median(normals[is_flat], axis=0)
    tilt = np.arccos(np.clip(normals @ (up / np.linalg.norm(up)), -1, 1))
    for view, flat, angle in zip(views, is_flat, tilt, strict=True):
        if flat and angle > limits.flat_max_rad:
            others = "the other flat boards" if is_flat.sum() > 2 else "another flat board"
            raise CalibrationError(
                f"{view.name} is listed as flat, but is tilted {np.degrees(angle):.1f} deg off "
                f"{others}; correct `placed` in the target file, or take the picture again "
                "(squares that are not square look the same)"
            )
    steep = int((tilt[~is_flat] > limits.tilt_min_rad).sum())
    if steep < limits.tilted_min:
        most = np.degrees(tilt[~is_flat].max())
        raise CalibrationError(
            f"the boards listed as tilted stand at most {most:.1f} deg off the table; {steep} of "
            f"them stand more than {np.degrees(limits.tilt_min_rad):.0f} deg off, "
            f"{limits.tilted_min} are required: with less tilt, a long lens and a high camera look "
            f"the same; {_TILT_MORE}"
        )


def check_fit(
    views: Sequence[View], residuals: Sequence[ViewResidual], limits: CalibrationLimits
) -> None:
    """Check that the pictures agree with the camera.

    Parameters
    ----------
    views : boards found; gives the size of a square in pixels
    residuals : residuals of each view, outliers left out
    limits : limits of plausible results

    Raises
    ------
    CalibrationError : residuals too large, in all or in one picture, or too many outliers
    """
    outliers = sum(r.outlier_count for r in residuals)
    corners = sum(r.corner_count for r in residuals)
    usual = float(np.median([r.rms_px for r in residuals]))
    worst = max(residuals, key=lambda r: r.rms_px)
    square_px = float(np.median([view.board.square_px for view in views]))
    limit_px = min(limits.rms_max_px, limits.rms_max_squares * square_px)
    if worst.rms_px > limits.picture_rms_ratio_max * usual and worst.rms_px > limit_px / 4:
        raise CalibrationError(
            f"{worst.name} disagrees with the other pictures: its corners are "
            f"{worst.rms_px:.2f} px off, those of the others {usual:.2f} px. Did the board or "
            "the camera move, was the board bent or not flat, or is `placed` wrong? Take the "
            "picture again or leave it out"
        )
    if usual > limit_px:
        raise CalibrationError(
            f"the corners are {usual:.2f} px off what any camera would show; at most "
            f"{limit_px:.2f} px are plausible. Check that the pictures are sharp, the board plane "
            "and its squares square, that `inner_corners` or `squares` is right, and that nobody "
            "touched focus or zoom"
        )
    if outliers > limits.outliers_max * corners:
        raise CalibrationError(
            f"{outliers} of {corners} corners do not agree with the others; clean the board and "
            "light it evenly, without reflections"
        )


def check_uncertainty(calibration: CalibratedCamera, limits: CalibrationLimits) -> None:
    """Check that the pictures determine the camera.

    Raises
    ------
    CalibrationError : focal length or positions on the table too uncertain, or nearly undetermined
    """
    fx, fy = calibration.camera.K[0, 0], calibration.camera.K[1, 1]
    relative = max(calibration.std["fx"] / fx, calibration.std["fy"] / fy)
    if not relative < limits.focal_std_max or not calibration.condition < limits.condition_max:
        raise CalibrationError(
            f"focal length and height over the table cannot be told apart (focal length known to "
            f"{100 * relative:.1f} %, the limit is {100 * limits.focal_std_max:.0f} %); "
            f"{_TILT_MORE}"
        )
    table = calibration.table[0]
    camera = calibration.camera
    width, height = camera.size_px
    middle = camera.on_plane(np.array([[width / 2, height / 2]]))[0]
    limit_mm = max(limits.table_std_max_mm, limits.table_std_max_px * camera.mm_per_px(middle))
    beyond_mm = limits.beyond_ratio_max * limit_mm
    if not (table.covered_worst_mm < limit_mm and table.worst_mm < beyond_mm):
        where = _where(table.worst_at_px[0] / width, table.worst_at_px[1] / height)
        raise CalibrationError(
            f"positions on the table would be uncertain by {table.covered_worst_mm:.2f} mm between "
            f"the boards and by {table.worst_mm:.2f} mm {where}; the limits are {limit_mm:.2f} mm "
            f"and {beyond_mm:.2f} mm. Add pictures with the board there, flat and tilted"
        )


def _where(u: float, v: float) -> str:
    """Return the part of the picture at shares (u, v) of its width and height, in words."""
    column = "left" if u < 0.4 else "right" if u > 0.6 else ""
    row = "upper" if v < 0.4 else "lower" if v > 0.6 else ""
    if row and column:
        return f"at the {row} {column}"
    if row or column:
        return f"in the {row or column} half"
    return "about the middle"
