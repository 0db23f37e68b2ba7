"""Arm and cameras: a plate in the gripper, seen by both cameras at many configurations.

One fit finds the poses of both cameras and the arm, both lenses, and the arm's differences from its
counters (docs/adr/0044). The board's mark on the table defines the world.
"""

import asyncio
import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from math import cos, degrees, pi, sin
from pathlib import Path
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.camera import FoundBoard
from controller.calibration.grippers import FingersError, TcpFit
from controller.calibration.kinematics import (
    BoardPicture,
    CameraPrior,
    CellFit,
    CellPrior,
    FaultLimits,
    KinematicArm,
    KinematicsError,
    Placing,
    PlateGrasp,
    Play,
    PoseCandidate,
    PrintedPattern,
    StopPicture,
    aim_uncertainty_mm,
    base_std,
    board_again,
    calibrate_and_prove,
    choose,
    clamped_std,
    measure_play,
    plate_faces,
    tcp_uncertainty,
)
from controller.calibration.showing import ShowingRegion
from controller.calibration.target import BoardSection, load_board
from controller.cell.services import CameraName
from controller.config.calibration_reference import CalibrationName
from controller.config.calibrations import (
    ArmCalibration,
    Calibration,
    CameraCalibration,
    Residual,
)
from controller.planning.motion import inverse_rows, segment_seconds
from controller.setup.drivers import find_driver
from controller.setup.measured_arm import at_rest, measured_arm
from messages import say

from ..bench import Bench
from ..boards import (
    HeldPlate,
    PlateInJaws,
    as_handed,
    board_file,
    found_in,
    lay,
    load_plate,
    look,
    put_away,
)
from ..errors import StepFailedError
from ..fingers import look_at_the_fingers

CAMERAS: Final[tuple[CameraName, ...]] = ("overhead", "inspection")
REGIONS: Final[Mapping[CameraName, ShowingRegion]] = {
    "overhead": ShowingRegion(620.0, 1150.0),
    "inspection": ShowingRegion(450.0, 950.0),
}
CANDIDATES: Final = 150  # number for each camera and face
PICTURES: Final = 44
MARK: Final = "mark"
FIRST_PICTURES: Final = 6  # pictures before giving up: if none of them is right, no other is
MARGIN_MM: Final = 25.0
MAX_RMS_PX: Final = 0.15
MAX_OFF_SIGMA: Final = 8.0  # a camera or a plate that was moved meanwhile is tens of them off
MAX_U_MM: Final = 0.4  # mostly the length of the tool, which the step `grippers` measures
MAX_U_DEG: Final = 0.15
MAX_PLAY_DEG: Final = 0.5
MAX_FINGER_PX: Final = 0.5
STOPS: Final = 4  # per camera, approached from both sides
FACES: Final = ("front", "back")


class ArmStep:
    """Both cameras, the arm's base and all figures that its model names, in one fit."""

    name = "arm"
    title = "poses of arm and cameras, and errors of the arm's counters"
    needs: tuple[str, ...] = ("devices", "light")
    uses: tuple[CalibrationName, ...] = ("lamps",)
    makes: tuple[CalibrationName, ...] = ("overhead", "inspection", "arm")
    valid_days: int | None = 90

    async def run(self, bench: Bench) -> Mapping[CalibrationName, Calibration]:
        """Take all pictures, fit, and return both cameras and the arm.

        Raises
        ------
        StepFailedError : a board is not found, or no cell fits the pictures
        DeclinedError : a person ended it
        DeviceError : a device does not answer or does not get there
        """
        arm = measured_arm(bench.layout)
        flat_file, plate_file = board_file(bench, "charuco"), board_file(bench, "paddle")
        plate = load_plate(plate_file)
        await bench.permit_motion("The arm homes, and then shows a plate to both cameras.")
        await bench.home_and_park()
        lying, placings = await _on_the_table(bench, flat_file)
        held = PlateInJaws(bench, as_handed(bench, plate), plate_file)
        await held.take(seed=1)
        prior = _prior(bench, arm, held.plate, placings)
        try:
            pictures, stops = await _in_the_jaws(bench, prior, held, lying)
        except StepFailedError:
            await held.give_back()
            raise
        await held.give_back()
        await _on_the_table_again(bench, flat_file, lying[0], placings[MARK])
        try:
            proven = await asyncio.to_thread(
                calibrate_and_prove,
                prior,
                [*lying, *pictures],
                lambda fit: measure_play(fit.layout, fit.x, stops, arm.motors),
            )
        except KinematicsError as error:
            raise StepFailedError(str(error)) from error
        fit, play = proven.fit, proven.play
        for fault in proven.left_out:
            bench.evidence.find(f"left out, because all others agree without it: {fault.message}")
        for fault in proven.faults:
            bench.evidence.find(f"{fault.kind.replace('_', ' ')}: {fault.message}")
        if proven.faults:
            raise StepFailedError(proven.faults[0].message)
        try:
            tcp = await look_at_the_fingers(bench, fit)
        except FingersError as error:
            raise StepFailedError(str(error)) from error
        for fault in tcp.faults():
            raise StepFailedError(fault.message)
        bench.evidence.measure("edges of the fingers", tcp.rms_px, "px", high=MAX_FINGER_PX)
        bench.evidence.measure(
            "opening of the jaws at counter 0", tcp.jaw_zero_mm, "mm", uncertainty=tcp.u_mm
        )
        for motor, one in play.items():
            bench.evidence.measure(
                f"play of {motor}",
                degrees(one.rad),
                "deg",
                uncertainty=degrees(one.u_rad),
                high=MAX_PLAY_DEG,
            )
        return _calibrations(bench, tcp, play)


