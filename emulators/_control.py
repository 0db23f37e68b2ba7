"""The control port: here tests read the truth and cause faults. The controller never uses it.

JSON lines on a unix socket; each ``{"do": VERB, ...}`` is answered by one
``{"ok": true, ...}`` or ``{"ok": false, "error": ...}``.
"""

import asyncio
import contextlib
import json
import math
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from emulators._cell import Cell
from emulators.umi_scara import Axis
from emulators.world import truth

Answer = dict[str, Any]


class ControlPort:
    """Serves a cell's control port on a unix socket."""

    def __init__(self, cell: Cell, path: Path) -> None:
        self._cell, self._path = cell, path
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self._verbs: dict[str, Callable[..., Answer | None]] = {
            "truth": self._truth,
            "time": self._time,
            "estop": self._estop,
            "reset": self._reset,
            "door": self._door,
            "supply": self._supply,
            "acknowledge": self._acknowledge,
            "drop": self._drop,
            "remove": self._remove,
            "lose_part": self._lose_part,
            "slip": self._slip,
            "miss": self._miss,
            "place": self._place,
            "lamp": self._lamp,
            "unplug": self._unplug,
            "plug": self._plug,
            "camera": self._camera,
            "arm_line": self._arm_line,
            "arm_ip": self._arm_ip,
            "arm_jam": self._arm_jam,
            "gripper": self._gripper,
            "line": self._line,
        }

    async def start(self) -> None:
        """Listen."""
        self._server = await asyncio.start_unix_server(self._serve, str(self._path))

    async def aclose(self) -> None:
        """Close the socket and delete it."""
        if self._server is None:
            return
        self._server.close()
        for writer in list(self._clients):
            writer.close()
        await self._server.wait_closed()
        self._server = None
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        try:
            while line := await reader.readline():
                writer.write(json.dumps(self.obey(line)).encode() + b"\n")
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            self._clients.discard(writer)
            writer.close()

    def obey(self, line: bytes) -> Answer:
        """Carry out one order and return its answer, which names what is wrong with the order."""
        try:
            order = json.loads(line)
            verb = self._verbs[order.pop("do")]
            return {"ok": True, **(verb(**order) or {})}
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            return {"ok": False, "error": f"{type(error).__name__}: {error}"}

    # --- truth ----------------------------------------------------------------------------------

    def _truth(self) -> Answer:
        return truth(self._cell.world)

    def _time(self) -> Answer:
        cell = self._cell
        return {
            "world_s": cell.now_s,
            "behind_s": cell.behind_s,
            "speed": cell.clock.speed,
            "lost_frames": {name: one.lost_count for name, one in cell.cameras.items()},
            "worker_pid": cell.desk.worker_pid,
        }

    # --- people and parts -------------------------------------------------------------------------

    def _estop(self, *, pressed: bool) -> None:
        if pressed:
            self._cell.signals.press_estop()
            self._cell.arm.press_estop()
        else:
            self._cell.signals.release_estop()

    def _reset(self) -> Answer:
        signals = self._cell.signals
        signals.reset()
        if signals.is_estop_chain_ok:
            self._cell.arm.release_estop()
        return {"chain_ok": signals.is_estop_chain_ok}

    def _door(self, *, closed: bool) -> None:
        self._cell.signals.is_door_closed = closed

    def _supply(self, *, on: bool) -> None:
        self._cell.signals.is_24v_ok = on
        for lamp in self._cell.lamps.values():
            lamp.is_supply_on = on

    def _acknowledge(self, *, down: bool) -> None:
        self._cell.signals.is_operator_acknowledging = down

    def _drop(
        self,
        part: int = 0,
        x_mm: float | None = None,
        y_mm: float | None = None,
        rest: int | None = None,
        theta_deg: float | None = None,
    ) -> None:
        theta_rad = None if theta_deg is None else math.radians(theta_deg)
        self._cell.world.drop(part, x_mm, y_mm, rest, theta_rad)

    def _remove(self, part: int = 0) -> None:
        self._cell.world.remove(part)

    def _lose_part(self, gripper: str = "arm") -> None:
        self._cell.world.lose_grasp(_gripper_name(gripper))

    def _slip(self, along_mm: float, gripper: str = "arm", turn_deg: float = 0.0) -> None:
        self._cell.world.slip(_gripper_name(gripper), along_mm, math.radians(turn_deg))

    def _miss(self, gripper: str = "arm") -> None:
        self._cell.world.miss(_gripper_name(gripper))

    def _place(self, T_world_part: list[list[float]], part: int = 0) -> None:
        self._cell.world.place(part, np.array(T_world_part, dtype=float).reshape(4, 4))

    # --- devices and wires ------------------------------------------------------------------------

    def _lamp(self, name: str, *, dead: bool = False, wire_broken: bool = False) -> None:
        lamp = self._cell.lamps[name]
        lamp.is_dead, lamp.is_dimming_wire_broken = dead, wire_broken

    def _unplug(self, camera: str) -> None:
        self._cell.camera_plugs.unplug(camera)

    def _plug(self, camera: str) -> Answer:
        return {"address": self._cell.camera_plugs.plug(camera)}

    def _camera(self, camera: str, **faults: Any) -> None:  # noqa: ANN401  (checked by `replace`)
        device = self._cell.cameras[camera]
        device.faults = replace(device.faults, **faults)

    def _arm_line(self, **faults: Any) -> None:  # noqa: ANN401  (checked by `_set`)
        _set(self._cell.arm_wire.faults, faults)

    def _arm_ip(self, ip: int, what: str) -> None:
        wire = self._cell.arm_wire
        {"restart": wire.restart, "kill": wire.kill, "revive": wire.revive}[what](ip)

    def _arm_jam(self, axis: str, *, jammed: bool = True) -> None:
        self._cell.arm.jam(Axis(axis), jammed)

    def _gripper(self, *, jammed: bool | None = None, powered: bool | None = None) -> None:
        if jammed is not None:
            self._cell.jaws.jammed = jammed
        if powered is not None:
            self._cell.gripper.is_powered = powered

    def _line(self, device: str, **faults: Any) -> None:  # noqa: ANN401  (checked by `_set`)
        cell = self._cell
        bus, unit = {
            "gripper": (cell.gripper_bus, cell.gripper.unit),
            "dimmer": (cell.lights_bus, cell.analog.unit),
            "relays": (cell.lights_bus, cell.relays.unit),
            "io": (cell.io_bus, cell.io.unit),
        }[device]
        _set(bus.faults(unit), faults)


def _set(target: Any, values: dict[str, Any]) -> None:  # noqa: ANN401  (a dataclass of faults)
    known = {field.name for field in fields(target)}
    for name, value in values.items():
        if name not in known:
            raise KeyError(f"{name}: none of {', '.join(sorted(known))}")
        setattr(target, name, value)


def _gripper_name(name: str) -> str:
    if name not in ("arm", "fixture"):
        raise ValueError(f"gripper {name!r} is neither arm nor fixture")
    return name
