"""The acts of people and gravity in the cell: buttons, the door, parts."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from emulators.guiding import aimed_at, guide, tcp_of
from emulators.world import part_pose, truth

from ._plant import Plant

Answer = dict[str, Any]


class PeopleAndParts:
    """Verbs of buttons, doors, supply and parts, on a plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.verbs: Mapping[str, Callable[..., Answer | None]] = {
            "truth": self._truth,
            "time": plant.timing,
            "as_built": plant.as_built.truth,
            "estop": self._estop,
            "reset": self._reset,
            "door": self._door,
            "supply": self._supply,
            "acknowledge": self._acknowledge,
            "drop": self._drop,
            "place": self._place,
            "shift": self._shift,
            "remove": self._remove,
            "put_back": self._put_back,
            "add": self._add,
            "board": self._board,
            "misprint": self._misprint,
            "give": self._give,
            "guide": self._guide,
            "lose_part": self._lose_part,
            "slip": self._slip,
            "miss": self._miss,
        }

    def _truth(self) -> Answer:
        return truth(self._plant.world)

    def _estop(self, *, pressed: bool = True) -> None:
        if pressed:
            self._plant.signals.press_estop()
            self._plant.arm_unit.body.press_estop()
        else:
            self._plant.signals.release_estop()

    def _reset(self) -> Answer:
        signals = self._plant.signals
        signals.reset()
        if signals.is_estop_chain_ok:
            self._plant.arm_unit.body.release_estop()
        return {"chain_ok": signals.is_estop_chain_ok}

    def _door(self, *, closed: bool = False) -> None:
        self._plant.signals.is_door_closed = closed

    def _supply(self, *, on: bool = False) -> None:
        self._plant.signals.is_24v_ok = on
        for lamp in self._plant.lamps.values():
            lamp.is_supply_on = on

    def _acknowledge(self, *, down: bool) -> None:
        self._plant.signals.is_operator_acknowledging = down

    def _drop(
        self,
        part: int = 0,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rest: int | None = None,
        theta_deg: float | None = None,
    ) -> None:
        theta_rad = None if theta_deg is None else math.radians(theta_deg)
        self._plant.world.drop(part, x_mm, y_mm, rest, theta_rad)

    def _place(self, T_world_part: list[list[float]], part: int = 0) -> None:
        self._plant.world.place(part, np.array(T_world_part, dtype=float).reshape(4, 4))

    def _shift(
        self, part: int = 0, x_mm: float = 0.0, y_mm: float = 0.0, turn_deg: float = 0.0
    ) -> None:
        self._plant.world.shift(part, (x_mm, y_mm), math.radians(turn_deg))

    def _remove(self, part: int = 0, file: str | None = None) -> None:
        numbers = (part,) if file is None else self._plant.added.boards_of(Path(file))
        for number in numbers:
            self._plant.world.remove(number)

    def _misprint(self, file: str, scale: float) -> None:
        self._plant.added.misprint(Path(file), scale)

    def _put_back(self, part: int = 0, gripper: str = "arm") -> None:
        self._plant.world.put_back(part, _gripper_name(gripper))

    def _add(self, file: str) -> Answer:
        return self._pose_of(self._plant.added.part(Path(file)))

    def _board(
        self,
        file: str,
        x_mm: float | None = None,
        y_mm: float | None = None,
        theta_deg: float = 0.0,
        tilt_deg: float = 0.0,
        scale: float | None = None,
        seed: int | None = None,
    ) -> Answer:
        theta_rad, tilt_rad = math.radians(theta_deg), math.radians(tilt_deg)
        board = self._plant.added.board(Path(file), scale)
        self._plant.added.lay(board, (x_mm, y_mm), theta_rad, tilt_rad, seed)
        return self._pose_of(board)

    def _give(
        self,
        file: str | None = None,
        part: int | None = None,
        gripper: str = "arm",
        axis: str = "z",
        scale: float | None = None,
        seed: int | None = 0,
    ) -> Answer:
        if (file is None) == (part is None):
            raise ValueError("either the `file` of a board or the number of a `part`")
        added = self._plant.added
        number = part if file is None else added.board(Path(file), scale)
        if number is None:
            raise ValueError("no part")
        added.give(number, _gripper_name(gripper), axis, seed)
        return self._pose_of(number)

    def _guide(
        self, tray: str | None = None, corner: Sequence[int] = (1, 1), seed: int = 0
    ) -> None:
        arm, layout = self._plant.arm_unit, self._plant.world.layout
        along_x, along_y = corner
        at_mm = tcp_of(arm, layout)
        guide(arm, layout, aimed_at(layout, at_mm, tray, (along_x, along_y), seed))

    def _pose_of(self, part: int) -> Answer:
        T = part_pose(self._plant.world, part)
        return {"part": part, "T_world_part": None if T is None else T.tolist()}

    def _lose_part(self, gripper: str = "arm") -> None:
        self._plant.world.lose_grasp(_gripper_name(gripper))

    def _slip(self, along_mm: float, gripper: str = "arm", turn_deg: float = 0.0) -> None:
        self._plant.world.slip(_gripper_name(gripper), along_mm, math.radians(turn_deg))

    def _miss(self, gripper: str = "arm") -> None:
        self._plant.world.miss(_gripper_name(gripper))


def _gripper_name(name: str) -> str:
    if name not in ("arm", "fixture"):
        raise ValueError(f"gripper {name!r} is neither arm nor fixture")
    return name
