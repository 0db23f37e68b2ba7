"""Boards and parts that a person brings into the emulated cell while it runs."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from emu_faults_bench import ROOT, StillCell

from emulators.umi_scara import Axis
from emulators.world import PictureMaker
from emulators.world.matter.solid import read_pieces

BOARDS = ROOT / "recipes" / "boards"
RING = 1
CLOSE = [0, 0, 0, 0, 2]  # umi_rtx.md 2.6: the gripper is motor 4 of IP 1; 2 is reverse


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("cell")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture
def cell(folder: Path) -> Iterator[StillCell]:
    cell = StillCell(folder)
    cell.verbs.do("remove")
    yield cell
    cell.desk.close()
    cell.world.close()
    cell.clock.close()


def pose(cell: StillCell, part: int) -> Any:
    return np.array(cell.verbs.do("truth")["parts"][part]["T_world_part"])


def custody(cell: StillCell, part: int) -> str:
    return str(cell.verbs.do("truth")["parts"][part]["custody"])


def board(name: str) -> str:
    return str(BOARDS / f"{name}.json")


def open_arm_gripper(cell: StillCell, opening_mm: float) -> None:
    """Put the arm gripper's jaws where they are so far apart."""
    axis = cell.arm.axes[Axis.GRIPPER]
    cell.arm.place({Axis.GRIPPER: axis.position})
    low, high = 0.0, 1400.0
    for _ in range(40):
        counts = (low + high) / 2.0
        cell.arm.place({Axis.GRIPPER: counts})
        is_narrow = cell.arm.joints().jaw_opening_mm < opening_mm
        low, high = (counts, high) if is_narrow else (low, counts)
    cell.world.advance(1.0 / 240.0)
    assert cell.world.arm_gripper.opening_mm == pytest.approx(opening_mm, abs=0.1)


def test_a_board_lies_where_it_was_put(cell: StillCell) -> None:
    answer = cell.verbs.do("board", file=board("charuco"), x_mm=300, y_mm=-70, theta_deg=90)
    T = pose(cell, answer["part"])
    np.testing.assert_allclose(T[:3, 3], (300.0, -70.0, 5.0), atol=1e-9)  # 5 mm thick
    np.testing.assert_allclose(T[:3, 0], (0.0, 1.0, 0.0), atol=1e-9)
    cell.pass_time(0.5)
    np.testing.assert_array_equal(pose(cell, answer["part"]), T)


def test_a_board_in_the_drop_area_lies_over_its_middle(cell: StillCell) -> None:
    T = pose(cell, cell.verbs.do("board", file=board("charuco"), theta_deg=25)["part"])
    # print of 12 x 9 squares of 15 mm; its middle from the first inner corner
    middle = T @ (5 * 15.0, 3.5 * 15.0, 0.0, 1.0)
    np.testing.assert_allclose(middle[:2], (360.0, 0.0), atol=1e-9)


def test_a_person_lays_a_board_a_little_beside_its_mark_and_each_time_elsewhere(
    cell: StillCell,
) -> None:
    at = {"file": board("charuco"), "x_mm": 300, "y_mm": -70}
    places = [pose(cell, cell.verbs.do("board", **at, seed=seed)["part"]) for seed in range(8)]
    off_mm = np.array([T[:2, 3] for T in places]) - (300.0, -70.0)
    assert np.abs(off_mm).max() <= 1.5
    assert len(np.unique(off_mm, axis=0)) == 8
    assert np.ptp(off_mm, axis=0).min() > 0.5
    again = pose(cell, cell.verbs.do("board", **at, seed=3)["part"])
    np.testing.assert_array_equal(again, places[3])


def test_the_same_board_brought_again_is_the_same_body(cell: StillCell) -> None:
    first = cell.verbs.do("board", file=board("charuco"))["part"]
    cell.verbs.do("remove", part=first)
    assert custody(cell, first) == "away"
    assert cell.verbs.do("board", file=board("charuco"))["part"] == first
    assert cell.verbs.do("board", file=board("charuco"), scale=1.01)["part"] == first + 1


def test_a_misprint_is_larger_whoever_brings_it_and_is_taken_by_its_file(cell: StillCell) -> None:
    right = cell.verbs.do("board", file=board("charuco"))["part"]
    cell.verbs.do("misprint", file=board("charuco"), scale=1.01)
    wrong = cell.verbs.do("board", file=board("charuco"))["part"]
    assert wrong != right
    assert cell.verbs.do("board", file=board("charuco"), scale=1.01)["part"] == wrong
    assert cell.verbs.do("board", file=board("charuco"), scale=1.0)["part"] == right
    cell.verbs.do("remove", file=board("charuco"))
    assert custody(cell, right) == custody(cell, wrong) == "away"


def test_a_propped_board_stands_on_its_lower_edge_and_stays(cell: StillCell) -> None:
    part = cell.verbs.do("board", file=board("chessboard"), tilt_deg=20)["part"]
    T = pose(cell, part)
    assert np.degrees(np.arccos(T[2, 2])) == pytest.approx(20.0)
    assert cell.world.parts[part].lowest_mm == pytest.approx(0.0, abs=1e-9)
    cell.verbs.do("drop", x_mm=300, y_mm=-250, rest=0)  # what falls elsewhere does not wake it
    cell.pass_time(1.0)
    np.testing.assert_array_equal(pose(cell, part), T)


def test_a_board_that_lies_stays_when_something_falls_elsewhere(cell: StillCell) -> None:
    part = cell.verbs.do("board", file=board("charuco"))["part"]
    T = pose(cell, part)
    cell.verbs.do("drop", x_mm=300, y_mm=-250, rest=0)
    cell.world.settle()
    np.testing.assert_allclose(pose(cell, part), T, atol=0.02)


