"""Nobody gets in, and nothing that is read runs: one attack for each promise.

Bounds of YAML, CSG, CAD files, archives and pictures are attacked in `wrong_inputs.py` and
`damaged_files.py`, paths of recipes in `wrong_inputs.py`, names in reports in
`test_results_report.py`.
"""

import ast
import json
import os
import signal
import socket
import stat
import struct
import subprocess
import sys
import tempfile
import textwrap
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.stored.pictures import read_grey
from emulators.camera_v4l2 import unmount
from emulators.owned import FOLDER_PREFIX, owned_folder
from emulators.world import LayoutError, read_layout

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
PACKAGES = ("controller", "drivers", "emulators", "messages", "simulation")
# multiprocessing pickles what it sends to our own child over our own pipe: nothing from a disk or
# a wire goes that way, which is why the modules that use it are named here
PIPES = {
    "controller/cli/running/ends.py",
    "controller/page/records/records.py",
    "controller/page/records/work.py",
    "controller/processes.py",
    "emulators/world/pictures/desk.py",
    "emulators/world/pictures/worker.py",
}
RUNS_WHAT_IT_READS = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve"}
SHELLS = {("os", "system"), ("os", "popen"), ("subprocess", "getoutput"), ("pty", "spawn")}


@pytest.fixture(scope="module")
def modules() -> list[tuple[str, ast.Module]]:
    """Return every module of ours, read once for all tests here."""
    return [
        (str(path.relative_to(ROOT)), ast.parse(path.read_text()))
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    ]


def imported(tree: ast.Module) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


def calls(tree: ast.Module) -> Iterator[ast.Call]:
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.Call))


def faults_of(tree: ast.Module) -> list[str]:
    """Return what in a module may run or unpickle what it reads, and its shells."""
    found = [f"imports {name}" for name in imported(tree) & RUNS_WHAT_IT_READS]
    for call in calls(tree):
        words = {one.arg: one.value for one in call.keywords if one.arg}
        if isinstance(call.func, ast.Name) and call.func.id in ("eval", "exec", "compile"):
            found.append(f"line {call.lineno}: {call.func.id}")
        if isinstance(call.func, ast.Attribute) and isinstance(call.func.value, ast.Name):
            if (call.func.value.id, call.func.attr) in SHELLS:
                found.append(f"line {call.lineno}: {call.func.value.id}.{call.func.attr}")
            if call.func.attr == "load" and call.func.value.id in ("np", "numpy"):
                allow = words.get("allow_pickle")
                if not (isinstance(allow, ast.Constant) and allow.value is False):
                    found.append(f"line {call.lineno}: numpy may unpickle")
        if "shell" in words:
            found.append(f"line {call.lineno}: a shell")
        if getattr(call.func, "attr", "") == "create_subprocess_shell":
            found.append(f"line {call.lineno}: a shell")
    return found


def test_nothing_unpickles_runs_or_gives_to_a_shell_what_it_reads(
    modules: list[tuple[str, ast.Module]],
) -> None:
    found = {name: faults for name, tree in modules if (faults := faults_of(tree))}
    assert found == {}
    pipes = {name for name, tree in modules if "multiprocessing" in imported(tree)}
    assert pipes == PIPES


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from marshal import loads",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "eval(text)",
        "os.system(text)",
        "subprocess.run(text, shell=True)",
        "asyncio.create_subprocess_shell(text)",
    ],
)
def test_that_would_be_seen(text: str) -> None:
    assert faults_of(ast.parse(text))


def test_no_source_names_an_address_that_others_reach(
    modules: list[tuple[str, ast.Module]],
) -> None:
    for name, tree in modules:
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert node.value not in ("0.0.0.0", "::"), f"{name}:{node.lineno}"


# --- what an emulator leaves on the machine -----------------------------------------------------


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="sec-", dir="/tmp") as name:
        yield Path(name)


class Emulator:
    """An emulated cell in a process of its own."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "emulators", "--cell", str(CELL), "--empty", *arguments],
            cwd=ROOT,
            env=os.environ | {"TMPDIR": str(folder)},
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self.process.stdout is not None
        self.ready = json.loads(self.process.stdout.readline())

    def end(self, by: signal.Signals = signal.SIGTERM, *, with_children: bool = False) -> None:
        (os.killpg if with_children else os.kill)(self.process.pid, by)
        self.process.wait(600)
        assert self.process.stdout is not None
        self.process.stdout.close()


def mode(path: str | Path) -> int:
    return stat.S_IMODE(os.lstat(path).st_mode)


def refused_to_others(path: str) -> bool:
    """Return whether another user's process is refused what a client would do."""
    script = textwrap.dedent(
        """
        import os, socket, stat, sys
        os.setgroups([]); os.setgid(65534); os.setuid(65534)
        try:
            if stat.S_ISSOCK(os.stat(sys.argv[1]).st_mode):
                socket.socket(socket.AF_UNIX).connect(sys.argv[1])
            else:
                os.open(sys.argv[1], os.O_RDWR | os.O_NONBLOCK)
        except PermissionError:
            sys.exit(3)
        """
    )
    return subprocess.run([sys.executable, "-c", script, path], check=False).returncode == 3


