"""Model of the UR arms: the published matrices, there and back, and what planning relies on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from controller.cache import digest_of
from controller.planning.geometry import overlap_turned
from controller.planning.model import ArmModel
from drivers.kinds import ArmDescription
from drivers.ur_arm import MODELS, UrModel, UrShape, describe

# as published, Denavit-Hartenberg, in metres: d1, a2, a3, d4, d5, d6 (ur.md 1.1)
PUBLISHED_M = {
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur5": (0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
}
TOOL_MM, JAWS_DEG = 170.0, 25.0


def shape(model: str = "ur5e", **given: object) -> UrShape:
    park = (0.0, -100.0, 110.0, -100.0, -90.0, 0.0)
    return UrShape(model, TOOL_MM, park, **({"jaws_deg": JAWS_DEG} | given))  # type: ignore[arg-type]


def arm(model: str = "ur5e", **given: object) -> UrModel:
    return describe(shape(model, **given)).model


def dh(theta: float, d: float, a: float, alpha: float) -> np.ndarray:
    """Return the matrix of one row of a Denavit-Hartenberg table, the field's own formula."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    )


def published_flange(model: str, q: np.ndarray) -> np.ndarray:
    d1, a2, a3, d4, d5, d6 = (1000 * v for v in PUBLISHED_M[model])
    table = [
        *((d1, 0, np.pi / 2), (0, a2, 0), (0, a3, 0)),
        *((d4, 0, np.pi / 2), (d5, 0, -np.pi / 2), (d6, 0, 0)),
    ]
    T = np.eye(4)
    for angle, (d, a, alpha) in zip(q, table, strict=True):
        T = T @ dh(angle, d, a, alpha)
    return T


def published_tcp(model: str, q: np.ndarray) -> np.ndarray:
    """Return the TCP as planning has it: x along the flange's z, y along the jaws."""
    turn = dh(np.radians(JAWS_DEG), TOOL_MM, 0, 0)
    approach_is_x = np.eye(4)
    approach_is_x[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]  # columns: z, x, y of the flange
    return published_flange(model, q) @ turn @ approach_is_x


def random_q(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, 6))


@pytest.mark.parametrize("model", MODELS)
def test_the_tcp_is_where_the_published_matrices_have_it(model: str) -> None:
    q = random_q(1, 100)
    expected = np.stack([published_tcp(model, row) for row in q])
    np.testing.assert_allclose(arm(model).forward(q), expected, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_the_last_link_is_the_flange_and_neighbours_are_a_links_length_apart(model: str) -> None:
    q = random_q(2, 50)
    R, origin = arm(model).link_frames(q)
    for row, joints in enumerate(q):
        T = published_flange(model, joints)
        np.testing.assert_allclose(R[row, -1], T[:3, :3], atol=1e-12)
        np.testing.assert_allclose(origin[row, -1], T[:3, 3], atol=1e-9)
    d1, a2, a3, d4, d5, d6 = (1000 * abs(v) for v in PUBLISHED_M[model])
    apart = np.linalg.norm(np.diff(origin, axis=1), axis=2)
    np.testing.assert_allclose(
        apart, np.tile([0, a2, np.hypot(a3, d4), d5, d6], (50, 1)), atol=1e-9
    )
    np.testing.assert_allclose(origin[:, 0], np.tile([0, 0, d1], (50, 1)), atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), model=st.sampled_from(MODELS))
def test_every_branch_leads_back_to_its_pose(seed: int, model: str) -> None:
    one = arm(model)
    T = one.forward(random_q(seed, 20))
    q = one.branches(T)
    assert q.shape == (20, 8, 6)
    there = np.isfinite(q).all(axis=2)
    assert (there == np.isfinite(q).any(axis=2)).all()
    assert there.any(axis=1).all()
    np.testing.assert_allclose(one.forward(q[there]), np.repeat(T[:, None], 8, 1)[there], atol=1e-6)


