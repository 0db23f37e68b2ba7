"""MQTT: state, results, alarms and orders on a broker, in plain JSON and as Sparkplug B (ADR 127).

Needs the extra `mqtt`.
"""

from pathlib import Path

from controller.config.cell.mqtt import MqttSection

from ...plant import Wire
from ._plain import MqttWire
from ._sparkplug import SparkplugWire

__all__ = ["MqttWire", "SparkplugWire", "mqtt_wires"]


def mqtt_wires(section: MqttSection, folder: Path) -> list[Wire]:
    """Return the wires of a section; names of files are relative to a folder."""
    plain = MqttWire(section, folder)
    if section.sparkplug is None:
        return [plain]
    return [plain, SparkplugWire(section, section.sparkplug, folder)]
