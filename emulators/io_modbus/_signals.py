"""The state of the cell's hard-wired contacts, as the world and tests set it.

Source: modbus_devices.md 7.4. These are copies for monitoring: 1 is healthy.
"""

from dataclasses import dataclass


@dataclass(slots=True)
class CellSignals:
    """Contacts of the cell; as made, everything is in order and no part is anywhere.

    Attributes
    ----------
    is_door_closed : the guard is closed and locked
    is_part_in_nest, is_part_between_jaws : part-present sensors of the nest and of gripper 2
    is_24v_ok : the supply of lights (and the air)
    is_operator_acknowledging : the button is down
    """

    is_door_closed: bool = True
    is_part_in_nest: bool = False
    is_part_between_jaws: bool = False
    is_24v_ok: bool = True
    is_operator_acknowledging: bool = False
    _is_estop_pressed: bool = False
    _is_estop_chain_ok: bool = True

    @property
    def is_estop_chain_ok(self) -> bool:
        """Whether the safety relay is in; a released button alone does not pull it in."""
        return self._is_estop_chain_ok

    def press_estop(self) -> None:
        """Push an emergency-stop button in; it latches."""
        self._is_estop_pressed = True
        self._is_estop_chain_ok = False

    def release_estop(self) -> None:
        """Pull the button out; the chain stays open until `reset`."""
        self._is_estop_pressed = False

    def reset(self) -> None:
        """Push the reset button of the safety relay; in vain while a button is down."""
        self._is_estop_chain_ok = not self._is_estop_pressed