def test_a_pose_well_within_reach_has_eight_different_branches() -> None:
    q0 = np.radians([20.0, -70.0, 80.0, -60.0, -70.0, 30.0])
    T = published_tcp("ur5e", q0)
    (q,) = arm().branches(T[None])
    assert np.isfinite(q).all()
    for a in range(8):
        np.testing.assert_allclose(published_tcp("ur5e", q[a]), T, atol=1e-8)
        for b in range(a):
            assert np.abs(np.angle(np.exp(1j * (q[a] - q[b])))).max() > 0.1


def test_the_inverse_finds_the_joints_that_made_the_pose() -> None:
    one = arm()
    q = one.middle_rad + random_q(3, 500) * (174.0 / 180.0)
    q = q[(np.abs(np.sin(q[:, 4])) > 1e-3) & (np.abs(np.sin(q[:, 2])) > 1e-3)]
    index, branch, rows = one.inverse(one.forward(q))
    assert (np.diff(index) >= 0).all()
    assert one.within_limits(rows).all()
    assert set(branch.tolist()) == set(range(8))
    nearest = np.full(len(q), np.inf)
    np.minimum.at(nearest, index, np.abs(rows - q[index]).max(axis=1))
    assert nearest.max() < 1e-6


@pytest.mark.parametrize("wrist2_deg", [0.0, 180.0])
def test_where_wrist_1_and_3_turn_about_one_axis_wrist_3_stands_in_its_middle(
    wrist2_deg: float,
) -> None:
    one = arm()
    T = published_tcp("ur5e", np.radians([20.0, -70.0, 80.0, -60.0, wrist2_deg, 30.0]))
    _, _, q = one.inverse(T[None])
    straight = np.abs(np.sin(q[:, 4])) < 1e-9
    assert straight.any()
    np.testing.assert_allclose(q[straight, 5], 0.0, atol=1e-12)
    np.testing.assert_allclose(one.forward(q), np.repeat(T[None], len(q), 0), atol=1e-6)


