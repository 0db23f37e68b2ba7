"""Forward and inverse kinematics of the arm: closed form, no I/O.

Joints are rows q = [shoulder, elbow, yaw, zed, pitch, roll]: shoulder, elbow and the yaw MOTOR's
angle, pitch and roll in rad, zed in mm (0 at the top stop, negative downwards). Frames (§6.2):
`arm` has its origin on the table plane under the shoulder axis, x straight ahead, y left, z up;
`tcp` has its origin between the finger tips, x along the approach axis, and the jaws open along y.
Everything is vectorised over leading dimensions. Sections (§) are those of umi_rtx.md.

Joints are those of the counters. The true joints of an arm follow from its measured `ArmGeometry`:
zeros, coupling and sag lie between motors and joints, where no counter sees them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from messages import key

from ..protocol import constants as c
from .limits import COUNTS_ORDER, limit_margins, worst_violation

__all__ = [
    "COUNTS_ORDER",
    "HEADINGS_RAD",
    "JOINT_RANGES",
    "LINKS",
    "Q_ORDER",
    "ArmGeometry",
    "counts_to_q",
    "forward",
    "inverse",
    "inverse_legal",
    "joints_moved_by",
    "limit_report",
    "link_frames",
    "q_to_counts",
    "within_limits",
]

Floats = NDArray[np.float64]

Q_ORDER: Final = ("shoulder_rad", "elbow_rad", "yaw_rad", "zed_mm", "pitch_rad", "roll_rad")
HEADINGS_RAD: Final = np.deg2rad(np.arange(-180.0, 180.0, 15.0))  # tried if the heading is free
LINKS: Final = ("carriage", "upper", "fore")

_SHOULDER, _ELBOW, _YAW, _ZED, _PITCH, _ROLL = range(6)
_REACH_SLACK_MM: Final = 1e-9  # rounding allowance: a fully stretched arm stays reachable
_GIMBAL_RAD: Final = 1e-10  # pitch closer to +-90 deg than this leaves the heading undetermined
# §5.2: ranges short of a full turn but not centred on 0; the image nearest to the centre is the one
_ROLL_CENTRE_RAD: Final = np.deg2rad((-132.0 + 181.0) / 2)
_ELBOW_CENTRE_RAD: Final = np.deg2rad((-180.0 + 151.0) / 2)

# allowance of a first check of limits, wider by more than a count and than the differences between
# joints and counters; `within_limits` decides (§5.2)
_ROUGH_RAD: Final = 0.06
_ROUGH_MM: Final = 5.0
_WRIST_PER_RAD: Final = np.rad2deg(2 * c.WRIST_COUNTS_PER_DEG)
_SHOULDER_RAD: Final = np.array(c.SHOULDER_RANGE) / np.rad2deg(c.SHOULDER_COUNTS_PER_DEG)
_ELBOW_RAD: Final = np.array(c.ELBOW_RANGE) / np.rad2deg(c.ELBOW_COUNTS_PER_DEG)
_WRIST_YAW_RAD: Final = np.array(c.YAW_LESS_ELBOW_RANGE) / np.rad2deg(c.YAW_COUNTS_PER_DEG)
_PITCH_RAD: Final = np.array(c.WRIST_SUM_RANGE) / _WRIST_PER_RAD
_ROLL_RAD: Final = np.array(c.WRIST_DIFFERENCE_RANGE) / _WRIST_PER_RAD
_ZED_MM: Final = np.array(c.ZED_RANGE) / c.ZED_COUNTS_PER_MM
# the yaw motor's angle is the gripper's to the forearm plus the elbow's share by the belt (§5.4)
_YAW_RAD: Final = (
    np.array(c.YAW_LESS_ELBOW_RANGE) + float(c.YAW_ELBOW_RATIO) * np.array(c.ELBOW_RANGE)
) / np.rad2deg(c.YAW_COUNTS_PER_DEG)
# (2, 6): lower and upper limit of each joint within §5.2
JOINT_RANGES: Final = np.stack(
    [_SHOULDER_RAD, _ELBOW_RAD, _YAW_RAD, _ZED_MM, _PITCH_RAD, _ROLL_RAD], axis=1
)

# counts = q @ _COUNTS_PER_Q in COUNTS_ORDER (§5.1, §5.3)
_COUNTS_PER_Q: Final = np.zeros((6, 6))
_COUNTS_PER_Q[_ELBOW, 0] = np.rad2deg(c.ELBOW_COUNTS_PER_DEG)
_COUNTS_PER_Q[_SHOULDER, 1] = np.rad2deg(c.SHOULDER_COUNTS_PER_DEG)
_COUNTS_PER_Q[_ZED, 2] = c.ZED_COUNTS_PER_MM
_COUNTS_PER_Q[_PITCH, 3:5] = np.rad2deg(c.WRIST_COUNTS_PER_DEG)
_COUNTS_PER_Q[_ROLL, 3:5] = np.rad2deg(c.WRIST_COUNTS_PER_DEG) * np.array([1.0, -1.0])
_COUNTS_PER_Q[_YAW, 5] = np.rad2deg(c.YAW_COUNTS_PER_DEG)
_Q_PER_COUNT: Final = np.linalg.inv(_COUNTS_PER_Q)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmGeometry:
    """One arm: its lengths (§6.1) [mm], and its joints' differences from its counters.

    All differences are 0 until they have been measured on the arm itself.

    Attributes
    ----------
    upper_mm, fore_mm : shoulder axis to elbow axis, elbow axis to wrist centre
    tool_mm : wrist centre to TCP, along the approach axis
    wrist_height_mm : wrist centre above the table at zed 0
    tool_off_mm : offset of the TCP from the approach axis, along the jaws' axis and across
    zero_rad : angles of shoulder, elbow, yaw, pitch, roll at which their counters mean 0
    zed_zero_mm : the same of zed
    yaw_per_elbow : heading that a turn of the elbow adds to the nominal half of it
    sag_mm : by how much the stretched arm hangs lower; less as the elbow folds, with the square of
        the reach
    """

    upper_mm: float = 253.5
    fore_mm: float = 253.5
    tool_mm: float = 177.0
    wrist_height_mm: float = 915.0
    tool_off_mm: tuple[float, float] = (0.0, 0.0)
    zero_rad: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    zed_zero_mm: float = 0.0
    yaw_per_elbow: float = 0.0
    sag_mm: float = 0.0

    def __post_init__(self) -> None:
        if not (self.upper_mm > 0 and self.fore_mm > 0 and self.tool_mm >= 0):
            raise ValueError(f"lengths must be positive: {self}")

    def from_counters(self, q: Floats) -> Floats:
        """Return the true joints (..., 6) for joints ``q`` by the counters."""
        true = q + self._zeros
        true[..., _YAW] += self.yaw_per_elbow * true[..., _ELBOW]
        true[..., _ZED] -= self._sag_mm(true[..., _ELBOW])
        return true

    def to_counters(self, true: Floats) -> Floats:
        """Return the joints by the counters for true joints (..., 6)."""
        q = true - self._zeros
        q[..., _YAW] -= self.yaw_per_elbow * true[..., _ELBOW]
        q[..., _ZED] += self._sag_mm(true[..., _ELBOW])
        return q

    @property
    def _zeros(self) -> Floats:
        shoulder, elbow, yaw, pitch, roll = self.zero_rad
        return np.array([shoulder, elbow, yaw, self.zed_zero_mm, pitch, roll])

    def _sag_mm(self, elbow_rad: Floats) -> Floats:
        return np.asarray(self.sag_mm * np.cos(elbow_rad / 2.0) ** 2)

    def wrist_target(self, T_arm_tcp: Floats) -> Floats:
        """Return the poses of a TCP on the approach axis, for TCP poses (..., 4, 4)."""
        if self.tool_off_mm == (0.0, 0.0):
            return T_arm_tcp
        pose = T_arm_tcp.copy()
        pose[..., :3, 3] -= pose[..., :3, 1:3] @ np.array(self.tool_off_mm)
        return pose


_DEFAULT: Final = ArmGeometry()


def _wrap(angle_rad: Floats) -> Floats:
    """Return the image of an angle in [-pi, pi)."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


