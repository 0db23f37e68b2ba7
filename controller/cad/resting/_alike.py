"""Look-alikes: pairs of stable poses whose views from above coincide under some turn.

A camera above sees a pose up to a turn and a shift on the table. Most pairs differ in area or
moments already. For the others, turns are guessed by correlating the lines about the middle, each
guess is fitted, and the largest distance between the two drawings is measured both ways.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import FloatArray

from ..solid import Solid
from ..views import LineView, line_view, prepare_views
from ._poses import StablePose
from ._surface import bulge_of

Evidence = Literal["outline", "edges"]

TOLERANCE_MM = 0.1
STEP_MM = 0.25  # distance between the points at which drawings are compared
MAX_POINTS = 3_000
TURN_BINS, RING_BINS = 720, 24
GUESS_COUNT = 5
FIT_COUNT = 200
FIT_ROUNDS = 6
MAX_COMPARED = 3_000  # pairs of drawings: each is bounded, and takes some hundredths of a second
EDGE_SHARE = (
    0.995  # of the edges' length that must coincide: where hidden lines end is a little uncertain
)


@dataclass(frozen=True, eq=False, slots=True)
class LookAlike:
    """Two poses that a camera above cannot distinguish.

    Attributes
    ----------
    pose, other : indices of the poses, the likelier first
    evidence : "outline": silhouettes coincide, lines inside differ; "edges": both coincide
    turn_rad : anticlockwise turn about the vertical that carries the view of ``pose`` to that of
        ``other``
    gap_mm : farthest that one outline is from the other after that turn
    """

    pose: int
    other: int
    evidence: Evidence
    turn_rad: float
    gap_mm: float


@dataclass(frozen=True, eq=False, slots=True)
class AlikeSearch:
    """Result of a search for look-alikes, and its extent.

    Attributes
    ----------
    pairs : pairs of the poses gone through
    pose_count : number of poses gone through, likeliest first, each compared with all before it
    """

    pairs: tuple[LookAlike, ...]
    pose_count: int


@dataclass(frozen=True, eq=False, slots=True)
class _Drawing:
    """Points along lines, about the outline's centroid, with the lines' directions there."""

    points: FloatArray
    tangents: FloatArray
    step_mm: float
    rings: FloatArray
    tree: cKDTree

    def gaps(self, points: FloatArray) -> FloatArray:
        """Return the distances (n,) of points (n, 2) from the lines."""
        if not len(self.points):
            return np.full(len(points), np.inf)
        far, nearest = self.tree.query(points)
        along = np.einsum("ij,ij->i", points - self.points[nearest], self.tangents[nearest])
        within = np.minimum(np.abs(along), self.step_mm / 2)
        return np.asarray(np.sqrt(np.maximum(far**2 - within**2, 0.0)))


def look_alikes(
    solid: Solid,
    poses: Sequence[StablePose],
    views: Sequence[LineView] | None = None,
    tolerance_mm: float = TOLERANCE_MM,
) -> tuple[LookAlike, ...]:
    """Return the pairs of poses that look the same from above; see `search_look_alikes`.

    Parameters
    ----------
    solid : the part
    poses : its stable poses
    views : `line_view` of each pose, if they are at hand
    tolerance_mm : lines that meet this well are the same, chords of curves allowed for

    Raises
    ------
    ValueError : views and poses are not as many
    """
    return search_look_alikes(solid, poses, views, tolerance_mm).pairs


def search_look_alikes(
    solid: Solid,
    poses: Sequence[StablePose],
    views: Sequence[LineView] | None = None,
    tolerance_mm: float = TOLERANCE_MM,
    max_compared: int = MAX_COMPARED,
) -> AlikeSearch:
    """Return the pairs that look the same from above, for as many poses as the budget allows.

    The search ends after a number of comparisons, so that a part of hundreds of poses keeps nobody
    waiting. The limit is a number, not a time, so that a part compiles to the same on any machine.

    Parameters
    ----------
    solid : the part
    poses : its stable poses, likeliest first
    views : `line_view` of each pose, if they are at hand
    tolerance_mm : lines that meet this well are the same, chords of curves allowed for
    max_compared : pairs of drawings compared at most

    Raises
    ------
    ValueError : views and poses are not as many
    """
    left = max_compared
    if views is None:
        model = prepare_views(solid)
        views = [line_view(solid, pose.R, prepared=model) for pose in poses]
    if len(views) != len(poses):
        raise ValueError(f"{len(views)} views of {len(poses)} poses")
    allowed = tolerance_mm + bulge_of(solid.mesh)
    reach = max(
        (float(np.ptp(v.loops[0].points, axis=0).max()) for v in views if v.loops), default=1
    )
    drawings: dict[int, tuple[_Drawing, _Drawing]] = {}
    found: list[LookAlike] = []
    for j in range(len(poses)):
        near = [i for i in range(j) if _could_be(views[i], views[j], allowed)]
        if len(near) > left:
            return AlikeSearch(tuple(found), j)
        left -= len(near)
        for i in near:
            for k in (i, j):
                if k not in drawings:
                    drawings[k] = _draw(views[k], reach)
            answer = _compare(
                drawings[i], drawings[j], allowed, same=poses[i].same_as == poses[j].same_as != -1
            )
            if answer is not None:
                evidence, turn, gap = answer
                found.append(LookAlike(poses[i].index, poses[j].index, evidence, turn, gap))
    return AlikeSearch(tuple(found), len(poses))


def _could_be(a: LineView, b: LineView, allowed: float) -> bool:
    """Return True if areas and moments of two outlines are close enough for a full comparison."""
    if not a.loops or not b.loops:
        return False
    if abs(a.area - b.area) > allowed * max(a.perimeter, b.perimeter):
        return False
    if len([x for x in a.loops if x.is_hole]) != len([x for x in b.loops if x.is_hole]):
        return False
    spreads = [np.sqrt(np.maximum(np.linalg.eigvalsh(v.second_moments), 0)) for v in (a, b)]
    # moving the whole rim outwards by the allowance changes the radius of gyration about as much
    return bool(np.abs(spreads[0] - spreads[1]).max() < 2 * allowed)


def _draw(view: LineView, reach: float) -> tuple[_Drawing, _Drawing]:
    """Return the outline, and the sharp edges visible inside it, as points."""
    rims = [np.vstack([loop.points, loop.points[:1]]) for loop in view.loops]
    lines = [e.points for e in view.edges if e.kind != "smooth" and not e.on_outline]
    return _points(rims, view, reach), _points(lines, view, reach)


def _points(lines: list[FloatArray], view: LineView, reach: float) -> _Drawing:
    empty = np.zeros((0, 2))
    start = np.concatenate([line[:-1] for line in lines]) if lines else empty
    end = np.concatenate([line[1:] for line in lines]) if lines else empty
    length = np.linalg.norm(end - start, axis=1)
    step = max(STEP_MM, float(length.sum()) / MAX_POINTS)
    count = np.maximum(np.ceil(length / step), 1).astype(np.int64)
    ids = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(ids)) - np.repeat(np.cumsum(count) - count, count)
    points = start[ids] + ((nth + 0.5) / count[ids])[:, None] * (end - start)[ids] - view.centroid
    tangents = ((end - start) / np.maximum(length, 1e-12)[:, None])[ids]
    weights = (length / count)[ids]
    rings = np.zeros((RING_BINS, TURN_BINS))
    turn = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) * TURN_BINS
    ring = np.clip(np.hypot(*points.T) / reach * RING_BINS, 0, RING_BINS - 1).astype(int)
    np.add.at(rings, (ring, np.floor(turn).astype(int) % TURN_BINS), weights)
    for shift in (1, 2):  # blurred, so that neighbouring bins meet
        rings = (rings + np.roll(rings, shift, axis=1) + np.roll(rings, -shift, axis=1)) / 3
    rings = (
        np.vstack([rings[1:], rings[-1:] * 0]) + 2 * rings + np.vstack([rings[:1] * 0, rings[:-1]])
    )
    return _Drawing(
        points, tangents, step, rings, cKDTree(points if len(points) else np.zeros((1, 2)))
    )


def _compare(
    a: tuple[_Drawing, _Drawing], b: tuple[_Drawing, _Drawing], allowed: float, *, same: bool
) -> tuple[Evidence, float, float] | None:
    """Return the evidence two drawings share, its turn and gap; None where the outlines differ.

    ``same`` poses, which a symmetry of the part relates, look the same if their outlines do.
    """
    best: tuple[Evidence, float, float] | None = None
    lined = len(a[1].points) > 0 and len(b[1].points) > 0
    guesses = _turns(a[0].rings, b[0].rings)
    if lined:
        both = _turns(a[0].rings + a[1].rings, b[0].rings + b[1].rings)
        guesses = np.unique(np.concatenate([both, guesses]))
    for guess in guesses:
        turn, shift = _fit(a[0], b[0], float(guess))
        gap = _farthest(a[0], b[0], _turned(turn), shift, allowed)
        if gap > allowed:
            continue
        edges = same or _edges_meet(a[1], b[1], _turned(turn), shift, allowed)
        if not edges and lined:  # a round outline leaves the turn to the edges inside
            turn_2, shift_2 = _fit(a[1], b[1], turn)
            gap_2 = _farthest(a[0], b[0], _turned(turn_2), shift_2, allowed)
            if gap_2 <= allowed and _edges_meet(a[1], b[1], _turned(turn_2), shift_2, allowed):
                edges, turn, gap = True, turn_2, gap_2
        wrapped = float((turn + np.pi) % (2 * np.pi) - np.pi)
        if edges:
            return "edges", wrapped, gap
        if best is None or gap < best[2]:
            best = "outline", wrapped, gap
    return best


def _turns(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the turns (g,) that bring the lines of a round the middle closest to those of b."""
    spectrum = np.conj(np.fft.rfft(a, axis=1)) * np.fft.rfft(b, axis=1)
    score = np.fft.irfft(spectrum.sum(axis=0), TURN_BINS)
    peak = (score >= np.roll(score, 1)) & (score > np.roll(score, -1))
    at = np.flatnonzero(peak) if peak.any() else np.array([0])
    at = at[np.argsort(-score[at], kind="stable")][:GUESS_COUNT]
    return np.asarray(at * 2 * np.pi / TURN_BINS)


