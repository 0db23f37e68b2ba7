"""Two plain recognisers to be compared with, which answer as `cellctl recognise --json` does.

python benchmarks/recognition_rivals.py --method masks|moments IMAGE... --parts PATH...
    --calibration FILE [--lighting backlit|front]

Both cut the picture by Otsu's threshold, take each outline to the table plane, and compare it with
the shadows that the parts, lying each way they can, cast from the camera onto the table.

masks : the filled outline, turned by 360 whole degrees, against every shadow; the best overlap
moments : Hu's seven moments by `cv2.matchShapes`; the turn by second and third moments

Nothing here comes from the recognition room: the stable poses are trimesh's.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from controller.cad import Camera  # noqa: E402  (path set above)

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

GRID = 176  # cells of 1 mm each way: the largest shadow has 167 mm
HALF = GRID / 2
LEAST_AREA_MM2 = 80.0
LEAST_PROBABILITY = 0.02
SAME_SIDE_RAD = np.radians(2.0)
LEAST_OVERLAP = 0.90  # less is unknown
MOST_UNLIKE = 0.10  # of cv2.matchShapes; more is unknown
AREA_RATIO = 1.15  # Hu's moments do not see size: outlines further apart in area are left out
SUBPIXEL = 16
FINE = 4  # cells to a millimetre each way where a shadow is cast


@dataclass(frozen=True, eq=False, slots=True)
class Shadow:
    """A part lying one way under the middle of the camera, as a mask round its own centroid.

    com_mm : (2,) the centre of mass as seen from the mask's centroid
    """

    part: str
    R: Array
    mask: Grey
    contour: NDArray[np.float32]
    area_mm2: float
    com_mm: Array
    com_height_mm: float
    axis_rad: float


def read_camera(path: Path) -> Camera:
    body = json.loads(path.read_text())
    return Camera(
        tuple(body["size_px"]),
        np.array(body["K"], dtype=float),
        np.array(body["distortion"], dtype=float),
        np.array(body["T_world_cam"], dtype=float),
    )


def part_files(paths: list[Path]) -> list[Path]:
    """Return the meshes among files and folders; a part that is there as STEP too counts once."""
    found: list[Path] = []
    for path in paths:
        found += sorted(path.glob("*.stl")) if path.is_dir() else [path]
    return [f for f in found if f.suffix.lower() == ".stl"]


def cast_shadows(path: Path, height_mm: float) -> list[Shadow]:
    """Return a part's shadows, one for each side it rests on, for a camera at a height."""
    mesh = trimesh.load(path, force="mesh")
    poses, odds = trimesh.poses.compute_stable_poses(mesh, threshold=LEAST_PROBABILITY)
    sides: list[Array] = []
    shadows = []
    for pose, _odds in zip(poses, odds, strict=True):
        R = np.asarray(pose[:3, :3], dtype=np.float64)
        if any(side @ R[2] > np.cos(SAME_SIDE_RAD) for side in sides):
            continue
        sides.append(R[2])
        corners = (np.asarray(mesh.triangles) - mesh.center_mass) @ R.T
        com_height = -float(corners[:, :, 2].min())
        corners[:, :, 2] += com_height
        flat = corners[:, :, :2] * (height_mm / (height_mm - corners[:, :, 2:]))
        shadow = _shadow(path.stem, R, flat, com_height)
        if shadow is not None:
            shadows.append(shadow)
    return shadows


