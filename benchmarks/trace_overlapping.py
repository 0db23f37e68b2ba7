"""Where parts lie that touch or lie on one another: laid over a neighbour, and let fall.

The first part lies on the table. Each further one touches what is there (`trace_touching`), or is
moved on over it until a share of the smaller one's shadow is over the other's, and let fall in
pybullet while all others stand still. It comes to rest flat on another, or leaning: one side on
the table, the other on its neighbour. The part that falls is taken for its convex hull. Truth is
where it came to rest: `stable_pose_R` and `theta_deg` then are no stable pose of the table's, and
`lies_on` has the numbers of the objects below. `free_share` is as for touching parts: nothing lies
before or behind that share of an outline.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pybullet
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from shapely import Polygon
from trace_placing import MAX_TRIES, NoRoomError, Part, Placed
from trace_touching import Piece, drawn, join, shown

from controller.imaging import Camera

Array = NDArray[np.float64]

LYING_SHARE = 0.5  # of the parts after the first; the others touch
OVERLAP = (0.05, 0.30)  # of the smaller of two shadows, from straight above
MAX_TILT_RAD = np.radians(25.0)  # parts on edge beside a tall one are left out
MOST_PARTS = 6
LAID_TRIES = 6  # with other parts, before one is taken that touches only
MM_PER_UNIT = 10.0  # Bullet is made for things of about a unit's size
GRAVITY = -981.0  # cm / s2
STEP_S = 1.0 / 480.0
MOST_STEPS = 1200
STILL = 2e-3  # cm / s and rad / s
FRICTION = 0.4
MARGIN = 1e-3  # units; Bullet would keep hulls 0.4 units apart
DROP_MM = 0.5
CONTACT_MM = 0.3


def put_overlapping(
    known: Sequence[Part],
    unknown: Sequence[Part],
    camera: Camera,
    rng: np.random.Generator,
) -> tuple[str, list[Placed]]:
    """Return the picture's kind (overlapping) and what lies on the table.

    Parameters
    ----------
    known : parts of the catalogue
    unknown : others; where there are any, about every fifth picture has one among its parts
    camera : whose picture shows all of them
    rng : what chance draws from

    Raises
    ------
    NoRoomError : no arrangement was found that the picture shows
    """
    for _ in range(MAX_TRIES):
        count = int(rng.integers(2, MOST_PARTS + 1))
        stranger = int(rng.integers(count)) if unknown and rng.random() < 0.2 else -1
        pieces: list[Piece] = []
        for number in range(count):
            pool = unknown if number == stranger else known
            is_laid = number > 0 and rng.random() < LYING_SHARE
            for _ in range(LAID_TRIES if is_laid else 1):
                piece = drawn(pool[int(rng.integers(len(pool)))], number != stranger, rng)
                towards = join(pieces, piece, rng)
                piece = pieces.pop()  # `join` may have turned it
                fallen = _laid_over(piece, pieces, towards, rng) if is_laid else None
                if fallen is not None:
                    piece = fallen
                    break
            pieces.append(piece)
        if any("lies_on" in piece.words for piece in pieces):
            placed = shown(pieces, False, camera, rng)
            if placed:
                return "overlapping", placed
    raise NoRoomError("no overlapping parts found that the picture shows")


def _laid_over(
    piece: Piece, others: Sequence[Piece], towards: Array, rng: np.random.Generator
) -> Piece | None:
    """Return a piece that touches others, moved on over them and let fall; None if it slid off."""
    wanted = rng.uniform(*OVERLAP)
    start = piece.at.copy()
    low, high = 0.0, float(np.ptp(np.concatenate(piece.loops), axis=0).max())
    for _ in range(12):
        far = 0.5 * (low + high)
        piece.at = start + far * towards
        low, high = (far, high) if overlap(piece, others) < wanted else (low, far)
    fallen = settled(piece, others)
    if fallen is None or not OVERLAP[0] / 2 <= overlap(fallen, others) <= OVERLAP[1]:
        return None
    return fallen


def overlap(piece: Piece, others: Sequence[Piece]) -> float:
    """Return the largest share of the smaller of two shadows that a piece and another have both."""
    mine = _shadow(piece)
    shares = [0.0]
    for other in others:
        theirs = _shadow(other)
        shares.append(mine.intersection(theirs).area / min(mine.area, theirs.area))
    return max(shares)


def _shadow(piece: Piece) -> Polygon:
    rings = sorted((loop + piece.at for loop in piece.loops), key=lambda r: -Polygon(r).area)
    return Polygon(rings[0], rings[1:]).buffer(0)


def settled(piece: Piece, others: Sequence[Piece]) -> Piece | None:
    """Return a piece where it comes to rest on others that stand still; None if on none of them.

    Parameters
    ----------
    piece : that falls, from above where it is
    others : that stand
    """
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, GRAVITY, physicsClientId=client)
        pybullet.setTimeStep(STEP_S, physicsClientId=client)
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        bodies = [pybullet.createMultiBody(0, plane, physicsClientId=client)]
        bodies += [_standing(other, client) for other in others]
        top = max(float(one.points_mm[:, 2].max()) for one in others)
        body = _falling(piece, top + DROP_MM, client)
        for one in [*bodies, body]:
            pybullet.changeDynamics(
                one, -1, lateralFriction=FRICTION, restitution=0.0, collisionMargin=MARGIN,
                physicsClientId=client,
            )  # fmt: skip
        if not _comes_to_rest(body, client):
            return None
        at, quat_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
        turned = np.array(pybullet.getMatrixFromQuaternion(quat_xyzw)).reshape(3, 3)
        below = tuple(
            k
            for k, one in enumerate(bodies[1:])
            if pybullet.getClosestPoints(
                body, one, CONTACT_MM / MM_PER_UNIT, physicsClientId=client
            )
        )
    finally:
        pybullet.disconnect(client)
    tilt = float(np.arccos(np.clip(turned[2, 2], -1.0, 1.0)))
    if not below or tilt > MAX_TILT_RAD:
        return None
    return piece.moved(turned, np.array(at) * MM_PER_UNIT, below)


def _standing(piece: Piece, client: int) -> int:
    faces = np.asarray(piece.part.solid.mesh.faces).ravel().tolist()
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_MESH,
        vertices=(piece.points_mm / MM_PER_UNIT).tolist(),
        indices=faces,
        flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
        physicsClientId=client,
    )
    return int(pybullet.createMultiBody(0, shape, physicsClientId=client))


def _falling(piece: Piece, lowest_mm: float, client: int) -> int:
    hull = piece.upright[ConvexHull(piece.upright).vertices]
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_MESH, vertices=(hull / MM_PER_UNIT).tolist(), physicsClientId=client
    )
    height = lowest_mm - float(piece.upright[:, 2].min())
    at = np.array([*piece.at, height]) / MM_PER_UNIT
    return int(pybullet.createMultiBody(0.1, shape, basePosition=at, physicsClientId=client))


def _comes_to_rest(body: int, client: int) -> bool:
    for step in range(MOST_STEPS):
        pybullet.stepSimulation(physicsClientId=client)
        if step % 20 == 19:
            speed, spin = pybullet.getBaseVelocity(body, physicsClientId=client)
            if step > 240 and max(np.abs([*speed, *spin])) < STILL:
                return True
    return False
