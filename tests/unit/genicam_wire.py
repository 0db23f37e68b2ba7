"""aravis' own fake GigE camera as a process, on loopback or at the far end of a cable.

It always uses the port 3956 of GigE Vision, so that only one may run on an address: a lock is held
meanwhile. A cable is a veth pair into a network namespace, which takes root.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import itertools
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

PROGRAM = "arv-fake-gv-camera-0.8"
LOOPBACK = "127.0.0.1"
SERIAL = "CELL1"
NAME = f"Aravis-Fake-{SERIAL}"
PORT = 3956
_UP_WALL_S = 60.0
_cables = itertools.count()
# GVCP, request 1, with acknowledgement: read the register of the number of stream channels
_READ = bytes.fromhex("42 01 0080 0004 0001 00000904")


def why_not_here() -> str:
    """Return why the fake camera cannot run here; empty if it can."""
    if shutil.which(PROGRAM) is None:
        return f"the program {PROGRAM} is not installed (Debian: apt-get install aravis-tools)"
    try:
        ctypes.CDLL("libaravis-0.8.so.0")
    except OSError:
        return "libaravis-0.8.so.0 is not installed (Debian: apt-get install libaravis-0.8-0)"
    return ""


def why_no_cable() -> str:
    """Return why no network namespace can be made here; empty if one can."""
    if why := why_not_here():
        return why
    if os.geteuid() != 0 or shutil.which("ip") is None:
        return "a network namespace takes root and the program ip"
    name = f"gc{os.getpid()}try"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    if made.returncode != 0:
        return f"no network namespace can be made here: {made.stderr.decode().strip()}"
    subprocess.run(["ip", "netns", "del", name], check=True)
    return ""


@dataclass
class FakeCamera:
    """The process, and the cable to it.

    Attributes
    ----------
    address : its IP address
    """

    address: str
    command: list[str]
    cable: str = ""  # the network interface on this side
    process: subprocess.Popen[bytes] | None = field(default=None, init=False)

    def start(self) -> None:
        """Start it; return once it answers."""
        self.process = subprocess.Popen(
            self.command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline_s = time.monotonic() + _UP_WALL_S
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.settimeout(0.1)
            while True:
                with contextlib.suppress(OSError):
                    probe.sendto(_READ, (self.address, PORT))
                    if probe.recv(64)[2:4] == b"\x00\x81":  # READREG_ACK
                        return
                assert self.process.poll() is None, f"{self.command} has ended"
                assert time.monotonic() < deadline_s, f"{self.command} does not answer"

    def stop(self) -> None:
        """Cut its power."""
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
            self.process = None

    def unplug(self) -> None:
        """Pull its cable; without one, cut its power."""
        if self.cable:
            _ip("link", "set", self.cable, "down")
        else:
            self.stop()

    def plug(self) -> None:
        """Plug it in again."""
        if self.cable:
            _ip("link", "set", self.cable, "up")
        else:
            self.start()


@contextlib.contextmanager
def on_loopback(*options: str) -> Iterator[FakeCamera]:
    """Run the fake camera on the loopback interface; one at a time on this machine."""
    lock = Path(tempfile.gettempdir()) / f"cellctl-gvcp-{PORT}.lock"
    with lock.open("a") as file:
        lock.chmod(0o666)
        fcntl.flock(file, fcntl.LOCK_EX)
        camera = FakeCamera(LOOPBACK, [PROGRAM, "-i", LOOPBACK, "-s", SERIAL, *options])
        camera.start()
        try:
            yield camera
        finally:
            camera.stop()


@contextlib.contextmanager
def on_a_cable(*options: str) -> Iterator[FakeCamera]:
    """Run the fake camera in a network namespace of its own, at the far end of a cable."""
    # names and addresses of their own: those of the cable before may not be gone yet
    number = os.getpid() * 16 + next(_cables) % 16
    here, there, space = f"gc{number}a", f"gc{number}b", f"gc{number}"
    net = int.from_bytes((10, 201, 0, 0)) + number % (1 << 14) * 4
    near, far = (socket.inet_ntoa((net + i).to_bytes(4)) for i in (1, 2))
    _ip("netns", "add", space)
    try:
        _ip("link", "add", here, "type", "veth", "peer", "name", there, "netns", space)
        _ip("addr", "add", f"{near}/30", "dev", here)
        _ip("link", "set", here, "mtu", "9000", "up")
        _ip("-n", space, "addr", "add", f"{far}/30", "dev", there)
        _ip("-n", space, "link", "set", there, "mtu", "9000", "up")
        _ip("-n", space, "link", "set", "lo", "up")
        inside = ["ip", "netns", "exec", space]
        camera = FakeCamera(far, [*inside, PROGRAM, "-i", there, "-s", SERIAL, *options], here)
        camera.start()
        try:
            yield camera
        finally:
            camera.stop()
    finally:
        _ip("netns", "del", space)  # and the cable with it


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)
