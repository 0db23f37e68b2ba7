"""Test-pattern GigE Vision cameras for any client: `python -m emulators.camera_genicam`.

Prints one JSON line with their addresses, then obeys JSON lines on stdin, each answered by one:
`{"unplug": "overhead"}`, `{"plug": "overhead"}`, `{"faults": "overhead", "lost_count": 1}`,
`{"where": null}`. Ends with stdin.
"""

import argparse
from dataclasses import replace
from typing import Any

from emulators.clock import WorldClock
from emulators.clock_pattern import ClockPattern
from emulators.steered import obey_lines, run_until_told

from .device import CameraConfig, GenicamDevice
from .features import Sensor
from .server import GenicamServer


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="emulators.camera_genicam", description=__doc__)
    parser.add_argument("names", nargs="*", default=["overhead"], help="names of the cameras")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=1024)
    parser.add_argument("--rate", type=float, default=30.0, help="frames in a world second")
    parser.add_argument("--speed", type=float, default=1.0, help="world seconds in a second")
    parser.add_argument("--delay", type=float, default=0.0, help="seconds a picture takes to make")
    return parser


def _camera(args: argparse.Namespace, clock: WorldClock, number: int, name: str) -> GenicamDevice:
    sensor = Sensor(args.width, args.height, args.rate)
    pattern = ClockPattern((args.width, args.height), delay_wall_s=args.delay)
    config = CameraConfig(sensor=sensor, user_name=name)
    device = GenicamDevice(pattern, clock, config, seed=number)
    pattern.connect(device.deliver)
    return device


def _obey(order: dict[str, Any], server: GenicamServer, devices: dict[str, GenicamDevice]) -> None:
    if "unplug" in order:
        server.unplug(order["unplug"])
    elif "plug" in order:
        server.plug(order["plug"])
    elif "faults" in order:
        device = devices[order.pop("faults")]
        device.faults = replace(device.faults, **order)


async def _main(args: argparse.Namespace) -> None:
    clock = WorldClock(speed=args.speed)
    devices = {name: _camera(args, clock, n, name) for n, name in enumerate(args.names, start=1)}

    def state() -> dict[str, Any]:
        return {
            "addresses": dict(server.addresses),
            "lost": {name: device.lost_count for name, device in devices.items()},
        }

    async with GenicamServer(devices, clock) as server:
        await obey_lines(server, state, lambda order: _obey(order, server, devices))


if __name__ == "__main__":
    run_until_told(_main(_parser().parse_args()))