# ---- pictures --------------------------------------------------------------------------------
async def _on_the_table(bench: Bench, file: Path) -> tuple[list[BoardPicture], dict[str, Placing]]:
    flat = load_board(file)
    area = bench.cell.table.drop_area
    width_mm, height_mm, thickness_mm = flat.plate_mm
    edge_mm = flat.margin_mm + flat.square_mm
    x_mm = sum(area.x) / 2 - width_mm / 2 + edge_mm
    y_mm = sum(area.y) / 2 - height_mm / 2 + flat.bare_mm + edge_mm
    board = await _at_its_mark(
        bench,
        file,
        flat,
        (x_mm, y_mm),
        f"Lay the flat board at its mark: the lower left inner corner of its print at x {x_mm:.1f} "
        f"y {y_mm:.1f} mm of the table, its lower side along x. Nothing else on the table. Is it "
        "there?",
        MARK,
        "the board at its mark, which fixes the world",
    )
    now_s = bench.clock.now_s()
    return (
        [BoardPicture(MARK, "overhead", "flat", board, MARK, taken_s=now_s)],
        {MARK: Placing(x_mm, y_mm, 0.0, thickness_mm)},
    )


async def _on_the_table_again(
    bench: Bench, file: Path, first: BoardPicture, place: Placing
) -> None:
    """Look again at the board on its mark: the overhead camera must not have moved.

    Raises
    ------
    StepFailedError : it was moved, or the board is not found
    """
    flat = load_board(file)
    text = "Lay the flat board at its mark again, as in the first picture. Is it there?"
    caption = "the board at its mark again, after all other pictures"
    again = await _at_its_mark(
        bench, file, flat, (place.x_mm, place.y_mm), text, f"{MARK}_again", caption
    )
    try:
        seen = board_again(bench.layout.overhead, "overhead", first.board, again, place.height_mm)
    except KinematicsError as error:
        raise StepFailedError(str(error)) from error
    measure, limits = bench.evidence.measure, FaultLimits()
    name = "board at its mark again"
    measure(f"{name}: from where it was", seen.moved_mm, "mm", high=limits.moved_mm)
    measure(f"{name}: turned", degrees(seen.turned_rad), "deg", high=degrees(limits.moved_rad))
    share = 100.0 * limits.again_scale
    measure(f"{name}: larger", 100.0 * seen.grown, "%", low=-share, high=share)
    if seen.fault is not None:
        bench.evidence.find(f"camera moved: {seen.fault.message}")
        raise StepFailedError(seen.fault.message)


async def _at_its_mark(
    bench: Bench,
    file: Path,
    flat: BoardSection,
    at_mm: tuple[float, float],
    text: str,
    name: str,
    caption: str,
) -> FoundBoard:
    """Have the flat board put at its mark, photograph it, and have it taken away."""
    await lay(bench, file, text, x_mm=at_mm[0], y_mm=at_mm[1])
    picture = await look(bench, "overhead", name, caption)
    board, _ = found_in(picture, flat, "the board at its mark")
    await put_away(bench, file, "Take the board off the table. Is the table empty?")
    return board


