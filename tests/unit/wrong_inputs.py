"""Wrong inputs of every command: what a person, a program or a bad disk can hand us.

Each row lays out files in a folder of its own and names the command line, the exit code, and words
of the one sentence that is to be printed. `test_cli_wrong_inputs.py` asks all of them within one
process, `benchmarks/bench_inputs.py` each in a process of its own, with seconds and memory.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
CELL_TEXT = (ROOT / "recipes/cells/emulated.yaml").read_text()
RECIPE_TEXT = """\
name: block
part: block.stl
unit: mm
density_g_cm3: 2.7
inspection:
  min_coverage: 0.5
  smallest_defect_mm: 3.0
grasp:
  force_n: 60
"""
CALIBRATION = {
    "size_px": [64, 48],
    "K": [[200.0, 0, 31.5], [0, 200.0, 23.5], [0, 0, 1]],
    "distortion": [0, 0, 0, 0, 0],
    "T_world_cam": [[0, -1, 0, 360], [-1, 0, 0, 0], [0, 0, -1, 1250], [0, 0, 0, 1]],
}
TARGET = {
    "inner_corners": [8, 5],
    "square_mm": 10,
    "images": [{"image": "board_0.png", "placed": "flat"}],
}
CELL_FILE = "cells/emulated.yaml"
RUN, CHECK = ("run", "recipe.yaml", "--runs", "runs"), ("check", "recipe.yaml")
RECOGNISE = ("recognise", "a.png", "--parts", "block.stl", "--calibration", "camera.json")
CALIBRATE = ("calibrate", "camera", "board_0.png", "--target", "target.json", "-o", "out.json")
Prepare = Callable[[Path], None]


@dataclass(frozen=True)
class Row:
    """A wrong input.

    Attributes
    ----------
    prepare : lays out what is wrong, in a folder that is sound but for that
    command : words of the command line; file names are relative to that folder
    says : words that the sentence must hold; those of a file with a line as `file:line`
    code : 2 where the command line or a file is wrong, 1 where cell or part say no
    """

    name: str
    prepare: Prepare
    command: tuple[str, ...]
    says: str
    code: int = 2


def lay_out(folder: Path) -> None:
    """Write a recipe, its part and cell, a calibration and a picture, all of them sound."""
    (folder / "cells").mkdir()
    (folder / "cells" / "emulated.yaml").write_text(CELL_TEXT)
    (folder / "recipe.yaml").write_text(RECIPE_TEXT)
    (folder / "block.stl").write_bytes(stl_box(50, 30, 20))
    (folder / "camera.json").write_text(json.dumps(CALIBRATION))
    (folder / "target.json").write_text(json.dumps(TARGET))
    (folder / "a.png").write_bytes(png(64, 48))
    (folder / "board_0.png").write_bytes(png(64, 48))


@dataclass(frozen=True)
class Cost:
    """What a command line came to in a process of its own.

    Attributes
    ----------
    seconds : by the clock; cpu_s : of computing, which other processes do not lengthen
    peak_bytes : of memory it held at once
    said : all it printed
    """

    code: int
    seconds: float
    cpu_s: float
    peak_bytes: int
    said: str


# a process starts with the peak of whoever forked it: so a small one forks
LAUNCHER = """
import json, os, sys, time
started = time.monotonic()
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ)
_, status, used = os.wait4(child, 0)
print(json.dumps([os.waitstatus_to_exitcode(status), time.monotonic() - started,
                  used.ru_utime + used.ru_stime, used.ru_maxrss * 1024]), file=sys.stderr)
"""


def cost_of(row: Row, folder: Path) -> Cost:
    """Ask a row's command line in a process of its own, in the folder it is laid out in."""
    done = subprocess.run(
        [
            sys.executable,
            "-S",
            "-c",
            LAUNCHER,
            sys.executable,
            "-m",
            "controller.cli",
            *row.command,
        ],
        cwd=folder,
        capture_output=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        text=True,
        errors="replace",
        check=True,
    )
    *said, told = done.stderr.strip().split("\n")
    code, seconds, cpu_s, peak_bytes = json.loads(told)
    return Cost(code, seconds, cpu_s, peak_bytes, "\n".join((*said, done.stdout)).strip())


# imports once all that any command line imports, and forks for each it is asked
FORKER = """
import gc, importlib, json, os, pkgutil, resource, sys, time
import controller.cli

def pages():
    # resident ones of its own, and those of files, which a fork maps anew as it goes
    with open("/proc/self/statm") as file:
        resident, of_files = map(int, file.read().split()[1:3])
    return resident - of_files, of_files

def peak_pages():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 // resource.getpagesize()

for module in pkgutil.walk_packages(controller.cli.__path__, "controller.cli."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
gc.collect()
gc.freeze()  # a fork that collects would copy what it only looks at
for line in sys.stdin:
    folder, cache, output, command = json.loads(line)
    started = time.monotonic()
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        own_at_first, _ = pages()
        os.chdir(folder)
        os.environ["XDG_CACHE_HOME"] = cache
        said = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(said, 1)
        os.dup2(said, 2)
        sys.argv = ["cellctl", *command]
        try:
            sys.exit(controller.cli.main())
        finally:
            more = peak_pages() - pages()[1] - own_at_first
            os.write(writing, str(more * resource.getpagesize()).encode())
    _, status, used = os.wait4(child, 0)
    more = int(os.read(reading, 64))
    os.close(reading)
    os.close(writing)
    print(json.dumps([os.waitstatus_to_exitcode(status), time.monotonic() - started,
                      used.ru_utime + used.ru_stime, more]), flush=True)
"""


