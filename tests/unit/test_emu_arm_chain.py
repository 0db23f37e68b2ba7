"""An arm of any kind in the emulated world: a chain of links with joints, boxes and motors."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from controller.cli.project.starter.drivers.arm.model import HIGH_RAD, LOW_RAD, NAMES, SixAxis
from emulators.as_built import draw_as_built
from emulators.umi_scara import ArmJoints
from emulators.world import Layout, LayoutError, Solid, World, read_layout
from emulators.world.arms import MadeShape
from emulators.world.chain import TCP, Chain, Link
from emulators.world.ground_truth import custody, part_pose
from emulators.world.matter.solid import solid_of
from emulators.world.poses import JointValues, forward
from emulators.world.shapes import Box

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
STEP_S = 1.0 / 240.0
BLOCK_MM = (60.0, 40.0, 20.0)
UP_TO_X = (1.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def layout() -> Layout:
    return read_layout(CELL)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Solid]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield solid_of(trimesh.creation.box(BLOCK_MM), "block")


def moved(x_mm: float, y_mm: float, z_mm: float) -> Array:
    T = np.eye(4)
    T[:3, 3] = x_mm, y_mm, z_mm
    return T


def one_to_one(*joints: str) -> dict[str, dict[str, float]]:
    return {joint: {joint: 1.0} for joint in joints}


# --- kinematics ----------------------------------------------------------------------------------


def umi_tip(joints: ArmJoints) -> Array:
    """Return T_base_tcp of a UMI RTX, written out: umi_rtx.md 6.4 with its lengths."""
    s, e = joints.shoulder_rad, joints.elbow_rad
    psi = s + e / 2.0 + joints.yaw_rad
    c, k = math.cos(psi), math.sin(psi)
    cp, sp = math.cos(joints.pitch_rad), math.sin(joints.pitch_rad)
    cr, sr = math.cos(joints.roll_rad), math.sin(joints.roll_rad)
    wrist = (
        253.5 * math.cos(s) + 253.5 * math.cos(s + e),
        253.5 * math.sin(s) + 253.5 * math.sin(s + e),
        915.0 + joints.zed_mm,
    )
    T = np.eye(4)
    T[:3, 0] = c * cp, k * cp, sp
    T[:3, 1] = -k * cr - c * sp * sr, c * cr - k * sp * sr, cp * sr
    T[:3, 2] = k * sr - c * sp * cr, -c * sr - k * sp * cr, cp * cr
    T[:3, 3] = np.array(wrist) + 177.0 * T[:3, 0]
    return T


def test_the_rtx_as_a_chain_has_the_poses_of_its_manual(layout: Layout) -> None:
    rng = np.random.default_rng(4)
    for values in rng.uniform(-2.0, 2.0, (100, 6)):
        joints = ArmJoints(*values)
        frames = forward(layout.arm, joints)
        np.testing.assert_allclose(frames[TCP], umi_tip(joints), atol=1e-9)
        s, e = joints.shoulder_rad, joints.elbow_rad
        elbow = (253.5 * math.cos(s), 253.5 * math.sin(s), 915.0 + joints.zed_mm)
        np.testing.assert_allclose(frames["fore"][:3, 3], elbow, atol=1e-9)
        along = (math.cos(s + e), math.sin(s + e), 0.0)
        np.testing.assert_allclose(frames["fore"][:3, 0], along, atol=1e-12)
        assert frames["carriage"][2, 3] == pytest.approx(915.0 + joints.zed_mm)


def six_axis_chain(arm: SixAxis) -> Chain:
    """Return the six-axis arm of the planner's tests as the world describes arms."""
    lift = (0.0, -1.0, 0.0)
    ahead = (1.0, 0.0, 0.0)
    links = (
        Link("turret", "", moved(0, 0, arm.height_mm), (0.0, 0.0, 1.0), drive={"turret": 1.0}),
        Link("upper", "turret", moved(arm.ahead_mm, 0, 0), lift, drive={"shoulder": 1.0}),
        Link("elbow", "upper", moved(arm.upper_mm, 0, 0), lift, drive={"elbow": 1.0}),
        Link("fore", "elbow", np.eye(4), ahead, drive={"roll": 1.0}),
        # bend turns the tool down, as the model has it: about +y
        Link("wrist", "fore", moved(arm.fore_mm, 0, 0), (0.0, 1.0, 0.0), drive={"bend": 1.0}),
        Link("flange", "wrist", np.eye(4), ahead, drive={"flange": 1.0}),
        Link(TCP, "flange", moved(arm.tool_mm, 0, 0)),
    )
    return Chain(NAMES, links, one_to_one(*NAMES))


