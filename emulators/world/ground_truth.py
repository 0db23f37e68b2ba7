"""The truth about the world, for tests and the control port only: no device may use it."""

from typing import Any

import numpy as np

from ._world import World
from .matter.parts import AWAY, HELD, PROPPED, RESTING
from .shapes import Array


def part_pose(world: World, index: int) -> Array | None:
    """Return T_world_part [mm] of a part; None if it is not in the cell."""
    part = world.parts[index]
    return None if part.state == AWAY else part.T_world_part.copy()


def custody(world: World, index: int) -> str:
    """Return a part's holder: `away`, `free`, `arm`, `fixture` (the fixed gripper) or `both`."""
    if world.parts[index].state == AWAY:
        return "away"
    holders = [
        gripper.name
        for gripper in (world.arm_gripper, world.fixed_gripper)
        if gripper.hold is not None and gripper.hold.part == index
    ]
    return "both" if len(holders) == 2 else (holders[0] if holders else "free")


def tray_of(world: World, index: int) -> str | None:
    """Return the tray a part lies in, by its centre of mass; None if in none."""
    part = world.parts[index]
    if part.state in (AWAY, HELD):
        return None
    for tray in world.layout.trays:
        if np.all(np.abs(part.centre_mm[:2] - tray.centre_mm) <= tray.size_mm / 2.0):
            return tray.name
    return None


def truth(world: World) -> dict[str, Any]:
    """Return all of that, and the events so far, as plain values."""
    parts = []
    for part in world.parts:
        T = part_pose(world, part.index)
        parts.append(
            {
                "name": part.solid.name,
                "custody": custody(world, part.index),
                "tray": tray_of(world, part.index),
                "at_rest": part.state in (RESTING, PROPPED),
                "T_world_part": None if T is None else T.tolist(),
            }
        )
    return {
        "time_s": world.time_s,
        "at_rest": world.is_at_rest,
        "parts": parts,
        "openings_mm": {
            "arm": world.arm_gripper.opening_mm,
            "fixture": world.fixed_gripper.opening_mm,
        },
        "last_motion_s": dict(world.last_motion_s),
        "collisions": [
            {"at_s": c.at_s, "moving": c.moving, "other": c.other, "depth_mm": c.depth_mm}
            for c in world.collisions
        ],
        "events": [
            {
                "at_s": e.at_s,
                "what": e.what,
                "part": e.part,
                "by": e.by,
                "lowest_mm": e.lowest_mm,
                "is_held": e.is_held,
            }
            for e in world.events
        ],
    }