def _prior(
    bench: Bench, arm: KinematicArm, plate: HeldPlate, placings: Mapping[str, Placing]
) -> CellPrior:
    layout = bench.layout
    front, back = plate_faces(plate.board)
    cameras = {"overhead": layout.overhead, "inspection": layout.inspection}
    return CellPrior(
        cameras={name: CameraPrior.within(camera) for name, camera in cameras.items()},
        faces={"flat": PrintedPattern(), "front": front, "back": back},
        placings=placings,
        grasps={"plate": PlateGrasp(plate.T_tcp_body, clamped_std())},
        arm=arm,
        T_world_arm=layout.T_world_arm,
        base_std=base_std(),
        joint_std=arm.joint_std,
    )


async def _in_the_jaws(
    bench: Bench, prior: CellPrior, held: PlateInJaws, lying: Sequence[BoardPicture]
) -> tuple[list[BoardPicture], list[StopPicture]]:
    """Return pictures with every motor moved from below, and stops approached from both sides.

    The latter of an arm alone whose gears have play.
    """
    bench.evidence.show("computing where to show the plate")
    motors = frozenset(prior.arm.motors)
    chosen = _configurations(bench, prior, held, lying)
    pictures: list[BoardPicture] = []
    stops: list[StopPicture] = []
    seen = Counter[str]()
    for number, one in enumerate(_in_order(bench, chosen), 1):
        bench.evidence.show(f"picture {number} of {len(chosen)}, {one.camera} camera")
        camera: CameraName = "overhead" if one.camera == "overhead" else "inspection"
        name = f"{camera}_{number:02d}"
        below = await held.shown(camera, one.q, name, from_below=True)
        if below is None:
            if not pictures and number == FIRST_PICTURES:
                last = bench.evidence.findings[-1]
                raise StepFailedError(
                    say(
                        "none of the first {number} pictures shows the plate: {last}",
                        number=number,
                        last=last,
                    )
                )
            continue
        pictures.append(below)
        seen[one.camera] += 1
        if motors and seen[one.camera] <= STOPS:
            above = await held.shown(camera, one.q, f"{name}_above", from_below=False)
            if above is not None:
                stops += [StopPicture(below, name), StopPicture(above, name, motors)]
    if len(pictures) < PICTURES // 2:
        raise StepFailedError(
            say(
                "the plate was found in {pictures_count} of {chosen_count} "
                "pictures, half of them are required; see which were left out, and "
                "why",
                pictures_count=len(pictures),
                chosen_count=len(chosen),
            )
        )
    return pictures, stops


def _configurations(
    bench: Bench, prior: CellPrior, held: PlateInJaws, lying: Sequence[BoardPicture]
) -> list[PoseCandidate]:
    rng, corners = np.random.default_rng(1), held.plate.corners_mm
    candidates: list[PoseCandidate] = []
    for name in CAMERAS:
        for face in FACES:
            q = held.configurations(
                name,
                REGIONS[name],
                CANDIDATES,
                rng,
                is_front=face == "front",
                margin_mm=MARGIN_MM,
            )
            within = [row for row in q if held.within_reach(row)]
            candidates += [PoseCandidate(name, face, "plate", row) for row in within]
    choice = choose(prior, candidates, dict.fromkeys(FACES, corners), PICTURES, on_table=lying)
    if len(choice.indices) < PICTURES // 2:
        raise StepFailedError(
            say(
                "only {indices_count} places were found where a camera sees the "
                "plate and the arm is free; check the cameras' poses in the cell "
                "file",
                indices_count=len(choice.indices),
            )
        )
    return [candidates[i] for i in choice.indices]


def _in_order(bench: Bench, chosen: Sequence[PoseCandidate]) -> list[PoseCandidate]:
    """Return configurations so that each is near the one before."""
    left, at, ordered = list(chosen), bench.layout.park_q, []
    while left:
        seconds = [float(segment_seconds(bench.layout, at, one.q)) for one in left]
        ordered.append(left.pop(int(np.argmin(seconds))))
        at = ordered[-1].q
    return ordered


