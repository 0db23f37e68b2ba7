"""The arm gripper's fingers before the station panel: the TCP between them, measured."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.grippers import FingerShape, TcpFit, locate_tcp, look_at_fingers
from controller.calibration.kinematics import CellFit
from controller.cell.devices.lamps import STATION_PANEL
from controller.planning.motion import inverse_rows
from controller.setup.measured_arm import measured_arm
from messages import say

from ..bench import Bench
from ..boards import go_to, look
from ..errors import StepFailedError

OPEN_MM: Final = 40.0
LOOKS: Final = 16
MARGIN_MM: Final = 25.0
OUT_OF_PLANE: Final = 0.45  # largest part of an approach out of the plane across the sight
SEED: Final = 3


async def look_at_the_fingers(bench: Bench, fit: CellFit) -> TcpFit:
    """Return the TCP between the fingers, from their outline before the panel.

    Parameters
    ----------
    bench : bench of the step, whose jaws are empty
    fit : fit of cameras and arm

    Raises
    ------
    FingersError : too little of the fingers is seen
    DeviceError : a device does not answer or does not get there
    """
    fingers = bench.cell.arm.fingers
    shape = FingerShape(fingers.length_mm, fingers.width_mm, fingers.thickness_mm)
    await bench.move_jaws(
        say("the arm gripper opens to {open_mm:.0f} mm", open_mm=OPEN_MM),
        lambda: bench.arm.move_gripper_mm(OPEN_MM),
    )
    opening_mm = await bench.arm.read_opening_mm()
    looks, scene = [], bench.scene()
    for number, q in enumerate(_showing_fingers(bench), 1):
        name = f"fingers_{number:02d}"
        try:
            await go_to(bench, scene, q, f"showing the fingers, {name}")
        except StepFailedError as error:
            bench.evidence.find(f"{name} left out: {error}")
            continue
        await bench.motion.ring_down()
        there = await bench.arm.read_q()
        picture = await look(
            bench, "inspection", name, "the fingers before the panel", lamp=STATION_PANEL
        )
        looks.append(look_at_fingers(picture, fit, "inspection", there, opening_mm, shape))
    await bench.go(bench.layout.park_q, "going to the park")
    return locate_tcp(fit, "inspection", looks)


def _showing_fingers(bench: Bench) -> FloatArray:
    """Return configurations (n, 6) that show the fingers from all sides, free of contact."""
    rng = np.random.default_rng(SEED)
    camera = bench.layout.inspection
    sight = camera.T_world_cam[:3, 2]
    rows: list[FloatArray] = []
    scene, take_up = bench.scene(), measured_arm(bench.layout).take_up
    for number in range(400):
        if len(rows) == LOOKS:
            break
        approach = rng.standard_normal(3)
        approach -= sight * (approach @ sight)
        approach = approach / np.linalg.norm(approach) + sight * rng.uniform(
            -OUT_OF_PLANE, OUT_OF_PLANE
        )
        approach /= np.linalg.norm(approach)
        side = np.cross(approach, rng.standard_normal(3))
        side /= np.linalg.norm(side)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([approach, side, np.cross(approach, side)])
        T[:3, 3] = bench.layout.station_mm + rng.uniform(-12.0, 12.0, 3) + 20.0 * approach
        _, _, q = inverse_rows(bench.layout, T[None])
        # where it is approached from as well
        both = [bench.layout.arm.within_limits(q - back) for back in (0.0, take_up)]
        q = q[np.all(both, axis=0)] if len(q) else q
        q = q[scene.free(q, MARGIN_MM) & scene.free(q - take_up, MARGIN_MM)] if len(q) else q
        if len(q):
            rows.append(q[number % len(q)])
    return np.array(rows)
