"""`--pose N` puts the emulated part down in stable pose N of `cellctl compile` and `plan`."""

from pathlib import Path

import numpy as np
import pytest

from controller.cad.compiled import CompiledPart, load_part
from controller.cell.devices.emulator import emulator_args
from controller.cli import main
from controller.cli.inputs.part_files import emulated_orientation, for_emulator
from emulators.app import Cell, build_parser, options_of
from emulators.world import LayoutError, truth

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes/cells/emulated.yaml"
PARTS = ROOT / "recipes/parts"
SHAFT = """
unit: mm
tolerance_mm: 0.02
part:
  difference:
    - union:
        - cylinder: {diameter: 28, height: 30}
        - cylinder: {diameter: 20, height: 64}
    - block: {from: [8, -3, 40], to: [12, 3, 56]}
"""
AT = (350.0, 20.0, 30.0)  # x, y [mm], theta [deg]


def pose_put_down(
    path: Path, part: CompiledPart, index: int, folder: Path, seed: int = 5
) -> np.ndarray:  # type: ignore[type-arg]
    """Return T_world_part of a part that the emulated cell has put down, by `--pose` and `--at`."""
    orientation = emulated_orientation([part], index)
    given = emulator_args(orientation, "{:g},{:g},{:g}".format(*AT), None)
    words = ["--cell", str(CELL), "--part", str(path), "--seed", str(seed), *given]
    cell = Cell(options_of(build_parser().parse_args(words)), folder)
    try:
        (told,) = truth(cell.world)["parts"]
    finally:
        cell.world.close()
        cell.clock.close()
    return np.array(told["T_world_part"])


@pytest.mark.parametrize("name", ["flange_xy", "idler_riser", "holder", "featuretype"])
def test_the_emulated_part_rests_in_the_stable_pose_of_this_index(
    name: str, tmp_path: Path
) -> None:
    path = PARTS / f"{name}.stl"
    part = load_part(path)
    for pose in (one for one in part.poses if not (one.marginal or one.rolling)):
        T_world_part = pose_put_down(path, part, pose.index, tmp_path)
        up_off = [float(np.linalg.norm(T_world_part[2, :3] - one.R[2])) for one in part.poses]
        assert int(np.argmin(up_off)) == pose.index
        assert up_off[pose.index] < 1e-3
        assert T_world_part[:2, :3] @ part.solid.centroid_mm + T_world_part[:2, 3] == pytest.approx(
            AT[:2], abs=1.0
        )
        R_turn = T_world_part[:3, :3] @ pose.R.T  # the theta of `plan --at`, too
        assert np.degrees(np.arctan2(R_turn[1, 0], R_turn[0, 0])) == pytest.approx(AT[2], abs=0.5)


def test_a_part_that_rolls_lies_at_a_roll_by_the_seed(tmp_path: Path) -> None:
    text = tmp_path / "shaft.csg.yaml"
    text.write_text(SHAFT, encoding="utf-8")
    part = load_part(text)
    (family,) = part.resting.families
    path = for_emulator(text, part, tmp_path)
    ups = []
    for seed in (1, 2, 3):
        T_world_part = pose_put_down(path, part, family.pose, tmp_path, seed)
        ups.append(T_world_part[2, :3])
        assert abs(float(ups[-1] @ family.axis)) < 0.01  # it lies on its side
        along = T_world_part[:2, :3] @ family.axis
        nominal = part.poses[family.pose].R[:2] @ family.axis
        turned = np.degrees(np.arctan2(*along[::-1]) - np.arctan2(*nominal[::-1]))
        assert (turned - AT[2] + 180) % 360 - 180 == pytest.approx(0.0, abs=1.0)
    rolls = np.degrees(np.arccos(np.clip(np.stack(ups) @ ups[0], -1, 1)))
    assert (rolls[1:] > 5.0).all()


def test_a_stable_pose_that_the_part_tips_out_of_is_refused(tmp_path: Path) -> None:
    path = PARTS / "featuretype.stl"
    part = load_part(path)
    (marginal,) = (one for one in part.poses if one.marginal)
    with pytest.raises(LayoutError, match="does not stay in this stable pose"):
        pose_put_down(path, part, marginal.index, tmp_path)


def test_an_orientation_in_which_the_part_cannot_rest_is_refused(tmp_path: Path) -> None:
    words = ["--cell", str(CELL), "--part", str(PARTS / "featuretype.stl")]
    tilted = "--orientation=1,0,0,0,0.8,-0.6,0,0.6,0.8"
    with pytest.raises(LayoutError, match=r"no such stable pose .* deg off"):
        Cell(options_of(build_parser().parse_args([*words, tilted])), tmp_path)
    with pytest.raises(LayoutError, match="nine numbers"):
        options_of(build_parser().parse_args([*words, "--orientation=1,0,0"]))
    with pytest.raises(LayoutError, match="not a rotation"):
        options_of(build_parser().parse_args([*words, "--orientation=1,0,0,0,1,0,0,0,-1"]))


@pytest.mark.parametrize(
    "words",
    [
        ["run", str(ROOT / "recipes/holder.yaml"), "--pose", "77"],
        ["emulate", "--cell", str(CELL), "--part", str(PARTS / "holder.stl"), "--pose", "77"],
    ],
    ids=["run", "emulate"],
)
def test_a_pose_that_the_part_does_not_have_is_refused_before_planning(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    message = "--pose 77: holder has stable poses 0 to 2 (`cellctl compile` lists them)"
    assert message in capsys.readouterr().err


def test_a_pose_without_a_part_on_the_table_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["emulate", "--cell", str(CELL), "--pose", "0"]) == 2
    assert "--pose 0: no part is on the emulated table" in capsys.readouterr().err
