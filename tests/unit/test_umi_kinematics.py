"""Kinematics of the arm against umi_rtx.md 6.6, and against itself there and back.

Sections (§) are those of umi_rtx.md.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.umi_scara import OutOfRangeError, kinematics
from drivers.umi_scara.model.kinematics import (
    ArmGeometry,
    counts_to_q,
    forward,
    inverse,
    inverse_legal,
    link_frames,
    q_to_counts,
)
from drivers.umi_scara.model.limits import check_limits

# umi_rtx.md 6.6; columns S E Z W1 W2 Y, wrist x y z, tip x y z, heading in degrees
TABLE = [
    ((0, 0, 0, 0, 0, 0), (507.00, 0, 915.00), (684.00, 0, 915.00), 0),
    ((0, 0, -1875, 0, 0, 0), (507.00, 0, 415.00), (684.00, 0, 415.00), 0),
    (
        (1315, -1315, -1875, -607, -607, 0),
        (358.50, 0.01, 415.00),
        (483.65, 0.01, 289.83),
        0.002,
    ),
    (
        (500, 1461, -1500, -1214, -1214, 487),
        (126.78, 300.25, 515.00),
        (126.80, 300.21, 338.00),
        117.108,
    ),
    (
        (-1000, 1500, -2000, 300, -500, 400),
        (302.76, 93.20, 381.67),
        (395.31, 242.33, 358.83),
        58.177,
    ),
    ((0, 2206, -1000, 0, 0, 735), (31.82, 122.97, 648.33), (-122.92, 208.91, 648.33), 150.953),
]


def to_counts_order(row: tuple[int, ...]) -> list[int]:
    shoulder, elbow, zed, wrist1, wrist2, yaw = row
    return [elbow, shoulder, zed, wrist1, wrist2, yaw]


def legal_q(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Random joints inside the limits of §5.2, drawn from the limits as printed there."""
    elbow = rng.uniform(-2629, 2205, count)
    shoulder = rng.uniform(-2629, 2629, count)
    yaw = elbow / 3 + rng.uniform(-1070, 1070, count)
    total, difference = rng.uniform(-2641, 107, count), rng.uniform(-3559, 4881, count)
    zed = rng.uniform(-3302, -21, count)
    pair = [(total + difference) / 2, (total - difference) / 2]
    return counts_to_q(np.column_stack([elbow, shoulder, zed, *pair, yaw]))


@pytest.mark.parametrize(("row", "wrist_mm", "tip_mm", "heading_deg"), TABLE)
def test_forward_agrees_with_the_numerical_check(
    row: tuple[int, ...],
    wrist_mm: tuple[float, ...],
    tip_mm: tuple[float, ...],
    heading_deg: float,
) -> None:
    q = counts_to_q(to_counts_order(row))
    T_arm_tcp = forward(q)
    T_arm_wrist = forward(q, ArmGeometry(tool_mm=0.0))
    assert T_arm_tcp[:3, 3] == pytest.approx(tip_mm, abs=0.005001)
    assert T_arm_wrist[:3, 3] == pytest.approx(wrist_mm, abs=0.005001)
    heading = q[0] + q[1] / 2 + q[2]
    assert np.rad2deg(heading) == pytest.approx(heading_deg, abs=0.0005001)
    assert q_to_counts(q).tolist() == to_counts_order(row)


def test_the_links_are_a_chain_of_turns_and_shifts_that_ends_at_the_wrist() -> None:
    def turned(angle_rad: float) -> NDArray[np.float64]:
        T = np.eye(4)
        T[:2, :2] = [
            [np.cos(angle_rad), -np.sin(angle_rad)],
            [np.sin(angle_rad), np.cos(angle_rad)],
        ]
        return T

    def shifted(x: float, z: float) -> NDArray[np.float64]:
        T = np.eye(4)
        T[[0, 2], 3] = x, z
        return T

    geometry = ArmGeometry(upper_mm=210.0, fore_mm=180.0, tool_mm=0.0, wrist_height_mm=800.0)
    q = legal_q(np.random.default_rng(4), 50)
    R, origin_mm = link_frames(q, geometry)
    for row, joints in enumerate(q):
        carriage = shifted(0.0, 800.0 + joints[3])
        upper = carriage @ turned(joints[0])
        fore = upper @ shifted(210.0, 0.0) @ turned(joints[1])
        for link, T in enumerate((carriage, upper, fore)):
            np.testing.assert_allclose(R[row, link], T[:3, :3], atol=1e-12)
            np.testing.assert_allclose(origin_mm[row, link], T[:3, 3], atol=1e-9)
        wrist = fore @ shifted(180.0, 0.0)
        np.testing.assert_allclose(wrist[:3, 3], forward(joints, geometry)[:3, 3], atol=1e-9)


