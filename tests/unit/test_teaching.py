"""What was taught, as it is written: nothing else of a cell file changes, and it is read back."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from ruamel.yaml import YAML

from controller.bring_up.jogging import TakenOver
from controller.bring_up.procedure import taught_trays, with_values
from controller.cli.bring_up.teaching import Teacher
from controller.config import ConfigError, load_cell
from controller.config.calibrations import TraysCalibration

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "recipes/cells/emulated.yaml").read_text()
Q = np.array([np.radians(70), np.radians(-5), 0.0, -25.0, -np.pi / 2, np.radians(3)])


def down_at(x: float, y: float, z: float) -> NDArray[np.float64]:
    """Return a pose whose x axis, the approach, points straight down."""
    T = np.eye(4)
    T[:3, :3] = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]
    T[:3, 3] = x, y, z
    return T


@dataclass
class Desk:
    """A folder with a cell file, on which somebody teaches."""

    path: Path

    def teach(self, what: str, taken: TakenOver) -> list[str]:
        teacher = Teacher(self.path, load_cell(self.path), what, "a tester")
        teacher.check()
        assert teacher.why_not(taken) == ""
        change = teacher.change(taken)
        difference = teacher.difference(change)
        before = self.path.read_text()
        assert before == self.path.read_text()
        teacher.write(change)
        return difference


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    path = tmp_path / "my_cell.yaml"
    path.write_text(TEXT)
    return Desk(path)


def test_a_tray_goes_into_a_calibration_that_the_cell_file_names(desk: Desk) -> None:
    difference = desk.teach("accept", TakenOver(Q, down_at(104.26, 387.0, 60.0)))
    file = desk.path.parent / "calibrations" / "trays.json"
    tree = json.loads(file.read_text())
    assert tree["centres"] == {"accept": [104.3, 387.0]}
    text = desk.path.read_text()
    assert hashlib.sha256(file.read_bytes()).hexdigest() in text
    # the drawing's own lines stay, comments included
    assert text.startswith(TEXT.rstrip("\n"))
    assert load_cell(desk.path).trays.accept.centre == (104.3, 387.0)
    assert load_cell(desk.path).trays.reject.centre == (-55.0, 400.0)
    assert any(line.startswith("+accept: [104.3, 387.0]") for line in difference)
    assert not any(line.startswith("-") and "---" not in line for line in difference)


def test_a_second_tray_joins_the_first(desk: Desk) -> None:
    desk.teach("accept", TakenOver(Q, down_at(104.0, 387.0, 60.0)))
    desk.teach("reject", TakenOver(Q, down_at(-52.0, 401.0, 60.0)))
    cell = load_cell(desk.path)
    assert (cell.trays.accept.centre, cell.trays.reject.centre) == ((104.0, 387.0), (-52.0, 401.0))
    assert desk.path.read_text().count("calibration:") == 1


def test_the_park_takes_the_place_of_the_drawings_and_keeps_the_comment(desk: Desk) -> None:
    desk.teach("park", TakenOver(Q, np.eye(4)))
    arm = YAML(typ="safe").load(desk.path)["arm"]
    assert arm["park_deg"] == {"shoulder": 70, "elbow": -5, "yaw": 0, "pitch": -90, "roll": 3}
    assert arm["park_zed_mm"] == -25
    before, after = TEXT.splitlines(), desk.path.read_text().splitlines()
    changed = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
    assert [a.split(":")[0].strip() for a, _ in changed] == ["park_deg", "park_zed_mm"]
    assert "# out of both cameras' pictures" in changed[0][1]


def test_the_station_takes_the_tcps_position(desk: Desk) -> None:
    desk.teach("station", TakenOver(Q, down_at(431.06, -2.0, 447.0)))
    assert load_cell(desk.path).station.position == (431.1, -2.0, 447.0)


def test_what_is_no_tray_is_not_taken(desk: Desk) -> None:
    teacher = Teacher(desk.path, load_cell(desk.path), "accept", "")
    assert "drawn" in teacher.why_not(TakenOver(Q, down_at(300.0, 390.0, 60.0)))
    level = down_at(100.0, 390.0, 60.0)
    level[:3, :3] = np.eye(3)
    assert "off straight down" in teacher.why_not(TakenOver(Q, level))
    assert desk.path.read_text() == TEXT


def test_a_file_of_trays_that_the_cell_file_does_not_name_is_not_overwritten(desk: Desk) -> None:
    file = desk.path.parent / "calibrations" / "trays.json"
    file.parent.mkdir()
    file.write_text("mine")
    with pytest.raises(ConfigError, match="does not name it"):
        Teacher(desk.path, load_cell(desk.path), "accept", "").check()
    assert file.read_text() == "mine"


def test_what_a_commissioning_writes_anew_is_not_taught_there(desk: Desk) -> None:
    (desk.path.parent / "steps").mkdir()
    path = desk.path.rename(desk.path.parent / "cell.yaml")
    for what in ("park", "station"):
        with pytest.raises(ConfigError, match="--cell DRAWING"):
            Teacher(path, load_cell(path), what, "").check()
    Teacher(path, load_cell(path), "accept", "").check()


def test_a_place_written_over_several_lines_is_left_to_a_person() -> None:
    text = "arm:\n  park_deg:\n    shoulder: 80\ntable: {}\n"
    with pytest.raises(ConfigError, match="several lines"):
        with_values(text, "arm", {"park_deg": "{shoulder: 70}"})
    with pytest.raises(ConfigError, match="not a section"):
        with_values("table: {}\n", "arm", {"park_deg": "{}"})


def test_a_key_that_is_missing_comes_behind_the_first() -> None:
    text = "arm:\n  park_deg: {a: 1}   # out of sight\n  links: {}\nstation: {park_deg: 3}\n"
    found = with_values(text, "arm", {"park_deg": "{a: 2}", "park_zed_mm": "-5"})
    assert found == (
        "arm:\n  park_deg: {a: 2}   # out of sight\n  park_zed_mm: -5\n  links: {}\n"
        "station: {park_deg: 3}\n"
    )


def trays(arm: str, u_mm: float, measured: datetime) -> TraysCalibration:
    return TraysCalibration(
        measured=measured,
        centres={"accept": (1.0, 2.0), "reject": (3.0, 4.0)},
        u_mm=u_mm,
        based_on={"arm": arm},
    )


def test_the_trays_that_are_kept_keep_their_age_and_their_uncertainty() -> None:
    now = datetime(2030, 5, 1, tzinfo=UTC)
    old = now - timedelta(days=100)
    from controller.config.calibration_reference import CalibrationReference

    def taught(before: TraysCalibration, arm: str) -> TraysCalibration:
        reference = CalibrationReference(file="arm.json", sha256=arm)
        return taught_trays(
            before, "accept", (9.0, 8.0),
            u_mm=1.0, arm=reference, now=now, by="", software="", cell="c",
        )  # fmt: skip

    same = taught(trays("a" * 64, 2.5, old), "a" * 64)
    assert (same.measured, same.u_mm) == (old, 2.5)
    assert same.centres == {"accept": (9.0, 8.0), "reject": (3.0, 4.0)}
    with pytest.raises(ConfigError, match="another calibration of the arm"):
        taught(trays("b" * 64, 2.5, old), "a" * 64)