# ---- what was found ----------------------------------------------------------------------------
def _calibrations(
    bench: Bench, tcp: TcpFit, play: Mapping[str, Play]
) -> dict[CalibrationName, Calibration]:
    evidence, fit = bench.evidence, tcp.fit
    evidence.measure("corner noise", fit.noise_px, "px", high=MAX_RMS_PX)
    outliers = sum(one.outlier_count for one in fit.pictures)
    used = sum(one.used_count for one in fit.pictures)
    evidence.measure("corners left out", 100 * outliers / max(1, used + outliers), "%", high=5)
    worst = max(one.off_sigma for one in fit.pictures)
    evidence.measure("the worst picture, in standard deviations", worst, high=MAX_OFF_SIGMA)
    residual = Residual(value=round(fit.noise_px, 4), unit="px", limit=MAX_RMS_PX)
    found: dict[CalibrationName, Calibration] = {}
    where = {"overhead": _at_the_table(bench), "inspection": _at_the_station(bench)}
    u_all = {}
    for name in CAMERAS:
        u_mm = rms(aim_uncertainty_mm(fit, name, where[name]).tolist())
        evidence.measure(
            (f"{name}: camera against arm, over the drop area"), u_mm, "mm", high=MAX_U_MM
        )
        found[name] = _camera(bench, fit, name, u_mm, residual)
        u_all[name] = u_mm
    rows = np.concatenate([*where.values()])
    rest_mm, rest_deg = at_rest(bench.layout, rows)
    evidence.measure("joints at rest about where they are sent, at the TCP", rest_mm, "mm")
    pose = tcp_uncertainty(fit, rows)
    u_deg = float(np.hypot(rms([degrees(one.u_rad) for one in pose]), rest_deg))
    evidence.measure("direction of the gripper", u_deg, "deg", high=MAX_U_DEG)
    play_deg = {name: round(max(0.0, degrees(one.rad)), 4) for name, one in play.items()}
    u_mm = float(np.hypot(max(u_all.values()), rest_mm))
    own = _arm(bench, fit, u_mm, u_deg, residual)
    found["arm"] = own.model_copy(
        update={
            "jaw_zero_mm": round(tcp.jaw_zero_mm, 3) if _takes_jaw_zero(bench) else None,
            "play_deg": play_deg,
        }
    )
    return found


def _takes_jaw_zero(bench: Bench) -> bool:
    driver = find_driver("arm", bench.cell.devices.arm.driver)
    return "jaw_zero_mm" in {one.name for one in dataclasses.fields(driver.settings)}


def rms(values: Sequence[float]) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def _at_the_table(bench: Bench) -> FloatArray:
    """Return configurations (n, 6) in which the gripper points down at the drop area."""
    area = bench.cell.table.drop_area
    down = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    places = [(x, y, 20.0) for x in np.linspace(*area.x, 4) for y in np.linspace(*area.y, 4)]
    return _reached(bench, places, [down, down @ _turn_x(pi / 2)])


def _at_the_station(bench: Bench) -> FloatArray:
    """Return configurations (n, 6) in which the TCP is about the station."""
    level = [_turn_z(a) @ _turn_x(r) for a in (0.0, pi / 2, -pi / 2) for r in (0.0, pi / 2)]
    return _reached(bench, [bench.layout.station_mm], level)


def _reached(bench: Bench, places: Sequence[Any], turns: Sequence[FloatArray]) -> FloatArray:
    T = np.zeros((len(places) * len(turns), 4, 4))
    T[:, 3, 3] = 1.0
    for i, (place, R) in enumerate((p, R) for p in places for R in turns):
        T[i, :3, :3], T[i, :3, 3] = R, place
    index, _, q = inverse_rows(bench.layout, T)
    _, first = np.unique(index, return_index=True)
    return np.asarray(q[first])


def _turn_x(angle: float) -> FloatArray:
    c, s = cos(angle), sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _turn_z(angle: float) -> FloatArray:
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def _camera(
    bench: Bench, fit: CellFit, name: CameraName, u_mm: float, residual: Residual
) -> CameraCalibration:
    camera = fit.camera(name)
    K = camera.K
    return CameraCalibration(
        **bench.header(residual=residual),
        size_px=camera.size_px,
        K=((K[0, 0], 0.0, K[0, 2]), (0.0, K[1, 1], K[1, 2]), (0.0, 0.0, 1.0)),
        distortion=tuple(camera.distortion.tolist()),
        T_world_cam=_matrix(camera.T_world_cam),
        u_pose_mm=u_mm,
        u_pose_deg=_u_deg(fit, name),
    )


def _arm(
    bench: Bench, fit: CellFit, u_mm: float, u_deg: float, residual: Residual
) -> ArmCalibration:
    return ArmCalibration(
        **bench.header(residual=residual),
        figures=fit.arm,
        T_world_arm=_matrix(fit.T_world_arm),
        u_mm=u_mm,
        u_deg=u_deg,
        observable=fit.observable,
        held=fit.held,
    )


def _u_deg(fit: CellFit, camera: str) -> float:
    block = fit.cov[fit.layout.where(camera), fit.layout.where(camera)]
    return degrees(float(np.sqrt(np.linalg.eigvalsh(block[:3, :3]).max())))


def _matrix(T: FloatArray) -> Any:  # noqa: ANN401  (rows of numbers)
    return tuple(tuple(float(v) for v in row) for row in T)
