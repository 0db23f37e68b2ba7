"""Robustness of a grasp against errors of the part's pose.

Flat pads turn a part until its walls lie against them, so a wrong pose is first closed on, then
turned by the walls' normals, and judged as any grasp (planning-facts.md 2.2, step 6; 5).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import BoolArray, FloatArray

from ..model import GraspRules, Jaw
from .contact import Contacts, PadGrid
from .judge import Judge
from .seeds import across

COARSE_STEP_MM = 4.0  # ray spacing of the first closing, which only shows how the part will turn
MAX_TURN_RAD = float(np.radians(5.0))  # pads turn a part by little more than its pose was wrong
MAX_SLIDE_MM = 2.0
LATTICE_COUNT = 3
# signs by which a lift of one pad's wall lowers the other's
SIDES = np.array([1.0, -1.0])[:, None, None, None]


def wrong_poses(rules: GraspRules, down: FloatArray | None = None) -> FloatArray:
    """Return `wrong_count` pose errors (n, 4, 4), evenly over +-wrong_mm and +-wrong_deg.

    An additive recurrence whose steps are powers of a generalised golden ratio: no random numbers,
    and any number of them fills the six dimensions evenly.

    Parameters
    ----------
    rules : number of poses, and their offsets
    down : (3,) direction down for a part on a table, whose height and tilt are then right
    """
    ratio = 1.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / 7.0)
    step = ratio ** -np.arange(1.0, 7.0)
    unit = 2 * ((0.5 + np.outer(np.arange(1, rules.wrong_count + 1), step)) % 1.0) - 1
    shift, turn = unit[:, :3] * rules.wrong_mm, unit[:, 3:] * np.radians(rules.wrong_deg)
    if down is not None:
        u, v = across(down)
        shift = np.outer(shift[:, 0], u) + np.outer(shift[:, 1], v)
        turn = np.outer(turn[:, 2], down)
    T = np.tile(np.eye(4), (rules.wrong_count, 1, 1))
    T[:, :3, 3] = shift
    T[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix()
    return T


def margins(
    judge: Judge,
    found: Contacts,
    inner: BoolArray,
    down: FloatArray | None = None,
    contact_mm2: float | None = None,
) -> FloatArray:
    """Return the share of wrong poses in which each grasp holds (n,).

    The part is turned about its centre of mass, by which its pose is measured. A little more than
    half of the contact is enough: a contact at a wrong pose still holds. Flat walls need one turn
    until they lie flat, a bore against its rim two; a part that slips is tried last.

    Parameters
    ----------
    judge : the part, the jaw and the rules
    found : n contacts, closed at the pose expected
    inner : (n,) the pads are the fingers' backs
    down : as in `wrong_poses`
    contact_mm2 : least contact of either pad at a wrong pose; None for that of two lines
    """
    least_mm2 = judge.rules.min_line_contact_mm2 if contact_mm2 is None else contact_mm2
    rules, jaw, centroid_mm = judge.rules, judge.jaw, judge.solid.centroid_mm
    wrong = wrong_poses(rules, down)
    n, k = len(found.T), len(wrong)
    if n == 0 or k == 0:
        return np.ones(n)
    T = np.tile(np.eye(4), (n * k, 1, 1))
    R = np.einsum("kij,njl->nkil", wrong[:, :3, :3], found.T[:, :3, :3])
    t = np.einsum("kij,nj->nki", wrong[:, :3, :3], found.T[:, :3, 3] - centroid_mm)
    T[:, :3, :3] = R.reshape(-1, 3, 3)
    T[:, :3, 3] = (t + centroid_mm + wrong[:, :3, 3]).reshape(-1, 3)
    which = np.repeat(np.arange(n), k)
    held = np.zeros(n * k, dtype=bool)
    # on a table the rim of a thin part is all there is: coarser rays would pass over it
    look = PadGrid.of(jaw, COARSE_STEP_MM) if down is None else judge.coarse
    rows = np.arange(n * k)
    for settle in (flattened, flattened, slid_home, None):
        at = which[rows]
        touched = judge.close(T, found.opening[at], inner[at], look, slopes=settle is not None)
        if look is judge.coarse:
            held[rows] = judge.holds(touched, inner[at], least_mm2)
        if settle is None:
            break
        open_ = np.flatnonzero(touched.touched & ~held[rows])
        T = settle(touched.take(open_), inner[at[open_]], jaw, look)
        rows, look = rows[open_], judge.coarse
    return np.asarray(held.reshape(n, k).mean(axis=1))


def flattened(touched: Contacts, inner: BoolArray, jaw: Jaw, grid: PadGrid) -> FloatArray:
    """Return T_part_tcp (n, 4, 4) after the closing pads have turned the part to rest on them.

    The part turns about the approach and about the pads' third axis as far as that brings the pads
    nearer to each other, and no farther than `MAX_TURN_RAD`. For small turns a point of the wall
    comes nearer in proportion to where on the pad it lies, and to how steep the wall is that the
    turn shifts along the pad.

    Parameters
    ----------
    touched : n contacts, with their gradients
    inner : (n,) the pads are the fingers' backs
    jaw : knows where on its fingers the pads are
    grid : the rays they were closed with
    """
    T, n = touched.T, len(touched.T)
    sense = np.where(inner, -1.0, 1.0)
    lever = (sense * touched.opening / 2)[:, None, None]
    points = grid.points + np.array([jaw.pad_centre_mm, 0.0])
    rise = points + lever * touched.gradient  # (2, n, m, 2)
    slope = _least_width(touched, rise * SIDES, np.tan(MAX_TURN_RAD))
    turned = np.zeros((n, 3))
    turned[:, 2], turned[:, 0] = slope[:, 0] * sense, -slope[:, 1] * sense
    pivot = T[:, :3, 3] - T[:, :3, 0] * jaw.pad_centre_mm
    out = T.copy()
    # the part turns in the gripper, so the gripper turns the other way in the part
    out[:, :3, :3] = T[:, :3, :3] @ Rotation.from_rotvec(-turned).as_matrix()
    out[:, :3, 3] = pivot + out[:, :3, 0] * jaw.pad_centre_mm
    return out


def slid_home(touched: Contacts, inner: BoolArray, jaw: Jaw, grid: PadGrid) -> FloatArray:
    """Return T_part_tcp (n, 4, 4) after slipping pads have centred the part.

    A part that slips where its walls are hollow, as a bore, comes to lie where it slips no more.

    Parameters
    ----------
    touched : n contacts, with their gradients
    inner, jaw, grid : as in `flattened`; not used here
    """
    slide = _least_width(touched, -touched.gradient, MAX_SLIDE_MM)
    out = touched.T.copy()
    out[:, :3, 3] -= out[:, :3, 0] * slide[:, :1] + out[:, :3, 2] * slide[:, 1:]
    return out


def _least_width(touched: Contacts, rise: FloatArray, most: float) -> FloatArray:
    """Return the two amounts (n, 2) that bring both pads nearest, neither beyond `most`.

    Every height changes by its two `rise` (2, n, m, 2) times the amounts, so the width between the
    first touches is a convex function; its least is searched on ever finer lattices.
    """
    n = len(touched.T)
    low, high = touched.height.astype(np.float32)
    low_rise, high_rise = rise.astype(np.float32)
    best = np.zeros((n, 2))
    step = most / 2
    lattice = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)], dtype=float)
    # nothing first: where nothing brings them nearer, nothing moves
    lattice = lattice[np.argsort(np.abs(lattice).sum(axis=1), kind="stable")]
    for _ in range(LATTICE_COUNT):
        tried = best[:, None] + step * lattice
        width = np.empty(tried.shape[:2], dtype=np.float32)
        for k in range(len(lattice)):
            x, z = tried[:, k].T[:, :, None].astype(np.float32)
            width[:, k] = (low + x * low_rise[:, :, 0] + z * low_rise[:, :, 1]).max(axis=1)
            width[:, k] += (high + x * high_rise[:, :, 0] + z * high_rise[:, :, 1]).max(axis=1)
        best = tried[np.arange(n), np.argmin(width, axis=1)]
        step *= 0.4
    return best
