"""Boards before the cameras: on the table and in the arm gripper, moved to and looked at.

Gears may have play. So each configuration for a picture is approached with every motor from one
side, from below by its counter unless the other side is requested, on an arm that says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from controller.arrays import FloatArray, Grey
from controller.calibration.camera import (
    Charuco,
    FoundBoard,
    NoBoardError,
    charuco_board,
    find_board,
)
from controller.calibration.kinematics import BoardPicture, plate_faces
from controller.calibration.showing import ShowingRegion, showing
from controller.calibration.target import BoardSection, load_board
from controller.cell.services import CameraName
from controller.config import SHIPPED
from controller.planning.geometry import Box
from controller.planning.motion import Scene
from controller.setup.measured_arm import measured_arm
from messages import joined, key, say

from .bench import UNCALIBRATED_MM, Bench, with_clearance
from .errors import StepFailedError
from .person import Errand

RING: Final[Mapping[CameraName, str]] = {"overhead": "table_ring", "inspection": "station_ring"}
BRIGHT: Final = 235  # grey level of 255; brighter white paper is saturated somewhere
DIMMEST: Final = 0.1
HALF_OPEN_MM: Final = 40.0
MAX_JAWS_OFF_MM: Final = 2.0  # the jaws are not calibrated yet
MAX_PADS_MM: Final = 8.0  # both pads together
PLATE_FORCE: Final = 30  # MAX_FORCE of the jaws; it has no unit (umi_rtx.md 5.6)


def board_file(bench: Bench, name: str) -> Path:
    """Return the file of a board: in the commissioning's folder `boards`, else the shipped one.

    Parameters
    ----------
    bench : bench of the step
    name : ``charuco`` or ``paddle``
    """
    own = bench.evidence.folder.parent.parent / "boards" / f"{name}.json"
    return own if own.is_file() else SHIPPED / "boards" / f"{name}.json"


@dataclass(frozen=True, slots=True, eq=False)
class HeldPlate:
    """A plate with a printed board on each face, between the jaws.

    Attributes
    ----------
    board : from its file
    T_tcp_body : (4, 4) nominal pose at the hand-over, to some mm and degrees
    """

    board: BoardSection
    T_tcp_body: FloatArray

    @property
    def box(self) -> Box:
        """Its bounding box in the TCP frame, some mm larger than itself."""
        width_mm, height_mm, thickness_mm = self.board.plate_mm
        T = self.T_tcp_body.copy()
        T[:3, 3] += T[:3, 0] * (height_mm - self.board.bare_mm) / 2.0
        return Box(T, np.array([height_mm, thickness_mm, width_mm]) / 2.0 + HANDED_MM)

    @property
    def corners_mm(self) -> FloatArray:
        """Inner corners (n, 2) of either face's print.

        Raises
        ------
        StepFailedError : it bears no ChArUco board
        """
        target = self.board.build()
        if not isinstance(target, Charuco):
            raise StepFailedError(key("the plate needs a ChArUco board on each face"))
        return np.asarray(charuco_board(target).getChessboardCorners(), dtype=np.float64)[:, :2]

    def T_tcp_board(self, *, is_front: bool) -> FloatArray:
        """Return (4, 4) of a face's print in the TCP frame."""
        front, back = plate_faces(self.board)
        return np.asarray(self.T_tcp_body @ (front if is_front else back).T_body_board)


def load_plate(file: Path) -> BoardSection:
    """Return the board of a plate for the jaws.

    Raises
    ------
    ConfigError : the file is wrong
    StepFailedError : it describes a board that cannot be held in the jaws and seen from both sides
    """
    board = load_board(file)
    missing = [
        what
        for what, is_there in (
            (key("a ChArUco board (`squares`)"), board.squares is not None),
            (key("a print on its back (`back_first_marker`)"), board.build_back() is not None),
            (key("a bare side for the grasp (`bare_mm`)"), board.bare_mm > 0),
        )
        if not is_there
    ]
    if missing:
        raise StepFailedError(
            say(
                "{file}: is no plate for the jaws: it lacks {missing}; print one "
                "with `cellctl print-target paddle`",
                file=file,
                missing=joined(", ", missing),
            )
        )
    return board


HANDED_MM: Final = 6.0  # largest offset at which a person holds the plate


def as_handed(bench: Bench, board: BoardSection) -> HeldPlate:
    """Return a plate whose bare side is between the pads, its print beyond the fingers."""
    T = np.eye(4)
    T[0, 3] = -bench.layout.arm_gripper.pad_centre_mm
    return HeldPlate(board, T)