def test_the_orientation_is_the_product_of_the_three_rotations() -> None:
    def about(axis: int, angle_rad: float) -> NDArray[np.float64]:
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        R = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        R[i, i] = R[j, j] = c
        R[i, j], R[j, i] = -s, s
        return R

    for q in legal_q(np.random.default_rng(1), 50):
        heading = q[0] + q[1] / 2 + q[2]
        expected = about(2, heading) @ about(1, -q[4]) @ about(0, q[5])
        assert forward(q)[:3, :3] == pytest.approx(expected, abs=1e-14)


def test_there_and_back_is_exact_for_random_legal_joints() -> None:
    q = legal_q(np.random.default_rng(2), 20_000)
    assert kinematics.within_limits(q).all()
    T_arm_tcp = forward(q)
    answers, legal = inverse(T_arm_tcp, heading_rad=0.0)
    error = np.abs(answers - q[:, None]).max(axis=-1)
    assert np.where(legal, error, np.inf).min(axis=-1).max() < 1e-9
    exists = np.isfinite(answers).all(axis=-1)
    back = forward(np.where(exists[..., None], answers, 0.0))
    assert np.abs(back - T_arm_tcp[:, None]).max(axis=(-2, -1))[exists].max() < 1e-9


def test_the_other_elbow_is_legal_as_often_as_the_reference_found() -> None:
    q = legal_q(np.random.default_rng(3), 20_000)
    q[:, 4] = np.maximum(q[:, 4], np.deg2rad(-81.0))  # one pitch branch, as in the reference
    answers, legal = inverse(forward(q), heading_rad=0.0)
    same = np.sign(answers[..., 1]) == np.sign(q[:, None, 1])
    other_is_legal = (legal & ~same).any(axis=-1).mean()
    assert other_is_legal == pytest.approx(0.39, abs=0.03)  # §6.6: 39 %


@settings(max_examples=200)
@given(seed=st.integers(0, 2**32 - 1), tool=st.floats(0, 250), fore=st.floats(150, 300))
def test_there_and_back_is_exact_for_any_geometry(seed: int, tool: float, fore: float) -> None:
    geometry = ArmGeometry(fore_mm=fore, tool_mm=tool)
    q = legal_q(np.random.default_rng(seed), 1)[0]
    T_arm_tcp = forward(q, geometry)
    answers, _ = inverse(T_arm_tcp, geometry, heading_rad=0.0)
    exists = np.isfinite(answers).all(axis=-1)
    assert exists.any()
    assert np.abs(forward(answers[exists], geometry) - T_arm_tcp).max() < 1e-9


def test_a_straight_arm_is_reached_and_one_micron_further_is_not() -> None:
    T_arm_tcp = forward(counts_to_q(to_counts_order((0, 0, -1875, 0, 0, 0))))
    answers, legal = inverse(T_arm_tcp)
    assert legal.any()
    best = answers[legal][0]
    assert np.abs(forward(best) - T_arm_tcp).max() < 1e-9
    T_arm_tcp[0, 3] += 0.001
    answers, legal = inverse(T_arm_tcp)
    assert not legal.any()
    assert np.isnan(answers).all()


def test_the_pose_at_the_homing_stops_finds_its_way_back() -> None:
    # the wrist stands in the shoulder axis there (r = 0), and yaw needs its image near -200 deg
    q = counts_to_q([-2629, 2630, -21, -3101, 459, -1947])
    answers, legal = inverse(forward(q))
    assert legal.any()
    for answer in answers[legal]:
        assert np.abs(forward(answer) - forward(q)).max() < 1e-9


def test_a_wrist_exactly_in_the_shoulder_axis_leaves_the_shoulder_to_choose() -> None:
    q = np.array([0.4, -np.pi, -1.2, -300.0, -0.5, 0.2])
    answers, legal = inverse(forward(q))
    assert legal.any()
    for answer in answers[legal]:
        assert np.abs(forward(answer) - forward(q)).max() < 1e-9


def test_straight_down_every_heading_offered_is_a_branch_of_its_own() -> None:
    headings = np.deg2rad([-60.0, 0.0, 30.0, 90.0])
    T_arm_tcp = np.eye(4)
    T_arm_tcp[:3, 0] = [0, 0, -1]  # approach
    T_arm_tcp[:3, 1] = [0.6, 0.8, 0]  # jaws
    T_arm_tcp[:3, 2] = np.cross(T_arm_tcp[:3, 0], T_arm_tcp[:3, 1])
    T_arm_tcp[:3, 3] = [350, 100, 60]
    answers, legal = inverse(T_arm_tcp, heading_rad=headings)
    assert answers.shape == (8, 6)
    for answer, heading in zip(answers, np.tile(headings, 2), strict=True):
        assert np.abs(forward(answer) - T_arm_tcp).max() < 1e-9
        assert answer[0] + answer[1] / 2 + answer[2] == pytest.approx(heading, abs=1e-9) or (
            np.cos(answer[0] + answer[1] / 2 + answer[2] - heading) == pytest.approx(1.0)
        )
        assert answer[4] == pytest.approx(-np.pi / 2)
    assert legal.any()


