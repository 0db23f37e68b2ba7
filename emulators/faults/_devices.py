"""Faults of devices and wires: bytes, boards, joints, supplies, lamps, cameras, lines."""

import random
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from typing import Any

from emulators.byte_faults import ByteFault, Harm, LineNoise
from emulators.modbus import Bus, WireFaults
from emulators.umi_scara import Axis

from ._plant import Plant

Answer = dict[str, Any]
DEVICES = ("arm", "gripper", "io")  # besides the modules of the lamp unit


class DevicesAndWires:
    """Verbs of devices and wires, on a plant."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.verbs: Mapping[str, Callable[..., Answer | None]] = {
            "arm_line": self._arm_line,
            "arm_ip": self._arm_ip,
            "arm_jam": self._arm_jam,
            "arm_jump": self._arm_jump,
            "arm_push": self._arm_push,
            "arm_stops": self._arm_stops,
            "byte": self._byte,
            "noise": self._noise,
            "line": self._line,
            "cut": self._cut,
            "gripper": self._gripper,
            "gripper_fault": self._gripper_fault,
            "lamp": self._lamp,
            "camera": self._camera,
            "unplug": self._unplug,
            "plug": self._plug,
            "power": self._power,
        }

    # --- the arm --------------------------------------------------------------------------------

    def _arm_line(self, **faults: Any) -> None:  # noqa: ANN401  (checked by `_set`)
        _set(self._plant.rtx.wire.faults, faults)

    def _arm_ip(self, ip: int, what: str = "restart") -> None:
        wire = self._plant.rtx.wire
        {"restart": wire.restart, "kill": wire.kill, "revive": wire.revive}[what](ip)

    def _arm_jam(self, axis: str, *, jammed: bool = True) -> None:
        self._plant.rtx.body.jam(Axis(axis), jammed)

    def _arm_jump(self, axis: str, counts: float) -> None:
        self._plant.rtx.body.jump(Axis(axis), counts)

    def _arm_push(self, axis: str, counts: float) -> None:
        self._plant.rtx.body.push(Axis(axis), counts)

    def _arm_stops(self) -> Answer:
        """Return the stops that the arm's boards have heard, and its motors' losses of supply."""
        plant = self._plant
        return {
            "stops": [asdict(stop) for stop in plant.rtx.wire.stops],
            "supply": [asdict(change) for change in plant.supply_changes],
        }

    # --- bytes and lines --------------------------------------------------------------------------

    def _byte(
        self,
        harm: str,
        device: str = "arm",
        direction: str = "from",
        *,
        skip: int = 0,
        bit: int = 2,
        late_s: float = 0.05,
    ) -> None:
        """Let one byte of a device's line be lost, doubled, flipped or late.

        On Modbus, whose frames have a checksum, any harm to a request makes the device pass it
        over; ``skip`` then counts bytes of the next reply.
        """
        fault = ByteFault(harm=Harm(harm), bit=bit, late_s=late_s)
        is_from = _is_from(direction)
        if device == "arm":
            self._noise_of(is_from=is_from).plan(fault, skip)
            return
        if device == "io":
            raise ValueError("io: it has a TCP connection of its own, which loses no byte")
        bus, unit = self._wire_of(device)
        bus.set_faults(
            unit,
            WireFaults(reply_fault=(skip, fault), requests_left=1)
            if is_from
            else WireFaults(is_deaf=True, requests_left=1),
        )

    def _noise(
        self,
        probability: float,
        direction: str = "from",
        harms: list[str] | None = None,
        seed: int = 0,
    ) -> None:
        """Let bytes on the arm's line suffer by chance."""
        if not 0.0 <= probability <= 1.0:
            raise ValueError(f"a probability of {probability}")
        noise = self._noise_of(is_from=_is_from(direction))
        noise.probability, noise.rng = probability, random.Random(seed)
        noise.harms = tuple(Harm(one) for one in harms) if harms else tuple(Harm)

    def _noise_of(self, *, is_from: bool) -> LineNoise:
        wire = self._plant.rtx.wire
        return wire.from_arm if is_from else wire.to_arm

    def _line(self, device: str, **faults: Any) -> None:  # noqa: ANN401  (checked by `_set`)
        bus, unit = self._wire_of(device)
        _set(bus.faults(unit), faults)

    def _wire_of(self, device: str) -> tuple[Bus, int]:
        plant = self._plant
        return {
            "gripper": (plant.gripper_bus, plant.gripper.unit),
            "io": (plant.io_bus, plant.io.unit),
            **{name: (plant.lights_bus, one.unit) for name, one in plant.lamp_modules.items()},
        }[device]

    def _cut(self, line: str, *, reachable: bool = False) -> None:
        """End a line's connections; new ones end at once until it is reachable again."""
        networks = self._plant.networks
        if line not in networks:
            raise ValueError(f"line {line!r} has no connection: {', '.join(networks) or 'none'}")
        networks[line].is_reachable = reachable
        if not reachable:
            networks[line].drop_connections()

    # --- grippers, lamps, cameras -----------------------------------------------------------------

    def _gripper(self, *, jammed: bool) -> None:
        self._plant.jaws.jammed = jammed

    def _gripper_fault(self, code: int) -> None:
        self._plant.gripper.raise_fault(code)

    def _lamp(
        self, name: str, *, dead: bool = False, strength: float = 1.0, wire_broken: bool = False
    ) -> None:
        if not 0.0 <= strength <= 1.0:
            raise ValueError(f"a lamp's strength of {strength}: 0 to 1")
        lamp = self._plant.lamps[name]
        lamp.is_dead, lamp.strength, lamp.is_dimming_wire_broken = dead, strength, wire_broken

    def _camera(self, camera: str, **faults: Any) -> None:  # noqa: ANN401  (checked by `replace`)
        device = self._plant.cameras[camera]
        device.faults = replace(device.faults, **faults)

    def _unplug(self, camera: str) -> None:
        if not self._plant.cameras[camera].is_plugged:
            raise ValueError(f"{camera} is unplugged already")
        self._plant.camera_plugs.unplug(camera)

    def _plug(self, camera: str) -> Answer:
        return {"address": self._plant.camera_plugs.plug(camera)}

    # --- supplies ---------------------------------------------------------------------------------

    def _power(self, device: str, *, on: bool = False) -> None:
        """Cut a device's supply or give it back; ``all`` is every device and every camera."""
        plant = self._plant
        if device == "all":
            for one in (*DEVICES, *plant.lamp_modules, *plant.cameras):
                self._power(one, on=on)
        elif device in plant.cameras:
            if plant.cameras[device].is_plugged and not on:
                plant.camera_plugs.unplug(device)
            elif on and not plant.cameras[device].is_plugged:
                plant.camera_plugs.plug(device)
        else:
            powered: dict[str, Any] = {
                "arm": plant.arm_unit,
                "gripper": plant.gripper,
                "io": plant.io,
                **plant.lamp_modules,
            }
            powered[device].is_powered = on
            if device == "io" and "io" in plant.networks:  # its own network plug dies with it
                self._cut("io", reachable=on)


def _is_from(direction: str) -> bool:
    if direction not in ("from", "to"):
        raise ValueError(f"direction {direction!r} is neither from nor to (the device)")
    return direction == "from"


def _set(target: Any, values: dict[str, Any]) -> None:  # noqa: ANN401  (a dataclass of faults)
    known = {field.name for field in fields(target)}
    for name in values:
        if name not in known:
            raise KeyError(f"{name}: none of {', '.join(sorted(known))}")
    for name, value in values.items():
        setattr(target, name, value)
