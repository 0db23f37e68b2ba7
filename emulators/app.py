"""The emulated cell as one process: devices on their wires, one world behind them, pictures of it.

Prints one JSON line on stdout when everything can be used, and nothing else there; see `main`.
The truth about the world stays inside: clients have the devices, and tests the control port that
``--control`` opens.
"""

import argparse
import asyncio
import contextlib
import json
import logging
import math
import os
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from emulators._cell import Cell as Cell
from emulators._cell import CellOptions
from emulators.camera_v4l2 import unmount
from emulators.control_port import ControlPort
from emulators.owned import owned_folder
from emulators.register import registered
from emulators.world import EngineError, LayoutError

log = logging.getLogger(__name__)

SLICE_WALL_S: Final = 0.003  # longest time of stepping the world before the wires get their turn
IDLE_WALL_S: Final = 0.001


def build_parser() -> argparse.ArgumentParser:
    """Return the command line of ``python -m emulators``."""
    parser = argparse.ArgumentParser(
        prog="emulators",
        description="Start the emulated cell; print the addresses of its devices as one JSON line.",
        epilog="example: python -m emulators --cell recipes/cells/emulated.yaml "
        "--part recipes/parts/featuretype.stl --seed 7",
    )
    parser.add_argument("--cell", type=Path, required=True, help="cell file (YAML)")
    parser.add_argument(
        "--part", type=Path, action="append", default=[], help="CAD file of a part; may be repeated"
    )
    parser.add_argument(
        "--empty",
        action="store_true",
        help="leave the table empty; the parts are known all the same",
    )
    parser.add_argument(
        "--feed",
        default="",
        metavar="N[,N...]",
        help="how often to bring each part again, in the order of --part, each once one is in a "
        "tray",
    )
    parser.add_argument(
        "--on-table",
        type=int,
        metavar="N",
        help="parts on the table at a time, drawn by the seed (default: all)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of everything random")
    parser.add_argument("--speed", type=float, default=1.0, help="world seconds per second")
    parser.add_argument(
        "--wall-clock",
        action="store_true",
        help="let time run on while clients or pictures are late, as in a real cell (at speed 1)",
    )
    parser.add_argument(
        "--as-built",
        type=int,
        metavar="SEED",
        help="let the cell stand as real ones do, some mm and degrees off its file, by this seed "
        "(default: exactly as the file has it)",
    )
    parser.add_argument(
        "--surfaces",
        choices=("plain", "machined"),
        help="how parts look: even, or with tool marks, dust, oil film and light from wall to wall "
        "(default: machined with --as-built, else plain)",
    )
    parser.add_argument(
        "--code",
        default="",
        metavar="KIND:TEXT",
        help="code on each part, data_matrix or qr, on the plane with most room; the final "
        "digits of the text count up with each part that is brought",
    )
    at_rest = parser.add_mutually_exclusive_group()
    at_rest.add_argument(
        "--pose",
        type=int,
        help="stable pose of every part, by the emulator's own numbers, which are not those of "
        "`cellctl compile` (default: by the seed)",
    )
    at_rest.add_argument(
        "--orientation",
        help="orientation of the first part at rest: nine numbers, row by row, of the rotation "
        "from CAD to upright",
    )
    parser.add_argument(
        "--at", help="pose of the first part on the table, X,Y,THETA_DEG (default: by the seed)"
    )
    parser.add_argument("--lines", choices=("tcp", "rtu-pty", "rtu-tcp"), default="tcp")
    parser.add_argument("--camera-transport", choices=("auto", "fuse", "socket"), default="auto")
    parser.add_argument("--control", type=Path, help="unix socket on which tests inject faults")
    parser.add_argument(
        "--ready-fd", type=int, help="file descriptor for the line (default: stdout)"
    )
    parser.add_argument("--json", action="store_true", help="no effect: the line is JSON always")
    parser.add_argument("--die-with-parent", action="store_true", help="end when stdin closes")
    parser.add_argument("--verbose", action="store_true", help="log to stderr")
    return parser