@pytest.mark.parametrize("transport", ["auto", "socket"])
def test_what_an_emulator_opens_is_its_owners_alone_and_gone_after_a_kill(
    folder: Path, transport: str
) -> None:
    control = folder / "control.sock"
    emulator = Emulator(folder, "--control", str(control), "--camera-transport", transport)
    devices = emulator.ready["devices"]
    cameras = [devices[name].removeprefix("unix:") for name in ("overhead", "inspection")]
    (home,) = folder.glob(f"{FOLDER_PREFIX}*")
    try:
        assert mode(home) == 0o700
        assert mode(control) == 0o600
        assert mode(emulator.ready["clock"]) == 0o600
        assert [mode(camera) for camera in cameras] == [0o600, 0o600]
        for name in ("gripper", "lights", "io"):
            assert devices[name]["host"] == "127.0.0.1"
        if os.geteuid() == 0:
            for path in (*cameras, emulator.ready["clock"]):
                assert refused_to_others(path), path
            folder.chmod(0o755)  # the socket's own permissions, not its folder's
            assert refused_to_others(str(control))
    finally:
        emulator.end(signal.SIGKILL, with_children=True)
    assert home.exists()  # nobody could take it away
    again = Emulator(folder, "--camera-transport", "socket")
    try:
        assert not home.exists()
        assert str(home) not in Path("/proc/mounts").read_text()
        assert not Path(emulator.ready["clock"]).exists()
        assert len(list(folder.glob(f"{FOLDER_PREFIX}*"))) == 1
    finally:
        again.end()
    assert list(folder.glob(f"{FOLDER_PREFIX}*")) == []


def test_what_is_left_of_a_killed_emulator_its_picture_process_takes_away(folder: Path) -> None:
    emulator = Emulator(folder)
    (home,) = folder.glob(f"{FOLDER_PREFIX}*")
    clock = Path(emulator.ready["clock"])
    assert clock.exists()
    emulator.end(signal.SIGKILL)
    until = time.monotonic() + 600  # a guard against a hang, no measure
    while home.exists() or clock.exists():
        assert time.monotonic() < until
        time.sleep(0.01)
    assert str(home) not in Path("/proc/mounts").read_text()


def test_the_folder_of_an_emulator_that_lives_is_left_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    strange = folder / f"{FOLDER_PREFIX}strange"
    strange.symlink_to("/etc")
    with owned_folder(unmount) as one, owned_folder(unmount) as other:
        assert one.exists()
        assert other.exists()
    assert strange.is_symlink()
    assert sorted(folder.iterdir()) == [strange]


def test_ports_of_the_emulated_cell_are_on_loopback_alone(folder: Path) -> None:
    emulator = Emulator(folder, "--camera-transport", "socket")
    try:
        ports = {emulator.ready["devices"][name]["port"] for name in ("gripper", "lights", "io")}
        rows = Path(f"/proc/{emulator.ready['pid']}/net/tcp").read_text().splitlines()[1:]
        listening = [row.split()[1].split(":") for row in rows if row.split()[3] == "0A"]
        hosts = {
            socket.inet_ntoa(struct.pack("<I", int(host, 16)))
            for host, port in listening
            if int(port, 16) in ports
        }
        assert hosts == {"127.0.0.1"}
        for port in ports:
            for host in own_addresses():
                with pytest.raises(OSError, match=r"refused|timed out|unreachable"):
                    socket.create_connection((host, port), 5.0)
    finally:
        emulator.end()


def own_addresses() -> list[str]:
    found = {str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None)}
    return [host for host in found if not host.startswith("127.") and ":" not in host]


# --- files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [1, 2]\nb: *a\n", "aliases"),
        ("a: " + "[" * 60 + "]" * 60, "nested"),
        ("a: b\n" * 300_000, "bytes"),
        ("!!python/object/apply:os.system ['true']", "not YAML|mapping"),
    ],
)
def test_the_emulators_reading_of_a_cell_file_has_bounds(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    with pytest.raises(LayoutError, match=words):
        read_layout(path)


def test_a_picture_that_promises_too_many_pixels_is_refused_before_it_is_decoded(
    tmp_path: Path,
) -> None:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    head = struct.pack(">IIBBBBB", 60_000, 60_000, 16, 6, 0, 0, 0)  # 28.8 GB decoded
    rows = zlib.compress(bytes(10_000_000), 9)
    path = tmp_path / "huge.png"
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )
    with pytest.raises(Exception, match="million"):
        read_grey(path, (60_000, 60_000))