def test_headings_are_sampled_when_none_are_given() -> None:
    T_arm_tcp = forward(np.array([0.3, 0.8, 0.1, -700.0, -np.pi / 2, 0.4]))
    answers, legal = inverse(T_arm_tcp)
    assert answers.shape == (2 * len(kinematics.HEADINGS_RAD), 6)
    assert legal.sum() > 10
    assert np.abs(forward(answers[legal]) - T_arm_tcp).max() < 1e-9


def test_steep_pitches_have_a_second_branch_beyond_straight_down() -> None:
    # half a turn takes the hand from -100 to +80 deg, and roll from -17 to +163 deg
    q = np.array([0.2, 0.9, 0.45 - np.deg2rad(100.0), -600.0, np.deg2rad(-85.0), -0.3])
    answers, legal = inverse(forward(q))
    pitches = np.rad2deg(answers[legal][:, 4])
    assert pitches.min() == pytest.approx(-95.0)
    assert pitches.max() == pytest.approx(-85.0)


def at_the_limits(rng: np.random.Generator) -> NDArray[np.float64]:
    """Joints (n, 6) on the limits of §5.2, stretched, folded, straight down, and just outside."""
    q = legal_q(rng, 160)
    q[:20, 4] = -np.pi / 2
    q[20:30, 1] = 0.0  # stretched
    q[30:40, 1] = -np.pi  # folded: the wrist stands in the shoulder axis
    q[40:50, 4] = -np.pi / 2
    q[40:50, 1] = -np.pi
    counts = q_to_counts(q)
    counts[50:60, 0], counts[60:70, 0] = 2206, -2630
    counts[70:80, 1], counts[80:90, 1] = 2630, -2630
    counts[90:100, 2], counts[100:110, 2] = -20, -3303
    counts[110:120, 5] = counts[110:120, 0] // 3 + 1071
    counts[120:130, 3:5] += (-2642 - counts[120:130, 3:5].sum(axis=1, keepdims=True)) // 2
    counts[130:140, 3:5] += (108 - counts[130:140, 3:5].sum(axis=1, keepdims=True)) // 2
    counts[140:150, 2] = -3305
    q[50:] = counts_to_q(counts[50:])
    return q


@given(seed=st.integers(0, 10**6), heading_count=st.integers(1, 12))
@settings(max_examples=25, deadline=None)
def test_the_legal_answers_alone_are_those_of_the_whole_inverse(
    seed: int, heading_count: int
) -> None:
    rng = np.random.default_rng(seed)
    T_arm_tcp = forward(at_the_limits(rng))
    headings = rng.uniform(-np.pi, np.pi, heading_count)
    answers, legal = inverse(T_arm_tcp, heading_rad=headings)
    where, which = np.nonzero(legal)
    index, branch, q = inverse_legal(T_arm_tcp, heading_rad=headings)
    assert np.array_equal(index, where)
    assert np.array_equal(branch, which)
    assert np.array_equal(q, answers[legal])
    assert np.abs(forward(q) - T_arm_tcp[index]).max() < 1e-9


def test_no_pose_has_no_answers() -> None:
    far = np.eye(4)
    far[:3, 3] = 3000.0, 0.0, 300.0
    for T_arm_tcp in (np.zeros((0, 4, 4)), far[None]):
        index, branch, q = inverse_legal(T_arm_tcp)
        assert index.shape == branch.shape == (0,)
        assert q.shape == (0, 6)


def test_leading_dimensions_pass_through() -> None:
    q = legal_q(np.random.default_rng(4), 12).reshape(3, 4, 6)
    T_arm_tcp = forward(q)
    assert T_arm_tcp.shape == (3, 4, 4, 4)
    answers, legal = inverse(T_arm_tcp, heading_rad=[0.0, 1.0])
    assert answers.shape == (3, 4, 4, 6)
    assert legal.shape == (3, 4, 4)
    assert q_to_counts(q).shape == (3, 4, 6)
    one, one_legal = inverse(T_arm_tcp[1, 2], heading_rad=[0.0, 1.0])
    assert np.array_equal(one, answers[1, 2], equal_nan=True)
    assert np.array_equal(one_legal, legal[1, 2])


