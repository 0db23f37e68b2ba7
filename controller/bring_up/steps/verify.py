"""Verification: the calibrated cell predicts the plate's pose, and both cameras check it.

The plate is held anew and shown at configurations without any fitted picture. All pictures share
one hold; the differences from it are the remaining errors of arm, cameras and lenses.
"""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray
from controller.calibration.kinematics import (
    BoardPicture,
    KinematicsError,
    board_pose,
    plate_faces,
)
from controller.calibration.showing import ShowingRegion
from controller.calibration.target import BoardSection
from controller.cell.custody import Custody
from controller.cell.services import CameraName
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import Calibration, VerificationRecord, VerifiedFigure
from controller.imaging import Camera, inverse_pose, rotation_angle
from controller.planning.motion import tcp_pose
from messages import say

from ..bench import Bench
from ..boards import PlateInJaws, as_handed, board_file, load_plate
from ..errors import StepFailedError
from ..proof import hand_off_and_back, length_study

LOOKS: Final = 13  # per camera
LOOKS_MIN: Final = 8
# regions of the plate for parts: as low over the table as it goes, and about the station
REGIONS: Final[Mapping[CameraName, ShowingRegion]] = {
    "overhead": ShowingRegion(900.0, 1150.0),
    "inspection": ShowingRegion(550.0, 850.0),
}
WHAT: Final[Mapping[CameraName, str]] = {"overhead": "pick", "inspection": "view"}
LIMIT_MM: Final = 0.5
LIMIT_DEG: Final = 0.3
# a hand-off there and back, with the fixed gripper as measured, and as a tape measure leaves it
HAND_OFF_LIMITS: Final = (1.0, 0.5)  # mm, deg
HAND_OFF_LIMITS_DRAWN: Final = (6.0, 1.5)
LENGTH_MM: Final = 0.15  # largest error of a known length in any picture
GRR_MM: Final = 0.05
VIEWS_TRIED: Final = 5
MARGIN_MM: Final = 15.0
SEED: Final = 2


class VerifyStep:
    """Checks the predictions of the calibrated cell: camera pictures and a hand-off."""

    name = "verify"
    title = "predicted poses of a plate in the calibrated cell, checked by both cameras"
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
        """Show a plate to both cameras, hand it off and back; return the results.

        Raises
        ------
        StepFailedError : the plate is not found, or too seldom
        DeclinedError : a person ended it
        DeviceError : a device does not answer or does not get there
        """
        file = board_file(bench, "paddle")
        plate = load_plate(file)
        await bench.permit_motion("The arm homes, and then shows a plate to both cameras.")
        await bench.home_and_park()
        held = PlateInJaws(bench, as_handed(bench, plate), file)
        await held.take(seed=SEED)
        try:
            pictures = await _look_round(held)
            seen = [one.q for one in pictures if one.camera == "inspection" and one.q is not None]
            handed = await hand_off_and_back(
                bench, held, seen[:VIEWS_TRIED], lambda one: holds_of(bench, plate, [one])[0]
            )
        except StepFailedError:
            if bench.handed.custody is Custody.NONE:
                await held.give_back()
            raise
        await held.give_back()
        figures: dict[str, VerifiedFigure] = {}

        def judge(name: str, values: FloatArray, unit: Literal["mm", "deg"], limit: float) -> None:
            value = float(np.percentile(values, 95))
            what = name if len(values) == 1 else f"{name}, of 95 % of {len(values)} looks"
            bench.evidence.measure(what, value, unit, high=limit)
            count = len(values)
            figures[name] = VerifiedFigure(
                value=round(value, 4), limit=limit, unit=unit, count=count
            )

        for camera, off in plate_offs(bench, plate, pictures).items():
            judge(say("{what} position", what=WHAT[camera]), off[:, 0], "mm", LIMIT_MM)
            judge(f"{WHAT[camera]} direction", off[:, 1], "deg", LIMIT_DEG)
        is_measured = "fixed_gripper" in bench.cell.calibration
        limit_mm, limit_deg = HAND_OFF_LIMITS if is_measured else HAND_OFF_LIMITS_DRAWN
        judge("hand-off position", np.array([handed.mm]), "mm", limit_mm)
        judge("hand-off direction", np.array([handed.deg]), "deg", limit_deg)
        if not is_measured:
            bench.evidence.find(
                "the fixed gripper stands as drawn: nothing measured it, and hand-offs are "
                "held to the accuracy of a tape measure"
            )
        T_tcp_body = mean_hold(holds_of(bench, plate, pictures))
        study = length_study(bench.layout, plate, pictures, T_tcp_body)
        judge("reference length", np.abs(study.off_mm).max(axis=1), "mm", LENGTH_MM)
        judge("reference length, GRR", np.array([study.grr_mm]), "mm", GRR_MM)
        x_mm, y_mm = study.reference_mm
        bench.evidence.find(
            f"reference: sides of {x_mm:g} and {y_mm:g} mm of the plate's print by its file, "
            f"{len(study.off_mm)} looks; mean {study.bias_mm:+.4f} mm off, repeatability "
            f"{study.repeatability_mm:.4f} mm, between cameras {study.setup_mm:.4f} mm (one "
            "standard deviation each)"
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
                say(
                    "the plate was found in {found_count} pictures of the {camera} "
                    "camera, {looks_min} are required; see which were left out, and why",
                    found_count=len(found),
                    camera=camera,
                    looks_min=LOOKS_MIN,
                )
            )
        pictures += found
    return pictures


def holds_of(bench: Bench, board: BoardSection, pictures: Sequence[BoardPicture]) -> FloatArray:
    """Return the hold of the plate by each picture, T_tcp_body (n, 4, 4).

    Parameters
    ----------
    bench : bench whose layout has cameras and arm
    board : board of the plate
    pictures : pictures of it in the arm gripper

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
            raise StepFailedError(say("{name}: the joints were not read", name=one.name))
        holds.append(inverse_pose(tcp_pose(bench.layout, one.q)) @ T_world_body)
    return np.array(holds)


def mean_hold(T: FloatArray) -> FloatArray:
    """Return the mean (4, 4) of poses (n, 4, 4) that differ by little."""
    mean = np.eye(4)
    mean[:3, :3] = Rotation.from_matrix(T[:, :3, :3]).mean().as_matrix()
    mean[:3, 3] = T[:, :3, 3].mean(axis=0)
    return mean


def plate_offs(
    bench: Bench, board: BoardSection, pictures: Sequence[BoardPicture]
) -> dict[CameraName, FloatArray]:
    """Return by camera the plate's distance from its prediction (n, 2) [mm, deg].

    Parameters
    ----------
    bench : bench whose layout predicts it
    board : board of the plate
    pictures : pictures of one hold of it, by both cameras

    Raises
    ------
    StepFailedError : a picture fits no pose of the board
    """
    T = holds_of(bench, board, pictures)
    R_mean = mean_hold(T)[:3, :3]
    # the middle of the print, where all of it is looked at
    middle = np.array([board.plate_mm[1] / 2, 0.0, 0.0])
    places = T[:, :3, :3] @ middle + T[:, :3, 3]
    off_mm = np.linalg.norm(places - places.mean(axis=0), axis=1)
    off_deg = np.array([degrees(rotation_angle(R_mean.T @ R)) for R in T[:, :3, :3]])
    names = np.array([one.camera for one in pictures])
    off = np.stack([off_mm, off_deg], axis=1)
    return {camera: off[names == camera] for camera in REGIONS}
