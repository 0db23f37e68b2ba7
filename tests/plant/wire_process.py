"""A bridge of one wire over a fake cell, as a process that a test may kill.

``python wire_process.py mqtt PORT KEEP_ALIVE_S``
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from fake_plant import FakePlant
from wire_bench import served

from controller.config.cell.mqtt import MqttSection
from controller.plant.wires.mqtt import MqttWire


async def main(port: int, keep_alive_s: int) -> None:
    settings = MqttSection(broker="127.0.0.1", port=port, keep_alive_s=keep_alive_s)
    async with served(MqttWire(settings, Path()), FakePlant()):
        await asyncio.Event().wait()


asyncio.run(main(int(sys.argv[1]), int(sys.argv[2])))