# ---- counts ------------------------------------------------------------------------------------
def q_to_counts(q: ArrayLike) -> NDArray[np.int64]:
    """Return the whole counts nearest to joints (§5.1, §5.3).

    Parameters
    ----------
    q : (..., 6) joints, finite

    Returns
    -------
    (..., 6) counts in COUNTS_ORDER: elbow, shoulder, zed, wrist 1, wrist 2, yaw

    Raises
    ------
    ValueError : a joint is NaN or infinite
    """
    joints = np.asarray(q, dtype=np.float64)
    if not np.isfinite(joints).all():
        raise ValueError("joints without a pose have no counts")
    return np.rint(joints @ _COUNTS_PER_Q).astype(np.int64)


def counts_to_q(counts: ArrayLike) -> Floats:
    """Return the joints (..., 6) of counts (..., 6) in COUNTS_ORDER (§6.3)."""
    return np.asarray(counts, dtype=np.float64) @ _Q_PER_COUNT


def joints_moved_by(axes: Iterable[c.Axis]) -> list[int]:
    """Return the joints, as indices in `Q_ORDER`, that motors have a part in (§5.3)."""
    moved = [COUNTS_ORDER.index(axis) for axis in axes]
    return np.flatnonzero((_COUNTS_PER_Q[:, moved] != 0).any(axis=1)).tolist()


