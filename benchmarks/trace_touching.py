"""Where parts lie that touch each other or leave the picture, and what of their outlines is free.

Parts touch as seen from straight above: one is slid up to another until their outlines meet, flat
side to flat side or as it comes, and stays a hair off. So no part lies on another, but through the
camera a tall one may hide some of its neighbour. `free_share` says of each object what share of
its outline in the picture no other object lies behind or before and the picture shows: truth.json
has it beside the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from trace_placing import MAX_TRIES, RIM_PX, NoRoomError, Part, Placed, Truth, turn

from controller.cad import Solid, ViewModel, outline, prepare_views
from controller.imaging import Camera

Array = NDArray[np.float64]

HAIR_MM = 0.02  # between parts that touch
FLAT_SHARE = 0.6  # of contacts that are flat side to flat side
MIN_SIDE_MM = 6.0  # of a side that counts as flat
MOST_PARTS = 6
LEAVING = (0.5, 0.95)  # free share of a part that leaves the picture
BESIDE_PX = 2.0  # outside an outline, where a neighbour takes its contrast away
SUBPIXEL = 8  # bits below the pixel in drawn outlines


def put_touching(
    known: Sequence[Part],
    unknown: Sequence[Part],
    leaving: bool,
    camera: Camera,
    rng: np.random.Generator,
) -> tuple[str, list[Placed]]:
    """Return the picture's kind (touching, leaving) and what lies on the table.

    Parameters
    ----------
    known : parts of the catalogue
    unknown : others; where there are any, about every fifth picture has one among its parts
    leaving : parts stand out of the picture, one or two that touch; otherwise two to six touch

    Raises
    ------
    NoRoomError : no arrangement was found that the picture shows
    """
    for _ in range(MAX_TRIES):
        count = int(rng.integers(1, 3)) if leaving else int(rng.integers(2, MOST_PARTS + 1))
        stranger = int(rng.integers(count)) if unknown and rng.random() < 0.2 else -1
        pieces: list[Piece] = []
        for number in range(count):
            pool = unknown if number == stranger else known
            part = pool[int(rng.integers(len(pool)))]
            join(pieces, drawn(part, number != stranger, rng), rng)
        placed = shown(pieces, leaving, camera, rng)
        if placed:
            return ("leaving" if leaving else "touching"), placed
    raise NoRoomError("no touching parts found that the picture shows")


class Piece:
    """A part in a pose at a turn, its centre of mass at ``at``; outlines from straight above.

    Parameters
    ----------
    part : what it is
    words : truth.json's, without its place
    lift_mm : of its lowest point above the table
    """

    def __init__(self, part: Part, words: Truth, lift_mm: float = 0.0) -> None:
        self.part, self.words, self.at, self.lift_mm = part, words, np.zeros(2), lift_mm
        R = turn(words)
        self.loops = [loop.points for loop in outline(part.solid, R, prepared=_views(part)).loops]
        self.upright = (np.asarray(part.solid.mesh.vertices) - part.solid.centroid_mm) @ R.T

    @property
    def height_mm(self) -> float:
        """Of its centre of mass above the table."""
        return self.lift_mm - float(self.upright[:, 2].min())

    @property
    def points_mm(self) -> Array:
        """(n, 3) its vertices where it lies."""
        return self.upright + np.array([*self.at, self.height_mm])

    def moved(self, turned: Array, centroid_mm: Array, below: tuple[int, ...]) -> Piece:
        """Return it turned further, elsewhere, lying on other pieces.

        Parameters
        ----------
        turned : (3, 3) world
        centroid_mm : (3,) world, of its centre of mass then
        below : numbers of the pieces it lies on
        """
        theta = np.radians(self.words["theta_deg"])
        c, s = np.cos(theta), np.sin(theta)
        about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        R = about_z.T @ turned @ turn(self.words)
        words = {**self.words, "stable_pose_R": np.round(R, 9).tolist(), "lies_on": list(below)}
        piece = Piece(self.part, words)
        piece.lift_mm = float(centroid_mm[2] + piece.upright[:, 2].min())
        piece.at = np.array(centroid_mm[:2])
        return piece

    @property
    def sides(self) -> Array:
        """(n, 2, 2) sides of all its loops, begin and end, about its own centre of mass."""
        return np.concatenate([np.stack([p, np.roll(p, -1, axis=0)], axis=1) for p in self.loops])

    def flat_sides(self) -> Array:
        """(n, 2, 2) long sides of its hull, anticlockwise."""
        points = np.concatenate(self.loops).astype(np.float32)
        hull = cv2.convexHull(points, clockwise=False)[:, 0].astype(np.float64)
        sides = np.stack([hull, np.roll(hull, -1, axis=0)], axis=1)
        return sides[np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1) >= MIN_SIDE_MM]


@lru_cache(maxsize=64)
def _views_of(solid: Solid) -> ViewModel:
    return prepare_views(solid)


def _views(part: Part) -> ViewModel:
    return _views_of(part.solid)


def drawn(part: Part, is_known: bool, rng: np.random.Generator) -> Piece:
    """Return a part in one of its stable poses, turned by chance."""
    pose = part.poses[rng.choice(len(part.poses), p=part.odds)]
    return Piece(part, _words(part, pose.index, pose.R, is_known, rng.uniform(0.0, 360.0)))


def _words(part: Part, index: int, R: Array, is_known: bool, theta_deg: float) -> Truth:
    return {
        "part": part.solid.name,
        "known": is_known,
        "pose_id": index,
        "stable_pose_R": np.round(R, 9).tolist(),
        "theta_deg": round(float(theta_deg), 4),
    }


def join(pieces: list[Piece], piece: Piece, rng: np.random.Generator) -> Array:
    """Add a piece, slid up to those there are; return the direction (2,) it came in."""
    if not pieces:
        pieces.append(piece)
        return np.zeros(2)
    beside = pieces[int(rng.integers(len(pieces)))]
    there, here = beside.flat_sides(), piece.flat_sides()
    if rng.random() < FLAT_SHARE and len(there) and len(here):
        a, b = there[int(rng.integers(len(there)))], here[int(rng.integers(len(here)))]
        along = (a[1] - a[0]) / np.linalg.norm(a[1] - a[0])
        turned = np.degrees(np.arctan2(*(a[0] - a[1])[::-1]) - np.arctan2(*(b[1] - b[0])[::-1]))
        words = piece.words
        theta = (words["theta_deg"] + turned) % 360.0
        R = np.array(words["stable_pose_R"])
        piece = Piece(piece.part, _words(piece.part, words["pose_id"], R, words["known"], theta))
        c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
        middle = b.mean(axis=0) @ np.array([[c, s], [-s, c]])
        half = 0.4 * (np.linalg.norm(a[1] - a[0]) + np.linalg.norm(b[1] - b[0]))
        start = beside.at + a.mean(axis=0) + rng.uniform(-half, half) * along - middle
        towards = np.array([-along[1], along[0]])  # into the part that is there
    else:
        angle = rng.uniform(0.0, 2 * np.pi)
        towards = np.array([np.cos(angle), np.sin(angle)])
        half = 0.3 * float(np.ptp(np.concatenate(beside.loops), axis=0).max())
        start = beside.at + rng.uniform(-half, half) * np.array([-towards[1], towards[0]])
    far = 1000.0
    start = start - far * towards
    stops = [_slide(start - one.at, piece.sides, one.sides, towards) for one in pieces]
    if min(stops) == np.inf:  # it would pass them all: begin again at the middle of one
        start, towards = beside.at - far * np.array([1.0, 0.0]), np.array([1.0, 0.0])
        stops = [_slide(start - one.at, piece.sides, one.sides, towards) for one in pieces]
    piece.at = start + (min(stops) - HAIR_MM) * towards
    pieces.append(piece)
    return np.asarray(towards)


def _slide(offset: Array, mine: Array, theirs: Array, towards: Array) -> float:
    """Return how far sides (n, 2, 2), offset, move in a direction until they meet others."""
    moved = mine + offset
    return min(_first_hit(moved[:, 0], towards, theirs), _first_hit(theirs[:, 0], -towards, moved))


def _first_hit(points: Array, towards: Array, sides: Array) -> float:
    """Return the shortest way of points (n, 2) in a direction to sides (m, 2, 2), inf for none."""
    across = np.array([-towards[1], towards[0]])
    u, v = points @ towards, points @ across
    a, b = sides @ towards, sides @ across
    span = b[:, 1] - b[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (v[:, None] - b[:, 0]) / span
        far = a[:, 0] + share * (a[:, 1] - a[:, 0]) - u[:, None]
    meets = (share >= 0) & (share <= 1) & (far >= 0)
    return float(far[meets].min()) if meets.any() else np.inf


def shown(
    pieces: Sequence[Piece], leaving: bool, camera: Camera, rng: np.random.Generator
) -> list[Placed]:
    """Return the pieces moved to where the picture shows them; nothing where it does not."""
    width, height = camera.size_px
    corners = camera.on_plane(np.array([[0, 0], [width, 0], [0, height], [width, height]], float))
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    for _ in range(40):
        shift = rng.uniform(low, high) - pieces[0].at
        placed = [_placed(piece, shift, camera) for piece in pieces]
        last = np.array([width, height]) - 1 - RIM_PX
        inside = [(p.hull_px >= RIM_PX).all() and (p.hull_px <= last).all() for p in placed]
        if all(inside) == leaving:
            continue
        objects = [(piece.part, p.words) for piece, p in zip(pieces, placed, strict=True)]
        shares = free_shares(objects, camera)
        if leaving and not LEAVING[0] <= min(shares) <= LEAVING[1]:
            continue
        for one, share in zip(placed, shares, strict=True):
            one.words["free_share"] = round(share, 4)
        return placed
    return []


def _placed(piece: Piece, shift: Array, camera: Camera) -> Placed:
    at = np.round(piece.at + shift, 4)
    height = piece.height_mm
    words = dict(piece.words)
    words |= {"x_mm": float(at[0]), "y_mm": float(at[1])}
    words["centroid_height_mm"] = round(height, 4)
    points = piece.upright + np.array([at[0], at[1], height])
    hull = cv2.convexHull(camera.project(points).astype(np.float32))[:, 0]
    return Placed(words, points[np.asarray(piece.part.solid.mesh.faces)], hull)


def free_shares(objects: Sequence[tuple[Part, Truth]], camera: Camera) -> list[float]:
    """Return of each object which share of its outline stands free in the picture.

    Parameters
    ----------
    objects : each with truth.json's words for it
    camera : that looks
    """
    width, height = camera.size_px
    rings = [_outline_px(part, words, camera) for part, words in objects]
    pad = 400  # round the picture, so that what leaves it is drawn whole
    masks = []
    for loops in rings:
        mask = np.zeros((height + 2 * pad, width + 2 * pad), np.uint8)
        drawn = [np.round((p + pad) * 2**SUBPIXEL).astype(np.int32) for p in loops]
        cv2.fillPoly(mask, drawn, 1, cv2.LINE_8, SUBPIXEL)
        masks.append(mask)
    shares = []
    for number, loops in enumerate(rings):
        others = sum((mask for k, mask in enumerate(masks) if k != number), np.zeros_like(masks[0]))
        free, total = 0.0, 0.0
        for loop in loops:
            points, normals = _every_px(loop)
            outside = np.round(points + BESIDE_PX * normals).astype(int) + pad
            on = np.round(points).astype(int)
            seen = ((on > 1) & (on < np.array([width, height]) - 2)).all(axis=1)
            outside = np.clip(outside, 0, np.array([width, height]) + 2 * pad - 1)
            free += float((seen & (others[outside[:, 1], outside[:, 0]] == 0)).sum())
            total += len(points)
        shares.append(free / max(total, 1.0))
    return shares


def _outline_px(part: Part, words: Truth, camera: Camera) -> list[Array]:
    T = np.eye(4)
    T[:3, :3] = turn(words)
    T[:3, 3] = [words["x_mm"], words["y_mm"], words["centroid_height_mm"]]
    T[:3, 3] -= T[:3, :3] @ part.solid.centroid_mm
    return [loop.points for loop in outline(part.solid, T, camera, prepared=_views(part)).loops]


def _every_px(ring: Array) -> tuple[Array, Array]:
    """Return points (n, 2) at each pixel of a closed ring and normals away from the part."""
    closed = np.vstack([ring, ring[:1]])
    ahead = np.diff(closed, axis=0)
    length = np.linalg.norm(ahead, axis=1)
    along = np.concatenate([[0.0], np.cumsum(length)])
    at = np.arange(0.5, along[-1], 1.0)
    side = np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(ring) - 1)
    tangent = ahead[side] / np.maximum(length[side], 1e-9)[:, None]
    points = closed[side] + (at - along[side])[:, None] * tangent
    # the part is on the left to the eye, where v runs down: away from it is to the right
    return points, np.column_stack([-tangent[:, 1], tangent[:, 0]])
