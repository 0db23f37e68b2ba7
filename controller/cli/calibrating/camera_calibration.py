"""`cellctl calibrate camera`: pictures of a board -> the camera, its lens and its pose.

Reads the files and prints the result; `controller.calibration.camera` computes it.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.table import Table

from controller.arrays import Grey
from controller.calibration.camera import (
    CalibratedCamera,
    CalibrationError,
    Charuco,
    NoBoardError,
    PlacedBoard,
    Target,
    View,
    WorldFrame,
    calibrate,
    find_board,
)
from controller.calibration.target import CalibrationTarget, load_target
from controller.config import ConfigError
from controller.stored.pictures import decoded, read_whole

from ..inputs.calibration_file import calibration_body, write_calibration
from ..inputs.checks import check_writable_folder, require_files
from ..terminal.output import emit, print_line, stdout


def calibrate_camera(images: list[Path], target_file: Path, output: Path, *, as_json: bool) -> int:
    """Calibrate a camera by its pictures, write the file; return the exit code.

    Parameters
    ----------
    images : pictures of the board, all by one camera, each with an entry in the target file
    target_file : the board, and where each picture has it (YAML)
    output : calibration file to write
    as_json : print the calibration as one JSON object

    Raises
    ------
    ConfigError : a file is wrong, or the pictures do not determine the camera
    """
    target = load_target(target_file)
    check_writable_folder(output.parent, "--output in")
    paths = _by_entry(images, target, target_file)
    require_files(paths.values())
    pictures = _read_all(paths)
    board = target.build()
    views, missed = [], {}
    for name, picture in pictures.items():
        try:
            views.append(View(name, target.placed(name), find_board(picture, board)))
        except NoBoardError as error:
            missed[name] = str(error)
    height, width = next(iter(pictures.values())).shape
    try:
        found = calibrate(views, (width, height), _world(target, views, missed))
    except CalibrationError as error:
        raise ConfigError(_refusal(str(error), len(pictures), missed)) from error
    body = calibration_body(found)
    body["counts"] = {"pictures": len(pictures), **body["counts"]}
    body |= {
        "missed": [{"image": name, "reason": why} for name, why in missed.items()],
        "board": _board_body(board),
        "made": {
            "by": f"cellctl {version('cellctl')} calibrate camera, OpenCV {cv2.__version__}",
            "at": datetime.now(UTC).isoformat(timespec="seconds"),
            "target": target_file.name,
            "images": [path.name for path in paths.values()],
        },
    }
    write_calibration(output, body)
    if as_json:
        emit({"file": str(output), **body})
    else:
        _report(found, missed, len(pictures), output)
    return 0


# -- files --------------------------------------------------------------------------------------


def _by_entry(images: list[Path], target: CalibrationTarget, target_file: Path) -> dict[str, Path]:
    """Return the pictures by their names in the target file, in its order."""
    found: dict[str, Path] = {}
    for path in images:
        name = target.entry_of(path)
        if name is None:
            raise ConfigError(
                f"{path}: `images` of {target_file} does not list it; add it there, "
                "with the pose of the board, or leave it out"
            )
        if name in found:
            raise ConfigError(
                f"{path} and {found[name]} both fit `{name}` of {target_file}; give one of them"
            )
        found[name] = path
    return {p.image: found[p.image] for p in target.images if p.image in found}


def _read_all(paths: Mapping[str, Path]) -> dict[str, Grey]:
    pictures: dict[str, Grey] = {}
    for name, path in paths.items():
        pictures[name] = read_grey(path)
        first = next(iter(paths))
        size, first_size = pictures[name].shape[::-1], pictures[first].shape[::-1]
        if size != first_size:
            raise ConfigError(
                f"{path}: {size[0]} x {size[1]} px, but {paths[first]} has {first_size[0]} x "
                f"{first_size[1]} px; calibrate from pictures of one camera at one setting"
            )
    return pictures


def read_grey(path: Path) -> Grey:
    """Return a picture of the board in 8 bits.

    Raises
    ------
    ConfigError : there is none, or it cannot be read
    """
    data = read_whole(path)
    picture = decoded(path, data, "grey")
    if picture.dtype != np.uint8:  # 10 to 16 bits: only the pattern counts
        brightest = max(float(picture.max()), 1.0)
        picture = np.rint(picture.astype(np.float64) * (255.0 / brightest))
    return np.asarray(picture, dtype=np.uint8)


def _world(target: CalibrationTarget, views: list[View], missed: Mapping[str, str]) -> WorldFrame:
    if target.world is not None:
        name = target.world.image
        if name in missed:
            raise ConfigError(
                f"{name} fixes the world, but its board was not found: {missed[name]}"
            )
        if name not in {view.name for view in views}:
            raise ConfigError(
                f"{name} fixes the world (`world.image`), but is not among the images"
            )
        return target.world.build()
    flat = [view.name for view in views if view.placed is PlacedBoard.FLAT]
    if not flat:
        raise ConfigError(
            _refusal("no flat board was found, so the table plane is unknown", 0, missed)
        )
    return WorldFrame(flat[0], (0.0, 0.0, 0.0), 0.0)


def _refusal(why: str, picture_count: int, missed: Mapping[str, str]) -> str:
    lines = [f"the camera is not calibrated: {why}"]
    if missed and picture_count:
        lines[0] += f" (no board found in {len(missed)} of {picture_count} pictures)"
    return "\n".join([*lines, *(f"  {name}: {reason}" for name, reason in missed.items())])


def _board_body(board: Target) -> dict[str, Any]:
    if isinstance(board, Charuco):
        return {
            "squares": list(board.squares),
            "square_mm": board.square_mm,
            "marker_mm": board.marker_mm,
            "dictionary": board.dictionary,
            "legacy_pattern": board.legacy_pattern,
        }
    return {"inner_corners": list(board.inner_corners), "square_mm": board.square_mm}


# -- what the operator reads --------------------------------------------------------------------


def _report(
    found: CalibratedCamera, missed: Mapping[str, str], picture_count: int, output: Path
) -> None:
    flat = sum(view.placed is PlacedBoard.FLAT for view in found.views)
    print_line(
        f"boards found in {len(found.views)} of {picture_count} pictures: {flat} flat, "
        f"{len(found.views) - flat} tilted; they cover {100 * found.coverage:.0f} % of the picture"
    )
    for name, reason in missed.items():
        print_line(f"  not in {name}: {reason}", style="yellow")
    stdout.print(_views_table(found))
    print_line(f"residual {found.rms_px:.3f} px rms over all pictures")
    K = found.camera.K
    std = found.std
    print_line(
        f"lens: fx {K[0, 0]:.2f} +- {std['fx']:.2f} px, fy {K[1, 1]:.2f} +- {std['fy']:.2f} px, "
        f"centre {K[0, 2]:.2f} +- {std['cx']:.2f}, {K[1, 2]:.2f} +- {std['cy']:.2f} px"
    )
    values = dict(zip(("k1", "k2", "p1", "p2", "k3"), found.camera.distortion, strict=True))
    shown = [f"{name} {values[name]:.3g} +- {std[name]:.1g}" for name in values if name in std]
    print_line(f"distortion: {', '.join(shown) if shown else 'none visible'}")
    if found.held_std:
        print_line(
            f"held at 0, since the pictures do not determine them: {', '.join(found.held_std)}"
        )
    x, y, z = found.camera.position_mm
    sx, sy, sz = found.position_std_mm
    print_line(
        f"camera at x {x:.2f} +- {sx:.2f}, y {y:.2f} +- {sy:.2f}, z {z:.2f} +- {sz:.2f} mm over "
        f"the table, {np.degrees(found.tilt_rad):.3f} +- {np.degrees(found.tilt_std_rad):.3f} deg "
        "off the vertical"
    )
    for plane in found.table:
        u, v = plane.worst_at_px
        print_line(
            f"a position at z = {plane.height_mm:g} mm is known to {plane.median_mm:.4f} mm "
            f"(median over the picture), {plane.covered_worst_mm:.4f} mm at worst where there were "
            f"boards, {plane.worst_mm:.4f} mm in all of the picture (pixel {u:.0f}, {v:.0f})"
        )
    print_line(f"written to {output}")


def _views_table(found: CalibratedCamera) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in ("picture", "placed"):
        table.add_column(column)
    for column in ("tilt deg", "corners", "left out", "rms px", "worst px"):
        table.add_column(column, justify="right")
    for view in found.views:
        table.add_row(
            view.name,
            view.placed.value,
            f"{np.degrees(view.tilt_rad):.1f}",
            str(view.corner_count),
            str(view.outlier_count),
            f"{view.rms_px:.3f}",
            f"{view.worst_px:.3f}",
        )
    return table