# ---- limits ------------------------------------------------------------------------------------
def within_limits(q: ArrayLike) -> NDArray[np.bool_]:
    """Return whether the arm would accept joints (..., 6): all of §5.2, on whole counts.

    Joints are rounded to counts first, so that this answer and the arm's are the same one.
    NaN is outside.
    """
    margins = limit_margins(np.rint(np.asarray(q, dtype=np.float64) @ _COUNTS_PER_Q))
    return np.asarray((margins >= 0).all(axis=-1), dtype=np.bool_)


def limit_report(q: ArrayLike) -> str:
    """Return the worst passed limit of one q (6,), and by how much; "within limits" if none is."""
    violation = worst_violation(np.rint(np.asarray(q, dtype=np.float64) @ _COUNTS_PER_Q))
    return key("within limits") if violation is None else str(violation)


# ---- forward -----------------------------------------------------------------------------------
def forward(q: ArrayLike, geometry: ArmGeometry = _DEFAULT) -> Floats:
    """Return T_arm_tcp of joints (§6.4).

    Parameters
    ----------
    q : (..., 6) joints; limits are not checked
    geometry : lengths of the arm

    Returns
    -------
    (..., 4, 4) pose of the TCP in the arm's frame [mm]
    """
    joints = geometry.from_counters(np.asarray(q, dtype=np.float64))
    shoulder, elbow, yaw, zed, pitch, roll = np.moveaxis(joints, -1, 0)
    heading = shoulder + elbow / 2 + yaw  # the yaw belt takes back half of the elbow's turn (§5.4)
    sin_h, cos_h = np.sin(heading), np.cos(heading)
    sin_p, cos_p = np.sin(pitch), np.cos(pitch)
    sin_r, cos_r = np.sin(roll), np.cos(roll)
    T_arm_tcp = np.zeros((*joints.shape[:-1], 4, 4))
    # Rz(heading) Ry(-pitch) Rx(roll)
    T_arm_tcp[..., 0, 0] = cos_h * cos_p
    T_arm_tcp[..., 1, 0] = sin_h * cos_p
    T_arm_tcp[..., 2, 0] = sin_p
    T_arm_tcp[..., 0, 1] = -cos_h * sin_p * sin_r - sin_h * cos_r
    T_arm_tcp[..., 1, 1] = -sin_h * sin_p * sin_r + cos_h * cos_r
    T_arm_tcp[..., 2, 1] = cos_p * sin_r
    T_arm_tcp[..., 0, 2] = -cos_h * sin_p * cos_r + sin_h * sin_r
    T_arm_tcp[..., 1, 2] = -sin_h * sin_p * cos_r - cos_h * sin_r
    T_arm_tcp[..., 2, 2] = cos_p * cos_r
    fore_heading = shoulder + elbow
    wrist_x = geometry.upper_mm * np.cos(shoulder) + geometry.fore_mm * np.cos(fore_heading)
    wrist_y = geometry.upper_mm * np.sin(shoulder) + geometry.fore_mm * np.sin(fore_heading)
    wrist = np.stack([wrist_x, wrist_y, geometry.wrist_height_mm + zed], axis=-1)
    tool = np.array([geometry.tool_mm, *geometry.tool_off_mm])
    T_arm_tcp[..., :3, 3] = wrist + T_arm_tcp[..., :3, :3] @ tool
    T_arm_tcp[..., 3, 3] = 1.0
    return T_arm_tcp


