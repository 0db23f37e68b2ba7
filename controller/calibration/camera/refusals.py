"""Refuse views that do not determine a camera; each case has its own advice."""

from collections.abc import Sequence

import cv2
import numpy as np

from controller.arrays import FloatArray
from messages import key, say

from ._types import (
    CalibratedCamera,
    CalibrationError,
    CalibrationLimits,
    PlacedBoard,
    View,
    ViewResidual,
    WorldFrame,
)

_TILT_MORE = key("add pictures of the board tilted by 15 to 30 deg, each in another direction")


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
                say(
                    "{name} shows {pixels_count} corners of the board, {corners_min} "
                    "are needed; take the picture again or leave it out",
                    name=view.name,
                    pixels_count=len(view.board.pixels),
                    corners_min=limits.corners_min,
                )
            )
    if len(views) < limits.boards_min:
        raise CalibrationError(
            say(
                "boards found in {views_count} pictures, {boards_min} are needed "
                "and ten are better; take more",
                views_count=len(views),
                boards_min=limits.boards_min,
            )
        )
    tilted_count = len(views) - len(flat)
    if tilted_count < limits.tilted_min:
        raise CalibrationError(
            say(
                "{tilted_count} of the boards found are tilted, at least "
                "{tilted_min} are required: on flat boards alone, a long lens and "
                "a high camera look the same; {tilt_more}",
                tilted_count=tilted_count,
                tilted_min=limits.tilted_min,
                tilt_more=_TILT_MORE,
            )
        )
    coverage = area_px(hull_of(views)) / (size_px[0] * size_px[1])
    if coverage < limits.coverage_min:
        u, v = np.vstack([view.board.pixels for view in views]).mean(axis=0) / size_px
        raise CalibrationError(
            say(
                "the boards cover {coverage_percent:.0f} % of the picture, {where}; "
                "{coverage_min_percent:.0f} % are needed, since the lens is a guess "
                "elsewhere; put boards into the empty areas",
                coverage_percent=100 * coverage,
                where=_where(u, v),
                coverage_min_percent=100 * limits.coverage_min,
            )
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
            others = (
                key("the other flat boards") if is_flat.sum() > 2 else key("another flat board")
            )
            raise CalibrationError(
                say(
                    "{name} is listed as flat, but is tilted {degrees:.1f} deg off "
                    "{others}; correct `placed` in the target file, or take the "
                    "picture again (squares that are not square look the same)",
                    name=view.name,
                    degrees=np.degrees(angle),
                    others=others,
                )
            )
    steep = int((tilt[~is_flat] > limits.tilt_min_rad).sum())
    if steep < limits.tilted_min:
        most = np.degrees(tilt[~is_flat].max())
        raise CalibrationError(
            say(
                "the boards listed as tilted stand at most {most:.1f} deg off the "
                "table; {steep} of them stand more than {degrees:.0f} deg off, "
                "{tilted_min} are required: with less tilt, a long lens and a high "
                "camera look the same; {tilt_more}",
                most=most,
                steep=steep,
                degrees=np.degrees(limits.tilt_min_rad),
                tilted_min=limits.tilted_min,
                tilt_more=_TILT_MORE,
            )
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
            say(
                "{name} disagrees with the other pictures: its corners are "
                "{rms_px:.2f} px off, those of the others {usual:.2f} px. Did the "
                "board or the camera move, was the board bent or not flat, or is "
                "`placed` wrong? Take the picture again or leave it out",
                name=worst.name,
                rms_px=worst.rms_px,
                usual=usual,
            )
        )
    if usual > limit_px:
        raise CalibrationError(
            say(
                "the corners are {usual:.2f} px off what any camera would show; at "
                "most {limit_px:.2f} px are plausible. Check that the pictures are "
                "sharp, the board plane and its squares square, that "
                "`inner_corners` or `squares` is right, and that nobody touched "
                "focus or zoom",
                usual=usual,
                limit_px=limit_px,
            )
        )
    if outliers > limits.outliers_max * corners:
        raise CalibrationError(
            say(
                "{outliers} of {corners} corners do not agree with the others; "
                "clean the board and light it evenly, without reflections",
                outliers=outliers,
                corners=corners,
            )
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
            say(
                "focal length and height over the table cannot be told apart "
                "(focal length known to {relative_percent:.1f} %, the limit is "
                "{focal_std_max_percent:.0f} %); {tilt_more}",
                relative_percent=100 * relative,
                focal_std_max_percent=100 * limits.focal_std_max,
                tilt_more=_TILT_MORE,
            )
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
            say(
                "positions on the table would be uncertain by "
                "{covered_worst_mm:.2f} mm between the boards and by "
                "{worst_mm:.2f} mm {where}; the limits are {limit_mm:.2f} mm and "
                "{beyond_mm:.2f} mm. Add pictures with the board there, flat and "
                "tilted",
                covered_worst_mm=table.covered_worst_mm,
                worst_mm=table.worst_mm,
                where=where,
                limit_mm=limit_mm,
                beyond_mm=beyond_mm,
            )
        )


def _where(u: float, v: float) -> str:
    """Return the part of the picture at shares (u, v) of its width and height, in words."""
    column = "left" if u < 0.4 else "right" if u > 0.6 else ""
    row = "upper" if v < 0.4 else "lower" if v > 0.6 else ""
    if row and column:
        return say("at the {row} {column}", row=row, column=column)
    if row or column:
        return say("in the {row} half", row=row or column)
    return key("about the middle")