def test_six_revolute_joints_have_the_poses_of_another_description_of_that_arm() -> None:
    arm = SixAxis()
    chain = six_axis_chain(arm)
    rng = np.random.default_rng(5)
    q = LOW_RAD + rng.random((100, 6)) * (HIGH_RAD - LOW_RAD)
    R, origins = arm.link_frames(q)
    for row, T_tcp, R_links, at_mm in zip(q, arm.forward(q), R, origins, strict=True):
        poses = chain.poses(np.eye(4), row.tolist())
        np.testing.assert_allclose(poses[TCP], T_tcp, atol=1e-9)
        for number, name in enumerate(("turret", "upper")):
            np.testing.assert_allclose(poses[name][:3, :3], R_links[number], atol=1e-9)
        np.testing.assert_allclose(poses["elbow"][:3, :3], R_links[2], atol=1e-9)
        np.testing.assert_allclose(poses["wrist"][:3, 3], at_mm[3], atol=1e-9)


UR5E_CELL = ROOT / "recipes" / "cells" / "ur5e.yaml"
# by hand from the published lengths: at 0 the arm lies along -x of its base; upright it stands
UR_TIPS = [
    ("ur3e", (-456.75, -223.15, 66.5), 693.95),
    ("ur5e", (-817.2, -232.9, 62.8), 1079.4),
    ("ur10e", (-1184.25, -290.7, 60.85), 1484.8),
]