def link_frames(q: ArrayLike, geometry: ArmGeometry = _DEFAULT) -> tuple[Floats, Floats]:
    """Return the frames of LINKS in the arm's frame (§6.2, §6.4), all at wrist height.

    The carriage rides on the shoulder axis and does not turn; x of the upper arm and of the
    forearm runs along the link, from the shoulder axis and from the elbow axis.

    Parameters
    ----------
    q : (n, 6) joints; limits are not checked
    geometry : lengths of the arm

    Returns
    -------
    R : (n, 3, 3, 3) rotations
    origin_mm : (n, 3, 3) origins [mm]
    """
    joints = geometry.from_counters(np.asarray(q, dtype=np.float64))
    n = len(joints)
    shoulder, elbow, zed = joints[:, _SHOULDER], joints[:, _ELBOW], joints[:, _ZED]
    R = np.zeros((n, 3, 3, 3))
    R[:, :, 2, 2] = R[:, 0, 0, 0] = R[:, 0, 1, 1] = 1.0
    for link, angle in ((1, shoulder), (2, shoulder + elbow)):
        cos, sin = np.cos(angle), np.sin(angle)
        R[:, link, 0, 0] = R[:, link, 1, 1] = cos
        R[:, link, 0, 1], R[:, link, 1, 0] = -sin, sin
    origin_mm = np.zeros((n, 3, 3))
    origin_mm[:, 2, :2] = geometry.upper_mm * R[:, 1, :2, 0]
    origin_mm[:, :, 2] = (geometry.wrist_height_mm + zed)[:, None]
    return R, origin_mm


# ---- inverse -----------------------------------------------------------------------------------
def inverse(
    T_arm_tcp: ArrayLike,
    geometry: ArmGeometry = _DEFAULT,
    *,
    heading_rad: ArrayLike | None = None,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return all joints that bring the TCP to a pose (§6.5), and a mask of those the arm accepts.

    Branches are both elbow signs times the wrist's orientations. Where the heading follows from
    the pose, these are two: pitch p, and 180 deg - p with heading and roll half a turn further.
    Where the gripper points straight up or down it does not: then each of `heading_rad` is one
    branch, and roll makes up for it.

    Parameters
    ----------
    T_arm_tcp : (..., 4, 4) [mm], proper rotations
    geometry : lengths of the arm
    heading_rad : (k,) or scalar headings of the gripper [rad] to try at pitch +-90 deg;
        HEADINGS_RAD if None

    Returns
    -------
    q : (..., B, 6) joints, NaN where a branch does not exist; B = 2 max(2, k), the elbow-positive
        half first
    legal : (..., B) bool, whether the branch exists and lies within_limits
    """
    pose = geometry.wrist_target(np.asarray(T_arm_tcp, dtype=np.float64))
    free_headings = _headings(heading_rad)
    wrist_rad = _wrist_branches(pose[..., :3, :3], free_headings)  # (..., H, 3)
    elbow, shoulder, is_folded = _elbows(pose, geometry)  # (2, ...), elbow-positive first
    height = pose[..., 2, 3] - geometry.tool_mm * pose[..., 2, 0] - geometry.wrist_height_mm
    halves = [
        _row(shoulder[k][..., None], elbow[k][..., None], height[..., None], wrist_rad, is_folded)
        for k in range(2)
    ]
    q = geometry.to_counters(np.concatenate(halves, axis=-2))
    return q, within_limits(q)


def inverse_legal(
    T_arm_tcp: ArrayLike,
    geometry: ArmGeometry = _DEFAULT,
    *,
    heading_rad: ArrayLike | None = None,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the solutions that `inverse` finds legal, without the rest: a quarter of the time.

    Parameters
    ----------
    T_arm_tcp : (n, 4, 4) [mm], proper rotations
    geometry : lengths of the arm
    heading_rad : as `inverse`

    Returns
    -------
    index, branch : (m,) whose pose, and which of the branches that `inverse` numbers; in order
    q : (m, 6) joints
    """
    pose = geometry.wrist_target(np.asarray(T_arm_tcp, dtype=np.float64))
    free_headings = _headings(heading_rad)
    slot_count = max(2, len(free_headings))
    is_locked = np.hypot(pose[:, 0, 0], pose[:, 1, 0]) < _GIMBAL_RAD
    found = []
    for members, headings, own_slots in (
        (np.flatnonzero(~is_locked), free_headings[:1], 2),
        (np.flatnonzero(is_locked), free_headings, len(free_headings)),
    ):
        if len(members):
            index, half, slot, q = _legal_rows(pose[members], geometry, headings, own_slots)
            found.append((members[index], half * slot_count + slot, q))
    if not found:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 6))
    index, branch, q = (np.concatenate(part) for part in zip(*found, strict=True))
    if len(found) > 1:
        order = np.argsort(index, kind="stable")
        index, branch, q = index[order], branch[order], q[order]
    return index, branch, q