def options_of(args: argparse.Namespace) -> CellOptions:
    """Return the options on the command line.

    Raises
    ------
    LayoutError : a value makes no sense
    """
    if not (math.isfinite(args.speed) and args.speed > 0.0):
        raise LayoutError(f"--speed {args.speed}: a factor above 0")
    if args.wall_clock and args.speed != 1.0:
        raise LayoutError(f"--speed {args.speed:g}: --wall-clock keeps real time; leave one out")
    if args.as_built is not None and args.as_built < 0:
        raise LayoutError(f"--as-built {args.as_built}: a seed of 0 or more")
    if args.on_table is not None and args.on_table < 1:
        raise LayoutError(f"--on-table {args.on_table}: 1 or more")
    at = None
    if args.at is not None:
        try:
            x_mm, y_mm, theta_deg = (float(word) for word in args.at.split(","))
        except ValueError as error:
            raise LayoutError(f"--at {args.at}: three numbers X,Y,THETA_DEG") from error
        at = (x_mm, y_mm, math.radians(theta_deg))
    orientation = None if args.orientation is None else _rotation(args.orientation)
    return CellOptions(
        cell=args.cell,
        parts=tuple(args.part),
        is_empty=args.empty,
        seed=args.seed,
        speed=args.speed,
        rest=args.pose,
        orientation=orientation,
        at=at,
        lines=args.lines,
        camera_transport=args.camera_transport,
        feed=_counts(args.feed),
        on_table=args.on_table,
        as_built=args.as_built,
        surfaces=args.surfaces,
        is_on_wall_clock=args.wall_clock,
        code=args.code,
    )


def _counts(text: str) -> tuple[int, ...]:
    try:
        counts = tuple(int(word) for word in text.split(",")) if text else ()
    except ValueError as error:
        raise LayoutError(f"--feed {text:.80}: whole numbers, between commas") from error
    if any(count < 0 for count in counts):
        raise LayoutError(f"--feed {text:.80}: no number below 0")
    return counts


def _rotation(text: str) -> NDArray[np.float64]:
    try:
        R = np.array([float(word) for word in text.split(",")]).reshape(3, 3)
    except ValueError as error:
        raise LayoutError(f"--orientation {text:.80}: nine numbers, row by row") from error
    if not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0.0):
        raise LayoutError(f"--orientation {text:.80}: not a rotation")
    return R


async def step_world(cell: Cell) -> None:
    """Let the world keep up with the clock, in slices that leave the wires their time."""
    while True:
        begun = time.monotonic()
        while cell.behind_s >= cell.step_s:
            cell.advance()
            if time.monotonic() - begun > SLICE_WALL_S:
                break
        cell.tick()
        is_late = cell.behind_s >= cell.step_s
        await asyncio.sleep(0.0 if is_late else IDLE_WALL_S)


async def serve(options: CellOptions, control: Path | None, ready: Any, stdin_ends: bool) -> None:  # noqa: ANN401  (a text stream)
    """Run an emulated cell until a signal ends it.

    Parameters
    ----------
    options : options of the emulated cell
    control : path of the control socket for tests; None opens none
    ready : text stream that gets one JSON line once every device can be used
    stdin_ends : also end when standard input is closed
    """
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    with owned_folder(unmount) as folder:
        async with contextlib.AsyncExitStack() as stack:
            cell = Cell(options, folder)
            stack.push_async_callback(cell.aclose)
            # SIGTERM during the seconds of loading must not leave mounts or children behind
            await cell.start()
            if control is not None:
                port = ControlPort(cell.faults, control)
                await port.start()
                stack.push_async_callback(port.aclose)
            tasks = [
                asyncio.create_task(step_world(cell), name="world"),
                asyncio.create_task(cell.run_cameras(), name="cameras"),
                asyncio.create_task(ended.wait(), name="end"),
            ]
            if stdin_ends:
                tasks.append(asyncio.create_task(_stdin_closed(), name="stdin"))
            stack.push_async_callback(_cancel, tasks)
            announcement = cell.announcement()
            stack.enter_context(registered(announcement))
            ready.write(json.dumps(announcement) + "\n")
            ready.flush()
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()


async def _cancel(tasks: Sequence[asyncio.Task[Any]]) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _stdin_closed() -> None:
    reader = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    transport, _ = await loop.connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin
    )
    try:
        while await reader.read(4096):
            pass
    finally:
        transport.close()


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``python -m emulators``; return 0, 1 (it broke) or 2: command line, files, no pybullet.

    The line on stdout: ``{"event": "ready", "speed", "wall_clock", "seed", "devices": {"arm",
    "gripper", "lights", "io", <camera>...}, "camera_transport", "why_not_fuse", "pid",
    "started_wall_s", "clock"}``; the clock is docs/shared-clock.md's.
    """
    args = build_parser().parse_args(argv)
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.INFO if args.verbose else logging.WARNING,
        format="%(name)s: %(message)s",
    )
    try:
        options = options_of(args)
        with contextlib.ExitStack() as stack:
            ready = sys.stdout
            if args.ready_fd is not None:
                ready = stack.enter_context(os.fdopen(args.ready_fd, "w"))
            asyncio.run(serve(options, args.control, ready, args.die_with_parent))
    except (LayoutError, EngineError) as error:
        log.error("%s", error)
        return 2
    return 0
