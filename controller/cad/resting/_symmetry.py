"""Symmetries: turns that leave a part unchanged, and mirror images that are another part.

The principal axes of inertia are the only candidates for axes when the three moments differ. Where
two are equal the third axis may be many-fold or of revolution, and half turns square to it are
guessed from corners that could change places; where all are equal, all from such corners. Every
guess is measured on the surface (`SymmetryMesh`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import BoolArray, FloatArray, square_to
from controller.imaging import rotation_angle

from ..solid import Solid
from ._poses import StablePose
from ._surface import SAME, SymmetryMesh, rotation_about

TOLERANCE_MM = 0.15  # bores are drawn this far off the axis of parts meant to be symmetric
EQUAL_MOMENTS = 2e-3  # share of their sum; tessellation alone makes moments of a round part differ
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61)
MAX_FOLD = 64
MAX_ANCHORS = 48  # equal corners tried as images of one
RETRY = 0.01
SAME_POSE_RAD = np.radians(1.5)
ODD_ANGLES_RAD = (0.7, 1.9, 2.6)  # angles that are no division of a round part
LARGEST_GROUP = 400


@dataclass(frozen=True, eq=False, slots=True)
class PartSymmetry:
    """The turns about its centre of mass that leave a part unchanged.

    Attributes
    ----------
    rotations : (k, 3, 3) in the CAD frame's axes, the identity first; of a part of revolution only
        those that do not follow from its axis
    axis : (3,) axis of revolution, CAD frame, or None
    is_ball : any turn leaves it as it is
    mirror : (3, 3) a reflection, or a reflection and a turn, that leaves it as it is; None if the
        part is chiral
    """

    rotations: FloatArray
    axis: FloatArray | None
    is_ball: bool
    mirror: FloatArray | None

    def related(self, a: FloatArray, b: FloatArray, within_rad: float = SAME_POSE_RAD) -> bool:
        """Return True if a symmetry carries one direction of the part to another.

        Parameters
        ----------
        a, b : (3,) unit, CAD frame
        within_rad : angle between the image of ``a`` and ``b`` below which they are one
        """
        if self.is_ball:
            return True
        images = self.rotations @ a
        if self.axis is not None:
            tilt = np.arccos(np.clip(images @ self.axis, -1, 1))
            other = np.arccos(np.clip(b @ self.axis, -1, 1))
            return bool(np.abs(tilt - other).min() < within_rad)
        return bool((images @ b).max() > np.cos(within_rad))


def part_symmetries(
    solid: Solid, tolerance_mm: float = TOLERANCE_MM, centre_of_mass_mm: FloatArray | None = None
) -> PartSymmetry:
    """Return the symmetries of a solid.

    Parameters
    ----------
    solid : any
    tolerance_mm : points that match this well, chords of curves allowed for, are the same
    centre_of_mass_mm : (3,) centre of mass of a part that is not of one density: symmetries that
        move it are none
    """
    surface = SymmetryMesh(solid.mesh, solid.centroid_mm, tolerance_mm)
    inertia = np.asarray(solid.mesh.moment_inertia, dtype=np.float64)
    moments, axes = np.linalg.eigh(inertia / np.trace(inertia))
    low, high = moments[1] - moments[0], moments[2] - moments[1]
    reach = float(np.linalg.norm(surface.vertices, axis=1).max())
    if low < EQUAL_MOMENTS and high < EQUAL_MOMENTS:
        turns = [rotation_about(a * v) for a in ODD_ANGLES_RAD[:2] for v in np.eye(3)]
        if all(surface.maps_to_itself(R) for R in turns):
            return PartSymmetry(np.eye(3)[None], None, is_ball=True, mirror=-np.eye(3))
    axis = axes[:, 0] if low >= high else axes[:, 2]  # the one that differs most
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    alike = min(low, high) < EQUAL_MOMENTS
    revolved = alike and all(
        surface.maps_to_itself(rotation_about(angle * axis)) for angle in ODD_ANGLES_RAD
    )
    proper, improper = [np.eye(3)], []
    guesses = list(_half_turns(axes))
    if revolved:
        side = square_to(axis)[0]
        guesses = [rotation_about(np.pi * side)]
        improper.append(np.eye(3) - 2 * np.outer(side, side))  # any plane through the axis
    elif alike:
        guesses += _many_fold(surface, axis)
        guesses += list(_corner_turns(surface, axis, reach))
        if max(low, high) < EQUAL_MOMENTS:
            guesses += list(_corner_pairs(surface, reach))
    order = (
        2 * _order(guesses, axis)
        if alike and not revolved and max(low, high) >= EQUAL_MOMENTS
        else LARGEST_GROUP
    )
    _try(surface, [g for g in guesses if np.linalg.det(g) > 0], proper, order)
    if not improper:
        mirrored = [-g for g in _half_turns(axes)] + [-np.eye(3)]
        mirrored += [g for g in guesses if np.linalg.det(g) < 0]
        _try(surface, mirrored, improper, 1)
    offset = np.zeros(3)
    if centre_of_mass_mm is not None:
        offset = np.asarray(centre_of_mass_mm, dtype=np.float64) - solid.centroid_mm
    keeps = [R for R in proper if np.linalg.norm(R @ offset - offset) <= tolerance_mm]
    along = axis if revolved else None
    if along is not None and np.linalg.norm(offset - (offset @ along) * along) > tolerance_mm:
        along = None
    return PartSymmetry(np.array(keeps), along, is_ball=False, mirror=next(iter(improper), None))


def _try(
    surface: SymmetryMesh, guesses: list[FloatArray], found: list[FloatArray], enough: int
) -> None:
    """Add the guesses that hold to ``found``; rotations with all their products."""
    wrong = np.zeros((0, 3, 3))
    for guess in guesses:
        if len(found) >= enough:
            return
        if any(_same(guess, known) for known in found):
            continue
        if len(wrong) and np.linalg.norm(wrong - guess, axis=(1, 2)).min() < RETRY:
            continue  # fitting led that one nowhere new either
        R = surface.matched(guess, np.array(found) if found else None)
        if R is None:
            wrong = np.concatenate([wrong, guess[None]])
            continue
        found.append(R)
        if np.linalg.det(R) > 0:
            found[:] = _closed(found)


def name_duplicates(poses: Sequence[StablePose], symmetry: PartSymmetry) -> tuple[StablePose, ...]:
    """Return the poses with `same_as` set to the first pose equivalent by symmetry."""
    named: list[StablePose] = []
    for pose in poses:
        first = next(
            (
                p.index
                for p in named
                if p.same_as == p.index
                and p.rolling == pose.rolling
                and symmetry.related(-p.R[2], -pose.R[2])
            ),
            pose.index,
        )
        named.append(replace(pose, same_as=first))
    return tuple(named)


def _half_turns(axes: FloatArray) -> Iterator[FloatArray]:
    for i in range(3):
        yield 2 * np.outer(axes[:, i], axes[:, i]) - np.eye(3)


def _many_fold(surface: SymmetryMesh, axis: FloatArray) -> list[FloatArray]:
    """Return the smallest turn about an axis that leaves the part unchanged, None without one."""
    order = 1
    for prime in PRIMES:
        power = prime
        while power <= MAX_FOLD and _holds(surface, 2 * np.pi / power * axis):
            power *= prime
        order *= power // prime
    return [rotation_about(2 * np.pi / order * axis)] if order > 1 else []


def _order(guesses: list[FloatArray], axis: FloatArray) -> int:
    """Return the order of an axis of symmetry, from the smallest turn about it among rotations."""
    turns = [g for g in guesses if np.linalg.det(g) > 0 and np.linalg.norm(g @ axis - axis) < 1e-9]
    angles = [rotation_angle(g) for g in turns]
    return max((round(2 * np.pi / a) for a in angles if a > 1e-6), default=1)


def _holds(surface: SymmetryMesh, turn: FloatArray) -> bool:
    guess = rotation_about(turn)
    R = surface.matched(guess, np.eye(3)[None])
    return R is not None and _same(guess, R)


def _corner_turns(surface: SymmetryMesh, axis: FloatArray, reach: float) -> Iterator[FloatArray]:
    """Guess half turns square to an axis, planes through it, and turned reflections along it."""
    e1, e2 = square_to(axis)
    points = surface.vertices
    x, y, z = points @ e1, points @ e2, points @ axis
    r, turn = np.hypot(x, y), np.arctan2(y, x)
    near = surface.corner_mm
    for anchor in _rare(np.column_stack([r, np.abs(z)]), r > 0.2 * reach, near):
        alike = np.abs(r - r[anchor]) < near
        for sense in (-1.0, 1.0):
            partners = np.flatnonzero(alike & (np.abs(z - sense * z[anchor]) < near))
            for partner in partners[:MAX_ANCHORS]:
                half = (turn[anchor] + turn[partner]) / 2
                side = np.cos(half) * e1 + np.sin(half) * e2
                if sense < 0:
                    yield 2 * np.outer(side, side) - np.eye(3)
                    ahead = turn[partner] - turn[anchor]
                    yield rotation_about(ahead * axis) @ (np.eye(3) - 2 * np.outer(axis, axis))
                else:
                    across = np.cross(axis, side)
                    yield np.eye(3) - 2 * np.outer(across, across)


def _corner_pairs(surface: SymmetryMesh, reach: float) -> Iterator[FloatArray]:
    """Guess turns and reflections that carry two corners to two others at the same distances."""
    points = surface.vertices
    r = np.linalg.norm(points, axis=1)
    near = surface.corner_mm
    for first in _rare(r[:, None], r > 0.5 * reach, near)[:1]:
        alike = np.flatnonzero(np.abs(r - r[first]) < near)[:MAX_ANCHORS]
        p = points[first]
        cosine = points[alike] @ p / (r[alike] * r[first])
        good = alike[np.abs(cosine) < 0.9]
        if not len(good):
            continue
        q = points[good[np.argmax(np.abs(cosine[np.abs(cosine) < 0.9]))]]
        angle_dot = p @ q
        frame = _frame(p, q)
        for i in alike:
            for j in alike:
                a, b = points[i], points[j]
                if i != j and abs(a @ b - angle_dot) < near * 2 * reach:
                    image = _frame(a, b)
                    yield image @ frame.T
                    image = image.copy()
                    image[:, 2] *= -1
                    yield image @ frame.T


def _rare(keys: FloatArray, wanted: BoolArray, near: float) -> list[int]:
    """Return up to three points whose kind, by keys (n, m) equal within ``near``, is rare."""
    ids = np.flatnonzero(wanted)
    if not len(ids):
        return []
    bins = np.round(keys[ids] / near).astype(np.int64)
    _, first, count = np.unique(bins, axis=0, return_index=True, return_counts=True)
    order = np.argsort(count, kind="stable")[:3]
    return [int(ids[i]) for i in first[order]]


def _closed(found: list[FloatArray]) -> list[FloatArray]:
    """Return all products of rotations, each once."""
    group = list(found)
    grown = True
    while grown and len(group) < LARGEST_GROUP:
        grown = False
        stack = np.array(group)
        for R in list(group):
            products = np.einsum("ij,njk->nik", R, stack)
            gaps = np.linalg.norm(products[:, None] - np.array(group)[None], axis=(2, 3))
            for product, gap in zip(products, gaps.min(axis=1), strict=True):
                if gap > SAME and not any(_same(product, known) for known in group):
                    group.append(product)
                    grown = True
    return group


def _same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.linalg.norm(a - b) < SAME)


def _frame(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the right-handed frame (3, 3) whose first axis is along a and second near b."""
    e1 = a / np.linalg.norm(a)
    e2 = b - (b @ e1) * e1
    e2 /= np.linalg.norm(e2)
    return np.column_stack([e1, e2, np.cross(e1, e2)])