async def look(
    bench: Bench, camera: CameraName, name: str, caption: str, *, lamp: str | None = None
) -> Grey:
    """Return a picture under one lamp, as bright as possible without saturation.

    Parameters
    ----------
    bench : bench of the step
    camera : camera that takes it
    name, caption : name and caption of the picture as evidence
    lamp : None for the camera's ring

    Raises
    ------
    DeviceError : a lamp does not confirm, or no frame comes
    OSError : the picture cannot be kept
    """
    level = 1.0
    while True:
        picture = await bench.imaging.shoot(camera, {lamp or RING[camera]: level})
        if np.percentile(picture, 99.5) <= BRIGHT or level <= DIMMEST:
            break
        level = max(DIMMEST, level * 0.7)
    await bench.evidence.keep(name, picture, caption)
    return picture


def found_in(picture: Grey, board: BoardSection, where: str) -> tuple[FoundBoard, bool]:
    """Return the board in a picture, and whether it is the plate's front.

    Parameters
    ----------
    picture : (height, width)
    board : board expected in it
    where : the picture was taken, as a message begins

    Raises
    ------
    StepFailedError : neither face is in it
    """
    faces = [(board.build(), True)]
    if (back := board.build_back()) is not None:
        faces.append((back, False))
    whys = []
    for target, is_front in faces:
        try:
            return find_board(picture, target), is_front
        except NoBoardError as error:
            whys.append(str(error))
    raise StepFailedError(f"{where}: {whys[0]}")


async def lay(bench: Bench, file: Path, text: str, **place: Any) -> None:  # noqa: ANN401
    """Have a board put on the table.

    Parameters
    ----------
    bench : bench of the step
    file : file of the board
    text : instruction for a person
    place : place, in the form of an order to an emulated cell

    Raises
    ------
    DeclinedError, NobodyThereError, CellError : nobody does it
    """
    order = {"do": "board", "file": str(file), **place}
    await bench.person.have_done(Errand("lay_board", text, (order,)))


async def put_away(bench: Bench, file: Path, text: str) -> None:
    """Have a board taken away.

    Parameters
    ----------
    bench : bench of the step
    file : file of the board
    text : instruction for a person

    Raises
    ------
    DeclinedError, NobodyThereError, CellError : nobody does it
    """
    order = {"do": "remove", "file": str(file)}
    await bench.person.have_done(Errand("put_away", text, (order,)))


async def go_to(
    bench: Bench, scene: Scene, q: FloatArray, what: str, *, from_below: bool | None = True
) -> None:
    """Move to a configuration (6,), its motors from one side.

    Parameters
    ----------
    bench : bench of the step
    scene : scene with the arm's load
    q : target joints
    what : purpose of the motion, as a message begins
    from_below : counters rise at last; False: they fall; None: as it comes

    Raises
    ------
    StepFailedError : no path is proven free
    """
    take_up = measured_arm(bench.layout).take_up
    before = q if from_below is None else (q - take_up if from_below else q + take_up)
    is_other = bool(take_up.any()) and bool(bench.layout.arm.within_limits(before).all())
    path = await bench.path_to(before if is_other else q, scene, what)
    await bench.motion.follow((*path, q) if is_other else path)