class Forker:
    """Command lines, each in a process of its own that has imported everything already.

    The peak is `imports_bytes` and, on top, the memory of its own that the process came to hold
    beyond what it was forked with.

    Parameters
    ----------
    scratch : an empty folder
    imports_bytes : of memory a process of its own holds at once that does little but import
    """

    def __init__(self, scratch: Path, imports_bytes: int) -> None:
        self._output = scratch / "said"
        self._imports_bytes = imports_bytes
        self._process = subprocess.Popen(
            [sys.executable, "-c", FORKER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            text=True,
        )

    def cost_of(self, row: Row, folder: Path, cache: Path) -> Cost:
        """Ask a row's command line in the folder it is laid out in."""
        asked, told = self._process.stdin, self._process.stdout
        assert asked is not None
        assert told is not None
        print(
            json.dumps([str(folder), str(cache), str(self._output), row.command]),
            file=asked,
            flush=True,
        )
        code, seconds, cpu_s, more_bytes = json.loads(told.readline())
        said = self._output.read_text(errors="replace").strip()
        return Cost(code, seconds, cpu_s, self._imports_bytes + more_bytes, said)

    def close(self) -> None:
        """End it."""
        self._process.communicate()


# --- what files hold ----------------------------------------------------------------------------


def stl_box(x: float, y: float, z: float) -> bytes:
    """A closed box as binary STL, centred."""
    corners = (
        np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
        * [x, y, z]
        - np.array([x, y, z]) / 2
    )
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    records = b"".join(
        struct.pack("<12fH", 0, 0, 0, *corners[[a, b, c]].ravel(), 0) for a, b, c in faces
    )
    return b"\0" * 80 + struct.pack("<I", len(faces)) + records


def png(width: int, height: int, data: bytes | None = None) -> bytes:
    """A grey PNG; its pixels are those of `data`, compressed, and few where its header lies."""

    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    rows = b"".join(b"\0" + bytes(width) for _ in range(height)) if data is None else data
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def jpeg_header(width: int, height: int) -> bytes:
    frame = struct.pack(">BHHB", 8, height, width, 1) + b"\x01\x11\x00"
    return b"\xff\xd8\xff\xc0" + struct.pack(">H", len(frame) + 2) + frame + b"\xff\xd9"


def tiff_header(width: int, height: int) -> bytes:
    entries = b"".join(
        struct.pack("<HHII", tag, 4, 1, value)
        for tag, value in ((256, width), (257, height), (258, 8), (259, 1), (262, 1), (273, 8))
    )
    return b"II*\0" + struct.pack("<IH", 8, 6) + entries + b"\0\0\0\0"


LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{','.join([f'*{chr(97 + i)}'] * 9)}]\n" for i in range(9)
)
CSG_BOMB = (
    "unit: mm\nshapes:\n  s0: {block: {size: [9, 9, 9]}}\n"
    + "".join(
        f"  s{i + 1}: {{union: [{{use: s{i}}}, {{use: s{i}, move: [{3.7 * i + 1}, 0, 1]}}]}}\n"
        for i in range(40)
    )
    + "part: {use: s40}\n"
)


# --- how they are laid out ----------------------------------------------------------------------


def nothing(folder: Path) -> None:
    """The command line itself is wrong."""


def write(name: str, data: bytes | str) -> Prepare:
    """Another file in the place of a sound one."""

    def prepare(folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data.encode() if isinstance(data, str) else data)

    return prepare


def recipe(old: str, new: str) -> Prepare:
    assert RECIPE_TEXT.count(old) == 1, old
    return write("recipe.yaml", RECIPE_TEXT.replace(old, new))


def cell(old: str, new: str) -> Prepare:
    assert CELL_TEXT.count(old) == 1, old
    return write("cells/emulated.yaml", CELL_TEXT.replace(old, new))


def cell_line(old: str) -> int:
    """The line of the shipped cell file that holds a text."""
    return CELL_TEXT[: CELL_TEXT.index(old)].count("\n") + 1


def gone(name: str) -> Prepare:
    return lambda folder: (folder / name).unlink()


def calibration(**more: Any) -> Prepare:
    return write("camera.json", json.dumps({**CALIBRATION, **more}))


