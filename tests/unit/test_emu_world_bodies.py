"""The emulated world as matter: arm, parts, grasps and collisions."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from emulators.umi_scara import ArmJoints
from emulators.world import Layout, LayoutError, Solid, World, load_solid, read_layout
from emulators.world.chain import TCP
from emulators.world.ground_truth import custody, part_pose, tray_of
from emulators.world.matter.grasp import apart
from emulators.world.matter.pads import Pads
from emulators.world.matter.solid import read_pieces, solid_of
from emulators.world.poses import forward, quat_xyzw_of, rotation_of

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
STEP_S = 1.0 / 240.0
BLOCK_MM = (60.0, 40.0, 20.0)
DOWN = -math.pi / 2.0

pytestmark = pytest.mark.usefixtures("cache")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def layout() -> Layout:
    return read_layout(CELL)


@pytest.fixture(scope="module")
def block(cache: Path) -> Solid:
    return solid_of(trimesh.creation.box(BLOCK_MM), "block")


class Arm:
    """An arm that is where it is put, with jaws that stop at the limit they are told."""

    def __init__(self, **joints: float) -> None:
        start = {"shoulder_rad": math.radians(80.0), "pitch_rad": DOWN, "jaw_opening_mm": 85.0}
        self.at = ArmJoints(**{**start, **joints})
        self.grasp_limit_mm: float | None = None
        self.blocked: set[tuple[str, int]] = set()

    def advance(self, dt_s: float) -> None:
        pass

    def joints(self) -> ArmJoints:
        return self.at

    def obstruct(self, motor: str, direction: int, blocked: bool) -> None:
        (self.blocked.add if blocked else self.blocked.discard)((motor, direction))


class Jaws:
    """The fixed gripper's jaws."""

    def __init__(self) -> None:
        self.opening_mm = 85.0
        self.grasp_limit_mm: float | None = None

    def advance(self, dt_s: float) -> None:
        pass


class Bench:
    """A world with an arm and jaws that a test moves."""

    def __init__(self, layout: Layout, *solids: Solid, seed: int = 1) -> None:
        self.layout, self.arm, self.jaws = layout, Arm(), Jaws()
        self.world = World(layout, solids, self.arm, self.jaws, self.arm.obstruct, seed)

    def go(self, seconds: float, **joints: float) -> None:
        start, count = self.arm.at, round(seconds / STEP_S)
        for i in range(count):
            f = (i + 1) / count
            way = {k: getattr(start, k) * (1 - f) + v * f for k, v in joints.items()}
            self.arm.at = replace(self.arm.at, **way)
            self.world.advance(STEP_S)

    def tcp_to(self, seconds: float, x: float, y: float, z: float, psi: float) -> None:
        """Move the TCP, approach straight down; umi_rtx.md 6.5 by hand."""
        there = self.world.arm_gripper.T_world_tcp[:2, 3]
        if math.hypot(x - there[0], y - there[1]) > 150.0:  # far: over everything
            self.go(0.2, zed_mm=0.0)
            self._turn_to(seconds, x, y, 0.0, psi)
        self._turn_to(seconds, x, y, z + 177.0 - 915.0, psi)

    def _turn_to(self, seconds: float, x: float, y: float, zed_mm: float, psi: float) -> None:
        radius = math.hypot(x, y)
        elbow = 2.0 * math.acos(radius / 507.0)
        phi = math.atan2(y, x)
        self.go(
            seconds,
            shoulder_rad=phi - elbow / 2.0,
            elbow_rad=elbow,
            yaw_rad=psi - phi,
            zed_mm=zed_mm,
            pitch_rad=DOWN,
        )

    def _jaws(self, to_mm: float, now: Callable[[], float], put: Callable[[float], None]) -> None:
        for _ in range(2000):
            step = max(-0.3, min(0.3, to_mm - now()))
            body = self.arm if put == self._put_arm_gripper else self.jaws
            limit = body.grasp_limit_mm
            after = now() + step
            if limit is not None and step < 0.0:
                after = max(after, min(now(), limit))
            if after == now():
                return
            put(after)
            self.world.advance(STEP_S)

    def _put_arm_gripper(self, opening_mm: float) -> None:
        self.arm.at = replace(self.arm.at, jaw_opening_mm=opening_mm)

    def _put_fixed_gripper(self, opening_mm: float) -> None:
        self.jaws.opening_mm = opening_mm

    def arm_gripper(self, to_mm: float) -> None:
        self._jaws(to_mm, lambda: self.arm.at.jaw_opening_mm, self._put_arm_gripper)

    def fixed_gripper(self, to_mm: float) -> None:
        self._jaws(to_mm, lambda: self.jaws.opening_mm, self._put_fixed_gripper)

    def pick_block(self, theta_rad: float = 0.0, off_mm: float = 0.0) -> None:
        """Grip a block that lies at (360, 0) across its 40 mm, and lift it."""
        self.world.drop(0, 360.0, 0.0, rest=0, theta_rad=theta_rad)
        assert self.world.settle()
        self.tcp_to(0.5, 360.0, off_mm, 150.0, 0.0)
        self.tcp_to(0.5, 360.0, off_mm, 5.0, 0.0)
        self.arm_gripper(0.0)
        self.tcp_to(0.5, 360.0, off_mm, 150.0, 0.0)


