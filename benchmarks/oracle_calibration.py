"""Write the calibrations of an emulated cell as built from its truth: a faultless commissioning.

What a controller makes of a calibration, and what a commissioning finds, are judged apart by it.
The truth is the emulator's, drawn from the seed; no wire has it. Not for the product: only
benchmarks and tests call it.

    python benchmarks/oracle_calibration.py --as-built 5 --out /tmp/cell5
    cellctl run featuretype --cell /tmp/cell5/cell.yaml --as-built 5
"""

import argparse
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from controller.config import EMULATED_CELL
from controller.config.calibrations import (
    ArmCalibration,
    CameraCalibration,
    FixedGripperCalibration,
    JointZeros,
    LampCalibration,
    LampsCalibration,
    TraysCalibration,
    write_calibration,
)
from emulators.as_built import draw_as_built
from emulators.umi_scara import COUNTS_PER_DEG, Axis
from emulators.world.layout import CameraLayout, Layout, read_layout


def calibrations_of(cell: Path, seed: int) -> dict[str, Any]:
    """Return the calibrations by name that a measurement without error would find."""
    layout = read_layout(cell)
    truth = draw_as_built(layout, seed).truth()
    header: dict[str, Any] = {"measured": datetime.now(UTC), "by": "the emulator's own truth"}
    found: dict[str, Any] = {
        name: _camera(one, header, layout.cameras[name], _exposure_share(truth, name))
        for name, one in truth["cameras"].items()
    }
    found["arm"] = _arm(truth["arm"], header)
    found["fixed_gripper"] = FixedGripperCalibration(
        **header, T_world_tcp=_rows(truth["fixed_gripper"]["T_world_tcp"]), u_mm=0.05, u_deg=0.05
    )
    found["lamps"] = _lamps(truth, layout, header)
    found["trays"] = TraysCalibration(
        **header, centres={k: tuple(v) for k, v in truth["trays"].items()}, u_mm=0.05
    )
    return found


def _lamps(truth: Mapping[str, Any], layout: Layout, header: Mapping[str, Any]) -> LampsCalibration:
    """Return lamps dimmed to the drawing's light, as far as they are brighter."""
    lamps = {}
    for name, one in truth["lamps"].items():
        camera = "overhead" if name.startswith("table") else "inspection"
        level = one["full_level"] * truth["cameras"][camera]["sensitivity"]
        nominal = layout.lamps[name]
        lamps[name] = LampCalibration(
            analog=nominal.analog,
            relay=nominal.relay,
            level=level,
            drive=min(1.0, 1.0 / level / _exposure_share(truth, camera)),
            settle_s=one["ramp_s"] + 0.02,
        )
    return LampsCalibration(**header, lamps=lamps)


def _exposure_share(truth: Mapping[str, Any], camera: str) -> float:
    """Return by how much longer a camera exposes, so that its weakest lamp is as drawn."""
    levels = [
        one["full_level"] * truth["cameras"][camera]["sensitivity"]
        for name, one in truth["lamps"].items()
        if (camera == "overhead") == name.startswith("table")
    ]
    return max(1.0, 1.0 / min(levels))


def _rows(matrix: Any) -> Any:  # noqa: ANN401  (nested lists of numbers)
    return tuple(tuple(row) for row in matrix)


def _camera(
    one: Mapping[str, Any], header: Mapping[str, Any], nominal: CameraLayout, share: float
) -> CameraCalibration:
    focal, (cx, cy) = one["focal_px"], one["centre_px"]
    return CameraCalibration(
        **header,
        size_px=(nominal.width_px, nominal.height_px),
        K=((focal, 0.0, cx), (0.0, focal, cy), (0.0, 0.0, 1.0)),
        distortion=tuple(one["distortion"]),
        T_world_cam=_rows(one["T_world_cam"]),
        u_pose_mm=0.05,
        u_pose_deg=0.01,
        blur_px=one["blur_px"],
        exposure_s=nominal.exposure_s * share,
    )


def _arm(arm: Mapping[str, Any], header: Mapping[str, Any]) -> ArmCalibration:
    counts = {Axis(name): play for name, play in arm["play_counts"].items()}
    # zeros are those of joints that every motor approaches from below: half the play short
    lag = {axis.value: play / COUNTS_PER_DEG[axis] / 2 for axis, play in counts.items()}
    short = {
        "shoulder": lag["shoulder"],
        "elbow": lag["elbow"],
        "yaw": lag["yaw"],
        "pitch": (lag["wrist1"] + lag["wrist2"]) / 2,
        "roll": (lag["wrist1"] - lag["wrist2"]) / 2,
    }
    zeros = {n: math.degrees(arm["zero_rad"][f"{n}_rad"]) - off for n, off in short.items()}
    return ArmCalibration(
        **header,
        T_world_arm=_rows(arm["T_world_base"]),
        upper_mm=arm["upper_mm"],
        fore_mm=arm["fore_mm"],
        tool_mm=arm["tool_mm"],
        tool_off_mm=tuple(arm["tool_off_mm"]),
        zero_deg=JointZeros(**zeros),
        zed_zero_mm=arm["zed_zero_mm"],
        yaw_per_elbow=arm["yaw_per_elbow"],
        sag_mm=arm["sag_mm"],
        jaw_zero_mm=arm["jaw_zero_mm"],
        play_deg={name: 2 * deg for name, deg in lag.items()},
        u_mm=0.2,
        u_deg=0.05,
    )


def write_cell(cell: Path, seed: int, folder: Path, leave_out: tuple[str, ...] = ()) -> Path:
    """Write a cell file with its calibrations to a folder; return its path."""
    lines = ["", "calibration:"]
    for name, one in calibrations_of(cell, seed).items():
        if name in leave_out:
            continue
        sha256 = write_calibration(folder / "calibrations" / f"{name}.json", one)
        lines.append(f"  {name}: {{file: calibrations/{name}.json, sha256: {sha256}}}")
    path = folder / "cell.yaml"
    path.write_text(cell.read_text(encoding="utf-8").rstrip() + "\n" + "\n".join(lines) + "\n")
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--as-built", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cell", type=Path, default=EMULATED_CELL)
    parser.add_argument("--leave-out", action="append", default=[])
    args = parser.parse_args()
    print(write_cell(args.cell, args.as_built, args.out, tuple(args.leave_out)))


if __name__ == "__main__":
    main()
