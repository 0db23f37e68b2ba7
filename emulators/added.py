"""Objects that a person brings into the cell while it runs: boards, and parts by CAD files.

World and pictures get to know of each at once. A board that was brought before is the same body
again, wherever it is by then.
"""

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emulators.world import (
    Board,
    LayoutError,
    PictureDesk,
    Solid,
    World,
    board_surface,
    load_solid,
    part_surface,
    read_board,
)
from emulators.world.poses import rotation_about

Array = NDArray[np.float64]

PLACING_MM: Final = 1.5  # largest offset from its mark on the table, in each direction
PLACING_RAD: Final = math.radians(1.0)
HOLDING_MM: Final = 2.0  # largest offset between the pads, along and across the approach
HOLDING_RAD: Final = math.radians(3.0)  # largest turn about the jaws' axis
_AXES: Final = ("x", "y", "z")


class AddedParts:
    """Brings parts and boards.

    Parameters
    ----------
    world : world with the objects
    desk : desk whose pictures show them
    """

    def __init__(self, world: World, desk: PictureDesk) -> None:
        self._world, self._desk = world, desk
        self._boards: dict[int, Board] = {}
        self._paths: dict[int, Path] = {}
        self._scales: dict[Path, float] = {}

    def misprint(self, path: Path, scale: float) -> None:
        """Let a board's print be enlarged, whenever it is brought from now on."""
        self._scales[path] = scale

    def boards_of(self, path: Path) -> tuple[int, ...]:
        """Return the numbers of the boards that were brought by a file."""
        return tuple(index for index, known in self._paths.items() if known == path)

    def part(self, path: Path) -> int:
        """Take a part by its CAD file; return its number. It is not in the cell yet.

        Raises
        ------
        ValueError : the file cannot be used
        """
        try:
            solid = load_solid(path)
        except LayoutError as error:
            raise ValueError(str(error)) from error
        index = self._world.add(solid)
        self._desk.add(part_surface(f"part {index}", solid))
        return index

    def board(self, path: Path, scale: float | None = None) -> int:
        """Return the number of a board, which is taken if it is new.

        Parameters
        ----------
        path : the board's own file
        scale : scale of its print, as a printer that enlarges; None: as its misprint, if it has one

        Raises
        ------
        ValueError : the file cannot be used
        """
        try:
            board = read_board(path, self._scales.get(path, 1.0) if scale is None else scale)
        except LayoutError as error:
            raise ValueError(str(error)) from error
        for index, known in self._boards.items():
            if known.key == board.key:
                return index
        index = self._world.add(board.solid())
        self._boards[index], self._paths[index] = board, path
        self._desk.add(board_surface(f"part {index}", board))
        return index

    def lay(
        self,
        index: int,
        at_mm: tuple[float | None, float | None],
        theta_rad: float,
        tilt_rad: float,
        seed: int | None,
    ) -> None:
        """Lay a board on the table, or prop it up there.

        Parameters
        ----------
        index : number of the board
        at_mm : x and y of the origin of its frame; None: its middle is over the drop area's
        theta_rad : theta of its x axis against the world's
        tilt_rad : about its x axis; other than 0, something unseen holds it up
        seed : seed of a person's error in placing it; None: none
        """
        board, layout = self._boards[index], self._world.layout
        middle = ((board.low_mm + board.high_mm) / 2.0)[:2]
        c, s = math.cos(theta_rad), math.sin(theta_rad)
        to_middle = np.array((c * middle[0] - s * middle[1], s * middle[0] + c * middle[1]))
        over_area = (layout.drop_low_mm + layout.drop_high_mm) / 2.0 - to_middle
        x_mm, y_mm = (over_area[i] if at is None else at for i, at in enumerate(at_mm))
        if seed is not None:
            rng = np.random.default_rng(seed)
            dx_mm, dy_mm = rng.uniform(-PLACING_MM, PLACING_MM, 2)
            x_mm, y_mm = x_mm + dx_mm, y_mm + dy_mm
            theta_rad += rng.uniform(-PLACING_RAD, PLACING_RAD)
        T = board.pose_on_table(float(x_mm), float(y_mm), theta_rad, tilt_rad)
        self._world.lay(index, T, is_propped=tilt_rad != 0.0)

    def give(self, index: int, gripper: str, axis: str, seed: int | None) -> None:
        """Let a person hold a board or a part between a gripper's open jaws until they close.

        Parameters
        ----------
        index : number of the board or part
        gripper : ``arm`` or ``fixture``
        axis : axis of the part's CAD frame, to be along the jaws' axis; a board has its own
        seed : seed of a person's error in holding it there; None: none

        Raises
        ------
        ValueError : it does not fit between these jaws as they stand
        """
        fingers = self._world.layout.arm.gripper.fingers
        if gripper != "arm":
            fingers = self._world.layout.fixed_gripper.fingers
        board = self._boards.get(index)
        if board is not None:
            T = board.pose_in_jaws()
        else:
            T = _along_jaws(self._world.parts[index].solid, axis, fingers.pad_length_mm)
        if seed is not None:
            rng = np.random.default_rng(seed)
            pivot = np.array((-fingers.pad_length_mm / 2.0, 0.0, 0.0))
            turn_rad = rng.uniform(-HOLDING_RAD, HOLDING_RAD)
            off = np.eye(4)
            off[:3, :3] = rotation_about(np.array((0.0, 1.0, 0.0)), turn_rad)
            off[:3, 3] = pivot - off[:3, :3] @ pivot
            off[[0, 2], 3] += rng.uniform(-HOLDING_MM, HOLDING_MM, 2)
            T = off @ T
        self._world.give(index, gripper, T)


def _along_jaws(solid: Solid, axis: str, pad_length_mm: float) -> Array:
    """Return T_tcp_part with an axis of the CAD frame along the jaws' axis, centred on the pads."""
    if axis not in _AXES:
        raise ValueError(f"axis {axis!r} is none of {', '.join(_AXES)}")
    T = np.eye(4)
    # cyclic, so that it stays a rotation: the axis goes to the TCP's y
    shift = 1 - _AXES.index(axis)
    T[:3, :3] = np.roll(np.eye(3), shift, axis=0)
    T[:3, 3] = np.array((-pad_length_mm / 2.0, 0.0, 0.0)) - T[:3, :3] @ solid.centre_mm
    return T
