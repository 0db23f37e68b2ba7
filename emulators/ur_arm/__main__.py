"""One UR arm on its ports, without a world: `python -m emulators.ur_arm`.

Prints one JSON line when all ports can be used: ``{"event": "ready", "model", "software", "host",
"dashboard", "primary", "secondary", "realtime", "rtde", "urcap"}``. Ends by a signal. Its joints
move by themselves; there is nothing to run into and nothing to grip. Its verbs are
docs/emulated-ur-arm.md's, on the socket of ``--control``.
"""

import argparse
import asyncio
import contextlib
import json
import logging
import math
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from emulators.clock import WorldClock
from emulators.control_port import ControlPort
from emulators.gripper_modbus import RobotiqDevice
from emulators.modbus import Stepper

from ._facts import MODELS, Software, software_of
from ._model import UrArm
from ._server import STANDARD_PORTS, Ports, UrServer
from ._verbs import UrVerbs

log = logging.getLogger(__name__)


def build_parser() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(
        prog="emulators.ur_arm",
        description="Start one emulated UR arm; print its ports as one JSON line.",
        epilog="example: python -m emulators.ur_arm --host 127.0.0.2 --standard-ports --running",
    )
    parser.add_argument("--model", choices=sorted(MODELS), default="ur5e", help="which arm")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument(
        "--standard-ports",
        action="store_true",
        help="the ports that clients expect, 29999, 30001 to 30004 and 63352; give each arm a "
        "--host of its own, such as 127.0.0.2 (default: free ports)",
    )
    parser.add_argument(
        "--software",
        default=Software().text,
        help="version of the controller, which decides on the layout of some packets",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of where the arm stands")
    parser.add_argument("--speed", type=float, default=1.0, help="world seconds per second")
    parser.add_argument(
        "--running", action="store_true", help="power on, brakes released from the start"
    )
    parser.add_argument("--no-gripper", action="store_true", help="nothing on the flange")
    parser.add_argument("--control", type=Path, help="socket for verbs")
    parser.add_argument("--verbose", action="store_true", help="log to stderr")
    return parser


async def serve(args: argparse.Namespace) -> None:
    """Serve one arm until a signal ends it."""
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    gripper = None if args.no_gripper else RobotiqDevice()
    arm = UrArm(MODELS[args.model], args.seed, gripper)
    if args.running:
        arm.start_running()
    ports = STANDARD_PORTS if args.standard_ports else Ports()
    server = UrServer(arm, args.host, ports, software_of(args.software))
    stepper = Stepper(WorldClock(args.speed), [arm])
    async with contextlib.AsyncExitStack() as stack:
        stack.push_async_callback(server.aclose)
        await server.start()
        if args.control is not None:
            control = ControlPort(UrVerbs(arm, server), args.control)
            stack.push_async_callback(control.aclose)
            await control.start()
        stack.push_async_callback(stepper.aclose)
        await stepper.start()
        ready = {
            "event": "ready",
            "model": args.model,
            "software": server.software.text,
            **server.announcement(),
        }
        sys.stdout.write(json.dumps(ready) + "\n")
        sys.stdout.flush()
        await ended.wait()


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``python -m emulators.ur_arm``; return 0, or 2 for a wrong command line or a port."""
    args = build_parser().parse_args(argv)
    logging.basicConfig(
        stream=sys.stderr,
        level=logging.INFO if args.verbose else logging.WARNING,
        format="%(name)s: %(message)s",
    )
    try:
        software_of(args.software)
        if not (math.isfinite(args.speed) and args.speed > 0.0):
            raise ValueError(f"--speed {args.speed}: a factor above 0")
        asyncio.run(serve(args))
    except (ValueError, OSError) as error:
        log.error("%s", error)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