@pytest.fixture
def bench(layout: Layout, block: Solid) -> Iterator[Bench]:
    one = Bench(layout, block)
    yield one
    one.world.close()


# --- layout and arm ------------------------------------------------------------------------------


def test_the_arm_stands_where_the_reference_table_says(layout: Layout) -> None:
    # umi_rtx.md 6.6: S E Z W1 W2 Y -> wrist, tip, heading
    rows = [
        (0, 0, 0, 0, 0, 0, (684.00, 0.0, 915.00), 0.0),
        (0, 0, -1875, 0, 0, 0, (684.00, 0.0, 415.00), 0.0),
        (1315, -1315, -1875, -607, -607, 0, (483.65, 0.01, 289.83), 0.002),
        (500, 1461, -1500, -1214, -1214, 487, (126.80, 300.21, 338.00), 117.108),
        (-1000, 1500, -2000, 300, -500, 400, (395.31, 242.33, 358.83), 58.177),
        (0, 2206, -1000, 0, 0, 735, (-122.92, 208.91, 648.33), 150.953),
    ]
    for s, e, z, w1, w2, y, tip_mm, heading_deg in rows:
        joints = ArmJoints(
            shoulder_rad=math.radians(s / 29.221),
            elbow_rad=math.radians(e / 14.611),
            yaw_rad=math.radians(y / 9.740),
            zed_mm=z / 3.750,
            pitch_rad=math.radians((w1 + w2) / (2 * 13.487)),
            roll_rad=math.radians((w1 - w2) / (2 * 13.487)),
        )
        T = forward(layout.arm, joints)[TCP]
        assert T[:3, 3] == pytest.approx(tip_mm, abs=0.006)
        pitch = joints.pitch_rad
        if abs(math.cos(pitch)) > 1e-3:
            heading = math.degrees(math.atan2(T[1, 0], T[0, 0]))
            assert heading == pytest.approx(heading_deg, abs=0.001)
        assert T[2, 0] == pytest.approx(math.sin(pitch))
        assert T[:3, :3] @ T[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_quaternions_are_pybullets_and_back() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        q = rng.normal(size=4)
        R = rotation_of(tuple(q / np.linalg.norm(q)))
        assert rotation_of(quat_xyzw_of(R)) == pytest.approx(R, abs=1e-12)
    # about z by 90 degrees: x -> y
    half = math.sqrt(0.5)
    assert rotation_of((0.0, 0.0, half, half)) @ (1, 0, 0) == pytest.approx((0, 1, 0), abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1, 2]", "mapping"),
        ("name: x\n", "table"),
        ("name: [", "not YAML"),
    ],
)
def test_a_cell_file_that_cannot_be_used_says_why(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    with pytest.raises(LayoutError, match=words):
        read_layout(path)


def in_old_names(text: str) -> str:
    """Return a cell file as it was written before its keys were renamed."""
    text = text.replace("\nfixed_gripper:", "\nfixture:").replace("  arm_gripper:", "  hand:")
    return text.replace("part_in_fixed_gripper:", "part_in_fixture:")


def test_a_cell_file_with_the_old_names_of_keys_means_the_same(tmp_path: Path) -> None:
    text, path = CELL.read_text(), tmp_path / "old.yaml"
    path.write_text(in_old_names(text))
    assert "fixed_gripper" not in path.read_text()
    old, new = read_layout(path), read_layout(CELL)
    assert repr(old.fixed_gripper) == repr(new.fixed_gripper)
    assert repr((old.post, old.arm.gripper)) == repr((new.post, new.arm.gripper))
    path.write_text(text + "fixture: {}\n")
    with pytest.raises(LayoutError, match="`fixture` is the old name of `fixed_gripper`"):
        read_layout(path)


def test_parts_that_cannot_be_used_say_why(tmp_path: Path) -> None:
    with pytest.raises(LayoutError, match=r"no\.stl"):
        load_solid(tmp_path / "no.stl")
    open_box = trimesh.creation.box((10.0, 10.0, 10.0))
    open_box.update_faces(np.arange(len(open_box.faces)) > 1)
    open_box.export(tmp_path / "open.stl")
    with pytest.raises(LayoutError, match="watertight"):
        load_solid(tmp_path / "open.stl")


# --- parts as bodies -----------------------------------------------------------------------------


def test_a_block_weighs_and_turns_as_aluminium_does(block: Solid) -> None:
    a, b, c = BLOCK_MM
    mass_kg = a * b * c * 2700e-9
    assert block.mass_kg == pytest.approx(mass_kg)
    moments = [mass_kg / 12.0 * (p * p + q * q) * 1e-6 for p, q in ((b, c), (a, c), (a, b))]
    assert np.sort(block.inertia_kg_m2) == pytest.approx(np.sort(moments))


def test_a_block_rests_on_six_sides_by_their_solid_angles(block: Solid) -> None:
    assert len(block.rests) == 6
    assert sum(rest.solid_angle for rest in block.rests) == pytest.approx(1.0)
    # the rectangle 2a x 2b seen from h above its middle: 4 asin(ab / sqrt((a2+h2)(b2+h2))) / 4 pi
    a, b, h = 30.0, 20.0, 10.0
    share = math.asin(a * b / math.sqrt((a * a + h * h) * (b * b + h * h))) / math.pi
    assert block.rests[0].solid_angle == pytest.approx(share)
    assert abs(block.rests[0].down[2]) == pytest.approx(1.0)
    assert block.rests[0].topple_rad == pytest.approx(math.atan2(20.0, 10.0))
    assert block.rests[0].R @ block.rests[0].down == pytest.approx((0.0, 0.0, -1.0))


def test_a_round_bar_has_only_its_ends_to_stand_on() -> None:
    bar = solid_of(trimesh.creation.cylinder(radius=10.0, height=12.0, sections=64), "bar")
    assert len(bar.stable_rests) == 2
    assert len(bar.rests) > 60


def test_convex_pieces_follow_an_angle_and_are_made_once(cache: Path) -> None:
    angle = trimesh.creation.extrude_polygon(
        trimesh.path.polygons.Polygon([(0, 0), (60, 0), (60, 10), (10, 10), (10, 50), (0, 50)]),
        30.0,
    )
    solid = solid_of(angle, "angle")
    pieces = [
        p * 1000.0 @ solid.T_part_body[:3, :3].T + solid.centre_mm
        for p in read_pieces(solid.pieces_path)
    ]
    assert len(pieces) >= 2
    volume = sum(trimesh.convex.convex_hull(p).volume for p in pieces)
    assert volume == pytest.approx(angle.volume, rel=0.12)  # one hull would be 70 % too much
    stamp = solid.pieces_path.stat().st_mtime_ns
    assert solid_of(angle.copy(), "again").pieces_path.stat().st_mtime_ns == stamp


def test_a_dropped_block_comes_to_rest_exactly_on_the_table(bench: Bench) -> None:
    world = bench.world
    world.drop(0, 400.0, 50.0, rest=0, theta_rad=0.7)
    assert not world.is_at_rest
    assert world.settle(2.0)
    T = part_pose(world, 0)
    assert T is not None
    assert abs(T[2, 2]) == pytest.approx(1.0, abs=1e-12)
    assert T[2, 3] == pytest.approx(BLOCK_MM[2] / 2.0, abs=1e-9)
    assert T[:2, 3] == pytest.approx((400.0, 50.0), abs=1.0)
    assert custody(world, 0) == "free"


def test_a_block_stood_on_its_edge_topples(bench: Bench) -> None:
    T = np.eye(4)
    c, s = math.cos(0.5), math.sin(0.5)
    T[:3, :3] = ((1, 0, 0), (0, c, -s), (0, s, c))
    T[:3, 3] = 360.0, 0.0, 40.0
    bench.world.place(0, T)
    assert bench.world.settle(5.0)
    after = part_pose(bench.world, 0)
    assert after is not None
    assert np.abs(after[2, :3]).max() == pytest.approx(1.0, abs=1e-9)


def test_the_same_seed_gives_the_same_world(layout: Layout, block: Solid) -> None:
    poses = []
    for seed in (5, 5, 6):
        one = Bench(layout, block, seed=seed)
        one.world.drop(0)
        assert one.world.settle()
        poses.append(part_pose(one.world, 0))
        one.world.close()
    assert np.array_equal(poses[0], poses[1])
    assert not np.allclose(poses[0], poses[2], atol=1.0)


def test_random_drops_fill_the_drop_area_and_stay_in_it(layout: Layout, block: Solid) -> None:
    one = Bench(layout, block)
    spots = []
    for _ in range(40):
        one.world.drop(0)
        spots.append(one.world.parts[0].centre_mm[:2].copy())
    one.world.close()
    low, high = np.min(spots, axis=0), np.max(spots, axis=0)
    assert np.all(low >= layout.drop_low_mm)
    assert np.all(high <= layout.drop_high_mm)
    assert np.all(high - low > 0.7 * (layout.drop_high_mm - layout.drop_low_mm))


def test_two_parts_push_each_other_apart(layout: Layout, block: Solid) -> None:
    one = Bench(layout, block, block)
    one.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    one.world.settle()
    one.world.drop(1, 360.0, 0.0, rest=0, theta_rad=0.4)
    T = part_pose(one.world, 1)
    assert T is not None
    T[2, 3] += 25.0
    one.world.place(1, T)
    assert one.world.settle()
    assert one.world.parts[1].centre_mm[2] > 25.0  # it lies on the other, not in it
    one.world.close()


# --- gripping ------------------------------------------------------------------------------------


def test_a_grip_centres_and_squares_the_part_and_the_jaws_stop_at_its_width(bench: Bench) -> None:
    bench.pick_block(theta_rad=math.radians(2.0), off_mm=1.0)
    assert custody(bench.world, 0) == "arm"
    assert bench.arm.at.jaw_opening_mm == pytest.approx(40.0, abs=0.002)
    T_world_part, T_world_tcp = part_pose(bench.world, 0), bench.world.arm_gripper.T_world_tcp
    assert T_world_part is not None
    T = np.linalg.inv(T_world_tcp) @ T_world_part
    assert abs(T[1, 3]) < 0.01  # in the middle between the pads
    assert abs(abs(T[1, 1]) - 1.0) < 1e-6  # flush
    assert [event.what for event in bench.world.events][-1] == "gripped"


def test_closing_on_nothing_closes(bench: Bench) -> None:
    bench.tcp_to(0.2, 360.0, 0.0, 150.0, 0.0)
    bench.arm_gripper(0.0)
    assert bench.arm.at.jaw_opening_mm == 0.0
    assert bench.arm.grasp_limit_mm is None


def test_a_held_part_does_not_move_in_the_gripper(bench: Bench) -> None:
    bench.pick_block()
    gripper, part = bench.world.arm_gripper, bench.world.parts[0]
    T_before = np.linalg.inv(gripper.T_world_tcp) @ part.T_world_part
    bench.tcp_to(1.0, 250.0, 200.0, 300.0, 1.3)
    bench.go(1.0, pitch_rad=-0.3, roll_rad=0.9)
    bench.tcp_to(1.0, 380.0, -80.0, 260.0, 0.4)
    T_after = np.linalg.inv(gripper.T_world_tcp) @ part.T_world_part
    off_mm, off_rad = apart(T_before, T_after)
    assert off_mm < 0.001
    assert off_rad < math.radians(0.001)


def test_a_released_part_falls_and_lies_in_the_tray_below(bench: Bench) -> None:
    bench.pick_block()
    bench.tcp_to(1.0, 250.0, 250.0, 200.0, 1.0)
    bench.tcp_to(1.0, 100.0, 390.0, 8.0, 1.0)
    bench.arm_gripper(85.0)
    assert bench.world.settle()
    assert custody(bench.world, 0) == "free"
    assert tray_of(bench.world, 0) == "accept"
    # the fingers let go of both sides at once, so it falls straight
    assert bench.world.parts[0].centre_mm[:2] == pytest.approx((100.0, 390.0), abs=2.0)


def test_a_finger_pushes_a_part_along(bench: Bench) -> None:
    bench.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    bench.world.settle()
    bench.arm_gripper(20.0)
    bench.tcp_to(0.5, 360.0, -70.0, 150.0, 0.0)
    bench.tcp_to(0.5, 360.0, -70.0, 8.0, 0.0)
    bench.tcp_to(1.0, 360.0, -10.0, 8.0, 0.0)
    # the finger's outer face is 10 + 8 mm ahead of the tip: at y = 8, and half the block beyond
    assert bench.world.parts[0].centre_mm[1] == pytest.approx(28.0, abs=2.5)
    assert custody(bench.world, 0) == "free"


def test_a_part_gripped_by_a_corner_falls_out(bench: Bench) -> None:
    bench.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    bench.world.settle()
    # only 0.4 mm of the block's end is between the pads, which are 12 mm wide
    bench.tcp_to(0.5, 360.0 + 30.0 + 5.6, 0.0, 150.0, 0.0)
    bench.tcp_to(0.5, 360.0 + 30.0 + 5.6, 0.0, 5.0, 0.0)
    bench.arm_gripper(0.0)
    bench.tcp_to(0.5, 360.0 + 30.0 + 5.6, 0.0, 100.0, 0.0)
    assert bench.world.settle()
    assert custody(bench.world, 0) == "free"
    assert bench.world.parts[0].centre_mm[2] < 25.0


def test_a_lost_part_is_not_caught_again_before_the_jaws_have_opened(bench: Bench) -> None:
    bench.pick_block()
    bench.world.lose_grasp("arm")
    assert custody(bench.world, 0) == "free"
    bench.arm_gripper(30.0)
    assert bench.world.settle()
    assert custody(bench.world, 0) == "free"
    assert bench.world.parts[0].centre_mm[2] < 25.0


def test_a_grip_told_to_miss_closes_on_nothing_once_and_the_next_one_holds(bench: Bench) -> None:
    bench.world.miss("arm")
    bench.pick_block()
    assert custody(bench.world, 0) == "free"
    assert bench.arm.at.jaw_opening_mm == 0.0
    assert bench.world.settle()
    bench.arm_gripper(85.0)
    bench.pick_block()
    assert custody(bench.world, 0) == "arm"


def test_a_slip_turns_the_part_about_the_pads_and_moves_it_along_the_fingers(bench: Bench) -> None:
    bench.pick_block()
    before = np.linalg.inv(bench.world.arm_gripper.T_world_tcp) @ bench.world.parts[0].T_world_part
    bench.world.slip("arm", 4.0, math.radians(10.0))
    after = np.linalg.inv(bench.world.arm_gripper.T_world_tcp) @ bench.world.parts[0].T_world_part
    moved = after @ np.linalg.inv(before)
    assert moved[:3, 3] == pytest.approx((4.0, 0.0, 0.0), abs=1e-9)
    assert moved[:3, 1] == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
    assert math.degrees(math.acos(moved[0, 0])) == pytest.approx(10.0)
    assert custody(bench.world, 0) == "arm"


def test_the_world_tells_letting_go_over_the_table_from_letting_go_in_the_air(
    bench: Bench,
) -> None:
    bench.pick_block()
    bench.arm_gripper(85.0)
    high = [event for event in bench.world.events if event.what == "released"][-1]
    # lifted from 5 to 150 mm, the block's lower side lies 145 mm above the table
    assert high.lowest_mm == pytest.approx(145.0, abs=1.0)
    assert not high.is_held
    bench.pick_block()
    bench.tcp_to(0.5, 360.0, 0.0, 6.0, 0.0)
    bench.arm_gripper(85.0)
    low = [event for event in bench.world.events if event.what == "released"][-1]
    assert low.lowest_mm == pytest.approx(1.0, abs=0.6)


# --- handing over --------------------------------------------------------------------------------


def bring_to_fixed_gripper(bench: Bench, off_mm: float = 0.0) -> None:
    """Put the block into the open fixed gripper: its 20 mm between the pads, held across 40."""
    bench.pick_block()
    tip = bench.layout.fixed_gripper.T_world_tcp
    # approach down and jaws along x: the block's 60 along y, 40 along x, 20 upright
    bench.tcp_to(1.0, 220.0, -200.0, 550.0, math.pi / 2.0)
    x, y, z = tip[:3, 3] + (0.0, 18.0, off_mm)
    grasp_z = z - (bench.world.parts[0].centre_mm[2] - bench.world.arm_gripper.T_world_tcp[2, 3])
    bench.tcp_to(1.0, x, y, 550.0, math.pi / 2.0)
    bench.tcp_to(1.0, x, y, grasp_z, math.pi / 2.0)


def test_a_part_is_passed_on_without_ever_being_loose(bench: Bench) -> None:
    bring_to_fixed_gripper(bench)
    assert custody(bench.world, 0) == "arm"
    assert bench.world.is_part_in_fixed_gripper
    bench.world.collisions.clear()  # the plain way in passes through a finger
    bench.fixed_gripper(0.0)
    assert bench.jaws.opening_mm == pytest.approx(20.0, abs=0.01)
    assert custody(bench.world, 0) == "both"
    before = bench.world.parts[0].centre_mm.copy()
    bench.arm_gripper(85.0)
    assert custody(bench.world, 0) == "fixture"
    bench.go(0.5, zed_mm=bench.arm.at.zed_mm + 120.0)
    assert custody(bench.world, 0) == "fixture"
    assert bench.world.parts[0].centre_mm == pytest.approx(before, abs=1.5)
    (let_go,) = [event for event in bench.world.events if event.what == "released"]
    assert let_go.is_held  # by the other one
    assert bench.world.collisions == []
    bench.fixed_gripper(85.0)
    assert bench.world.settle()
    assert custody(bench.world, 0) == "free"
    assert bench.world.parts[0].centre_mm[2] < 40.0


def test_pads_give_a_little_and_then_the_part_is_torn_from_the_arm(bench: Bench) -> None:
    bring_to_fixed_gripper(bench)
    bench.fixed_gripper(0.0)
    bench.go(0.2, zed_mm=bench.arm.at.zed_mm + 2.0)
    assert custody(bench.world, 0) == "both"
    bench.go(0.2, zed_mm=bench.arm.at.zed_mm + 6.0)
    assert custody(bench.world, 0) == "fixture"
    assert "torn" in [event.what for event in bench.world.events]


def test_a_part_far_off_the_middle_stops_one_finger_and_is_not_held(bench: Bench) -> None:
    bring_to_fixed_gripper(bench, off_mm=8.0)
    bench.fixed_gripper(0.0)
    # the upper finger meets the block at 10 + 8 mm from the middle, the lower one nothing yet
    assert bench.jaws.opening_mm == pytest.approx(36.0, abs=0.7)
    assert custody(bench.world, 0) == "arm"


def test_jaws_that_a_part_had_stopped_close_once_it_is_gone(bench: Bench) -> None:
    bring_to_fixed_gripper(bench, off_mm=8.0)
    bench.fixed_gripper(0.0)
    bench.fixed_gripper(85.0)
    bench.go(0.5, zed_mm=bench.arm.at.zed_mm + 120.0)
    bench.fixed_gripper(0.0)
    assert bench.jaws.opening_mm == 0.0


# --- running into things -------------------------------------------------------------------------


def test_the_gripper_stops_at_the_table_and_comes_up_again(bench: Bench) -> None:
    bench.tcp_to(0.5, 360.0, 100.0, 20.0, 0.0)
    bench.go(0.3, zed_mm=bench.arm.at.zed_mm - 20.8)
    assert ("zed", -1) in bench.arm.blocked
    assert {c.other for c in bench.world.collisions} == {"table"}
    bench.go(0.3, zed_mm=bench.arm.at.zed_mm + 20.0)
    assert not bench.arm.blocked


def test_a_gripper_that_has_not_moved_yet_is_where_the_arm_holds_it(bench: Bench) -> None:
    tip = forward(bench.layout.arm, bench.arm.at)[TCP]
    assert bench.world.snapshot().poses[TCP] == pytest.approx(tip)
    assert bench.world.arm_gripper.T_world_tcp == pytest.approx(tip)
    bench.arm_gripper(60.0)
    assert bench.world.collisions == []


def test_a_gripper_may_leave_a_part_that_lies_against_its_finger(bench: Bench) -> None:
    bench.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    bench.world.settle()
    bench.arm_gripper(42.0)
    bench.tcp_to(0.5, 360.0, 0.0, 60.0, 0.0)
    bench.tcp_to(0.5, 360.0, 0.0, 5.0, 0.0)
    part = bench.world.parts[0]
    T = part.T_world_part.copy()
    T[1, 3] += 1.2  # it has come to lie 0.2 mm inside a finger
    part.move(T)
    bench.go(0.5, zed_mm=bench.arm.at.zed_mm + 60.0)
    assert bench.world.collisions == []
    assert not bench.arm.blocked
    assert part.centre_mm[2] == pytest.approx(10.0, abs=1e-6)


def test_a_part_that_topples_when_let_go_does_not_catch_the_gripper(bench: Bench) -> None:
    T = np.eye(4)
    T[:3, :3] = ((1, 0, 0), (0, 0, -1), (0, 1, 0))  # on its narrow long side, 20 mm thick
    T[:3, 3] = 360.0, 0.0, 20.0
    bench.world.place(0, T)
    assert bench.world.settle()
    bench.tcp_to(0.5, 360.0, 0.0, 150.0, 0.0)
    bench.tcp_to(0.5, 360.0, 0.0, 20.0, 0.0)
    bench.arm_gripper(0.0)
    assert custody(bench.world, 0) == "arm"
    bench.go(0.3, zed_mm=bench.arm.at.zed_mm + 10.0, roll_rad=0.5)
    bench.arm_gripper(26.0)
    assert bench.world.settle()
    bench.go(0.2, zed_mm=bench.arm.at.zed_mm - 1.0)
    bench.go(0.5, zed_mm=bench.arm.at.zed_mm + 80.0)
    assert bench.world.collisions == []
    assert not bench.world.arm_gripper.passing
    bench.go(0.1, zed_mm=bench.arm.at.zed_mm + 1.0)


def test_a_gripper_swung_into_the_station_panel_stops_the_axis_that_swings_it(bench: Bench) -> None:
    bench.tcp_to(0.5, 410.0, 150.0, 450.0, 0.0)
    assert not bench.world.collisions
    bench.go(1.0, shoulder_rad=bench.arm.at.shoulder_rad + 0.6)
    assert ("shoulder", 1) in bench.arm.blocked
    assert not {motor for motor, _ in bench.arm.blocked} & {"zed", "wrist1", "wrist2"}
    assert {c.other for c in bench.world.collisions} == {"station_panel"}


def test_a_finger_that_comes_down_on_a_part_stops_and_may_go_up_again(bench: Bench) -> None:
    bench.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    bench.world.settle()
    bench.arm_gripper(20.0)
    bench.tcp_to(0.5, 360.0, 0.0, 60.0, 0.0)
    bench.go(0.5, zed_mm=bench.arm.at.zed_mm - 42.0)
    assert ("zed", -1) in bench.arm.blocked
    assert {c.other for c in bench.world.collisions} == {"part 0"}
    bench.go(0.5, zed_mm=bench.arm.at.zed_mm + 10.0)
    assert not bench.arm.blocked
    assert bench.world.parts[0].centre_mm[:2] == pytest.approx((360.0, 0.0), abs=1.0)


def test_fingers_in_a_hollow_that_convex_pieces_would_fill_do_not_move_the_part(
    layout: Layout,
) -> None:
    # a disc with a hub: one convex piece would be a cone where the fingers stand
    disc = trimesh.creation.cylinder(radius=50.0, height=8.0, sections=64)
    home_q = trimesh.creation.cylinder(radius=15.0, height=16.0, sections=64)
    disc.apply_translation((0.0, 0.0, 4.0))
    home_q.apply_translation((0.0, 0.0, 16.0))
    both = trimesh.boolean.union([disc, home_q])
    bench = Bench(layout, solid_of(both, "flange"))
    bench.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    bench.world.settle()
    top_mm = bench.world.parts[0].bounds_mm[1][2]
    assert top_mm == pytest.approx(24.0, abs=0.01)
    before = bench.world.parts[0].centre_mm.copy()
    bench.arm_gripper(40.0)
    bench.tcp_to(0.5, 360.0, 2.0, 60.0, 0.0)
    bench.tcp_to(0.5, 360.0, 2.0, 10.0, 0.0)
    assert bench.world.parts[0].centre_mm == pytest.approx(before, abs=1e-9)
    bench.arm_gripper(0.0)
    assert custody(bench.world, 0) == "arm"
    assert bench.arm.at.jaw_opening_mm == pytest.approx(30.0, abs=0.05)
    assert bench.world.parts[0].centre_mm[1] == pytest.approx(2.0, abs=0.1)
    assert bench.world.collisions == []
    bench.world.close()


def test_a_push_beside_the_middle_turns_a_part_and_leaves_the_point_where_it_is_pushed(
    bench: Bench,
) -> None:
    bench.world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.0)
    bench.world.settle()
    part = bench.world.parts[0]
    centre = part.centre_mm.copy()
    point = centre + np.array((20.0, -20.0, 0.0))
    local = np.linalg.inv(part.T_world_part) @ np.append(point, 1.0)
    part.slide(point, np.array((0.0, 0.01, 5.0)))
    moved = (part.T_world_part @ local)[:3] - point
    assert moved[1] == pytest.approx(0.01, rel=1e-3)
    assert moved[2] == pytest.approx(0.0, abs=1e-9)
    assert part.T_world_part[1, 0] * part.T_world_part[0, 0] > 0.0  # counter-clockwise
    assert 0.0 < part.centre_mm[1] - centre[1] < 0.01


