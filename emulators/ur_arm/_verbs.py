"""What may befall a UR arm, by verb; docs/emulated-ur-arm.md."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from ._model import UrArm
from ._server import UrServer

Answer = dict[str, Any]
_WRONG = (KeyError, TypeError, ValueError, IndexError, AttributeError)


class UrVerbs:
    """Verbs of one arm and its controller.

    Parameters
    ----------
    arm : the controller
    server : its ports
    """

    def __init__(self, arm: UrArm, server: UrServer) -> None:
        self._arm, self._server = arm, server
        self.verbs: Mapping[str, Callable[..., Answer | None]] = {
            "arm_state": self._state,
            "arm_protective_stop": self._protective_stop,
            "arm_safeguard": self._safeguard,
            "arm_mode": self._mode,
            "arm_slider": self._slider,
            "arm_line": self._line,
            "arm_jam": self._jam,
            "arm_input": self._input,
            "arm_power": self._power,
            "arm_gripper": self._gripper,
            "estop": self._estop,
        }

    def obey(self, line: bytes) -> Answer:
        """Carry out one line of JSON and return its answer, which names any fault in the line."""
        try:
            order = json.loads(line)
            return {"ok": True, **(self.verbs[order.pop("do")](**order) or {})}
        except (*_WRONG, RecursionError) as error:
            return {"ok": False, "error": f"{type(error).__name__}: {error}"}

    def _state(self) -> Answer:
        arm = self._arm
        joints = arm.joints()
        return {
            "time_s": arm.time_s,
            "q_rad": list(joints.q),
            "jaw_opening_mm": joints.jaw_opening_mm,
            "robot_mode": arm.robot_mode.name,
            "safety_mode": arm.safety_mode.name,
            "runtime_state": arm.runtime_state.name,
            "stop_cause": arm.stop_cause,
            "program": arm.program_name,
            "digital_outputs": arm.digital_outputs,
            "payload_kg": arm.payload_kg,
        }

    def _protective_stop(self, cause: str = "contact") -> None:
        self._arm.protective_stop(cause)

    def _safeguard(self, *, is_open: bool = True) -> None:
        self._arm.safeguard_stop(is_open=is_open)

    def _mode(self, *, remote: bool = False) -> None:
        self._arm.set_remote(is_remote=remote)

    def _slider(self, fraction: float) -> None:
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f"a speed slider at {fraction}: 0 to 1")
        self._arm.slider = fraction

    def _line(self, **faults: float) -> None:
        self._server.set_faults(**faults)

    def _jam(self, joint: str, *, jammed: bool = True) -> None:
        for direction in (-1, 1):
            self._arm.obstruct(joint, direction, jammed)

    def _input(self, number: int, *, on: bool = True) -> None:
        self._arm.set_input(number, is_on=on)

    def _power(self, *, on: bool = False) -> None:
        self._server.is_powered = on

    def _gripper(self, *, jammed: bool | None = None, fault: int | None = None) -> None:
        gripper = self._arm.gripper
        if gripper is None:
            raise ValueError("this arm carries no gripper")
        if jammed is not None:
            gripper.jaws.jammed = jammed
        if fault is not None:
            gripper.raise_fault(fault)

    def _estop(self, *, pressed: bool = True) -> None:
        if pressed:
            self._arm.press_estop()
        else:
            self._arm.release_estop()
