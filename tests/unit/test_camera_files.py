"""A camera that is a folder of pictures or a video: order, time, end, and what it refuses."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.camera_files import (
    FOLDER_DRIVER,
    VIDEO_DRIVER,
    FileCamera,
    FileSettings,
    Folder,
    NoPictureError,
    Size,
    Video,
)
from drivers.clock import CellClock
from drivers.errors import LinkError, ReplyTimeoutError, UnpluggedError
from drivers.kinds import Camera, Capture, Site
from drivers.wires import UNTAPPED, CameraTap, Wires

SIZE = Size(32, 24)
PERIOD_S, EXPOSURE_S = 0.2, 0.05


def grey(level: int) -> np.ndarray[Any, Any]:
    return np.full((24, 32), level, np.uint8)


def store(folder: Path, pictures: dict[str, np.ndarray[Any, Any]]) -> Path:
    folder.mkdir(exist_ok=True)
    for name, image in pictures.items():
        assert cv2.imwrite(str(folder / name), image)
    return folder


@pytest.fixture
def three(tmp_path: Path) -> Path:
    """Return a folder whose names sort otherwise as text than by their numbers."""
    return store(
        tmp_path / "pictures",
        {"look10.png": grey(30), "look9.png": grey(20), "Look1.png": grey(10)},
    )


def film(path: Path, levels: Sequence[int]) -> Path:
    """Write a video without loss, so that grey levels stay what they are."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (32, 24))
    assert writer.isOpened()
    for level in levels:
        writer.write(cv2.cvtColor(grey(level), cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


class Stepped:
    """A clock that is moved by the test: every pause passes at once."""

    def __init__(self) -> None:
        self.now = 100.0

    def clock(self) -> CellClock:
        stepped = self

        class Clock(CellClock):
            def now_s(self) -> float:
                return stepped.now

            async def wait(self, futures: Any, duration_s: float, **_: Any) -> None:
                stepped.now += duration_s
                await asyncio.sleep(0)

        return Clock()


def camera(source: Any, stepped: Stepped | None = None, **more: Any) -> FileCamera:
    settings = {"period_s": PERIOD_S, "exposure_s": EXPOSURE_S, "late_s": 5.0} | more
    clock = CellClock() if stepped is None else stepped.clock()
    return FileCamera(source, name="overhead", clock=clock, **settings)


async def levels(device: FileCamera, count: int, stepped: Stepped) -> list[int]:
    return [int((await device.frame_after(stepped.now)).image[0, 0]) for _ in range(count)]


async def test_pictures_come_by_name_with_numbers_by_their_value(three: Path) -> None:
    stepped = Stepped()
    async with camera(Folder("overhead", three, SIZE), stepped) as device:
        assert "3 pictures" in device.model
        assert device.shape == (24, 32)
        assert await levels(device, 3, stepped) == [10, 20, 30]


async def test_behind_the_last_picture_it_is_gone_and_stays_gone(three: Path) -> None:
    stepped = Stepped()
    device = camera(Folder("overhead", three, SIZE), stepped)
    await device.connect()
    await levels(device, 3, stepped)
    with pytest.raises(UnpluggedError, match=r"all 3 pictures have been shown.*at_end: loop"):
        await device.frame_after(stepped.now)
    with pytest.raises(LinkError, match="all 3 pictures"):  # a retry does not begin anew by itself
        await device.connect()
    await device.close()


async def test_a_loop_begins_anew(three: Path) -> None:
    stepped = Stepped()
    async with camera(Folder("overhead", three, SIZE), stepped, loops=True) as device:
        assert await levels(device, 7, stepped) == [10, 20, 30, 10, 20, 30, 10]


async def test_connected_again_it_goes_on_where_it_was(three: Path) -> None:
    stepped = Stepped()
    device = camera(Folder("overhead", three, SIZE), stepped)
    async with device:
        assert await levels(device, 1, stepped) == [10]
    async with device:
        assert await levels(device, 1, stepped) == [20]


@pytest.mark.parametrize("after_s", [0.0, 0.01, 0.19, 0.2, 1.37])
async def test_a_frame_lies_wholly_after_the_instant_and_is_there_no_sooner(
    after_s: float, three: Path
) -> None:
    stepped = Stepped()
    async with camera(Folder("overhead", three, SIZE), stepped) as device:
        t_s = stepped.now + after_s
        frame = await device.frame_after(t_s)
        assert frame.earliest_light_s >= t_s - 1e-6
        assert frame.earliest_light_s - t_s < PERIOD_S + 1e-6
        assert frame.timestamp_s == pytest.approx(frame.earliest_light_s + EXPOSURE_S)
        assert stepped.now >= frame.timestamp_s - 1e-6


async def test_two_looks_at_once_get_two_frames_a_period_apart(three: Path) -> None:
    stepped = Stepped()
    async with camera(Folder("overhead", three, SIZE), stepped) as device:
        t_s = stepped.now
        first, second = await device.frame_after(t_s), await device.frame_after(t_s)
        assert second.earliest_light_s - first.earliest_light_s == pytest.approx(PERIOD_S)


async def test_passing_pictures_go_on_while_nobody_looks(tmp_path: Path) -> None:
    many = {f"{i}.png": grey(i) for i in range(40)}
    stepped = Stepped()
    folder = store(tmp_path / "many", many)
    async with camera(Folder("overhead", folder, SIZE), stepped, passes=True) as device:
        assert await levels(device, 1, stepped) == [0]
        await device.pause()
        await device.resume()
        # 2.0 s after the first frame began, the tenth after it begins
        frame = await device.frame_after(100.0 + 10 * PERIOD_S)
        assert int(frame.image[0, 0]) == 10
        with pytest.raises(UnpluggedError, match="all 40 pictures"):
            await device.frame_after(100.0 + 40 * PERIOD_S)


async def test_a_passing_loop_counts_turns(three: Path) -> None:
    stepped = Stepped()
    async with camera(Folder("o", three, SIZE), stepped, passes=True, loops=True) as device:
        frame = await device.frame_after(100.0 + 7 * PERIOD_S)  # 7 = two turns of three, and one
        assert int(frame.image[0, 0]) == 20
        frame = await device.frame_after(100.0 + 9 * PERIOD_S)
        assert int(frame.image[0, 0]) == 10


async def test_a_video_is_shown_picture_by_picture(tmp_path: Path) -> None:
    path = film(tmp_path / "film.mkv", [16, 80, 160])
    stepped = Stepped()
    async with camera(Video("overhead", path, SIZE), stepped, loops=True) as device:
        assert device.model == "video film.mkv"
        seen = await levels(device, 5, stepped)
    np.testing.assert_allclose(seen, [16, 80, 160, 16, 80], atol=2)  # RGB and back


async def test_a_video_that_has_ended_says_after_how_many_pictures(tmp_path: Path) -> None:
    path = film(tmp_path / "film.mkv", [16, 80, 160])
    stepped = Stepped()
    device = camera(Video("overhead", path, SIZE), stepped)
    await device.connect()
    await levels(device, 3, stepped)
    with pytest.raises(UnpluggedError, match="all 3 pictures"):
        await device.frame_after(stepped.now)
    await device.close()


async def test_colours_become_grey_and_16_bits_stay(tmp_path: Path) -> None:
    stepped = Stepped()
    colour = np.zeros((24, 32, 3), np.uint8)
    colour[..., 1] = 200  # green, of which luma has 0.587 (ITU-R BT.601)
    folder = store(tmp_path / "colour", {"a.png": colour})
    async with camera(Folder("o", folder, SIZE), stepped) as device:
        frame = await device.frame_after(stepped.now)
        assert (frame.white, frame.image.dtype) == (255, np.uint8)
        np.testing.assert_allclose(frame.image, 0.587 * 200, atol=1.0)
    deep = store(tmp_path / "deep", {"a.png": np.full((24, 32), 40_000, np.uint16)})
    async with camera(Folder("o", deep, Size(32, 24, allows_16_bits=True)), stepped) as device:
        frame = await device.frame_after(stepped.now)
        assert (frame.white, int(frame.image.max())) == (65_535, 40_000)


@pytest.mark.parametrize(
    ("pictures", "size", "words"),
    [
        ({"a.png": np.zeros((24, 31), np.uint8)}, SIZE, "31 x 24 px; `size_px` .* is 32 x 24"),
        ({"a.png": grey(1), "b.png": np.zeros((9, 9), np.uint8)}, SIZE, r"b\.png: 9 x 9 px"),
        ({"a.png": np.zeros((24, 32), np.uint16)}, SIZE, "16 bits a pixel.*add Y16"),
        ({"a.png": grey(1)}, Size(32, 24, False, True), "8 bits a pixel.*add GREY"),
        (
            {"a.png": grey(1), "b.png": np.zeros((24, 32), np.uint16)},
            Size(32, 24, True, True),
            r"b\.png: 16 bits a pixel, and 8 in a\.png",
        ),
        ({}, SIZE, "no picture .* is in this folder"),
    ],
)
async def test_pictures_of_another_camera_are_refused_when_it_is_opened(
    pictures: dict[str, Any], size: Size, words: str, tmp_path: Path
) -> None:
    device = camera(Folder("overhead", store(tmp_path / "p", pictures), size))
    with pytest.raises(NoPictureError, match=words):
        await device.connect()


@pytest.mark.parametrize("data", [b"", b"no picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"])
async def test_a_damaged_picture_is_named(data: bytes, three: Path) -> None:
    (three / "look5.png").write_bytes(data)
    device = camera(Folder("overhead", three, SIZE))
    with pytest.raises(NoPictureError, match=r"look5\.png: is not a readable picture"):
        await device.connect()


async def test_a_folder_or_video_that_is_not_there_is_named(tmp_path: Path) -> None:
    nowhere = tmp_path / "nowhere"
    with pytest.raises(NoPictureError, match=f"{nowhere}: No such file"):
        await camera(Folder("overhead", nowhere, SIZE)).connect()
    with pytest.raises(NoPictureError, match="no such video file"):
        await camera(Video("overhead", nowhere, SIZE)).connect()
    text = tmp_path / "film.mp4"
    text.write_text("no video")
    with pytest.raises(NoPictureError, match="no video that OpenCV can read"):
        await camera(Video("overhead", text, SIZE)).connect()


@pytest.mark.parametrize("address", ["rtsp://127.0.0.1/film", "film_%03d.png"])
async def test_a_video_is_a_file_and_no_address_or_pattern(address: str, tmp_path: Path) -> None:
    store(tmp_path, {"film_000.png": grey(1)})
    with pytest.raises(NoPictureError, match="no such video file"):
        await camera(Video("overhead", tmp_path / address, SIZE)).connect()


async def test_hidden_and_other_files_are_no_pictures(three: Path) -> None:
    (three / ".look0.png").write_bytes(b"")
    (three / "notes.txt").write_text("three pictures")
    async with camera(Folder("overhead", three, SIZE)) as device:
        assert "3 pictures" in device.model


async def test_paused_it_shows_nothing_and_resumed_no_older_frame(three: Path) -> None:
    stepped = Stepped()
    async with camera(Folder("overhead", three, SIZE), stepped) as device:
        await device.pause()
        with pytest.raises(ValueError, match="paused"):
            await device.frame_after(stepped.now)
        stepped.now += 10.0
        await device.resume()
        frame = await device.frame_after(0.0)
        assert frame.earliest_light_s >= 110.0


async def test_a_frame_too_far_off_ends_in_a_time_out_and_costs_no_picture(three: Path) -> None:
    async with camera(Folder("overhead", three, SIZE)) as device:
        with pytest.raises(ReplyTimeoutError, match="no frame begun after"):
            await device.frame_after(time.monotonic() + 1e6, 0.01)
        assert int((await device.frame_after(0.0)).image[0, 0]) == 10


async def test_closing_ends_a_wait(three: Path) -> None:
    device = camera(Folder("overhead", three, SIZE))
    await device.connect()
    waiting = asyncio.create_task(device.frame_after(time.monotonic() + 1e6))
    await asyncio.sleep(0)
    await device.close()
    with pytest.raises(LinkError, match="closed"):
        await waiting


class Tape:
    """A recording of calls: answers by what was asked, on the second run without any file."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, bytes, bytes]] = []
        self.played = 0
        self.is_played = False

    def call(self, what: str, sent: bytes, do: Callable[[], bytes]) -> bytes:
        if not self.is_played:
            self.rows.append((what, sent, do()))
            return self.rows[-1][2]
        row = self.rows[self.played]
        self.played += 1
        assert row[:2] == (what, sent)
        return row[2]


class Taped:
    def __init__(self, tape: Tape) -> None:
        self.tape = tape

    def camera(self, name: str) -> CameraTap | None:
        tape: Any = self.tape
        return tape  # type: ignore[no-any-return]

    def thread(self, name: str) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(1)


async def test_a_recording_needs_no_files_when_it_is_played(three: Path, tmp_path: Path) -> None:
    tape, stepped = Tape(), Stepped()
    wires: Any = Taped(tape)
    async with camera(Folder("overhead", three, SIZE), stepped, wires=wires) as device:
        recorded = [(await device.frame_after(stepped.now)).image for _ in range(2)]
    tape.is_played = True
    gone = Folder("overhead", tmp_path / "gone", SIZE)
    async with camera(gone, stepped, wires=wires) as device:
        assert "3 pictures" in device.model
        for image in recorded:
            np.testing.assert_array_equal((await device.frame_after(stepped.now)).image, image)


def site(folder: Path, address: str, formats: tuple[str, ...] = ("GREY",)) -> Site:
    capture = Capture(32, 24, formats, 5.0, 0.01, 0, None, 5.0)
    wires: Wires = UNTAPPED

    def no_link() -> Any:
        raise AssertionError("a camera has no Modbus line")

    return Site(
        name="overhead",
        address=address,
        section={},
        clock=CellClock(),
        open_link=no_link,
        capture=capture,
        wires=wires,
        folder=folder,
    )


async def test_a_relative_address_begins_at_the_cell_file(three: Path, tmp_path: Path) -> None:
    for address in ("pictures", "pictures/", str(three)):
        device: Camera = FOLDER_DRIVER.build(site(tmp_path, address), FileSettings())
        await device.connect()
        frame: Any = await device.frame_after(0.0)
        assert int(frame.image[0, 0]) == 10
        await device.close()
    film(tmp_path / "film.mkv", [80])
    device = VIDEO_DRIVER.build(site(tmp_path, "film.mkv"), FileSettings())
    await device.connect()
    await device.close()


async def test_formats_of_the_cell_file_say_what_pictures_may_be(three: Path) -> None:
    device = FOLDER_DRIVER.build(site(three.parent, "pictures", ("Y16",)), FileSettings())
    with pytest.raises(NoPictureError, match="8 bits a pixel"):
        await device.connect()