def test_the_arm_gripper_closes_on_the_paddle_that_a_person_holds_there(cell: StillCell) -> None:
    open_arm_gripper(cell, 40.0)
    part = cell.verbs.do("give", file=board("paddle"), seed=5)["part"]
    tcp = cell.world.arm_gripper.T_world_tcp
    held = np.linalg.inv(tcp) @ pose(cell, part)
    # the print stands out beyond the fingers, its normal along the jaws' axis
    np.testing.assert_allclose(held[:3, 2], (0.0, 1.0, 0.0), atol=1e-9)
    lowest_of_print = held @ (30.0, -12.0, 0.0, 1.0)
    assert lowest_of_print[0] > 3.0
    cell.arm.set_power(1, True)
    cell.arm.go_manual(1, CLOSE)
    cell.pass_time(5.0)
    assert cell.world.arm_gripper.opening_mm == pytest.approx(10.0, abs=0.1)  # the plate's
    assert custody(cell, part) == "arm"
    tcp = cell.world.arm_gripper.T_world_tcp
    seated = np.linalg.inv(tcp) @ pose(cell, part)
    assert seated[1, 3] == pytest.approx(5.0, abs=0.05)  # the front's distance from the middle
    np.testing.assert_allclose(seated[[0, 2], 3], held[[0, 2], 3], atol=0.5)


def test_a_person_holds_the_paddle_each_time_a_little_otherwise(cell: StillCell) -> None:
    open_arm_gripper(cell, 40.0)
    tcp = cell.world.arm_gripper.T_world_tcp
    turns, places = [], []
    for seed in (None, 1, 2, 3):
        part = cell.verbs.do("give", file=board("paddle"), seed=seed)["part"]
        T = np.linalg.inv(tcp) @ pose(cell, part)
        turns.append(np.degrees(np.arctan2(-T[2, 1], T[0, 1])))
        places.append((T @ (30.0, -15.0, -5.0, 1.0))[[0, 2]])  # where the bare side begins
        cell.verbs.do("remove", part=part)
    np.testing.assert_allclose(places[0], (3.0, 0.0), atol=1e-9)
    assert turns[0] == pytest.approx(0.0, abs=1e-9)
    assert len(set(turns)) == 4
    assert np.abs(turns).max() <= 3.0
    assert np.abs(np.array(places) - (3.0, 0.0)).max() < 3.0


def test_a_plate_is_one_convex_piece_exactly_as_large_as_it_is(cell: StillCell) -> None:
    part = cell.world.parts[cell.verbs.do("board", file=board("paddle"))["part"]]
    (corners_m,) = read_pieces(part.solid.pieces_path)
    # the body's axes are the plate's, in some order
    assert sorted(1e3 * np.ptp(corners_m, axis=0)) == pytest.approx([10.0, 90.0, 120.0])


def test_jaws_that_are_too_narrow_take_no_paddle(cell: StillCell) -> None:
    open_arm_gripper(cell, 8.0)
    with pytest.raises(ValueError, match=r"stands at 8\.\d mm: part 1 needs 10\.0 mm"):
        cell.verbs.do("give", file=board("paddle"))


def test_a_board_without_a_bare_side_cannot_be_held(cell: StillCell) -> None:
    with pytest.raises(ValueError, match="bare_mm"):
        cell.verbs.do("give", file=board("charuco"))


def test_a_gauge_block_that_was_not_known_before_stops_the_fixed_jaws(
    cell: StillCell, folder: Path
) -> None:
    block = folder / "gauge.stl"
    trimesh.creation.box((9.0, 30.0, 35.0)).export(block)
    part = cell.verbs.do("add", file=str(block))["part"]
    assert custody(cell, part) == "away"
    cell.jaws.opening_mm = 60.0
    cell.world.advance(1.0 / 240.0)
    cell.verbs.do("give", part=part, gripper="fixture", axis="y")
    cell.jaws.drive(0.0, 150.0, 60.0)
    cell.pass_time(0.5)
    assert cell.jaws.opening_mm == pytest.approx(30.0, abs=0.1)
    assert custody(cell, part) == "fixture"


def test_pictures_show_what_was_brought_and_nothing_after_it_was_taken(cell: StillCell) -> None:
    maker = PictureMaker(cell.desk._scene)
    before = maker.radiance(0, cell.poses(), {RING: 1.0})
    part = cell.verbs.do("board", file=board("chessboard"))["part"]
    maker.add(cell.desk._scene.moving[-1])
    with_board = maker.radiance(0, cell.poses(), {RING: 1.0})
    assert with_board.max() > 3.0 * before.max()  # paper on a table of 18 %
    cell.verbs.do("remove", part=part)
    np.testing.assert_array_equal(maker.radiance(0, cell.poses(), {RING: 1.0}), before)


@pytest.mark.parametrize(
    ("verb", "order", "match"),
    [
        ("board", {"file": "no_such_file.json"}, "no_such_file"),
        ("board", {"file": board("charuco"), "scale": 1.2}, "does not fit"),
        ("add", {"file": "no_such_part.stl"}, "no_such_part"),
        ("give", {}, "either"),
        ("give", {"part": 0, "file": board("paddle")}, "either"),
        ("give", {"part": 0, "axis": "w"}, "none of x, y, z"),
        ("give", {"part": 0, "gripper": "third"}, "neither"),
    ],
)
def test_what_cannot_be_brought_is_refused(
    cell: StillCell, verb: str, order: dict[str, Any], match: str
) -> None:
    with pytest.raises(ValueError, match=match):
        cell.verbs.do(verb, **order)
