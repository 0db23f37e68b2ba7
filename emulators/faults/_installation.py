"""Changes of an installation: a camera knocked, gears and pads worn, lamps swapped."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from emulators.umi_scara import COUNTS_PER_DEG, Axis
from emulators.world.poses import rotation_about

from ._plant import Plant

Answer = dict[str, Any]


class Wear:
    """Verbs of wear, loosening and wrong connections, on a plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.verbs: Mapping[str, Callable[..., Answer | None]] = {
            "knock": self._knock,
            "gear_play": self._gear_play,
            "pads": self._pads,
            "swap_lamps": self._swap_lamps,
            "io_watchdog": self._io_watchdog,
        }

    def _knock(
        self,
        camera: str,
        mm: Sequence[float] = (0.0, 0.0, 0.0),
        turn_deg: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Move a camera in its own frame, and turn it about its own centre."""
        by_mm, vector = np.asarray(mm, float), np.radians(np.asarray(turn_deg, float))
        if by_mm.shape != (3,) or vector.shape != (3,):
            raise ValueError("mm and turn_deg take three numbers each")
        T = np.eye(4)
        angle = float(np.linalg.norm(vector))
        T[:3, :3] = rotation_about(vector, angle) if angle else np.eye(3)
        T[:3, 3] = by_mm
        self._plant.knock_camera(camera, T)

    def _gear_play(self, axis: str, deg: float) -> None:
        """Set the play of a motor's gear from now on."""
        if deg < 0.0:
            raise ValueError(f"a play of {deg} deg")
        arm, motor = self._plant.rtx.body, Axis(axis)
        if motor not in COUNTS_PER_DEG:
            raise ValueError(
                f"{axis} does not turn: {', '.join(one.value for one in COUNTS_PER_DEG)}"
            )
        counts = deg * COUNTS_PER_DEG[motor]
        arm.become(replace(arm.errors, play_counts={**arm.errors.play_counts, motor: counts}))

    def _pads(self, thinner_mm: float) -> None:
        """Make both pads of the arm's gripper thinner by an amount each, from now on."""
        arm = self._plant.rtx.body
        if not math.isfinite(thinner_mm):
            raise ValueError(f"pads thinner by {thinner_mm} mm")
        zero_mm = arm.errors.jaw_zero_mm + 2.0 * thinner_mm
        arm.become(replace(arm.errors, jaw_zero_mm=zero_mm))

    def _swap_lamps(self, one: str, other: str) -> None:
        """Swap the outputs and relays of two lamps."""
        first, second = self._plant.lamps[one], self._plant.lamps[other]
        first.wiring, second.wiring = (
            replace(second.wiring, name=one),
            replace(first.wiring, name=other),
        )

    def _io_watchdog(self, *, off: bool = False, bridged: bool = False) -> None:
        """Let the I/O block's watchdog be off, or its relay's contact be bridged, or neither."""
        self._plant.io.is_watchdog_off = off
        self._plant.io.is_motor_relay_bridged = bridged