@pytest.mark.parametrize(("model", "flange_mm", "high_mm"), UR_TIPS)
def test_a_ur_arm_stands_where_its_published_lengths_say(
    model: str, flange_mm: tuple[float, float, float], high_mm: float, tmp_path: Path
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(UR5E_CELL.read_text().replace("ur5e,", f"{model}, jaws_deg: 90,"))
    arm = read_layout(path).arm
    lying = arm.chain.poses(np.eye(4), [0.0] * 6)
    np.testing.assert_allclose(lying["wrist3"][:3, 3], flange_mm, atol=1e-9)
    upright = arm.chain.poses(np.eye(4), [0.0, -math.pi / 2, 0.0, -math.pi / 2, 0.0, 0.0])
    at_mm = (0.0, flange_mm[1], high_mm)
    np.testing.assert_allclose(upright["wrist3"][:3, 3], at_mm, atol=1e-9)
    # the TCP 177 mm before the flange, whose z is -y of the base; the jaws a quarter turn off its x
    np.testing.assert_allclose(lying[TCP][:3, 3], np.add(flange_mm, (0, -177, 0)), atol=1e-9)
    np.testing.assert_allclose(lying[TCP][:3, 0], (0.0, -1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(lying[TCP][:3, 1], lying["wrist3"][:3, 1], atol=1e-12)
    # and it stands turned round at the edge of the table
    np.testing.assert_allclose(
        forward(arm, JointValues((0.0,) * 6, 85.0))["wrist3"][:3, 3],
        (-350.0 - flange_mm[0], -flange_mm[1], flange_mm[2]),
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("given", "put", "words"),
    [
        ("model: ur5e", "model: ur5", "arm.shape.model: 'ur5' is not emulated"),
        ("-90, 0]}", "-90]}", "arm.shape.park_deg: 6 joints, found 5"),
        ("flange_to_tcp_mm: 177, ", "", "entry 'flange_to_tcp_mm' is missing"),
        ("driver: ur,", "driver: kr,", "`arm.shape` describes an arm of the driver `kr`"),
    ],
)
def test_an_arm_that_cannot_be_emulated_is_named(
    given: str, put: str, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "cell.yaml"
    text = UR5E_CELL.read_text()
    assert given in text
    path.write_text(text.replace(given, put))
    with pytest.raises(LayoutError) as raised:
        read_layout(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert words in str(raised.value)


def test_two_motors_of_a_bevel_gear_share_two_joints(layout: Layout) -> None:
    """Pitch turns by half the sum of both motors, roll by half their difference."""
    chain = layout.arm.chain
    step = np.zeros(6)
    step[chain.joints.index("pitch")], step[chain.joints.index("roll")] = 0.3, 0.1
    steps = chain.motor_steps(step)
    assert (steps["wrist1"], steps["wrist2"]) == pytest.approx((0.4, 0.2))
    assert [steps[name] for name in ("shoulder", "elbow", "yaw", "zed")] == [0.0] * 4


@pytest.mark.parametrize(
    ("links", "motors", "what"),
    [
        ((Link("a", "b", np.eye(4)), Link(TCP, "a", np.eye(4))), one_to_one("x"), "not before"),
        ((Link("a", "", np.eye(4), drive={"x": 1.0}), Link(TCP, "a", np.eye(4))),
         one_to_one("x"), "axis"),
        ((Link("a", "", np.eye(4), UP_TO_X, drive={"y": 1.0}), Link(TCP, "a", np.eye(4))),
         one_to_one("x"), "axis"),
        ((Link("a", "", np.eye(4), UP_TO_X, drive={"x": 1.0}),), one_to_one("x"), "last link"),
        ((Link("a", "", np.eye(4), UP_TO_X, drive={"x": 1.0}), Link(TCP, "a", np.eye(4))),
         {"m": {}}, "motors"),
    ],
)  # fmt: skip
def test_a_chain_that_hangs_together_badly_is_refused(
    links: tuple[Link, ...], motors: dict[str, dict[str, float]], what: str
) -> None:
    with pytest.raises(ValueError, match=what):
        Chain(("x",), links, motors)


# --- the world with an arm that is no RTX --------------------------------------------------------

AXES = ("along", "across", "up", "turn")
HIGH_MM = 500.0


def gantry() -> Chain:
    """Return three slides over the table and a gripper that hangs down and turns about z."""
    T_down = np.eye(4)
    T_down[:3, :3] = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))  # approach down
    beam = Box("beam", np.array((-30.0, -30.0, -60.0)), np.array((30.0, 30.0, 300.0)))
    x, y, z = np.eye(3).tolist()
    links = (
        Link("bridge", "", moved(0, 0, HIGH_MM), tuple(x), slides=True, drive={"along": 1.0}),
        Link("cart", "bridge", np.eye(4), tuple(y), slides=True, drive={"across": 1.0}),
        Link("mast", "cart", np.eye(4), tuple(z), slides=True, drive={"up": 1.0}),
        Link("spindle", "mast", np.eye(4), tuple(z), drive={"turn": 1.0}, boxes=(beam,)),
        Link(TCP, "spindle", moved(0, 0, -200.0) @ T_down),
    )
    return Chain(AXES, links, one_to_one(*AXES))


class Mover:
    """A body of an arm that goes where a test sends it, unless the world has blocked a motor."""

    def __init__(self, *q: float) -> None:
        self.at = JointValues(q, 85.0)
        self.grasp_limit_mm: float | None = None
        self.blocked: set[tuple[str, int]] = set()

    def advance(self, dt_s: float) -> None:
        pass

    def joints(self) -> JointValues:
        return self.at

    def obstruct(self, motor: str, direction: int, blocked: bool) -> None:
        (self.blocked.add if blocked else self.blocked.discard)((motor, direction))


class Jaws:
    opening_mm = 85.0
    grasp_limit_mm: float | None = None

    def advance(self, dt_s: float) -> None:
        pass


class Bench:
    def __init__(self, layout: Layout, chain: Chain, q: tuple[float, ...], *solids: Solid) -> None:
        self.arm = Mover(*q)
        clear = Box("column", np.array((-700.0, 700.0, 0.0)), np.array((-600.0, 800.0, 20.0)))
        arm = replace(layout.arm, shape=MadeShape(chain), column=clear)
        self.layout = replace(layout, arm=arm)
        self.world = World(self.layout, solids, self.arm, Jaws(), self.arm.obstruct)

    def go(self, seconds: float, *q: float) -> None:
        start, count = np.array(self.arm.at.q), round(seconds / STEP_S)
        for share in (np.arange(count) + 1.0) / count:
            at = start + share * (np.array(q) - start)
            self.arm.at = replace(self.arm.at, q=tuple(at.tolist()))
            self.world.advance(STEP_S)

    def close(self) -> None:
        for _ in range(300):
            limit = self.arm.grasp_limit_mm
            after = self.arm.at.jaw_opening_mm - 0.3
            if limit is not None:
                after = max(after, min(limit, self.arm.at.jaw_opening_mm))
            self.arm.at = replace(self.arm.at, jaw_opening_mm=max(0.0, after))
            self.world.advance(STEP_S)


@pytest.fixture
def bench(layout: Layout, block: Solid) -> Iterator[Bench]:
    one = Bench(layout, gantry(), (360.0, 0.0, 0.0, 0.0), block)
    yield one
    one.world.close()


def test_a_gantry_lifts_a_part_and_turns_it(bench: Bench) -> None:
    world = bench.world
    world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    assert world.settle()
    before = part_pose(world, 0)
    bench.go(0.5, 360.0, 0.0, -295.0, 0.0)  # fingertips at 5 mm
    bench.close()
    assert custody(world, 0) == "arm"
    bench.go(0.5, 360.0, 0.0, -100.0, math.radians(90.0))
    after = part_pose(world, 0)
    assert before is not None
    assert after is not None
    quarter = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    np.testing.assert_allclose(after[:3, :3], quarter @ before[:3, :3], atol=1e-3)
    assert after[2, 3] - before[2, 3] == pytest.approx(195.0, abs=0.1)
    assert world.collisions == []


def test_the_motor_that_drives_into_the_table_is_stopped_and_no_other(bench: Bench) -> None:
    bench.go(0.5, 360.0, 0.0, -290.0, 0.0)
    assert bench.arm.blocked == set()
    bench.go(0.3, 380.0, 0.0, -305.0, 0.2)
    assert bench.arm.blocked == {("up", -1)}
    assert {collision.other for collision in bench.world.collisions} == {"table"}
    bench.go(0.3, 380.0, 0.0, -200.0, 0.2)
    assert bench.arm.blocked == set()


@pytest.mark.parametrize("meets_base", [True, False])
def test_a_link_that_is_built_beside_its_base_does_not_run_into_it(
    layout: Layout, block: Solid, meets_base: bool
) -> None:
    chain = gantry()
    links = tuple(
        replace(link, meets_base=meets_base) if link.name == "spindle" else link
        for link in chain.links
    )
    bench = Bench(layout, replace(chain, links=links), (-500.0, 750.0, 0.0, 0.0), block)
    try:
        bench.go(0.5, -650.0, 750.0, -435.0, 0.0)  # the beam's end 5 mm above the table
        met = {(one.moving, one.other) for one in bench.world.collisions}
        assert (("beam", "column") in met) == meets_base
        assert ("palm", "column") in met  # the gripper on the arm may run into it in any case
    finally:
        bench.world.close()


def test_a_link_of_the_chain_is_seen_and_moves(bench: Bench) -> None:
    at = bench.world.snapshot().poses["spindle"][:3, 3]
    bench.go(0.2, 400.0, 20.0, -50.0, 0.0)
    step = bench.world.snapshot().poses["spindle"][:3, 3] - at
    np.testing.assert_allclose(step, (40.0, 20.0, -50.0), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_as_built_each_link_of_an_arm_is_a_little_off(layout: Layout, seed: int) -> None:
    chain = six_axis_chain(SixAxis())
    drawn = replace(layout, arm=replace(layout.arm, shape=MadeShape(chain)))
    built = draw_as_built(drawn, seed)
    for link, nominal in zip(built.layout.arm.chain.links, chain.links, strict=True):
        T = np.linalg.inv(nominal.T_on_link) @ link.T_on_link
        by_mm = 0.5 if link.name == TCP else 0.3
        assert 0.0 < np.linalg.norm(T[:3, 3]) <= by_mm
        assert math.degrees(math.acos(min(1.0, (np.trace(T[:3, :3]) - 1) / 2))) <= 0.03 + 1e-6
        assert built.truth()["arm"]["links"][link.name] == link.T_on_link.tolist()
