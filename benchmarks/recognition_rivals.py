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

from recognition_parts import cad_files, read_mesh  # noqa: E402

from controller.imaging import Camera  # noqa: E402  (path set above)

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

GRID = 176  # cells of 1 mm each way: the largest shadow has 167 mm
HALF = GRID / 2
MIN_AREA_MM2 = 80.0
MIN_PROBABILITY = 0.02
SAME_SIDE_RAD = np.radians(2.0)
CAST_AGAIN = 8  # of the best overlaps
APART_DEG = 4
MIN_OVERLAP = 0.90  # less is unknown
MAX_UNLIKE = 0.10  # of cv2.matchShapes; more is unknown
AREA_RATIO = 1.15  # Hu's moments do not see size: outlines further apart in area are left out
SUBPIXEL = 16
FINE = 4  # cells to a millimetre each way where a shadow is cast


@dataclass(frozen=True, eq=False, slots=True)
class Shadow:
    """A part lying one way under the middle of the camera, as a mask round its own centroid.

    com_mm : (2,) the centre of mass as seen from the mask's centroid
    corners_mm : (n, 3, 3) triangles of the part lying so: from the centre of mass, above the table
    """

    part: str
    R: Array
    mask: Grey
    contour: NDArray[np.float32]
    area_mm2: float
    com_mm: Array
    com_height_mm: float
    axis_rad: float
    corners_mm: Array


def read_camera(path: Path) -> Camera:
    body = json.loads(path.read_text())
    return Camera(
        tuple(body["size_px"]),
        np.array(body["K"], dtype=float),
        np.array(body["distortion"], dtype=float),
        np.array(body["T_world_cam"], dtype=float),
    )


def cast_shadows(part: str, mesh: trimesh.Trimesh, height_mm: float) -> list[Shadow]:
    """Return a part's shadows, one for each side it rests on, for a camera at a height."""
    poses, odds = trimesh.poses.compute_stable_poses(mesh, threshold=MIN_PROBABILITY)
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
        if np.linalg.norm(corners[:, :, :2], axis=2).max() > 1.2 * HALF:
            continue
        loops = cast(corners, 0.0, np.zeros(2), np.array([0.0, 0.0, height_mm]))
        mask, centroid, moments = drawn(loops)
        outer = max(loops, key=len).astype(np.float32) - centroid.astype(np.float32)
        size, long_axis = moments["m00"], axis(moments)
        shadows.append(
            Shadow(part, R, mask, outer, size, -centroid, com_height, long_axis, corners)
        )
    return shadows


