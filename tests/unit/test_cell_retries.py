"""Devices that fail for a while: what is asked again, how often, and what the journal keeps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.journal import Journal, read_rows
from controller.cell.services import Imaging, Retries, fault_policy
from controller.cell.services.records import BatchRecord, RunProgress
from controller.config import FaultsSection
from drivers.clock import CellClock
from drivers.errors import BadReplyError, DeviceError, LinkError, RefusedError, UnpluggedError

POLICY = fault_policy(
    FaultsSection.model_validate({"camera": [{"do": "retry", "times": 2}, {"do": "abort"}]})
)


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    opened = Journal(tmp_path / "journal.sqlite", "run")
    yield opened
    opened.close()


class Camera:
    """A camera that fails as it is told to, call by call, and must be opened again after that."""

    is_paused = False

    def __init__(self, *errors: DeviceError | None) -> None:
        self.errors = list(errors)
        self.calls: list[str] = []
        self.is_open = True

    def _next(self, call: str) -> None:
        self.calls.append(call)
        error = self.errors.pop(0) if self.errors else None
        if error is not None:
            self.is_open = False
            raise error

    async def frame_after(self, t_s: float, timeout_s: float) -> Any:
        assert self.is_open
        self._next("frame")
        return SimpleNamespace(image=np.zeros((2, 2), np.uint8), white=255)

    async def close(self) -> None:
        self.is_open = False

    async def connect(self) -> None:
        self._next("connect")
        self.is_open = True

    async def pause(self) -> None: ...

    async def resume(self) -> None: ...


class DeepCamera(Camera):
    """A camera with 12 bits a pixel: black, the two levels about the middle of a grey, white."""

    async def frame_after(self, t_s: float, timeout_s: float) -> Any:
        levels = np.array([[0, 2047, 2055, 4095]], np.uint16)
        return SimpleNamespace(image=levels, white=4095)


async def test_a_picture_of_12_bits_is_scaled_by_its_white_and_rounded(tmp_path: Path) -> None:
    lamps: Any = Lamps()
    cameras: Any = {"overhead": DeepCamera()}
    image = await Imaging(lamps, cameras, frozenset(), tmp_path).shoot("overhead", {"ring": 1.0})
    # 2047 * 255 / 4095 = 127.47, 2055 * 255 / 4095 = 127.97
    assert (image.dtype, image.tolist()) == (np.uint8, [[0, 127, 128, 255]])


class Lamps:
    names = ("ring",)

    def __init__(self) -> None:
        self.count = 0

    async def set(self, levels: Any, settle: bool) -> float:
        self.count += 1
        return 0.0


def imaging_of(camera: Any, journal: Journal, tmp_path: Path) -> tuple[Imaging, Any]:
    record = BatchRecord(journal, RunProgress(), lambda: None)
    retries = Retries(record, lambda: POLICY, CellClock(1000.0))
    lamps: Any = Lamps()
    cameras: Any = {"overhead": camera}
    files = lambda file, digest: None  # noqa: E731
    return Imaging(lamps, cameras, frozenset(), tmp_path, files, retries), lamps


GONE = UnpluggedError("camera: its node is gone")


async def test_a_camera_that_is_plugged_in_again_is_opened_and_gives_its_picture(
    journal: Journal, tmp_path: Path
) -> None:
    # its node is back before its permissions are set
    camera = Camera(GONE, RefusedError("camera: permission denied", 13), None, None)
    imaging, lamps = imaging_of(camera, journal, tmp_path)
    assert (await imaging.shoot("overhead", {"ring": 1.0})).shape == (2, 2)
    assert camera.calls == ["frame", "connect", "connect", "frame"]
    assert lamps.count == 1  # the light is as it was
    rows = [r.body for r in read_rows(journal.path) if r.name == "device_retried"]
    assert [(row["device"], row["error"], row["number"]) for row in rows] == [
        ("overhead", "camera: its node is gone", 1),
        ("overhead", "camera: permission denied", 2),
    ]


async def test_a_camera_that_stays_away_is_an_error_once_the_policy_ends(
    journal: Journal, tmp_path: Path
) -> None:
    # what is asked for again under its name is not there: that is no other fault
    camera = Camera(GONE, *[LinkError("camera: no such file")] * 9)
    imaging, _ = imaging_of(camera, journal, tmp_path)
    with pytest.raises(UnpluggedError, match="its node is gone"):
        await imaging.shoot("overhead", {"ring": 1.0})
    assert camera.calls == ["frame", "connect", "connect"]


async def test_a_camera_that_is_back_and_refuses_is_another_fault(
    journal: Journal, tmp_path: Path
) -> None:
    camera = Camera(GONE, *[RefusedError("camera: permission denied", 13)] * 9)
    imaging, _ = imaging_of(camera, journal, tmp_path)
    with pytest.raises(RefusedError, match="permission denied"):
        await imaging.shoot("overhead", {"ring": 1.0})


async def test_bytes_that_the_manual_forbids_are_not_tried_again(
    journal: Journal, tmp_path: Path
) -> None:
    camera = Camera(BadReplyError("camera: 00"))
    imaging, _ = imaging_of(camera, journal, tmp_path)
    with pytest.raises(BadReplyError):
        await imaging.shoot("overhead", {"ring": 1.0})
    assert camera.calls == ["frame"]
