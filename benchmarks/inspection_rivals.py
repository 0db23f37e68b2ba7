"""What others would do with the same pictures: differences from a golden view, SSIM, ellipses.

The golden views are traced pictures of the perfect part of the same material under the same
lamps, at the pose that the set expects (benchmarks/trace_held.py --golden). Each picture is first
laid over its golden view by a homography (ECC), as anyone would, and its brightness fitted. Each
rival gives a specimen a score; where it draws the line is chosen on one folder and proven on
another.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from inspection_truth import Compared
from numpy.typing import NDArray
from scipy import ndimage

from controller.imaging import Camera

Array = NDArray[np.float64]
Grey = NDArray[np.float32]
Words = dict[str, Any]

DIFFERENT = 24.0  # greys by which a picture differs from the golden view
SSIM_SIGMA_PX = 1.5
SSIM_AREA_PX = 4.0  # low similarity counts where it holds over some pixels
DARK = 0.55  # of the panel's grey, before which the part stands
SQUARE_COS = 0.9  # holes looked into more obliquely are left out
AT_PX = 25.0


@dataclass(frozen=True)
class Score:
    """How much a specimen differs, and whether it does so most where its defect is."""

    value: float
    is_at_place: bool


def scores(folder: Path, truth: Words) -> dict[str, Score] | None:
    """Return a score by rival; None where there are no golden views.

    Parameters
    ----------
    folder : of the specimen
    truth : of the specimen
    """
    if not (folder / "golden").is_dir():
        return None
    best = {"difference": (0.0, False), "ssim": (0.0, False)}
    for pose in truth["poses"]:
        backlit = _read(folder / "golden" / f"{pose['view']}_backlight.png")
        if backlit is None:
            continue
        part = (backlit < DARK * np.percentile(backlit, 90)).astype(np.uint8)
        near = cv2.dilate(part, np.ones((9, 9), np.uint8)) > 0
        for file in sorted((folder / "golden").glob(f"{pose['view']}_*.png")):
            golden, picture = _read(file), _read(folder / file.name)
            if golden is None or picture is None:
                continue
            laid, valid = laid_over(picture, golden)
            mask = near & valid
            for name, score_of in (("difference", _difference), ("ssim", _dissimilarity)):
                value, at = score_of(laid, golden, mask)
                if value > best[name][0]:
                    is_at = "at_px" in pose and pose.get("visible", False)
                    is_at = is_at and float(np.hypot(*(at - np.array(pose["at_px"])))) < AT_PX
                    best[name] = value, is_at
    return {name: Score(*value) for name, value in best.items()}


def _read(path: Path) -> Grey | None:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    return None if picture is None else picture.astype(np.float32)


def laid_over(picture: Grey, golden: Grey) -> tuple[Grey, NDArray[np.bool_]]:
    """Return the picture laid over the golden view, as bright as it, and where it is known."""
    height, width = golden.shape
    small = [cv2.resize(p, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
             for p in (golden, picture)]  # fmt: skip
    homography = np.eye(3, dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-4)
    try:
        _, homography = cv2.findTransformECC(
            small[0],
            small[1],
            homography,
            cv2.MOTION_HOMOGRAPHY,
            stop,
            None,
            5,  # type: ignore[call-overload]
        )
        scale = np.array([[2.0, 0, 0.5], [0, 2.0, 0.5], [0, 0, 1]])
        homography = scale @ homography @ np.linalg.inv(scale)
    except cv2.error:
        homography = np.eye(3, dtype=np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    laid = cv2.warpPerspective(picture, homography, (width, height), flags=flags, borderValue=-1e6)
    valid = laid > -1.0
    a, b = laid[valid][::37], golden[valid][::37]
    gain = float((a @ b) / max(float(a @ a), 1.0))
    return np.asarray(laid * gain, np.float32), np.asarray(valid, bool)


def _difference(laid: Grey, golden: Grey, mask: NDArray[np.bool_]) -> tuple[float, Array]:
    """Return the largest area that differs, and its middle."""
    off = np.abs(cv2.GaussianBlur(np.where(mask, laid - golden, 0), (0, 0), 1.0)) > DIFFERENT
    cleaned = cv2.morphologyEx(off.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, _, stats, middles = cv2.connectedComponentsWithStats(cleaned)
    if count < 2:
        return 0.0, np.zeros(2)
    i = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return float(stats[i, cv2.CC_STAT_AREA]), np.asarray(middles[i])


def _dissimilarity(laid: Grey, golden: Grey, mask: NDArray[np.bool_]) -> tuple[float, Array]:
    """Return one less the least structural similarity, and where it is."""

    def soft(p: Grey) -> Grey:
        return np.asarray(cv2.GaussianBlur(p, (0, 0), SSIM_SIGMA_PX), np.float32)

    a, b = np.where(mask, laid, golden).astype(np.float32), golden
    mean_a, mean_b = soft(a), soft(b)
    var_a, var_b = soft(a * a) - mean_a**2, soft(b * b) - mean_b**2
    both = soft(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    ssim = (2 * mean_a * mean_b + c1) * (2 * both + c2)
    ssim /= (mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2)
    low = cv2.GaussianBlur((1 - ssim) * mask, (0, 0), SSIM_AREA_PX)
    v, u = np.unravel_index(int(low.argmax()), low.shape)
    return float(low[v, u]), np.array([u, v], float)


def ellipse_diameters(folder: Path, words: Words, truth: Words) -> list[Compared]:
    """Return diameters of holes by Canny's edges and cv2.fitEllipse, against truth.

    Each hole's mouth in each backlit and ring picture that looks into it; pixels become mm by
    the depth expected. U is what OpenCV says of it: nothing (0).

    Parameters
    ----------
    folder : of the specimen
    words : SET.json
    truth : of the specimen
    """
    c = words["camera"]
    camera = Camera(
        tuple(c["size_px"]), np.array(c["K"]), np.array(c["distortion"]), np.array(c["T_world_cam"])
    )
    out: list[Compared] = []
    for view in words["views"]:
        T = np.array(view["T_world_part"])
        for lamp in ("backlight", "ring"):
            picture = cv2.imread(str(folder / view["pictures"][lamp]), cv2.IMREAD_GRAYSCALE)
            if picture is None:
                continue
            edges = cv2.Canny(cv2.GaussianBlur(picture, (0, 0), 1.0), 40, 110)
            for hole in truth["holes"]:
                if hole["exists"] and (d := _diameter(edges, camera, T, hole)) is not None:
                    error = d - hole["true_d_mm"]
                    out.append(Compared("diameter", error, 0.0, hole["nominal_d_mm"]))
    return out


def _diameter(edges: NDArray[np.uint8], camera: Camera, T: Array, hole: Words) -> float | None:
    """Return the diameter of the rim that is turned to the camera [mm]."""
    axis = T[:3, :3] @ np.array(hole["axis"])
    ends = np.array(hole["nominal_ends"]) @ T[:3, :3].T + T[:3, 3]
    to_camera = camera.position_mm - ends[0]
    cos = float(axis @ to_camera / np.linalg.norm(to_camera))
    if abs(cos) < SQUARE_COS:
        return None
    at = ends[0] if cos > 0 else ends[1]
    mm_per_px = camera.mm_per_px(at)
    radius = hole["nominal_d_mm"] / 2 / mm_per_px
    middle = camera.project(at[None])[0]
    reach = int(1.3 * radius + 8)
    left, top = np.round(middle).astype(int) - reach
    if left < 0 or top < 0:
        return None
    here = edges[top : top + 2 * reach, left : left + 2 * reach]
    labels, count = ndimage.label(here > 0, np.ones((3, 3)))
    found: list[float] = []
    for i in range(1, count + 1):
        rows, columns = np.nonzero(labels == i)
        if not 0.6 < len(rows) / (2 * np.pi * radius) < 3:
            continue
        (x, y), (a, b), _ = cv2.fitEllipse(np.column_stack([columns, rows]).astype(np.float32))
        if abs(max(a, b) / 2 / radius - 1) < 0.2 and np.hypot(x - reach, y - reach) < 12:
            found.append(max(a, b) * mm_per_px)
    nominal = float(hole["nominal_d_mm"])
    return min(found, key=lambda d: abs(d - nominal)) if found else None


def best_line(values: Array, is_bad: NDArray[np.bool_]) -> float:
    """Return the threshold that parts bad from good best: the largest sum of both rates.

    Parameters
    ----------
    values : (n,) scores
    is_bad : (n,) truth
    """
    lines = np.unique(values)
    middle = (lines[1:] + lines[:-1]) / 2 if len(lines) > 1 else lines
    told = [
        (values[is_bad] > t).mean() + (values[~is_bad] <= t).mean() if is_bad.any() else 0.0
        for t in middle
    ]
    return float(middle[int(np.argmax(told))])
