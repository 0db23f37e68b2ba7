"""CAD files of other parts than a good specimen: its mirror image, another revision, a like one."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trace_held_defects import NoPlaceError, mesh_of, pick, told_words
from trace_held_parts import FAMILIES, NOMINAL_SAG_MM, drawn, placed
from twisted_good import Good, Twist, extents, part_of

Array = NDArray[np.float64]
Body = Any  # manifold3d's solid
Words = dict[str, Any]

SAME_SHARE = 0.002  # of the volume; solids that differ by less are the same
SAME_MOMENT = 0.03  # moments of inertia that differ by less leave the axes open
TURN_STEP_DEG = 5.0  # where axes are open; the best turns are refined
SIZE_SHARE = 0.2  # by which boxes of parts of about the same size differ
TRY_COUNT = 40


def _middle(body: Body) -> Array:
    return np.asarray(np.array(body.bounding_box()).reshape(2, 3).mean(axis=0))


def mirrored(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file is mirrored across a plane through the middle of its box.

    Raises
    ------
    NoPlaceError : the part is its own mirror image, turned or not
    """
    c, n = _middle(good.body), np.eye(3)[int(rng.integers(3))]
    body = good.body.translate(-c).mirror(n.tolist()).translate(c)
    if not is_handed(good.part.name):
        raise NoPlaceError("its own mirror image, or that turned")
    size = float(extents(body).max())
    return Twist(body, told_words(c, size, [], across=n) | {"holes": []})


@lru_cache(maxsize=64)
def is_handed(name: str) -> bool:
    """Whether a part is another one in the mirror: no turn lays its mirror image on it.

    Mirror images across different planes are the same solid, turned; one of them decides for all.
    """
    body = part_of(name).build(sag_mm=NOMINAL_SAG_MM)
    return not is_turned(body.mirror([1.0, 0.0, 0.0]), body)


def is_turned(body: Body, other: Body, share: float = SAME_SHARE) -> bool:
    """Whether any turn and shift makes one solid of another, by what is left over of them.

    Centres of mass and principal axes are laid on each other, in all four ways of it. Where two
    moments of inertia are alike, their axes are open: then every turn about the third axis is
    tried, step by step, and the best one refined. With three alike, all turns of a cube.

    Parameters
    ----------
    body, other : solids
    share : of the volume of `other`; less than that left over is the same
    """
    first, second = _principal(body), _principal(other)
    if abs(body.volume() / other.volume() - 1) > share:
        return False
    limit = share * other.volume()

    def left(R: Array) -> float:
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = second[0] - R @ first[0]
        return 2 * float((placed(body, T) - other).volume())  # volumes are alike

    near = 50 * limit  # a turn that leaves more is not the right one, refined or not
    return any(
        now < limit or (now < near and _refined(left, R) < limit)
        for R in _turns(first, second, left)
        for now in (left(R),)
    )


def _principal(body: Body) -> tuple[Array, Array, Array]:
    """Return centre of mass, principal moments in rising order, axes as columns."""
    mesh = mesh_of(body)
    moments, axes = np.linalg.eigh(mesh.moment_inertia)
    return np.asarray(mesh.center_mass), moments, axes


def _turns(
    first: tuple[Array, Array, Array], second: tuple[Array, Array, Array],
    left: Callable[[Array], float],
) -> list[Array]:  # fmt: skip
    """Return the rotations that may lay the first solid on the second."""
    if np.abs(first[1] / second[1] - 1).max() > SAME_MOMENT:
        return []
    flips = [np.diag([a, b, c]) for a in (1, -1) for b in (1, -1) for c in (1, -1)]
    m = second[1]
    alike = [bool(m[1] / m[0] - 1 < SAME_MOMENT), bool(m[2] / m[1] - 1 < SAME_MOMENT)]
    laid = [second[2] @ f @ first[2].T for f in flips]
    laid = [R for R in laid if np.linalg.det(R) > 0]
    if not any(alike):
        return laid
    if all(alike):
        cube = [np.eye(3)[list(p)] @ f for p in _ORDERS for f in flips]
        return [R for R in (second[2] @ C @ first[2].T for C in cube) if np.linalg.det(R) > 0]
    axis = second[2][:, 2 if alike[0] else 0]
    out = []
    for R in laid:
        angles = np.arange(0, 360, TURN_STEP_DEG)
        scores = [left(_about(axis, a) @ R) for a in angles]
        # the best few of the coarse turns, each refined later
        out += [_about(axis, angles[i]) @ R for i in np.argsort(scores)[:4]]
    return out


_ORDERS = ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2))


def _about(axis: Array, degrees: float) -> Array:
    T = trimesh.transformations.rotation_matrix(np.radians(degrees), axis)
    return np.asarray(T[:3, :3])


def _refined(left: Callable[[Array], float], R: Array) -> float:
    """Return what is left over at the best turn near another one."""
    best = left(R)
    for step in (2.0, 0.8, 0.3, 0.1):
        for axis in np.eye(3):
            for sign in (-1, 1):
                while (now := left(_about(axis, sign * step) @ R)) < best - 1e-9:
                    best, R = now, _about(axis, sign * step) @ R
    return best


def wrong_revision(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file is of another revision of the same family: every size a little different."""
    family, _, number = good.part.name.rpartition("_")
    if family not in FAMILIES or not number.isdigit():  # a file may be named like a family
        raise NoPlaceError("no other revision")
    for _ in range(TRY_COUNT):
        other = drawn(family, int(number) + int(rng.integers(1, 1_000_000)) * 10_000)
        body = other.build(sag_mm=NOMINAL_SAG_MM)
        if np.abs(extents(body) / extents(good.body) - 1).max() < SIZE_SHARE / 2:
            return _other(good, body, other.name)
    raise NoPlaceError("no revision of about the same size")


def wrong_part(good: Good, rng: np.random.Generator) -> Twist:
    """The CAD file is of another part of the folder, of about the same size."""
    sizes = extents(good.body)
    fits = []
    for name, body in sorted(good.others.items()):
        sizes_there = extents(body)
        R = np.zeros((3, 3))
        R[np.argsort(sizes), np.argsort(sizes_there)] = 1.0
        R[:, 0] *= np.linalg.det(R)  # no mirror image
        off = np.sort(sizes_there) / np.sort(sizes) - 1
        if name != good.part.name and np.abs(off).max() < SIZE_SHARE:
            T = np.eye(4)
            T[:3, :3] = R
            fits.append((name, placed(body, T)))
    name, body = pick(fits, rng)
    return _other(good, body, name)


def _other(good: Good, body: Body, name: str) -> Twist:
    body = body.translate(_middle(good.body) - _middle(body))
    same = (body - good.body).volume() + (good.body - body).volume()
    if same < 0.02 * good.body.volume():
        raise NoPlaceError("too much alike")
    size = float(extents(body).max())
    return Twist(body, told_words(_middle(body), size, []) | {"holes": [], "other": name})