def test_a_held_part_meets_the_table_before_the_gripper_does(bench: Bench) -> None:
    bench.pick_block()
    bench.tcp_to(0.5, 360.0, 0.0, 2.0, 0.0)
    assert [(c.moving, c.other) for c in bench.world.collisions] == [("part 0", "table")]


def test_the_park_position_and_a_pick_run_into_nothing(bench: Bench) -> None:
    bench.go(0.1, shoulder_rad=math.radians(80.0), elbow_rad=0.0, yaw_rad=0.0, pitch_rad=DOWN)
    bench.pick_block()
    assert bench.world.collisions == []


def test_pads_find_the_width_of_a_round_bar_to_a_hundredth(layout: Layout) -> None:
    bar = trimesh.creation.cylinder(radius=15.0, height=40.0, sections=256)
    solid = solid_of(bar, "bar")
    pads = Pads(layout.arm.gripper.fingers)
    T = np.eye(4)
    T[:3, 3] = -12.0, 0.7, 0.0  # 0.7 off the middle
    seat = pads.seat(solid.ray_scene(), T, 34.0)
    assert seat.opening_mm == pytest.approx(30.0, abs=0.02)
    assert seat.shift_mm == pytest.approx(0.7, abs=0.02)


def test_a_calm_world_costs_next_to_nothing(bench: Bench) -> None:
    bench.world.drop(0, 360.0, 0.0, rest=0)
    bench.world.settle()
    steps = 0

    def count() -> None:
        nonlocal steps
        steps += 1

    bench.world.bodies.step = count  # type: ignore[method-assign]  # counts physics steps
    bench.world.advance(60.0)
    assert steps == 0
    assert bench.world.time_s > 60.0
