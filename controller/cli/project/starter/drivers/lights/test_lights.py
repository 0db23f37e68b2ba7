"""Which channel of the emulated lamp unit the driver sets, and to what."""

import asyncio

import pytest

from controller.cli.project.starter.drivers.lights import AcmeLights, Settings
from controller.cli.project.starter.drivers.lights.emulator import AcmeDevice, serve
from drivers.kinds import Lamp
from drivers.modbus_link import ModbusLink, TcpAddress

LAMPS = (Lamp("ring", analog=0, relay=0), Lamp("panel", analog=3, relay=0, drive=0.5))


def test_levels_arrive_on_the_lamps_own_channels() -> None:
    """Set two lamps, one of which is to be driven to half of its brightness."""

    async def story() -> None:
        device = AcmeDevice()
        async with serve(device) as address:
            host, _, port = address.rpartition(":")
            async with ModbusLink(TcpAddress(host, int(port))) as link:
                lights = AcmeLights(link, 1, LAMPS, Settings())
                await lights.connect()
                await lights.set({"ring": 1.0, "panel": 0.5})
                assert device.thousandths == [1000, 0, 0, 250, 0, 0, 0, 0]
                with pytest.raises(ValueError, match="panel"):
                    await lights.set({"ring": 0.2, "panel": 1.5})
                assert device.thousandths[0] == 1000
                await lights.all_off()
                assert not any(device.thousandths)

    asyncio.run(story())


def test_a_channel_that_the_unit_lacks_is_named() -> None:
    """Give a lamp of the cell file a ninth channel."""
    link = ModbusLink(TcpAddress("127.0.0.1", 1))
    with pytest.raises(ValueError, match="side"):
        AcmeLights(link, 1, (Lamp("side", analog=8, relay=0),), Settings())