def cast(corners: Array, turn: float, com_mm: Array, above_mm: Array) -> list[Array]:
    """Return the loops [mm] of the shadow of a part that lies turned, its centre of mass there."""
    c, s = np.cos(turn), np.sin(turn)
    place = corners[:, :, :2] @ np.array([[c, s], [-s, c]]) + com_mm - above_mm[:2]
    flat = place * (above_mm[2] / (above_mm[2] - corners[:, :, 2:])) + above_mm[:2] - com_mm
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    facing = flat[a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0]
    large = np.zeros((2 * GRID * FINE, 2 * GRID * FINE), np.uint8)
    for triangle in np.round((facing + GRID) * FINE * SUBPIXEL).astype(np.int32):
        cv2.fillConvexPoly(large, triangle, 1, shift=4)
    contours, _ = cv2.findContours(large, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [contour.reshape(-1, 2) / FINE - GRID + com_mm for contour in contours]


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
        if cv2.contourArea(loops[0].astype(np.float32)) >= MIN_AREA_MM2:
            found.append(loops)
    return found


@dataclass(frozen=True, eq=False, slots=True)
class Match:
    """What an outline is taken for; the centre of mass at a place on the table."""

    shadow: Shadow | None
    turn_rad: float
    score: float
    place_mm: Array


def place_of(shadow: Shadow, turn: float, centroid: Array, above_mm: Array) -> Array:
    """Return where the centre of mass (2,) stands, from the centroid of the shadow."""
    # what stands higher is seen further from under the camera
    shrink = 1 - shadow.com_height_mm / above_mm[2]
    c, s = np.cos(turn), np.sin(turn)
    under = above_mm[:2] + (centroid - above_mm[:2]) * shrink
    return np.asarray(under + np.array([[c, -s], [s, c]]) @ shadow.com_mm)


class Masks:
    """Overlap of the filled outline, turned by whole degrees, with every shadow.

    The best ones are cast again at their place, since a tall part shows its side off the middle.
    """

    def __init__(self, shadows: list[Shadow]) -> None:
        self._shadows = shadows
        self._masks = np.stack([s.mask.ravel() for s in shadows]).astype(np.float32)
        self._areas = self._masks.sum(axis=1)

    def match(self, loops: list[Array], above_mm: Array) -> Match:
        """Return what fits loops [mm] best, seen by a camera above."""
        mask, centroid, _ = drawn(loops)
        turned = np.empty((360, GRID * GRID), np.float32)
        for k in range(360):
            c, s = np.cos(np.radians(k)), np.sin(np.radians(k))  # back by k degrees
            back = np.array([[c, s, HALF * (1 - c - s)], [-s, c, HALF * (1 - c + s)]])
            turned[k] = cv2.warpAffine(mask, back, (GRID, GRID), flags=cv2.INTER_NEAREST).ravel()
        common = turned @ self._masks.T
        overlap = common / (turned.sum(axis=1)[:, None] + self._areas[None] - common)
        found = []
        for _ in range(CAST_AGAIN):
            k, j = np.unravel_index(overlap.argmax(), overlap.shape)
            overlap[np.arange(k - APART_DEG, k + APART_DEG + 1) % 360, j] = 0
            found.append(self._again(self._shadows[j], np.radians(k), mask, centroid, above_mm))
        best = max(found, key=lambda match: match.score)
        return Match(
            best.shadow if best.score >= MIN_OVERLAP else None,
            best.turn_rad,
            best.score,
            best.place_mm if best.score >= MIN_OVERLAP else centroid,
        )

    def _again(
        self, shadow: Shadow, turn: float, mask: Grey, centroid: Array, above_mm: Array
    ) -> Match:
        place = place_of(shadow, turn, centroid, above_mm)
        there, middle, _ = drawn(cast(shadow.corners_mm, turn, place, above_mm))
        common = int((there & mask).sum())
        score = common / max(int((there | mask).sum()), 1)
        shift = (centroid - middle) * (1 - shadow.com_height_mm / above_mm[2])
        return Match(shadow, turn, score, place + shift)


class Moments:
    """Hu's moments of the outer outline, among shadows of about the same size."""

    def __init__(self, shadows: list[Shadow]) -> None:
        self._shadows = shadows

    def match(self, loops: list[Array], above_mm: Array) -> Match:
        """Return what fits loops [mm] best, seen by a camera above."""
        _, centroid, moments = drawn(loops)
        outer = loops[0].astype(np.float32)
        best, least = None, MAX_UNLIKE
        for shadow in self._shadows:
            ratio = moments["m00"] / shadow.area_mm2
            if not 1 / AREA_RATIO < ratio < AREA_RATIO:
                continue
            unlike = cv2.matchShapes(outer, shadow.contour, cv2.CONTOURS_MATCH_I1, 0)
            if unlike < least:
                best, least = shadow, unlike
        if best is None:
            return Match(None, 0.0, 0.0, centroid)
        turn = axis(moments) - best.axis_rad
        score = 1.0 - least / MAX_UNLIKE
        return Match(best, turn, score, place_of(best, turn, centroid, above_mm))


def recognise(
    picture: Grey, camera: Camera, lighting: str, method: Masks | Moments
) -> list[dict[str, Any]]:
    """Return the answers to one picture."""
    answers = []
    for loops in find_outlines(picture, camera, lighting):
        found = method.match(loops, camera.position_mm)
        answers.append(
            {
                "part": None if found.shadow is None else found.shadow.part,
                "stable_pose_R": None if found.shadow is None else found.shadow.R.tolist(),
                "x_mm": float(found.place_mm[0]),
                "y_mm": float(found.place_mm[1]),
                "theta_deg": float(np.degrees(found.turn_rad)),
                "score": found.score,
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
    shadows = [
        shadow
        for name, file in cad_files(args.parts).items()
        for shadow in cast_shadows(name, read_mesh(file), height_mm)
    ]
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