@pytest.mark.parametrize("ahead_mm", [0.0, 100.0, 2000.0])
def test_a_pose_out_of_reach_has_no_branch(ahead_mm: float) -> None:
    T = np.eye(4)
    T[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    T[:3, 3] = ahead_mm, 0.0, 300.0  # within d4 of the base's axis, and far beyond the arm
    one = arm()
    if ahead_mm == 100.0:
        assert np.hypot(ahead_mm, 0) < one.size.d4
    assert np.isnan(one.branches(T[None])).all()
    assert len(one.inverse(T[None])[0]) == 0


def test_a_straight_line_keeps_its_branch_without_a_jump() -> None:
    one = arm()
    T = np.repeat(
        published_tcp("ur5e", np.radians([20.0, -70.0, 80.0, -60.0, -70.0, 30.0]))[None], 41, 0
    )
    T[:, 2, 3] += np.linspace(0.0, 80.0, 41)
    _, branch, q = one.inverse(T)
    whole = [b for b in range(8) if (branch == b).sum() == 41]
    assert len(whole) >= 4
    for b in whole:
        assert np.abs(np.diff(q[branch == b], axis=0)).max() < 0.05


def test_no_line_passes_the_cut_half_a_turn_from_a_joints_middle() -> None:
    """The TCP goes all the way round the base: behind it, the branch ends before it would jump."""
    one = arm()
    q0 = np.radians([0.0, -70.0, 80.0, -100.0, -90.0, 30.0])
    turns = np.radians(np.arange(0.0, 360.0, 1.0))
    rows = np.repeat(q0[None], len(turns), 0)
    rows[:, 0] += turns
    index, branch, q = one.inverse(one.forward(rows))
    for b in set(branch.tolist()):
        mine = branch == b
        # over the missing poses it may be anywhere; over neighbouring ones it moves on by a degree
        step = np.abs(np.diff(q[mine], axis=0)).max(axis=1)[np.diff(index[mine]) == 1]
        assert step.max() < np.radians(1.5)
        assert len(set(range(360)) - set(index[mine].tolist())) in range(9, 13)


def test_another_middle_moves_the_cut() -> None:
    one = arm(middle_deg=(90.0, -90.0, 0.0, -90.0, 0.0, 180.0))
    q = np.radians([200.0, -70.0, 80.0, -100.0, -90.0, 300.0])
    _, _, rows = one.inverse(one.forward(q)[None])
    assert np.abs(rows - q).max(axis=1).min() < 1e-8


def test_a_joint_may_stand_a_whole_turn_away_and_is_within_limits() -> None:
    one = arm()
    assert one.within_limits(np.radians([359.0, -200.0, 100.0, 300.0, -10.0, -359.0]))
    q = np.radians([0.0, -90.0, 0.0, 361.0, 0.0, 0.0])
    assert not one.within_limits(q)
    assert one.limit_report(q) == "wrist1 passed by 1.0 deg (360 deg is the end)"
    assert not one.within_limits(np.full(6, np.nan))
    spread = one.spread(np.random.default_rng(0).random((500, 6)))
    assert one.within_limits(spread).all()
    weights = np.stack([limit.weights for limit in one.joint_limits])
    np.testing.assert_array_equal(weights, np.eye(6))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("joint", range(6))
def test_no_point_moves_farther_than_the_radii_allow(model: str, joint: int) -> None:
    one = arm(model)
    rng = np.random.default_rng(joint)
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    for q in random_q(joint, 30):
        to = q.copy()
        to[joint] = rng.uniform(-np.pi, np.pi)
        far, beside = one.tool_mm + 80.0, 70.0
        turn = rng.uniform(0, 2 * np.pi)
        ahead = np.sqrt(far**2 - beside**2) - one.tool_mm
        point = np.array([ahead, beside * np.cos(turn), beside * np.sin(turn), 1.0])
        rows = q + np.linspace(0, 1, 300)[:, None] * (to - q)
        paths = [(one.forward(rows) @ point)[:, :3]]
        R, origin = one.link_frames(rows)
        for k, link in enumerate(one.links):
            for corner in link.T[:3, 3] + signs * link.half_mm:
                paths.append(origin[:, k] + R[:, k] @ corner)
        allowed_mm = np.abs(to - q) @ one.radii_mm(q, to, far, beside) + 1e-6
        for path in paths:
            assert np.linalg.norm(np.diff(path, axis=0), axis=1).sum() <= allowed_mm


def test_the_reach_is_the_farthest_the_wrist_comes_from_the_bases_axis() -> None:
    one = arm()
    q = random_q(5, 20000)
    q[:, 2] *= 0.05
    wrist = one.link_frames(q)[1][:, 4]
    away = np.hypot(wrist[:, 0], wrist[:, 1]).max()
    assert one.reach_mm - 15.0 < away <= one.reach_mm


# ---- timing -----------------------------------------------------------------------------------
def test_a_move_takes_the_time_of_its_leading_axis_trapezoid() -> None:
    timing = shape().timing()
    speed, accel = np.radians(60.0), np.radians(80.0)
    q = np.zeros(6)
    far = q.copy()
    far[[0, 5]] = 2.0, -1.0  # long enough for full speed
    expected = 2.0 / speed + speed / accel
    assert timing.move_seconds(q, far) == pytest.approx(expected + timing.command_s)
    near = np.array([0.1, 0, 0, 0, 0, 0])
    assert timing.move_seconds(q, near) == pytest.approx(
        2 * np.sqrt(0.1 / accel) + timing.command_s
    )
    assert timing.move_seconds(q, q) == 0.0
    both = timing.move_seconds(np.zeros((2, 6)), np.stack([far, near]))
    np.testing.assert_allclose(both, [timing.move_seconds(q, far), timing.move_seconds(q, near)])


def test_the_command_of_a_move_lets_no_joint_pass_its_own_limit() -> None:
    timing = shape("ur10e", speed_deg_s=170.0).timing()
    np.testing.assert_allclose(np.degrees(timing.joint_speeds), [120, 120, 170, 170, 170, 170])
    step = np.radians([100.0, 0, 110.0, 0, 0, 0])
    v = timing.leading_speed(step)  # of the elbow, which turns farther
    assert np.degrees(v) == pytest.approx(132.0)  # the base then has its 120
    assert timing.leading_speed(step, 0.25) == pytest.approx(0.25 * v)


@pytest.mark.parametrize("step_rad", [0.05, 0.6, 3.0])
def test_the_course_is_the_trapezoid_on_the_joint_line(step_rad: float) -> None:
    timing = shape().timing()
    a, b = np.zeros(6), np.array([step_rad, -step_rad / 2, 0, 0, 0.1 * step_rad, 0])
    q, share = timing.courses(a, b, 2001)
    np.testing.assert_allclose(q, share[:, None] * b, atol=1e-12)
    assert share[0] == 0.0
    assert share[-1] == pytest.approx(1.0)
    seconds = float(timing.move_seconds(a, b)) - timing.command_s
    speed = np.diff(share) * step_rad / (seconds / 2000)
    assert speed.min() >= 0.0
    assert speed.max() <= np.radians(60.0) * 1.001
    assert np.abs(np.diff(speed)).max() / (seconds / 2000) <= np.radians(80.0) * 1.01
    np.testing.assert_array_equal(timing.stray(b), np.zeros(6))


# ---- what planning asks for -------------------------------------------------------------------
def test_planning_takes_the_model_and_finds_its_plans_again() -> None:
    described: ArmDescription[ArmModel] = describe(shape())  # the type checker's proof
    assert digest_of(described.model) == digest_of(describe(shape()).model)
    assert digest_of(described.model) != digest_of(describe(shape(jaws_deg=0.0)).model)
    assert described.model.joint_names[0] == "base_rad"
    assert described.model.homing_sweep(np.zeros(6), np.zeros(6)) == ()


def test_drawn_postures_hang_the_tool_straight_down() -> None:
    one = arm()
    for q in random_q(7, 50):
        *_, last = one.retreats(q[None], 5)[0]
        np.testing.assert_allclose(one.forward(last)[:3, 0], [0, 0, -1], atol=1e-9)
        assert abs(last[3] - q[3]) <= np.pi + 1e-9
        for group in one.detours(q, q + 0.1):
            for path in group:
                np.testing.assert_array_equal(path[0], q)
                np.testing.assert_array_equal(path[-1], q + 0.1)


@pytest.mark.parametrize("model", MODELS)
def test_standing_arm_and_working_arm_touch_nothing_of_themselves_and_a_folded_one_does(
    model: str,
) -> None:
    one = arm(model)
    up, working, folded = np.radians(
        [[0, -90, 0, -90, 0, 0], [30, -60, 90, -120, -90, 0], [0, -90, 170, -90, 0, 0]]
    )
    R, origin = one.link_frames(np.stack([up, working, folded]))
    met = np.zeros(3, bool)
    for i, j in one.link_pairs:
        a, b = one.links[i], one.links[j]
        at = [origin[:, k] + R[:, k] @ link.T[:3, 3] for k, link in ((i, a), (j, b))]
        half = [np.repeat(link.half_mm[None], 3, 0) for link in (a, b)]
        met |= overlap_turned(R[:, i], half[0], R[:, j], half[1], at[1] - at[0])
    assert met.tolist() == [False, False, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "ur6"}, "model: 'ur6' is none of ur3e, ur5e, ur10e, ur5"),
        ({"flange_to_tcp_mm": 1700.0}, "flange_to_tcp_mm: 0 to 500 mm, not 1700"),
        ({"speed_deg_s": 200.0}, "speed_deg_s: 1 to 180 deg/s, not 200"),
        ({"acceleration_deg_s2": float("nan")}, "acceleration_deg_s2: 1 to 800"),
        (
            {"park_deg": (0.0, 0.0, 190.0, 0.0, 0.0, 0.0)},
            "park_deg: elbow: -180 to 180 deg, not 190",
        ),
        ({"middle_deg": (190.0, -90.0, 0.0, -90.0, 0.0, 0.0)}, "middle_deg: base: half a turn"),
        ({"middle_deg": (0.0, -90.0, 0.0, -90.0, 9.0, 0.0)}, "middle_deg: wrist2: 0"),
    ],
)
def test_a_shape_that_no_arm_has_is_refused(change: dict[str, object], message: str) -> None:
    given: dict[str, object] = {
        "model": "ur5e",
        "flange_to_tcp_mm": TOOL_MM,
        "park_deg": (0.0, -100.0, 110.0, -100.0, -90.0, 0.0),
    }
    with pytest.raises(ValueError, match=message):
        UrShape(**(given | change))  # type: ignore[arg-type]


