"""MQTT: the cell's state, results, alarms and orders on a broker, in plain JSON (ADR 127).

Needs the extra `mqtt`.
"""

from pathlib import Path

from controller.config.cell.mqtt import MqttSection

from ...plant import Wire
from ._plain import MqttWire

__all__ = ["MqttWire", "mqtt_wires"]


def mqtt_wires(section: MqttSection, folder: Path) -> list[Wire]:
    """Return the wires of a section; names of files are relative to a folder."""
    return [MqttWire(section, folder)]