def _fit(a: _Drawing, b: _Drawing, turn: float) -> tuple[float, FloatArray]:
    """Return the turn and shift (2,) near a guess that bring the lines of a closest to b's."""
    shift = np.zeros(2)
    some = a.points[:: max(1, len(a.points) // FIT_COUNT)]
    for _ in range(FIT_ROUNDS):
        moved = some @ _turned(turn).T + shift
        far, nearest = b.tree.query(moved)
        near = far <= max(4 * float(np.median(far)), 1e-6)
        t = b.tangents[nearest][near]
        n = np.column_stack([-t[:, 1], t[:, 0]])
        gap = np.einsum("ij,ij->i", b.points[nearest][near] - moved[near], n)
        arm = moved[near][:, 0] * n[:, 1] - moved[near][:, 1] * n[:, 0]
        # a circle turns on itself: what the lines leave free stays as guessed
        scale = max(float(np.abs(arm).max(initial=0)), 1e-9)
        system = np.column_stack([arm / scale, n])
        step, *_ = np.linalg.lstsq(system, gap, rcond=1e-3)
        spin = step[0] / scale
        turn, shift = turn + float(spin), _turned(float(spin)) @ shift + step[1:]
        if abs(spin) * scale + np.abs(step[1:]).max() < 1e-4:
            break
    return turn, shift


def _farthest(a: _Drawing, b: _Drawing, R: FloatArray, shift: FloatArray, allowed: float) -> float:
    """Return the largest distance between a, turned and shifted, and b, both ways [mm]."""
    moved = a.points @ R.T + shift
    few = moved[:: max(1, len(moved) // 100)]
    if float(b.gaps(few).max()) > allowed:  # settles most guesses
        return np.inf
    return float(max(b.gaps(moved).max(), a.gaps((b.points - shift) @ R).max()))


def _edges_meet(a: _Drawing, b: _Drawing, R: FloatArray, shift: FloatArray, allowed: float) -> bool:
    if not len(a.points) and not len(b.points):
        return True
    if not len(a.points) or not len(b.points):
        return False
    there = b.gaps(a.points @ R.T + shift) <= allowed
    back = a.gaps((b.points - shift) @ R) <= allowed
    return bool(min(there.mean(), back.mean()) >= EDGE_SHARE)


def _turned(angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