# ---- as made ---------------------------------------------------------------------------------
def as_made(seed: int) -> UrModel:
    """Return an arm whose frames are off within what a calibration expects."""
    one = arm()
    bounds = np.array([figure.bound for figure in one.figures.unknowns])
    return one.measured(np.random.default_rng(seed).uniform(-1, 1, len(bounds)) * bounds)


@pytest.mark.parametrize("seed", [1, 2])
def test_an_arm_as_made_is_a_chain_of_the_published_rows_each_with_its_own_shift(seed: int) -> None:
    made = as_made(seed)
    values = {
        one.name: value for one, value in zip(made.figures.unknowns, made.made.ravel(), strict=True)
    }

    def off(link: str) -> np.ndarray:
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(
            [values[f"{link}_r{axis}_rad"] for axis in "xyz"]
        ).as_matrix()
        T[:3, 3] = [values[f"{link}_{axis}_mm"] for axis in "xyz"]
        return T

    d1, a2, a3, d4, d5, d6 = (1000 * v for v in PUBLISHED_M["ur5e"])
    fixed = (
        dh(0, d1, 0, np.pi / 2), dh(0, 0, a2, 0), dh(0, d4, a3, 0),
        dh(0, 0, 0, np.pi / 2) @ dh(0, d5, 0, 0), dh(0, 0, 0, -np.pi / 2) @ dh(0, d6, 0, 0),
    )  # fmt: skip
    links = ("shoulder", "elbow", "wrist1", "wrist2", "wrist3")
    turn = dh(np.radians(JAWS_DEG), TOOL_MM, 0, 0)
    approach_is_x = np.eye(4)
    approach_is_x[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    for q in random_q(seed, 20):
        T = dh(q[0], 0, 0, 0)
        for row, link, angle in zip(fixed, links, q[1:], strict=True):
            T = T @ row @ off(link) @ dh(angle, 0, 0, 0)
        T = T @ turn @ approach_is_x @ off("tool")
        np.testing.assert_allclose(made.forward(q), T, atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_arm_as_made_gets_back_to_its_joints(seed: int) -> None:
    made = as_made(seed)
    q = made.spread(np.random.default_rng(seed).uniform(size=(300, 6)))
    T = made.forward(q)
    index, _, rows = made.inverse(T)
    np.testing.assert_allclose(made.forward(rows), T[index], atol=1e-3)
    found = [
        np.abs(rows[index == k] - one).max(axis=1).min(initial=np.inf) < 1e-4
        for k, one in enumerate(q)
    ]
    # where no two axes are nearly in one line, nor the arm stretched, nor a joint near its cut
    inside = np.abs(q - made.middle_rad).max(axis=1) < np.radians(172.0)
    bent = np.abs(q[:, 2]) > np.radians(10.0)
    sound = inside & bent & (least_turn(made, q) > 0.03)
    assert sound.sum() > 150
    assert np.array(found)[sound].all()


def least_turn(made: UrModel, q: np.ndarray) -> np.ndarray:
    """Return the least motion of the TCP (n,) for joints that turn by 1 rad together.

    Shifts count by 300 mm.
    """
    T, step = made.forward(q), 1e-6
    by = np.stack([(made.forward(q + d) - T)[:, :3] / step for d in step * np.eye(6)], axis=-1)
    by[:, :, 3] /= 300.0
    return np.linalg.svd(by.reshape(len(q), 12, 6), compute_uv=False)[:, -1]


def test_nothing_of_an_arm_as_made_moves_farther_than_its_radii() -> None:
    made = as_made(4)
    rng = np.random.default_rng(4)
    for a in made.spread(rng.uniform(size=(50, 6))):
        b = a.copy()
        joint = int(rng.integers(6))
        b[joint] += 0.02
        radii = made.radii_mm(a, b, made.tool_mm, 0.0)
        moved = np.linalg.norm(made.forward(b)[:3, 3] - made.forward(a)[:3, 3])
        assert moved <= 0.02 * radii[joint] + 1e-9
