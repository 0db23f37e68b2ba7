"""Test-pattern cameras for any V4L2 client: `python -m emulators.camera_v4l2 DIRECTORY`.

Prints one JSON line that says where they are, then obeys JSON lines on stdin, each answered by one:
`{"unplug": "video0"}`, `{"plug": "video0", "as": "video2"}`,
`{"faults": "video0", "error_count": 1}`, `{"where": null}`. Ends with stdin.
"""

import argparse
from pathlib import Path
from typing import Any

from emulators.clock import WorldClock
from emulators.clock_pattern import ClockPattern
from emulators.steered import obey_lines, run_until_told

from .device import Faults, V4l2Device
from .kernel import CameraConfig
from .server import CameraServer


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="emulators.camera_v4l2", description=__doc__)
    parser.add_argument("directory", type=Path, help="where the cameras appear")
    parser.add_argument("--transport", choices=("auto", "fuse", "socket"), default="auto")
    parser.add_argument("--cameras", type=int, default=1, help="how many")
    parser.add_argument("--rate", type=int, default=30, help="frames in a world second")
    parser.add_argument("--speed", type=float, default=1.0, help="world seconds in a second")
    parser.add_argument("--delay", type=float, default=0.0, help="seconds a picture takes to make")
    parser.add_argument("--soe", action="store_true", help="stamp frames when exposure starts")
    return parser


def _camera(args: argparse.Namespace, clock: WorldClock) -> V4l2Device:
    config = CameraConfig(
        rates_hz=tuple(sorted({args.rate, 60, 30, 10, 5}, reverse=True)),
        default_rate_hz=args.rate,
        stamps_exposure_start=args.soe,
    )
    pattern = ClockPattern(config.sizes_px[0], delay_wall_s=args.delay)
    device = V4l2Device(pattern, clock, config)
    pattern.connect(device.deliver)
    return device


def _obey(order: dict[str, Any], server: CameraServer, devices: dict[str, V4l2Device]) -> None:
    if "unplug" in order:
        server.unplug(order["unplug"])
    elif "plug" in order:
        server.plug(order["plug"], order.get("as"))
    elif "faults" in order:
        name = order.pop("faults")
        devices[name].faults = Faults(**order)


async def _main(args: argparse.Namespace) -> None:
    clock = WorldClock(speed=args.speed)
    devices = {f"video{number}": _camera(args, clock) for number in range(args.cameras)}

    def state() -> dict[str, Any]:
        return {
            "addresses": dict(server.addresses),
            "transport": server.transport,
            "why_not_fuse": server.why_not_fuse,
            "started_wall_s": clock.started_wall_s,
            "lost": {name: device.lost_count for name, device in devices.items()},
        }

    async with CameraServer(devices, args.directory, args.transport) as server:
        await obey_lines(server, state, lambda order: _obey(order, server, devices))


if __name__ == "__main__":
    run_until_told(_main(_parser().parse_args()))