def link(name: str, to: str) -> Prepare:
    def prepare(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(to)

    return prepare


def pipe(name: str) -> Prepare:
    def prepare(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)

    return prepare


def directory(name: str) -> Prepare:
    def prepare(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).mkdir()

    return prepare


def sparse(name: str, size: int) -> Prepare:
    """A file that says it is large and takes no room."""

    def prepare(folder: Path) -> None:
        with (folder / name).open("wb") as file:
            file.truncate(size)

    return prepare


def outside(name: str) -> Prepare:
    """A sound part beside the recipe's folder, and a recipe that names it."""

    def prepare(folder: Path) -> None:
        inner = folder / "inner"
        inner.mkdir()
        shutil.move(folder / "cells", inner / "cells")
        text = RECIPE_TEXT.replace("part: block.stl", f"part: {name}")
        (inner / "recipe.yaml").write_text(text.replace("{folder}", str(folder)))
        (inner / "link.stl").symlink_to(folder / "block.stl")

    return prepare


INNER = ("run", "inner/recipe.yaml", "--runs", "runs")
OVERHEAD = "pose: {position: [360, 0, 1250], x_axis: [0, -1, 0], y_axis: [-1, 0, 0]}"
INSPECTION = "pose: {position: [430, -700, 450], x_axis: [1, 0, 0], y_axis: [0, 0, -1]}"
BOARD = json.dumps({**TARGET, "images": [{"image": "../board_0.png", "placed": "flat"}] * 2})

ROWS: tuple[Row, ...] = (
    # recipes and cells: files that are none
    Row("no recipe", nothing, ("run", "none.yaml"), "none.yaml: No such file"),
    Row("recipe is a directory", directory("recipe.yaml"), RUN, "recipe.yaml: is a directory"),
    Row("recipe is a pipe", pipe("recipe.yaml"), RUN, "recipe.yaml: is not a plain file"),
    Row("recipe is /dev/zero", nothing, ("run", "/dev/zero"), "/dev/zero: is not a plain file"),
    Row("recipe links to /dev/zero", link("recipe.yaml", "/dev/zero"), RUN, "is not a plain file"),
    Row("recipe links to itself", link("recipe.yaml", "recipe.yaml"), RUN, "recipe.yaml: Too many"),
    Row("recipe of 10 GB", sparse("recipe.yaml", 10**10), RUN, "recipe.yaml: has more than"),
    Row("empty recipe", write("recipe.yaml", ""), CHECK, "recipe.yaml: is empty"),
    Row("binary recipe", write("recipe.yaml", bytes(range(256))), CHECK, "is not a text file"),
    Row("recipe in cp1252", write("recipe.yaml", "name: \xfc".encode("cp1252")), CHECK, "UTF-8"),
    Row("recipe of zeros", write("recipe.yaml", b"\0" * 900), CHECK, "not valid YAML"),
    Row("recipe is a list", write("recipe.yaml", "- a\n- b\n"), CHECK, "is empty or not a list of"),
    Row("recipe is the part", write("recipe.yaml", stl_box(1, 1, 1)), CHECK, "recipe.yaml: "),
    Row("name that is too long", nothing, ("run", "x" * 5000), "File name too long"),
    Row("cell is /dev/zero", nothing, (*RUN, "--cell", "/dev/zero"), "/dev/zero: is not a plain"),
    Row(
        "cell is a recipe",
        nothing,
        (*RUN, "--cell", "recipe.yaml"),
        "recipe.yaml: is a recipe, not a cell",
    ),
    Row("recipe is a cell", nothing, ("check", CELL_FILE), "is a cell file, not a recipe; name it"),
    Row("run of a cell", nothing, ("run", CELL_FILE, "--runs", "runs"), "name it with --cell"),
    Row("plan of a recipe", nothing, ("plan", "recipe.yaml"), "is a recipe, not a CAD file; name"),
    Row("compile of a recipe", nothing, ("compile", "recipe.yaml"), "name it with --recipe"),
    Row("plan of a cell", nothing, ("plan", CELL_FILE), "is a cell file, not a CAD file"),
    Row("doctor of no cell", nothing, ("doctor", "--cell", "none.yaml"), "none.yaml: No such file"),
    Row(
        "page for others in plain text",
        nothing,
        ("serve", "--host", "192.0.2.7"),
        "others could read what is sent",
    ),
    Row("page with half a key", nothing, ("serve", "--tls-key", "key.pem"), "require each other"),
    Row(
        "page behind plain text",
        nothing,
        ("serve", "--behind", "http://cell.example"),
        "is not like https://cell.example",
    ),
    Row("page with a proxy of no name", nothing, ("serve", "--proxy", "10.0.0.1"), "--behind"),
    Row(
        "page at a foreign address",
        nothing,
        ("serve", "--host", "192.0.2.7", "--behind", "https://cell.example"),
        "--host 192.0.2.7 --port 8470",
    ),
    Row("account of no name", nothing, ("account", "--role", "viewer"), "name the account"),
    Row("account of no known role", nothing, ("account", "ada", "--role", "boss"), "'boss'"),
    Row("account without a role", nothing, ("account", "ada"), "--role ROLE"),
    Row("account with signs", nothing, ("account", "../ada", "--role", "viewer"), "begins with"),
    Row("account that is not there", nothing, ("account", "ada", "--remove"), "no account `ada`"),
    Row("rejudge by no recipe", nothing, ("rejudge",), "--recipe"),
    Row(
        "rejudge by a recipe that is not there",
        nothing,
        ("rejudge", "--recipe", "no.yaml"),
        "no.yaml",
    ),
    Row("connect without a wire", nothing, ("connect",), "has no section `connect`"),
    Row("connect of no cell file", nothing, ("connect", "--cell", "no.yaml"), "no.yaml"),
    Row("deliveries of no bridge", nothing, ("deliveries",), "was never connected to a plant"),
    Row("orders of no bridge", nothing, ("orders",), "was never connected to a plant"),
    Row("status of no run", nothing, ("status",), "no run at this cell: nobody holds", 1),
    Row("watch of no run", nothing, ("watch",), "no run at this cell: nobody holds", 1),
    Row("pause of no run", nothing, ("pause", "now"), "Start one with `cellctl run`", 1),
    Row("pause at no time", nothing, ("pause", "soon"), "'soon' is not one of"),
    Row("resume of no run", nothing, ("resume",), "no run at this cell", 1),
    Row("step of no run", nothing, ("step",), "no run at this cell", 1),
    Row("stop of no run", nothing, ("stop",), "no run at this cell", 1),
    Row("abort of no run", nothing, ("abort",), "no run at this cell", 1),
    Row("stop for too long a reason", nothing, ("stop", "--why", "x" * 1001), "--why: 1001"),
    Row("answer to no run", nothing, ("answer", "look"), "no run at this cell", 1),
    Row("an empty answer", nothing, ("answer", ""), "ANSWER must be one word"),
    Row("answer to question 0", nothing, ("answer", "look", "--number", "0"), "--number"),
    Row("ack of nothing", nothing, ("ack", "--why", "looked"), "there is nothing to", 1),
    Row("ack without a reason", nothing, ("ack",), "--why"),
    Row("ack for an empty reason", nothing, ("ack", "--why", " "), "--why needs 1 to 1000"),
    Row("ack of no cell", nothing, ("ack", "--why", "x", "--cell", "none.yaml"), "No such"),
    Row("recover of no cell", nothing, ("recover", "--cell", "none.yaml"), "none.yaml: No such"),
    Row("recover of the emulated cell", nothing, ("recover",), "Nothing is left to recover"),
    Row("init where files are", nothing, ("init", "."), ".: has files in it; name a new"),
    Row("init of a kind", nothing, ("init", "new", "--kind", "arm"), "--kind requires --driver"),
    Row("init of no such kind", nothing, ("init", "new", "--driver", "x", "--kind", "io"), "io"),
    Row("init of no name", nothing, ("init", "new", "--driver", "A b"), "--driver `A b`: begins"),
    Row("init of a file", nothing, ("init", "recipe.yaml"), "recipe.yaml: is a file"),
    Row("init below a file", nothing, ("init", "recipe.yaml/new"), "recipe.yaml is a file"),
    Row("recipe of no name we know", nothing, ("check", "flange"), "flange: no such file, and no"),
    # YAML that is none, or blows up
    Row("tab in YAML", recipe("  min_coverage", "\tmin_coverage"), CHECK, "recipe.yaml:6: "),
    Row("key twice", recipe("unit: mm", "unit: mm\nunit: mm"), CHECK, "recipe.yaml:4: not valid"),
    Row(
        "deep YAML", write("recipe.yaml", "a: " + "[" * 60_000), RUN, "recipe.yaml:1: more than 12"
    ),
    Row(
        "deep sections",
        write("recipe.yaml", "".join(f"{' ' * i}a:\n" for i in range(400))),
        RUN,
        "more than 12 levels",
    ),
    Row("billion laughs", write("recipe.yaml", LAUGHS), RUN, "recipe.yaml:1: anchors"),
    Row("alias of nothing", recipe("unit: mm", "unit: *mm"), CHECK, "recipe.yaml:3: anchors"),
    Row(
        "tag that would run",
        recipe("unit: mm", "unit: !!python/object/apply:os.system [id]"),
        CHECK,
        "recipe.yaml:3: tags",
    ),
    Row("endless list", write("recipe.yaml", "a: [" + "1," * 50_000 + "]"), CHECK, "10000 values"),
    Row(
        "impossible date",
        recipe("name: block", "name: 2026-13-45"),
        CHECK,
        "recipe.yaml:1: not valid YAML: '2026-13-45' is not a date",
    ),
    Row(
        "impossible hour",
        recipe("name: block", "name: 2026-11-22 25:61:00"),
        CHECK,
        "recipe.yaml:1: ",
    ),
    Row("number of 9999 digits", recipe("2.7", "1" * 9999), CHECK, "recipe.yaml"),
    # recipes: values
    Row(
        "unknown key",
        recipe("force_n", "forse_n"),
        RUN,
        "recipe.yaml:9: unknown key `grasp.forse_n`",
    ),
    Row("unknown unit", recipe("unit: mm", "unit: parsec"), RUN, "recipe.yaml:3: `unit`"),
    Row(
        "unit of a part in mm is inch",
        recipe("unit: mm", "unit: inch"),
        RUN,
        "recipe.yaml:3: block is 1270",
    ),
    Row(
        "unit of a part in mm is m",
        recipe("unit: mm", "unit: m"),
        RUN,
        "recipe.yaml:3: block is 50000",
    ),
    Row("density that is no number", recipe("2.7", ".nan"), RUN, "recipe.yaml:4: `density_g_cm3`"),
    Row("infinite density", recipe("2.7", ".inf"), CHECK, "recipe.yaml:4: `density_g_cm3`"),
    Row("density of nothing", recipe("2.7", "0"), CHECK, "recipe.yaml:4: `density_g_cm3`"),
    Row("negative force", recipe("force_n: 60", "force_n: -60"), CHECK, "recipe.yaml:9: "),
    Row("section is a number", recipe("  force_n: 60", " 60"), CHECK, "recipe.yaml:8: `grasp`"),
    Row("no name", recipe("name: block\n", ""), CHECK, "`name` is missing"),
    Row("name with a slash", recipe("name: block", "name: ../x"), RUN, "recipe.yaml:1: `name`"),
    Row("count 0 in the recipe", recipe("unit: mm", "unit: mm\ncount: 0"), RUN, "recipe.yaml:4: "),
    # what a recipe names
    Row(
        "part that is not there",
        recipe("block.stl", "blok.stl"),
        RUN,
        "recipe.yaml:2: unknown part",
    ),
    Row(
        "part up and outside", outside("../block.stl"), INNER, "recipe.yaml:2: `part`: ../block.stl"
    ),
    Row(
        "part outside by its full name",
        outside("{folder}/block.stl"),
        INNER,
        "outside the recipe's",
    ),
    Row(
        "part outside by a link",
        outside("link.stl"),
        INNER,
        "recipe.yaml:2: `part`: link.stl is outside",
    ),
    Row("part is a device", recipe("block.stl", "/dev/zero"), RUN, "recipe.yaml:2: `part`"),
    Row("part with a zero byte", recipe("block.stl", '"a\\0.stl"'), RUN, "recipe.yaml:2: "),
    Row(
        "cell outside",
        recipe("unit: mm", "unit: mm\ncell: ../cell.yaml"),
        RUN,
        "recipe.yaml:4: `cell`: ../cell.yaml is outside the recipe's folder; name the cell",
    ),
    # cells: values
    Row(
        "camera pose in metres",
        cell(OVERHEAD, OVERHEAD.replace("360, 0, 1250", "0.36, 0, 1.25")),
        RUN,
        f"emulated.yaml:{cell_line(OVERHEAD)}: `cameras.overhead.pose.position`: the camera",
    ),
    Row(
        "inspection camera in metres",
        cell(INSPECTION, INSPECTION.replace("430, -700, 450", "0.43, -0.7, 0.45")),
        RUN,
        f"emulated.yaml:{cell_line(INSPECTION)}: `cameras.inspection.pose`: `station.position` is",
    ),
    Row(
        "camera that looks away",
        cell(OVERHEAD, OVERHEAD.replace("[-1, 0, 0]}", "[1, 0, 0]}")),
        RUN,
        "`cameras.overhead.pose`: the middle of `table.drop_area` is not in its picture",
    ),
    Row(
        "drop area in metres",
        cell(
            "drop_area:    {x: [270, 450], y: [-100, 100]}",
            "drop_area:    {x: [0.27, 0.45], y: [-0.1, 0.1]}",
        ),
        CHECK,
        "`table.drop_area`: a side of",
    ),
    Row("arm in metres", cell("upper_mm: 253.5", "upper_mm: 0.2535"), CHECK, "`arm.upper_mm`"),
    Row(
        "inspection camera without calibration",
        cell("    focal_px: 3733.0\n", ""),
        CHECK,
        f"emulated.yaml:{cell_line('inspection:       #')}: `cameras.inspection.focal_px` is",
    ),
    Row("camera of no pixels", cell("focal_px: 3571.0", "focal_px: 0"), CHECK, "focal_px"),
    Row(
        "lamp on no channel",
        cell("{analog: 5, relay: 5, kind: spot", "{analog: 9, relay: 5, kind: spot"),
        CHECK,
        "analog",
    ),
    # characteristics
    Row(
        "characteristic that the part lacks",
        recipe(
            "  min_coverage: 0.5\n",
            "  characteristics:\n    - {id: hole 9 mm diameter, plus: 0.3, minus: 0.3}\n",
        ),
        CHECK,
        "recipe.yaml:7: `inspection.characteristics`: no characteristic 'hole 9 mm diameter'",
    ),
    # CAD files
    Row("empty part", write("block.stl", b""), RUN, "block.stl: the file is empty"),
    Row(
        "part of 4 billion triangles",
        write("block.stl", b"\0" * 80 + b"\xff" * 4 + b"\0" * 50),
        RUN,
        "block.stl: promises 4294967295 triangles",
    ),
    Row(
        "part that is open",
        write(
            "block.stl",
            stl_box(50, 30, 20)[:-50].replace(struct.pack("<I", 12), struct.pack("<I", 11), 1),
        ),
        RUN,
        "not closed",
    ),
    Row(
        "part with corners that are no numbers",
        write("block.stl", stl_box(math.nan, 30, 20)),
        RUN,
        "block.stl",
    ),
    Row(
        "part is a pipe",
        pipe("block.stl"),
        ("compile", "block.stl"),
        "block.stl: is not a regular file",
    ),
    Row(
        "part is a directory",
        directory("block.stl"),
        ("plan", "block.stl", "--cell", CELL_FILE),
        "block.stl: is a dir",
    ),
    Row("part is /dev/zero", nothing, ("compile", "/dev/zero"), "/dev/zero"),
    Row("part of 10 GB", sparse("big.stl", 10**10), ("compile", "big.stl"), "big.stl: "),
    Row("part in metres", write("block.stl", stl_box(0.05, 0.03, 0.02)), RUN, "block.stl"),
    Row(
        "CSG bomb", write("bomb.csg.yaml", CSG_BOMB), ("compile", "bomb.csg.yaml"), "bomb.csg.yaml"
    ),
    Row(
        "deep CSG",
        write("deep.csg.yaml", "part: " + "[" * 9999),
        ("compile", "deep.csg.yaml"),
        "deep.csg.yaml:1: nested deeper",
    ),
    Row("STEP that is none", write("x.step", "ISO-10303-21;"), ("compile", "x.step"), "x.step"),
    Row("no such kind of part", write("x.dwg", "x"), ("compile", "x.dwg"), "x.dwg"),
    # pictures and calibrations
    Row(
        "PNG of 60000 x 60000",
        write("a.png", png(60_000, 60_000, b"\0")),
        RECOGNISE,
        "a.png: 60000 x 60000 px",
    ),
    Row(
        "JPEG of 60000 x 60000",
        write("a.png", jpeg_header(60_000, 60_000)),
        RECOGNISE,
        "a.png: 60000 x 60000 px",
    ),
    Row(
        "TIFF of 60000 x 60000",
        write("a.png", tiff_header(60_000, 60_000)),
        RECOGNISE,
        "a.png: 60000 x 60000 px",
    ),
    Row(
        "board of 60000 x 60000",
        write("board_0.png", png(60_000, 60_000, b"\0")),
        CALIBRATE,
        "board_0.png: 60000 x 60000 px",
    ),
    Row(
        "PNG that unpacks to 100 MB",
        write("a.png", png(64, 48, bytes(10**8))),
        RECOGNISE,
        "a.png: is cut off or damaged",
    ),
    Row(
        "picture without pixels",
        write("a.png", png(0, 48)),
        RECOGNISE,
        "a.png: is not a readable picture",
    ),
    Row(
        "picture cut off",
        write("a.png", png(64, 48)[:-30]),
        RECOGNISE,
        "a.png: is cut off or damaged",
    ),
    Row(
        "picture is a text", write("a.png", "hello"), RECOGNISE, "a.png: is not a readable picture"
    ),
    Row(
        "picture is /dev/zero", link("a.png", "/dev/zero"), RECOGNISE, "a.png: is not a plain file"
    ),
    Row("picture is a pipe", pipe("a.png"), RECOGNISE, "a.png: is not a plain file"),
    Row("picture of 10 GB", sparse("a.png", 10**10), RECOGNISE, "a.png: has more than"),
    Row("picture of another size", write("a.png", png(32, 24)), RECOGNISE, "a.png: 32 x 24 px"),
    Row(
        "calibration is /dev/zero",
        link("camera.json", "/dev/zero"),
        RECOGNISE,
        "camera.json: is no",
    ),
    Row(
        "calibration is a pipe", pipe("camera.json"), RECOGNISE, "camera.json: is not a plain file"
    ),
    Row("no calibration", gone("camera.json"), RECOGNISE, "camera.json: No such file"),
    Row("deep JSON", write("camera.json", "[" * 200_000), RECOGNISE, "camera.json: not valid JSON"),
    Row("calibration with NaN", calibration(distortion=[math.nan] * 5), RECOGNISE, "no number of"),
    Row("calibration of words", calibration(K="focal"), RECOGNISE, "camera.json: no camera"),
    Row(
        "calibration of no pixels",
        calibration(size_px=[0, -5]),
        RECOGNISE,
        "camera.json: `size_px`",
    ),
    Row("calibration of 10^12 pixels", calibration(size_px=[10**6, 10**6]), RECOGNISE, "`size_px`"),
    Row(
        "calibration in metres",
        calibration(T_world_cam=[[0, -1, 0, 0.36], [-1, 0, 0, 0], [0, 0, -1, 1.25], [0, 0, 0, 1]]),
        RECOGNISE,
        "camera.json: `T_world_cam`: the camera would",
    ),
    Row("calibration that is a list", write("camera.json", "[1, 2]"), RECOGNISE, "camera.json: no"),
    Row("target names a picture twice", write("target.json", BOARD), CALIBRATE, "target.json"),
    Row(
        "target of wrong types",
        write("target.json", '{"square_mm": "ten"}'),
        CALIBRATE,
        "target.json",
    ),
    Row(
        "folder without pictures", directory("a.png"), RECOGNISE, "a.png: no picture in this folder"
    ),
    # options
    Row("unknown command", nothing, ("runn",), "runn"),
    Row("unknown option", nothing, (*RUN, "--sped", "3"), "--sped"),
    Row("count 0", nothing, (*RUN, "--count", "0"), "--count"),
    Row("count below 0", nothing, (*RUN, "--count", "-1"), "--count"),
    Row("count of a billion", nothing, (*RUN, "--count", "1000000000"), "--count"),
    Row("speed 0", nothing, (*RUN, "--speed", "0"), "--speed"),
    Row("speed below 0", nothing, (*RUN, "--speed", "-1"), "--speed"),
    Row("speed nan", nothing, (*RUN, "--speed", "nan"), "--speed"),
    Row("speed inf", nothing, (*RUN, "--speed", "inf"), "--speed"),
    Row("seed of words", nothing, (*RUN, "--seed", "lucky"), "--seed"),
    Row("seed below 0", nothing, (*RUN, "--seed", "-7"), "--seed"),
    Row(
        "jobs that are none", nothing, ("compile", "block.stl", "--jobs", "0"), "--jobs 0: expected"
    ),
    Row(
        "jobs at no address",
        nothing,
        ("plan", "block.stl", "--jobs", "localhost"),
        "--jobs localhost",
    ),
    Row(
        "jobs without a cache",
        nothing,
        ("compile", "block.stl", "--jobs", "2", "--no-cache"),
        "--jobs cannot be combined with --no-cache",
    ),
    Row("density nan", nothing, ("compile", "block.stl", "--density", "nan"), "--density"),
    Row(
        "place that is no number", nothing, (*RUN, "--at", "nan,0,0"), "--at nan,0,0: must be three"
    ),
    Row(
        "place of two numbers",
        nothing,
        ("plan", "block.stl", "--at", "1,2", "--cell", CELL_FILE),
        "--at 1,2: must be three",
    ),
    Row("place off the table", nothing, (*RUN, "--at", "900,0,0"), "--at 900,0,0: off the table"),
    Row(
        "place to emulate off the table",
        nothing,
        ("emulate", "--at", "900,0,0", "--part", "block.stl", "--cell", "cells/emulated.yaml"),
        "--at 900,0,0: off the table",
    ),
    Row("pose below 0", nothing, (*RUN, "--pose", "-1"), "--pose"),
    Row(
        "stepwise without a person",
        nothing,
        (*RUN, "--step", "--json"),
        "--step asks before each motion",
    ),
    Row(
        "no such pose",
        nothing,
        ("plan", "block.stl", "--unit", "mm", "--pose", "99", "--cell", "cells/emulated.yaml"),
        "--pose 99: block has stable poses",
    ),
    Row("part to lay is not there", nothing, (*RUN, "--lay", "none.stl"), "none.stl"),
    Row(
        "part to emulate is a pipe",
        pipe("p.stl"),
        ("emulate", "--part", "p.stl", "--cell", "cells/emulated.yaml"),
        "p.stl",
    ),
    Row(
        "cell to emulate is wrong",
        cell("upper_mm: 253.5", "upper_mm: -1"),
        ("emulate", "--cell", "cells/emulated.yaml"),
        "`arm.upper_mm`",
    ),
    Row("control socket nowhere", nothing, (*RUN, "--control", "no/such/socket"), "--control"),
    Row(
        "faster than real on real devices",
        cell("arm:         {address: emulated}", "arm:         {address: /dev/ttyS9}"),
        (*RUN, "--speed", "5"),
        "--speed 5: time cannot",
    ),
    # folders and disks
    Row("runs is a file", write("runs", "x"), RUN, "--runs runs: "),
    Row(
        "runs below a file",
        write("runs", "x"),
        ("run", "recipe.yaml", "--runs", "runs/deep"),
        "is a file; name a folder",
    ),
    Row(
        "runs that cannot be made",
        nothing,
        ("run", "recipe.yaml", "--runs", "/proc/runs"),
        "--runs /proc/runs: ",
    ),
    Row(
        "runs on a full disk",
        nothing,
        ("run", "recipe.yaml", "--runs", "/dev/full/runs"),
        "--runs /dev/full/runs: ",
    ),
    Row(
        "page that cannot be written",
        nothing,
        ("plan", "block.stl", "--cell", "cells/emulated.yaml", "--report", "/proc/none/x.html"),
        "/proc/none",
    ),
    Row(
        "step of commissioning that there is not",
        nothing,
        ("commission", "--cell", CELL_FILE, "--yes", "--step", "lamp"),
        "--step lamp: the steps are devices, light",
    ),
    Row(
        "step of commissioning before those that it needs",
        nothing,
        ("commission", "--cell", CELL_FILE, "--yes", "--step", "light"),
        "it needs `devices`, which is not done",
    ),
    Row(
        "reach of a recipe that there is not",
        nothing,
        ("commission", "--cell", CELL_FILE, "--yes", "--recipe", "none.yaml"),
        "none.yaml",
    ),
    Row(
        "--yes for a person at real devices",
        write(
            CELL_FILE,
            CELL_TEXT.replace("arm:         {address: emulated}", "arm: {address: /dev/x}"),
        ),
        ("commission", "--cell", CELL_FILE, "--yes"),
        "--yes answers for a person, and this cell has real devices",
    ),
    Row(
        "record of a step that is damaged",
        write("out/steps/light.json", "{"),
        ("commission", "--cell", CELL_FILE, "--out", "out", "--status"),
        "out/steps/light.json: is no record of commissioning",
    ),
    Row(
        "commissioning into a file",
        write("out", "x"),
        ("commission", "--cell", CELL_FILE, "--out", "out", "--status"),
        "--out out: is a file",
    ),
    Row(
        "jog without a terminal and without orders",
        nothing,
        ("jog", "--cell", CELL_FILE),
        "is no terminal",
    ),
    Row(
        "jog by orders that are not there",
        nothing,
        ("jog", "--cell", CELL_FILE, "--commands", "orders.txt", "--yes"),
        "orders.txt: ",
    ),
    Row(
        "jog in JSON with keys",
        nothing,
        ("jog", "--cell", CELL_FILE, "--json"),
        "--json requires --commands",
    ),
    Row(
        "jog that answers for a person at real devices",
        write(
            CELL_FILE,
            CELL_TEXT.replace("arm:         {address: emulated}", "arm: {address: /dev/x}"),
        ),
        ("jog", "--cell", CELL_FILE, "--commands", "-", "--yes"),
        "--yes answers for a person, and this cell has real devices",
    ),
    Row(
        "jog whose journal has no folder",
        nothing,
        ("jog", "--cell", CELL_FILE, "--commands", "-", "--yes", "--runs", "/proc/runs"),
        "--runs /proc/runs: ",
    ),
    Row(
        "teaching what nobody knows",
        nothing,
        ("teach", "roof", "--cell", CELL_FILE, "--commands", "-", "--yes"),
        "'roof' is not one of",
    ),
    Row(
        "teaching a park that stands on several lines",
        write(
            CELL_FILE,
            CELL_TEXT.replace(
                "park_deg: {shoulder: 80, elbow: 0, yaw: 0, pitch: -90, roll: 0}",
                "park_deg:\n    {shoulder: 80, elbow: 0, yaw: 0, pitch: -90, roll: 0}",
            ),
        ),
        ("teach", "park", "--cell", CELL_FILE, "--commands", "-", "--yes"),
        "`arm.park_deg` is spread over several lines",
    ),
    Row(
        "teaching over trays that the cell file does not name",
        write("cells/calibrations/trays.json", "{}"),
        ("teach", "accept", "--cell", CELL_FILE, "--commands", "-", "--yes"),
        "trays.json: exists, but `calibration` of the cell file does not name it",
    ),
    Row(
        "dry run of two parts",
        nothing,
        ("run", "recipe.yaml", "--dry", "--count", "2", "--runs", "runs"),
        "--count: --dry takes no part",
    ),
    Row(
        "dry run that keeps wires",
        nothing,
        ("run", "recipe.yaml", "--dry", "--record", "all.wires", "--runs", "runs"),
        "--record: --dry takes no part",
    ),
    Row(
        "dry run from a stable pose that there is not",
        nothing,
        ("run", "recipe.yaml", "--dry", "--pose", "99", "--runs", "runs"),
        "--pose 99: the part has the stable poses 0",
    ),
    Row(
        "dry run, step by step, where nobody is",
        nothing,
        ("run", "recipe.yaml", "--dry", "--step", "--runs", "runs"),
        "--step asks before each motion",
    ),
    Row("board that no file has", nothing, ("print-target", "wall"), "wall: no board of this name"),
    Row(
        "board larger than the paper",
        nothing,
        ("print-target", "charuco", "--square-mm", "60"),
        "a4 has 200 x 261 mm",
    ),
    Row(
        "board of half a square",
        nothing,
        ("print-target", "charuco", "--squares", "12.5x9"),
        "--squares 12.5x9: squares across and down",
    ),
    Row(
        "board with more markers than its dictionary",
        nothing,
        ("print-target", "charuco", "--squares", "40x40", "--square-mm", "4"),
        "DICT_4X4_250 has 250 markers",
    ),
    Row(
        "board that was fitted to the page",
        nothing,
        ("print-target", "charuco", "--measured-mm", "170"),
        "5.56 % off the nominal",
    ),
    Row(
        "sheet that is no PDF",
        nothing,
        ("print-target", "charuco", "-o", "board.png"),
        "--output board.png: the sheet is a PDF",
    ),
    Row(
        "calibration that cannot be written",
        nothing,
        (*CALIBRATE[:-1], "/proc/none/x.json"),
        "--output in /proc/none",
    ),
    # reports
    Row("report of no runs", nothing, ("report", "--runs", "none"), "no journal at none", 1),
    Row("views that are not there", nothing, ("inspect", "none.json"), "none.json: No such file"),
    Row(
        "replay of wires that are not there",
        nothing,
        ("replay", "--wires", "none.wires"),
        "none.wires: No such file",
    ),
    Row(
        "replay of a file that has no wires",
        nothing,
        ("replay", "--wires", CELL_FILE),
        "this is no file that `cellctl run --record` writes",
    ),
    Row(
        "recording over another file",
        nothing,
        (*RUN, "--record", "recipe.yaml"),
        "--record recipe.yaml: exists already",
    ),
    Row(
        "replay of wires with a run",
        nothing,
        ("replay", "nonsense", "--wires", "none.wires"),
        "RUN and --wires exclude each other",
    ),
    Row(
        "replay of pictures with a cell",
        nothing,
        ("replay", "--cell", "none.yaml"),
        "--cell requires --wires",
    ),
    Row("replay of no run", nothing, ("replay", "nonsense"), "no run `nonsense` in runs"),
    Row("verify of no run", nothing, ("verify", "nonsense"), "no run `nonsense` in runs"),
    Row("statistics of no runs", nothing, ("stats", "none.yaml"), "no journal at runs", 1),
    Row("yields of no runs", nothing, ("stats",), "no journal at runs", 1),
    Row(
        "yields by nothing",
        nothing,
        ("stats", "--by", "moon"),
        "--by moon: must be one of day, run",
    ),
    Row(
        "statistics of a recipe and a lot",
        nothing,
        ("stats", "block", "--lot", "L7"),
        "require --by",
    ),
    Row("backup of no runs", nothing, ("backup", "b.tar"), "no journal at runs", 1),
    Row("restore of no file", nothing, ("backup", "b.tar", "--restore"), "b.tar: No such file", 1),
    Row(
        "restore of another file",
        nothing,
        ("backup", "block.stl", "--restore"),
        "block.stl: is no backup, or damaged",
        1,
    ),
    Row("history of no runs", nothing, ("history",), "no journal at runs", 1),
    Row("review of no runs", nothing, ("review",), "no journal at runs", 1),
    Row(
        "review with no such verdict",
        nothing,
        ("review", "SN1", "--verdict", "good"),
        "--verdict good: must be one of accept, reject",
    ),
    Row("review of nothing", nothing, ("review", "--verdict", "accept"), "--verdict, --output"),
    Row(
        "history of a wrong date",
        nothing,
        ("history", "--since", "yesterday"),
        "--since yesterday: must be a date such as 2026-03-01",
    ),
    Row(
        "history of a wrong verdict",
        nothing,
        ("history", "--verdict", "good"),
        "--verdict good: must be one of pass, fail",
    ),
    Row(
        "history of a part and a filter",
        nothing,
        ("history", "SN1", "--lot", "L7"),
        "PART SN1: cannot be combined with filters",
    ),
    Row(
        "export to a table of no kind",
        nothing,
        ("history", "--export", "all.xlsx"),
        "--export all.xlsx: name a file that ends in .csv, .parquet, .qif",
    ),
    Row(
        "store at no URL",
        write("runs/journal.sqlite", b""),
        ("history", "--store", "nonsense"),
        "the store's URL cannot be read",
        1,
    ),
    Row(
        "store is no database",
        write("runs/history.sqlite", b"x" * 4096),
        ("history",),
        "not a database",
        1,
    ),
    Row("learning nothing", nothing, ("learn", "-o", "a.learned"), "name either SET... or --runs"),
    Row(
        "learning from sets that are not there",
        nothing,
        ("learn", "none.json", "-o", "a.learned"),
        "none.json: No such file",
    ),
    Row("gauge of nothing", nothing, ("gauge",), "name what was measured: sets of views"),
    Row("gauge of no run", nothing, ("gauge", "nonsense"), "no run `nonsense` in runs"),
    Row("report of no run", nothing, ("report", "nonsense"), "no run `nonsense` in runs"),
    Row(
        "report of a path",
        nothing,
        ("report", "../../etc/passwd", "--runs", "runs"),
        "no run `../../etc/passwd` in runs: there is no journal; name the folder with --runs",
    ),
    Row(
        "journal is no database",
        write("runs/journal.sqlite", b"x" * 4096),
        ("report", "--runs", "runs"),
        "journal",
        1,
    ),
    Row("journal is a directory", directory("runs"), ("report", "--runs", "runs"), "no journal", 1),
    # what the cell or the part says no to
    Row(
        "part that nothing can hold",
        write("big.stl", stl_box(90, 87, 84)),
        ("plan", "big.stl", "--cell", "cells/emulated.yaml", "--unit", "mm"),
        "cellctl",
        1,
    ),
)