class PlateInJaws:
    """A plate in the arm gripper, and the arm's motions with it.

    Parameters
    ----------
    bench : bench of the step
    plate : nominal plate in the jaws
    file : file of its board
    """

    def __init__(self, bench: Bench, plate: HeldPlate, file: Path) -> None:
        self._bench = bench
        self.plate = plate
        self.file = file
        layout = with_clearance(bench.layout, UNCALIBRATED_MM)
        thickness_mm = plate.board.plate_mm[2]
        self.scene = Scene(layout, thickness_mm + 2.0, layout.fixed_open_mm, carried=plate.box)

    async def take(self, seed: int, force: int = PLATE_FORCE) -> None:
        """Have the plate handed over at the park, and close the jaws on it.

        Parameters
        ----------
        seed : seed of how an emulated person holds it
        force : MAX_FORCE of the jaws

        Raises
        ------
        StepFailedError : the jaws closed on something else, or on nothing
        DeclinedError, NobodyThereError, CellError, DeviceError : it cannot be done
        """
        bench, board = self._bench, self.plate.board
        thickness_mm = board.plate_mm[2]
        await bench.move_jaws(
            say("the arm gripper opens to {half_open_mm:.0f} mm", half_open_mm=HALF_OPEN_MM),
            lambda: bench.arm.move_gripper_mm(HALF_OPEN_MM),
        )
        order = {"do": "give", "file": str(self.file), "gripper": "arm", "seed": seed}
        text = (
            "Hold the plate between the jaws of the arm gripper: its bare side between the pads, "
            "its faces along the jaws, its print beyond the fingers. The jaws close next. Is it "
            "there?"
        )
        await bench.person.have_done(Errand("give_plate", text, (order,)))
        opening_mm = 0.0

        async def close() -> None:
            nonlocal opening_mm
            opening_mm = await bench.arm.grasp(force)

        await bench.move_jaws("the arm gripper closes on the plate", close)
        off_mm = opening_mm - thickness_mm
        bench.evidence.measure(
            "jaws on the plate, against its thickness",
            off_mm,
            "mm",
            low=-MAX_JAWS_OFF_MM,
            high=MAX_JAWS_OFF_MM,
        )
        if abs(off_mm) > MAX_JAWS_OFF_MM:
            # fingers without pads close farther on the same plate
            pads = (
                say("pads are missing or worn by {worn_mm:.1f} mm each, ", worn_mm=-off_mm / 2)
                if -MAX_PADS_MM < off_mm < 0.0
                else ""
            )
            raise StepFailedError(
                say(
                    "the jaws closed to {opening_mm:.1f} mm, the plate is {thickness_mm:g} mm "
                    "thick: {pads}the plate is not between them, or its file is of another plate",
                    opening_mm=opening_mm,
                    thickness_mm=thickness_mm,
                    pads=pads,
                )
            )

    async def give_back(self) -> None:
        """Go to the park and have a person take the plate as the jaws open."""
        bench = self._bench
        await self.go(bench.layout.park_q, "bringing the plate back", from_below=False)
        await bench.person.confirm(
            "take_plate", "The jaws open next: hold the plate. Do you hold it?"
        )
        await bench.move_jaws(
            say("the arm gripper opens to {half_open_mm:.0f} mm", half_open_mm=HALF_OPEN_MM),
            lambda: bench.arm.move_gripper_mm(HALF_OPEN_MM),
        )
        await put_away(bench, self.file, "Put the plate away. Is it away?")

    def within_reach(self, q: FloatArray) -> bool:
        """Return whether the arm also reaches the approach positions on either side of q (6,)."""
        layout, scene = self._bench.layout, self.scene
        take_up = measured_arm(layout).take_up
        rows = np.stack([q, q - take_up, q + take_up])
        return bool(layout.arm.within_limits(rows).all() and scene.free(rows, 10.0).all())

    def configurations(
        self,
        camera: CameraName,
        region: ShowingRegion,
        count: int,
        rng: np.random.Generator,
        *,
        is_front: bool,
        margin_mm: float,
    ) -> FloatArray:
        """Return configurations (n, 6) that show a face to a camera, n up to ``count``.

        Parameters
        ----------
        camera : camera that must see it
        region : distance range from the camera
        count : enough of them
        rng : draws them
        is_front : face of the plate
        margin_mm : distance to keep from everything

        Raises
        ------
        StepFailedError : the plate bears no ChArUco board
        """
        layout, corners = self._bench.layout, self.plate.corners_mm
        return showing(
            layout,
            self.scene,
            getattr(layout, camera),
            self.plate.T_tcp_board(is_front=is_front),
            (corners.min(axis=0) + corners.max(axis=0)) / 2,
            region,
            count,
            rng,
            margin_mm=margin_mm,
        )

    async def shown(
        self, camera: CameraName, q: FloatArray, name: str, *, from_below: bool | None
    ) -> BoardPicture | None:
        """Show the plate and return its picture; None, with a note, if it cannot be shown.

        Parameters
        ----------
        camera : camera that must see it
        q : (6,) target joints
        name : name of the picture
        from_below : as `go_to`

        Raises
        ------
        DeviceError : a device does not answer or does not get there
        """
        bench = self._bench
        try:
            await self.go(q, f"showing the plate, {name}", from_below=from_below)
            await bench.motion.ring_down()
            there = await bench.arm.read_q()
            picture = await look(bench, camera, name, f"{camera} camera, {name}")
            board, is_front = found_in(picture, self.plate.board, name)
        except StepFailedError as error:
            bench.evidence.find(f"{name} left out: {error}")
            return None
        face = "front" if is_front else "back"
        return BoardPicture(name, camera, face, board, "plate", there, bench.clock.now_s())

    async def go(self, q: FloatArray, what: str, *, from_below: bool | None = True) -> None:
        """Move to a configuration (6,) with the plate, its motors from one side.

        Parameters
        ----------
        q : target joints
        what : purpose of the motion, as a message begins
        from_below : as `go_to`

        Raises
        ------
        StepFailedError : no path is proven free
        """
        await go_to(self._bench, self.scene, q, what, from_below=from_below)
