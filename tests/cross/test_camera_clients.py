"""Unmodified V4L2 clients against the emulated camera's FUSE node."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "unit"))  # the helper that starts the cameras

from emu_camera_process import CameraProcess, cameras

from emulators.camera_v4l2 import can_mount

WHY_NOT = can_mount()
pytestmark = pytest.mark.skipif(WHY_NOT is not None, reason=f"no FUSE: {WHY_NOT}")

PATIENCE_S = 600.0

# Reads frames, prints one JSON line; a process of its own, as a client of FUSE must be.
OPENCV_CLIENT = """
import json, sys
import cv2
from emulators.camera_v4l2 import read_clock_pattern

path, fourcc, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
camera = cv2.VideoCapture(path, cv2.CAP_V4L2)
camera.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*fourcc))
camera.set(cv2.CAP_PROP_FRAME_WIDTH, 1280)
camera.set(cv2.CAP_PROP_FRAME_HEIGHT, 1024)
camera.set(cv2.CAP_PROP_AUTO_EXPOSURE, 1)
camera.set(cv2.CAP_PROP_EXPOSURE, 100)
found = []
for number in range(count):
    ok, picture = camera.read()
    if not ok:
        break
    start_s, end_s = read_clock_pattern(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
    stamp_s = camera.get(cv2.CAP_PROP_POS_MSEC) / 1000
    found.append((list(picture.shape), start_s, end_s, stamp_s, int(picture[900, 640].mean())))
code = int(camera.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode()
print(json.dumps({"opened": camera.isOpened(), "fourcc": code, "frames": found}))
camera.release()
"""


@pytest.fixture
def camera(tmp_path: Path) -> Iterator[CameraProcess]:
    with cameras(tmp_path / "dev", "--rate=20") as process:
        yield process


def run_client(*command: str) -> str:
    environment = os.environ | {"OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT": "10"}
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE_S, check=True, env=environment,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    return done.stdout


@pytest.mark.parametrize(
    ("fourcc", "black", "white"),
    [("GREY", 0, 255), ("YUYV", 16, 235), ("MJPG", 0, 255)],  # OpenCV takes YUYV as BT.601 video
)
def test_opencv_streams_pictures_of_the_exposures_that_their_stamps_tell(
    camera: CameraProcess, fourcc: str, black: int, white: int
) -> None:
    out = run_client(sys.executable, "-c", OPENCV_CLIENT, camera["video0"], fourcc, "12")
    result = json.loads(out)
    assert (result["opened"], result["fourcc"]) == (True, fourcc)
    assert len(result["frames"]) == 12
    ends_s = [end_s for _, _, end_s, _, _ in result["frames"]]
    assert ends_s == sorted(set(ends_s))
    for shape, _, end_s, stamp_s, _ in result["frames"]:
        assert shape == [1024, 1280, 3]
        assert stamp_s == pytest.approx(camera.state["started_wall_s"] + end_s, abs=2e-3)
    _, start_s, end_s, _, level = result["frames"][-1]
    assert end_s - start_s == pytest.approx(0.01, abs=2e-6)  # 100 of 100 us, as OpenCV set it
    painted = 128 * 0.01 / 0.0157
    assert level == pytest.approx((painted - black) * 255 / (white - black), abs=2)


@pytest.mark.skipif(shutil.which("v4l2-ctl") is None, reason="v4l2-ctl is not installed")
def test_v4l2_ctl_sets_a_control_and_streams(camera: CameraProcess) -> None:
    # v4l2-ctl looks a node up in sysfs, where a FUSE file is not: it gets a /sys of its own
    look_up = "mount -t tmpfs t /sys/dev/char && mkdir /sys/dev/char/0:0 && "
    look_up += 'echo DEVNAME=video0 >/sys/dev/char/0:0/uevent && exec "$@"'
    privately = ("unshare", "-m", "sh", "-c", look_up, "sh", "v4l2-ctl", "-d", camera["video0"])
    assert "gain: 12" in run_client(*privately, "-c", "gain=12", "-C", "gain")
    listing = run_client(*privately, "--list-formats-ext")
    assert "'Y16 '" in listing
    assert "1280x1024" in listing
    run_client(*privately, "--stream-mmap", "--stream-count=10")
