"""Verification: the commissioned cell predicts where a plate is, and both cameras are asked.

The plate is held anew and shown where no picture was fitted to. All pictures share one hold; what
differs from it is what arm, cameras and lenses still have wrong between them.
"""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray
from controller.commissioning.kinematics import (
    BoardPicture,
    KinematicsError,
    board_pose,
    plate_faces,
)
from controller.commissioning.showing import Region
from controller.commissioning.target import BoardSection, load_board
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration, Figure, VerificationRecord
from controller.imaging import Camera, inverse_pose, rotation_angle
from controller.planning.motion import tcp_pose

from ...services import CameraName
from ..bench import Bench
from ..boards import PlateInJaws, as_handed, board_file
from ..errors import StepFailedError

LOOKS: Final = 13  # of each camera
LOOKS_MIN: Final = 8
# the plate where parts are: as low over the table as it goes, and about the station
REGIONS: Final[Mapping[CameraName, Region]] = {
    "overhead": Region(900.0, 1150.0),
    "inspection": Region(550.0, 850.0),
}
WHAT: Final[Mapping[CameraName, str]] = {"overhead": "pick", "inspection": "view"}
LIMIT_MM: Final = 0.5
LIMIT_DEG: Final = 0.3
MARGIN_MM: Final = 15.0
SEED: Final = 2


class VerifyStep:
    """Whether the cell, as calibrated, predicts what its cameras see."""

    name = "verify"
    title = "the calibrated cell predicts where a plate is, and both cameras check it"
    needs: tuple[str, ...] = ("arm", "grippers", "trays")
    uses: tuple[CalibrationName, ...] = (
        "overhead",
        "inspection",
        "arm",
        "fixed_gripper",
        "trays",
        "lamps",
    )
    makes: tuple[CalibrationName, ...] = ("verification",)
    valid_days: int | None = 30

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Show a plate to both cameras; return how well each was predicted.

        Raises
        ------
        StepFailedError : the plate is not found, or too seldom
        DeclinedError : a person ended it
        DeviceError : a device does not answer or does not get there
        """
        file = board_file(bench, "paddle")
        plate = load_board(file)
        await bench.permit_motion("The arm homes, and then shows a plate to both cameras.")
        await bench.home_and_park()
        held = PlateInJaws(bench, as_handed(bench, plate), file)
        await held.take(seed=SEED)
        try:
            pictures = await _look_round(held)
        except StepFailedError:
            await held.give_back()
            raise
        await held.give_back()
        figures: dict[str, Figure] = {}
        for camera, off in plate_offs(bench, plate, pictures).items():
            for kind, unit, limit, values in (
                ("position", "mm", LIMIT_MM, off[:, 0]),
                ("direction", "deg", LIMIT_DEG, off[:, 1]),
            ):
                value = float(np.percentile(values, 95))
                name = f"{WHAT[camera]} {kind}"
                bench.evidence.measure(
                    f"{name}, of 95 % of {len(values)} looks", value, unit, high=limit
                )
                figures[name] = Figure(
                    value=round(value, 4),
                    limit=limit,
                    unit="mm" if unit == "mm" else "deg",
                    count=len(values),
                )
        return {"verification": VerificationRecord(**bench.header(), figures=figures)}


async def _look_round(held: PlateInJaws) -> list[BoardPicture]:
    rng = np.random.default_rng(SEED)
    pictures = []
    for camera, region in REGIONS.items():
        rows = [
            held.configurations(camera, region, LOOKS, rng, is_front=is_front, margin_mm=MARGIN_MM)
            for is_front in (True, False)
        ]
        # both faces in turn
        mixed = [row for pair in zip(*rows, strict=False) for row in pair]
        found: list[BoardPicture] = []
        for number, q in enumerate(mixed, 1):
            if len(found) == LOOKS:
                break
            picture = await held.shown(camera, q, f"{camera}_{number:02d}", from_below=None)
            if picture is not None:
                found.append(picture)
        if len(found) < LOOKS_MIN:
            raise StepFailedError(
                f"the plate was found in {len(found)} pictures of the {camera} camera, "
                f"{LOOKS_MIN} are required; see which were left out, and why"
            )
        pictures += found
    return pictures


def plate_offs(
    bench: Bench, board: BoardSection, pictures: Sequence[BoardPicture]
) -> dict[CameraName, FloatArray]:
    """Return by camera how far the plate was from its prediction (n, 2) [mm, deg].

    Parameters
    ----------
    bench : whose layout predicts it
    board : of the plate
    pictures : of one hold of it, by both cameras

    Raises
    ------
    StepFailedError : a picture fits no pose of the board
    """
    faces = dict(zip(("front", "back"), plate_faces(board), strict=True))
    holds = []
    for one in pictures:
        camera: Camera = getattr(bench.layout, one.camera)
        try:
            T_cam_board = board_pose(camera, one.board)
        except KinematicsError as error:
            raise StepFailedError(f"{one.name}: {error}") from error
        T_world_body = camera.T_world_cam @ T_cam_board @ inverse_pose(faces[one.face].T_body_board)
        if one.q is None:
            raise StepFailedError(f"{one.name}: the joints were not read")
        holds.append(inverse_pose(tcp_pose(bench.layout, one.q)) @ T_world_body)
    T = np.array(holds)
    R_mean = Rotation.from_matrix(T[:, :3, :3]).mean().as_matrix()
    # the middle of the print, where all of it is looked at
    middle = np.array([board.plate_mm[1] / 2, 0.0, 0.0])
    places = T[:, :3, :3] @ middle + T[:, :3, 3]
    off_mm = np.linalg.norm(places - places.mean(axis=0), axis=1)
    off_deg = np.array([degrees(rotation_angle(R_mean.T @ R)) for R in T[:, :3, :3]])
    names = np.array([one.camera for one in pictures])
    off = np.stack([off_mm, off_deg], axis=1)
    return {camera: off[names == camera] for camera in REGIONS}
