"""`cellctl doctor --pictures`: what the cameras see, and dark lamps however it ends."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from controller.cell.lock import hold_cell
from controller.cli import main
from controller.cli.devices.doctor_pictures import LAMPS, take_pictures
from controller.config import load_cell

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"


class Lamps:
    """Lamps that note how they were set."""

    names = ("table_backlight", "table_ring", "station_backlight", "station_ring")

    def __init__(self) -> None:
        self.levels: dict[str, float] = {}
        self.is_dark = False

    async def set(self, levels: dict[str, float], *, settle: bool) -> float:
        assert settle
        self.levels, self.is_dark = levels, False
        return 0.0

    async def all_off(self) -> None:
        self.is_dark = True


class Eye:
    """A camera whose picture is as bright as the lamps that are lit; it may wait for ever."""

    is_paused = False

    def __init__(self, lamps: Lamps, frame_count: int = 1000) -> None:
        self._lamps = lamps
        self._left = frame_count
        self.waits = asyncio.Event()

    async def frame_after(self, _: float, __: float) -> Any:
        if self._left == 0:
            self.waits.set()
            await asyncio.Event().wait()
        self._left -= 1
        lit = [name for name, level in self._lamps.levels.items() if level > 0]
        level = 200 if lit[0].endswith("backlight") else 50
        return SimpleNamespace(image=np.full((6, 8), level, np.uint8), white=255)


class Seconds:
    """A clock that goes by as it is slept."""

    def __init__(self) -> None:
        self.at_s = 0.0

    def now_s(self) -> float:
        return self.at_s

    async def sleep(self, duration_s: float) -> None:
        self.at_s += duration_s


def count_of(folder: Path) -> int:
    return len(list(folder.iterdir()))


def cell(frame_count: int = 1000) -> Any:
    lamps = Lamps()
    eyes = {name: Eye(lamps, frame_count) for name in LAMPS}
    return SimpleNamespace(lights=lamps, **eyes)


async def test_each_camera_takes_a_picture_under_each_lamp_and_only_the_last_are_kept(
    tmp_path: Path,
) -> None:
    devices = cell()
    found: list[dict[str, Any]] = []
    await take_pictures(devices, Seconds(), tmp_path, 1.0, found.append)  # type: ignore[arg-type]
    assert devices.lights.is_dark
    assert {(one["camera"], one["lamp"]) for one in found} == {
        (camera, lamp) for camera, lamps in LAMPS.items() for lamp in lamps
    }
    rounds = len(found) // 4
    assert rounds > 3
    assert count_of(tmp_path) == 4 * 2
    for one in found[-4:]:
        image = cv2.imread(str(tmp_path / one["file"]), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        assert image.mean() == (200 if one["lamp"].endswith("backlight") else 50)


async def test_whoever_ends_it_finds_the_lamps_dark(tmp_path: Path) -> None:
    devices = cell(frame_count=1)
    task = asyncio.create_task(
        take_pictures(devices, Seconds(), tmp_path, 60.0, lambda _: None)  # type: ignore[arg-type]
    )
    await devices.overhead.waits.wait()
    assert not devices.lights.is_dark
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert devices.lights.is_dark


@pytest.mark.parametrize(
    ("words", "message"),
    [(["--pictures", "p"], "--runs"), (["--runs", "r", "--watch", "3"], "--pictures")],
)
def test_pictures_need_the_lock_and_a_time_needs_pictures(
    words: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["doctor", "--cell", str(CELL), *words]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_examined_under_the_lock_while_a_run_has_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with hold_cell(tmp_path, load_cell(CELL), "the-run"):
        assert main(["doctor", "--cell", str(CELL), "--runs", str(tmp_path)]) == 1
    assert "the-run" in capsys.readouterr().err