def _shadow(part: str, R: Array, flat: Array, com_height_mm: float) -> Shadow | None:
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    facing = flat[a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0]
    if np.abs(facing).max() > 1.5 * HALF:
        return None
    large = np.zeros((2 * GRID * FINE, 2 * GRID * FINE), np.uint8)
    for triangle in np.round((facing + GRID) * FINE * SUBPIXEL).astype(np.int32):
        cv2.fillConvexPoly(large, triangle, 1, shift=4)
    contours, _ = cv2.findContours(large, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    loops = [c.reshape(-1, 2) / FINE - GRID for c in contours]
    mask, centroid, moments = drawn(loops)
    outer = max(loops, key=len).astype(np.float32)
    return Shadow(
        part,
        R,
        mask,
        outer - centroid.astype(np.float32),
        moments["m00"],
        -centroid,
        com_height_mm,
        axis(moments),
    )


def drawn(loops: list[Array]) -> tuple[Grey, Array, dict[str, float]]:
    """Return loops [mm] filled on a grid round their centroid, the centroid, and the moments."""
    middle = np.concatenate(loops).mean(axis=0)
    mask = _filled([loop - middle for loop in loops])
    moments = cv2.moments(mask, binaryImage=True)
    if moments["m00"] == 0:
        return mask, middle, moments
    centroid = np.array([moments["m10"], moments["m01"]]) / moments["m00"] - HALF + middle
    return _filled([loop - centroid for loop in loops]), centroid, moments


def _filled(loops: list[Array]) -> Grey:
    mask = np.zeros((GRID, GRID), np.uint8)
    fixed = [np.round((loop + HALF) * SUBPIXEL).astype(np.int32) for loop in loops]
    cv2.fillPoly(mask, fixed, 1, shift=4)
    return mask


def axis(moments: dict[str, float]) -> float:
    """Return the direction of the long axis [rad], towards the tail of the third moments."""
    turn = 0.5 * np.arctan2(2 * moments["mu11"], moments["mu20"] - moments["mu02"])
    c, s = np.cos(turn), np.sin(turn)
    tail = (
        c**3 * moments["mu30"]
        + 3 * c**2 * s * moments["mu21"]
        + 3 * c * s**2 * moments["mu12"]
        + s**3 * moments["mu03"]
    )
    return float(turn if tail >= 0 else turn + np.pi)


def find_outlines(picture: Grey, camera: Camera, lighting: str) -> list[list[Array]]:
    """Return the loops [mm on the table] of each object, outline and holes."""
    smooth = cv2.medianBlur(picture, 5) if min(picture.shape) > 500 else picture
    if lighting == "backlit":
        _, mask = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
    else:
        rim = np.concatenate([smooth[:8].ravel(), smooth[-8:].ravel(), smooth[:, :8].ravel()])
        unlike = cv2.absdiff(smooth, np.full_like(smooth, int(np.median(rim))))
        _, mask = cv2.threshold(unlike, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        wide = max(3, min(picture.shape) // 140 | 1)
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel)
    contours, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found: list[list[Array]] = []
    for k, contour in enumerate(contours):
        if tree[0][k][3] >= 0 or len(contour) < 8:
            continue
        mine = [contour] + [
            c for c, links in zip(contours, tree[0], strict=True) if links[3] == k and len(c) >= 8
        ]
        loops = [camera.on_plane(c.reshape(-1, 2).astype(np.float64))[:, :2] for c in mine]
        if cv2.contourArea(loops[0].astype(np.float32)) >= LEAST_AREA_MM2:
            found.append(loops)
    return found


class Masks:
    """Overlap of the filled outline, turned by whole degrees, with every shadow."""

    def __init__(self, shadows: list[Shadow]) -> None:
        self._shadows = shadows
        self._masks = np.stack([s.mask.ravel() for s in shadows]).astype(np.float32)
        self._areas = self._masks.sum(axis=1)

    def match(self, loops: list[Array]) -> tuple[Shadow | None, float, float, Array]:
        """Return the shadow, the turn [rad], the score, and the outline's centroid [mm]."""
        mask, centroid, _ = drawn(loops)
        turned = np.empty((360, GRID * GRID), np.float32)
        for k in range(360):
            c, s = np.cos(np.radians(k)), np.sin(np.radians(k))  # back by k degrees
            back = np.array([[c, s, HALF * (1 - c - s)], [-s, c, HALF * (1 - c + s)]])
            turned[k] = cv2.warpAffine(mask, back, (GRID, GRID), flags=cv2.INTER_NEAREST).ravel()
        common = turned @ self._masks.T
        overlap = common / (turned.sum(axis=1)[:, None] + self._areas[None] - common)
        k, j = np.unravel_index(overlap.argmax(), overlap.shape)
        score = float(overlap[k, j])
        known = self._shadows[j] if score >= LEAST_OVERLAP else None
        return known, float(np.radians(k)), score, centroid


class Moments:
    """Hu's moments of the outer outline, among shadows of about the same size."""

    def __init__(self, shadows: list[Shadow]) -> None:
        self._shadows = shadows

    def match(self, loops: list[Array]) -> tuple[Shadow | None, float, float, Array]:
        """Return the shadow, the turn [rad], the score, and the outline's centroid [mm]."""
        _, centroid, moments = drawn(loops)
        outer = loops[0].astype(np.float32)
        best, least = None, MOST_UNLIKE
        for shadow in self._shadows:
            ratio = moments["m00"] / shadow.area_mm2
            if not 1 / AREA_RATIO < ratio < AREA_RATIO:
                continue
            unlike = cv2.matchShapes(outer, shadow.contour, cv2.CONTOURS_MATCH_I1, 0)
            if unlike < least:
                best, least = shadow, unlike
        turn = 0.0 if best is None else axis(moments) - best.axis_rad
        return best, turn, 1.0 - least / MOST_UNLIKE, centroid


def recognise(
    picture: Grey, camera: Camera, lighting: str, method: Masks | Moments
) -> list[dict[str, Any]]:
    """Return the answers to one picture."""
    answers = []
    above = camera.position_mm
    for loops in find_outlines(picture, camera, lighting):
        shadow, turn, score, centroid = method.match(loops)
        place = centroid
        if shadow is not None:
            # what stands higher is seen further from under the camera
            shrink = 1 - shadow.com_height_mm / above[2]
            c, s = np.cos(turn), np.sin(turn)
            place = above[:2] + (centroid - above[:2]) * shrink
            place = place + np.array([[c, -s], [s, c]]) @ shadow.com_mm
        answers.append(
            {
                "part": None if shadow is None else shadow.part,
                "stable_pose_R": None if shadow is None else shadow.R.tolist(),
                "x_mm": float(place[0]),
                "y_mm": float(place[1]),
                "theta_deg": float(np.degrees(turn)),
                "score": score,
                "ambiguous_with": [],
            }
        )
    return answers


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("images", nargs="+", type=Path)
    parser.add_argument("--method", choices=("masks", "moments"), required=True)
    parser.add_argument("--parts", nargs="+", type=Path, required=True)
    parser.add_argument("--calibration", type=Path, required=True)
    parser.add_argument("--lighting", choices=("backlit", "front"), default="backlit")
    args = parser.parse_args()
    camera = read_camera(args.calibration)
    height_mm = float(camera.position_mm[2])
    shadows = [s for path in part_files(args.parts) for s in cast_shadows(path, height_mm)]
    method = {"masks": Masks, "moments": Moments}[args.method](shadows)
    for path in args.images:
        begin = time.perf_counter()
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        answers = recognise(picture, camera, args.lighting, method)
        seconds = (time.perf_counter() - begin) / max(1, len(answers))
        for answer in answers:
            print(json.dumps({"image": path.name, **answer, "seconds": seconds}), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