def _legal_rows(
    pose: Floats, geometry: ArmGeometry, free_headings: Floats, slot_count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return index, elbow half, slot and joints of the legal answers for poses of one kind.

    Solutions beyond the limit of one joint are dropped before the other joints are computed, with a
    small allowance; `within_limits` has the last word.
    """
    wrist_rad = _wrist_branches(pose[:, :3, :3], free_headings)[:, :slot_count]
    elbow, shoulder, is_folded = _elbows(pose, geometry)
    height = pose[:, 2, 3] - geometry.tool_mm * pose[:, 2, 0] - geometry.wrist_height_mm
    arm_ok = _roughly(elbow, _ELBOW_RAD) & (_roughly(shoulder, _SHOULDER_RAD) | is_folded)
    arm_ok &= _roughly(height, _ZED_MM, _ROUGH_MM)
    wrist_ok = _roughly(wrist_rad[..., 1], _PITCH_RAD) & _roughly(wrist_rad[..., 2], _ROLL_RAD)
    ok = arm_ok.T[:, :, None] & wrist_ok[:, None]
    wrist_yaw = _wrap(wrist_rad[:, None, :, 0] - (shoulder + elbow).T[:, :, None])
    ok &= _roughly(wrist_yaw, _WRIST_YAW_RAD) | is_folded[:, None, None]
    index, half, slot = np.nonzero(ok)
    arm = half, index
    q = geometry.to_counters(
        _row(shoulder[arm], elbow[arm], height[index], wrist_rad[index, slot], is_folded[index])
    )
    legal = within_limits(q)
    return index[legal], half[legal], slot[legal], q[legal]


def _roughly(value: Floats, limits: Floats, slack: float = _ROUGH_RAD) -> NDArray[np.bool_]:
    return np.asarray((value > limits[0] - slack) & (value < limits[1] + slack))


def _headings(heading_rad: ArrayLike | None) -> Floats:
    return np.atleast_1d(
        np.asarray(HEADINGS_RAD if heading_rad is None else heading_rad, dtype=np.float64)
    )


def _wrist_branches(R: Floats, free_headings: Floats) -> Floats:
    """Return (..., H, 3) heading, pitch, roll that give rotations (..., 3, 3); NaN fills up."""
    slot_count = max(2, len(free_headings))
    level = np.hypot(R[..., 0, 0], R[..., 1, 0])
    pitch = np.arctan2(R[..., 2, 0], level)
    heading = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    is_locked = level < _GIMBAL_RAD

    regular = np.full((*pitch.shape, slot_count, 2), np.nan)
    regular[..., 0, :] = np.stack([heading, pitch], axis=-1)
    other_pitch = np.where(pitch < 0, -np.pi, np.pi) - pitch
    regular[..., 1, :] = np.stack([heading + np.pi, other_pitch], axis=-1)

    locked = np.full_like(regular, np.nan)
    locked[..., : len(free_headings), 0] = free_headings
    locked[..., 1] = pitch[..., None]

    branches = np.where(is_locked[..., None, None], locked, regular)
    psi, p = branches[..., 0], branches[..., 1]
    sin_psi, cos_psi = np.sin(psi), np.cos(psi)
    # the second row of Rz(-psi) R is (Rx(roll)) row two at every pitch, so gimbal lock spares it
    cos_roll = -sin_psi * R[..., None, 0, 1] + cos_psi * R[..., None, 1, 1]
    sin_roll = sin_psi * R[..., None, 0, 2] - cos_psi * R[..., None, 1, 2]
    roll = _wrap(np.arctan2(sin_roll, cos_roll) - _ROLL_CENTRE_RAD) + _ROLL_CENTRE_RAD
    return np.stack([psi, np.where(np.isnan(psi), np.nan, p), roll], axis=-1)


def _elbows(pose: Floats, geometry: ArmGeometry) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return elbow and shoulder (2, ...) of both elbow signs for poses, and where it is folded.

    NaN where the wrist cannot be. Folded back on itself the wrist stands in the shoulder axis,
    any shoulder angle will do, and the one given here says nothing.
    """
    upper, fore = geometry.upper_mm, geometry.fore_mm
    x = pose[..., 0, 3] - geometry.tool_mm * pose[..., 0, 0]
    y = pose[..., 1, 3] - geometry.tool_mm * pose[..., 1, 0]
    reach = np.hypot(x, y)
    # half angle: tan(e/2)^2 = ((U+F)^2 - r^2) / (r^2 - (U-F)^2); its arctan keeps precision where
    # the arccos of §6.5 loses it
    outer = (upper + fore - reach) * (upper + fore + reach)
    inner = (reach - abs(upper - fore)) * (reach + abs(upper - fore))
    slack = _REACH_SLACK_MM * (upper + fore)
    is_reachable = (outer >= -slack) & (inner >= -slack)
    root_outer, root_inner = np.sqrt(np.maximum(outer, 0)), np.sqrt(np.maximum(inner, 0))
    bent = np.where(is_reachable, 2 * np.arctan2(root_outer, root_inner), np.nan)
    elbow = np.stack([bent, -bent])
    bend = np.arctan2(fore * np.sin(bent), upper + fore * np.cos(bent))
    shoulder = _wrap(np.arctan2(y, x) - np.stack([bend, -bend]))
    elbow = _wrap(elbow - _ELBOW_CENTRE_RAD) + _ELBOW_CENTRE_RAD
    return elbow, shoulder, reach < _REACH_SLACK_MM


def _row(
    shoulder: Floats,
    elbow: Floats,
    height: Floats,
    wrist_rad: Floats,
    is_folded: NDArray[np.bool_],
) -> Floats:
    """Return joints (..., 6) of orientations (..., 3) on arms whose shape broadcasts to (...)."""
    psi = wrist_rad[..., 0]
    if is_folded.any():
        # the shoulder angle that keeps the gripper nearest to straight ahead of the forearm
        ahead = np.clip(_wrap(psi - elbow), -np.pi / 2, np.pi / 2)
        folded = is_folded if is_folded.ndim == psi.ndim else is_folded[..., None]
        shoulder = np.where(folded, ahead, shoulder)
    q = np.empty((*psi.shape, 6))
    q[..., _SHOULDER] = shoulder
    q[..., _ELBOW] = elbow
    q[..., _YAW] = _wrap(psi - shoulder - elbow) + elbow / 2  # relative to the forearm (§5.4)
    q[..., _ZED] = height
    q[..., _PITCH:] = wrist_rad[..., 1:]
    q[np.isnan(q).any(axis=-1)] = np.nan
    return q