@pytest.mark.parametrize(
    ("counts", "name"),
    [
        ([2207, 0, -100, 0, 0, 735], "elbow"),
        ([-2631, 0, -100, 0, 0, -877], "elbow"),
        ([0, 2631, -100, 0, 0, 0], "shoulder"),
        ([0, 0, -19, 0, 0, 0], "zed"),
        ([0, 0, -3304, 0, 0, 0], "zed"),
        ([0, 0, -100, 55, 54, 0], "pitch"),
        ([0, 0, -100, -1321, -1322, 0], "pitch"),
        ([0, 0, -100, 2442, -2441, 0], "roll"),
        ([0, 0, -100, -1781, 1780, 0], "roll"),
        ([-2629, 0, -100, 0, 0, -1948], "yaw"),  # §4.2: this yaw lies 0.7 count outside
        ([300, 0, -100, 0, 0, 1172], "yaw"),
        ([300, 0, -100, 0, 0, -972], "yaw"),
    ],
)
def test_one_count_beyond_a_limit_is_reported_by_name(counts: list[int], name: str) -> None:
    assert not kinematics.within_limits(counts_to_q(counts))
    assert kinematics.limit_report(counts_to_q(counts)).startswith(name)
    with pytest.raises(OutOfRangeError) as refusal:
        check_limits(counts)
    assert refusal.value.axis.startswith(name)
    assert 0 < abs(refusal.value.asked - refusal.value.limit) <= 1


@pytest.mark.parametrize(
    "counts",
    [
        [2206, 2630, -20, 54, 54, 735],
        [-2630, -2630, -3303, -1321, -1321, -876],
        [-2629, 2630, -20, -3101, 459, -1947],  # §4.2: satisfies all combined limits
        [300, 0, -20, 0, 0, 1171],
        [300, 0, -20, 0, 0, -971],
    ],
)
def test_the_limits_themselves_are_inside(counts: list[int]) -> None:
    assert kinematics.within_limits(counts_to_q(counts))
    assert kinematics.limit_report(counts_to_q(counts)) == "within limits"
    check_limits(counts)


@given(seed=st.integers(0, 2**32 - 1))
def test_what_kinematics_calls_legal_the_arm_accepts(seed: int) -> None:
    q = legal_q(np.random.default_rng(seed), 1)[0] * np.array([1.05, 1.05, 1.05, 1, 1.05, 1.05])
    if kinematics.within_limits(q):
        check_limits(q_to_counts(q))
    else:
        with pytest.raises(OutOfRangeError):
            check_limits(q_to_counts(q))


def test_nowhere_is_outside() -> None:
    nowhere = np.full(6, np.nan)
    assert not kinematics.within_limits(nowhere)
    with pytest.raises(ValueError, match="no counts"):
        q_to_counts(nowhere)


def measured() -> ArmGeometry:
    return ArmGeometry(
        upper_mm=253.8,
        fore_mm=253.1,
        tool_mm=176.6,
        tool_off_mm=(0.45, -0.35),
        zero_rad=(0.008, -0.007, 0.006, -0.005, 0.0085),
        zed_zero_mm=0.4,
        yaw_per_elbow=-0.005,
        sag_mm=0.8,
    )


def test_a_measured_arm_is_a_chain_of_its_own_turns_and_shifts() -> None:
    def rigid(axis: int, angle_rad: float, *shift_mm: float) -> NDArray[np.float64]:
        c, s = np.cos(angle_rad), np.sin(angle_rad)
        T = np.eye(4)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        T[i, i] = T[j, j] = c
        T[i, j], T[j, i] = -s, s
        T[:3, 3] = shift_mm or (0.0, 0.0, 0.0)
        return T

    for shoulder, elbow, yaw, zed, pitch, roll in legal_q(np.random.default_rng(8), 30):
        true_elbow = elbow - 0.007
        sag = 0.8 * (1.0 + np.cos(true_elbow)) / 2.0
        hand = yaw + 0.006 - 0.005 * true_elbow - true_elbow / 2.0  # against the forearm
        T = (
            rigid(2, shoulder + 0.008, 0.0, 0.0, 915.0 + zed + 0.4 - sag)
            @ rigid(2, true_elbow, 253.8, 0.0, 0.0)
            @ rigid(2, hand, 253.1, 0.0, 0.0)
            @ rigid(1, -(pitch - 0.005))
            @ rigid(0, roll + 0.0085)
            @ rigid(0, 0.0, 176.6, 0.45, -0.35)
        )
        q = np.array([shoulder, elbow, yaw, zed, pitch, roll])
        np.testing.assert_allclose(forward(q, measured()), T, atol=1e-9)


def test_a_measured_arm_gets_back_to_the_joints_that_its_counters_meant() -> None:
    q = legal_q(np.random.default_rng(9), 200)
    index, _, found = inverse_legal(forward(q, measured()), measured())
    for number, row in enumerate(q):
        off = np.abs(found[index == number] - row).max(axis=1)
        assert off.min() < 1e-6, row
