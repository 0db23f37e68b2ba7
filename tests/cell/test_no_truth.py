"""No truth reaches the controller but over the wires: what it opens and whom it calls is listed.

An audit hook in every process of the controller writes down each file opened and each connection
made. Whatever is not the recipe's own files, the run's own folder, the cache, Python itself, or a
device's announced address would be a way round the wires.
"""

import json
import re
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import ROOT, Run

from controller.cell.journal import read_rows

HOOK = '''
import os, sys

def _family(pid):
    """Return whether a process or any of its ancestors is the emulator."""
    while pid > 1:
        try:
            with open(f"/proc/{pid}/cmdline", "rb") as file:
                words = file.read().split(b"\\0")
            with open(f"/proc/{pid}/stat") as file:
                parent = int(file.read().rsplit(")", 1)[1].split()[1])
        except OSError:
            return False
        if b"emulators" in words:
            return True
        pid = parent
    return False

_log = os.environ.get("CELLCTL_AUDIT")
if _log and not _family(os.getpid()):
    _fd = os.open(_log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def _hook(event, args):
        if event == "open" and isinstance(args[0], (str, bytes)):
            os.write(_fd, f"open {os.fsdecode(args[0])}\\n".encode())
        elif event == "socket.connect":
            os.write(_fd, f"connect {args[1]!r}\\n".encode())

    sys.addaudithook(_hook)
'''


@pytest.mark.slow(always=True)
def test_the_controller_opens_nothing_but_its_files_and_its_devices(
    start: Callable[..., Run], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hook").mkdir()
    (tmp_path / "hook" / "sitecustomize.py").write_text(HOOK)
    log = tmp_path / "audit.log"
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "hook"))
    monkeypatch.setenv("CELLCTL_AUDIT", str(log))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    # a stranger: the run goes as far as asking every device and judging all pictures of the table
    ran = start(
        "recipes/holder.yaml", "--lay", "recipes/parts/idler_riser.stl", "--seed", "1"
    ).follow()
    assert ran.result["code"] == "unknown_object", ran.result

    devices = next(r for r in read_rows(ran.journal) if r.name == "run_began").body["devices"]
    addresses = {d["address"] for d in devices.values()}
    lines = log.read_text().splitlines()
    opened = {line.removeprefix("open ") for line in lines if line.startswith("open ")}
    called = {line.removeprefix("connect ") for line in lines if line.startswith("connect ")}
    assert any(path.endswith("holder.stl") for path in opened), "the hook saw nothing"

    own = (
        *(str(ROOT / name) for name in ("controller", "drivers", "messages", "recipes")),
        "recipes/",
        str(ROOT / "cellctl.egg-info"), str(tmp_path),
        *{sysconfig.get_paths()[key] for key in ("stdlib", "purelib", "platlib")},
        sys.prefix, sys.base_prefix, "/usr", "/etc", "/lib", "/proc/self", "/sys/devices/system",
        "/dev/null", "/dev/urandom", "/sys/fs/cgroup",
    )  # fmt: skip
    strange = {
        path
        for path in opened
        if not path.startswith(own) and path not in addresses and not path.startswith("<")
        and not re.fullmatch(r"\d+|/proc/\d+/(cmdline|stat|status)|/dev/shm/.*", path)
        # Python's own trial whether the folder for temporary files can be written
        and not re.fullmatch(re.escape(tempfile.gettempdir()) + r"/[a-z0-9_]{8}", path)
        # on sys.path for `recipes`, which is data without an __init__: a name, and no file
        and not re.fullmatch(r"__editable__\.cellctl-[\d.]+\.finder\.__path_hook__", path)
    }  # fmt: skip
    assert not strange
    allowed = {json.dumps(a) for a in addresses} | addresses
    for call in called:
        where = call.strip("()").replace("'", "").replace(", ", ":")
        assert where in allowed or where.removeprefix("b") in allowed, f"a call to {call}"
