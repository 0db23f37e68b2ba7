"""The emulated cell's file with a Universal Robots arm in it."""

from __future__ import annotations

from pathlib import Path

EMULATED_CELL = Path(__file__).parents[1] / "recipes" / "cells" / "emulated.yaml"
SHAPE = "{model: ur5e, flange_to_tcp_mm: 177, park_deg: [0, -110, 130, -110, -90, 0]}"


def write_ur_cell(
    path: Path, address: str, settings: str = "{}", shape: str = SHAPE, driver: str = "ur"
) -> Path:
    """Write the file: the arm behind the table, turned round, since it works towards its -x."""
    lines = EMULATED_CELL.read_text().splitlines()
    first = lines.index("arm:")
    last = next(i for i in range(first + 1, len(lines)) if lines[i][:1].strip())
    kept = "\n".join(lines[first + 1 : last])
    arm = (
        "arm:\n"
        "  pose: {position: [-350, 0, 0], x_axis: [-1, 0, 0], y_axis: [0, -1, 0]}\n"
        "  jaw_max_mm: 85.0\n"
        "  column: [-426, -274, -76, 76, 0, 95]\n"
        f"  shape: {shape}\n{kept[kept.index('  arm_gripper:') :]}"
    )
    own = next(line for line in lines if line.startswith("  arm:"))
    here = f"  arm: {{driver: {driver}, address: '{address}', settings: {settings}}}"
    path.write_text("\n".join([*lines[:first], arm, *lines[last:], ""]).replace(own, here))
    return path
