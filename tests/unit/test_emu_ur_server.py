"""The emulated controller on sockets. Time is the test's: no wall clock decides."""

import asyncio
import json
import re
import struct
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
from emu_ur_bench import is_at_rest, running_arm

from emulators.gripper_modbus import RobotiqDevice
from emulators.ur_arm import CYCLE_S, STANDARD_PORTS, RobotMode, UrArm, UrServer, UrVerbs

ROOT = Path(__file__).parents[2]
PATIENCE_WALL_S = 60.0
VERSION_2 = bytes.fromhex("00 05 56 00 02")
START = bytes.fromhex("00 03 53")
STAMPS = b"\x00\x14O" + struct.pack(">d", 125.0) + b"timestamp"

Client = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@asynccontextmanager
async def serving(arm: UrArm) -> AsyncIterator[UrServer]:
    server = UrServer(arm)
    await server.start()
    try:
        yield server
    finally:
        await server.aclose()


@asynccontextmanager
async def client_of(server: UrServer, port: str) -> AsyncIterator[Client]:
    host, number = server.ports[port].address
    reader, writer = await asyncio.open_connection(host, number)
    try:
        yield reader, writer
    finally:
        writer.close()


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_WALL_S):
        while not is_so():  # noqa: ASYNC110 -- the sockets need rounds of the loop
            await asyncio.sleep(0.001)


async def settle() -> None:
    """Let whatever is on its way between sockets of this loop arrive."""
    for _ in range(20):
        await asyncio.sleep(0.001)


async def line_of(client: Client) -> str:
    async with asyncio.timeout(PATIENCE_WALL_S):
        return (await client[0].readline()).decode().rstrip("\n")


async def package_of(client: Client) -> tuple[str, bytes]:
    async with asyncio.timeout(PATIENCE_WALL_S):
        size, kind = struct.unpack(">HB", await client[0].readexactly(3))
        return chr(kind), await client[0].readexactly(size - 3)


async def packet_of(client: Client) -> tuple[int, bytes]:
    async with asyncio.timeout(PATIENCE_WALL_S):
        size, kind = struct.unpack(">IB", await client[0].readexactly(5))
        return kind, await client[0].readexactly(size - 5)


async def message_of(client: Client) -> tuple[int, bytes]:
    """Return kind and content of the next message behind its time stamp and source."""
    while True:
        kind, payload = await packet_of(client)
        if kind == 20:
            return payload[9], payload[10:]


async def started(client: Client) -> None:
    client[1].write(VERSION_2 + STAMPS + START)
    assert [(await package_of(client))[0] for _ in range(3)] == ["V", "O", "S"]


async def stamp_of(client: Client) -> float:
    kind, payload = await package_of(client)
    assert kind == "U"
    (stamp,) = struct.unpack(">d", payload[1:])
    return float(stamp)


async def test_every_port_is_a_free_one_and_announced() -> None:
    async with serving(UrArm(gripper=RobotiqDevice())) as server:
        announced = server.announcement()
        assert announced.pop("host") == "127.0.0.1"
        assert set(announced) == {
            "dashboard", "primary", "secondary", "realtime", "rtde", "urcap",
        }  # fmt: skip
        assert len(set(announced.values())) == 6


async def test_an_arm_without_a_gripper_has_no_port_for_one() -> None:
    async with serving(UrArm()) as server:
        assert "urcap" not in server.announcement()


async def test_two_arms_have_the_standard_ports_on_addresses_of_their_own() -> None:
    servers = [UrServer(UrArm(), host, STANDARD_PORTS) for host in ("127.0.77.1", "127.0.77.2")]
    try:
        for server in servers:
            await server.start()
            assert server.announcement()["rtde"] == 30004
    finally:
        for server in servers:
            await server.aclose()


async def test_a_taken_port_leaves_nothing_open() -> None:
    first = UrServer(UrArm(), "127.0.77.3", STANDARD_PORTS)
    await first.start()
    second = UrServer(UrArm(), "127.0.77.3", STANDARD_PORTS)
    with pytest.raises(OSError, match="address already in use"):
        await second.start()
    await first.aclose()
    await second.start()
    await second.aclose()


async def test_rtde_streams_in_the_world_s_time() -> None:
    arm = UrArm()
    async with serving(arm) as server, client_of(server, "rtde") as client:
        await started(client)
        arm.advance(0.080)
        stamps = [await stamp_of(client) for _ in range(10)]
        assert stamps == pytest.approx([0.008 * n for n in range(1, 11)])


async def test_late_packages_come_later_and_lost_ones_never() -> None:
    arm = UrArm()
    async with serving(arm) as server, client_of(server, "rtde") as client:
        await started(client)
        server.set_faults(lost_count=2, late_s=0.1)
        arm.advance(0.100)
        await settle()
        assert not client[0]._buffer  # type: ignore[attr-defined]
        arm.advance(0.100)
        assert await stamp_of(client) == pytest.approx(0.024)
        server.set_faults(late_s=0.0)
        arm.advance(0.016)
        stamps = [await stamp_of(client) for _ in range(11)]
        assert stamps == sorted(stamps)


async def test_a_cable_that_is_out_lets_nothing_through_and_keeps_connections() -> None:
    arm = UrArm()
    async with serving(arm) as server, client_of(server, "dashboard") as dashboard:
        assert await line_of(dashboard) == "Connected: Universal Robots Dashboard Server"
        async with client_of(server, "rtde") as client:
            await started(client)
            server.set_faults(unplugged=True)
            dashboard[1].write(b"robotmode\n")
            arm.advance(0.5)
            await settle()
            assert not client[0]._buffer  # type: ignore[attr-defined]
            assert not dashboard[0]._buffer  # type: ignore[attr-defined]
            server.set_faults(unplugged=False)
            assert await line_of(dashboard) == "Robotmode: POWER_OFF"
            arm.advance(CYCLE_S * 4)
            assert await stamp_of(client) > 0.5


async def test_a_program_moves_the_arm_and_a_wrong_one_shows_in_the_messages() -> None:
    arm = running_arm()
    async with serving(arm) as server, client_of(server, "primary") as primary:
        assert (await message_of(primary))[0] == 3  # version
        async with client_of(server, "secondary") as secondary:
            secondary[1].write(b"movej([0.2, -1.5, 1.5, -1.5, -1.5, 0], a=2, v=1)\n")
            await until(lambda: arm.is_program_running)
            arm.advance(2.0)
            assert is_at_rest(arm)
            assert arm.q_rad[0] == 0.2
            secondary[1].write(b"movel(p[0,0,0,0,0,0])\n")
            kind, content = await message_of(primary)
        assert kind == 10
        assert struct.unpack(">ii", content[:8]) == (1, 1)
        assert content[8:] == b"compile_error_name_not_found:movel:"
        assert arm.q_rad[0] == 0.2


async def test_an_arm_without_power_says_why_it_takes_no_program() -> None:
    async with serving(UrArm()) as server, client_of(server, "primary") as primary:
        await message_of(primary)
        primary[1].write(b"stopj(2)\n")
        assert await message_of(primary) == (0, b"program refused: robot mode is POWER_OFF")


async def test_local_mode_ends_script_connections_and_new_ones_may_only_read() -> None:
    arm = running_arm()
    async with serving(arm) as server:
        async with client_of(server, "primary") as primary:
            await message_of(primary)
            arm.set_remote(is_remote=False)
            arm.advance(CYCLE_S)
            with suppress(ConnectionError):  # an end or a reset, as the system likes
                await asyncio.wait_for(primary[0].read(), PATIENCE_WALL_S)
        async with client_of(server, "primary") as primary:
            await message_of(primary)
            arm.set_remote(is_remote=True)
            primary[1].write(b"set_digital_out(0, True)\n")
            kind, content = await message_of(primary)
            assert (kind, struct.unpack(">i", content[:4])) == (6, (210,))
        async with client_of(server, "primary") as primary:
            await message_of(primary)
            primary[1].write(b"set_digital_out(0, True)\n")
            await until(lambda: arm.is_program_running)
            arm.advance(CYCLE_S)
    assert arm.digital_outputs == 1


async def test_state_comes_ten_times_a_second_and_the_real_time_packet_with_every_cycle() -> None:
    arm = UrArm()
    async with (
        serving(arm) as server,
        client_of(server, "secondary") as secondary,
        client_of(server, "realtime") as realtime,
    ):
        assert (await packet_of(secondary))[0] == 20
        assert (await packet_of(secondary))[0] == 16
        await until(lambda: server.ports["realtime"].client_count == 1)
        await settle()
        arm.advance(0.3)
        assert [(await packet_of(secondary))[0] for _ in range(3)] == [16, 16, 16]
        async with asyncio.timeout(PATIENCE_WALL_S):
            packets = await realtime[0].readexactly(150 * 1220)
        stamps = [struct.unpack_from(">d", packets, 1220 * n + 4)[0] for n in range(150)]
        assert stamps == pytest.approx([CYCLE_S * n for n in range(1, 151)])


async def test_a_client_that_does_not_read_loses_packages_and_holds_nothing_up() -> None:
    arm = UrArm()
    async with serving(arm) as server, client_of(server, "realtime") as client:
        await until(lambda: server.ports["realtime"].client_count == 1)
        client[0]._transport.pause_reading()  # type: ignore[attr-defined]
        for _ in range(40):
            arm.advance(0.5)
            await asyncio.sleep(0)
        (writer,) = server.ports["realtime"]._clients.values()
        assert writer.transport.get_write_buffer_size() < 1 << 20


async def test_a_controller_without_supply_is_gone_and_starts_anew() -> None:
    arm = running_arm()
    verbs = UrVerbs(arm, server := UrServer(arm))
    await server.start()
    async with client_of(server, "dashboard") as client:
        await line_of(client)
        assert verbs.obey(b'{"do": "arm_power", "on": false}') == {"ok": True}
        with suppress(ConnectionError):  # an end or a reset, as the system likes
            assert await asyncio.wait_for(client[0].read(), PATIENCE_WALL_S) == b""
    verbs.obey(b'{"do": "arm_power", "on": true}')
    async with client_of(server, "dashboard") as client:
        assert (await line_of(client)).startswith("Connected")
    assert arm.robot_mode is RobotMode.POWER_OFF
    await server.aclose()


async def test_the_urcap_keeps_its_gripper_company() -> None:
    arm = running_arm(gripper=RobotiqDevice())
    async with serving(arm) as server, client_of(server, "urcap") as client:
        arm.advance(3.0)
        client[1].write(b"GET FLT\n")
        async with asyncio.timeout(PATIENCE_WALL_S):
            assert await client[0].read(64) == b"FLT 0"


@pytest.mark.parametrize(
    ("order", "word"),
    [
        ({"do": "arm_slider", "fraction": 2}, "0 to 1"),
        ({"do": "arm_line", "nonsense": 1}, "none of late_s, lost_count, unplugged"),
        ({"do": "arm_jam", "joint": "knee"}, "knee"),
        ({"do": "arm_input", "number": 18}, "0 to 17"),
        ({"do": "arm_gripper", "jammed": True}, "no gripper"),
        ({"do": "dance"}, "dance"),
    ],
)
async def test_a_verb_that_makes_no_sense_says_so(order: dict[str, object], word: str) -> None:
    verbs = UrVerbs(arm := UrArm(), UrServer(arm))
    answer = verbs.obey(json.dumps(order).encode())
    assert not answer["ok"]
    assert word in answer["error"]


def test_every_verb_has_a_row_on_its_page() -> None:
    verbs = UrVerbs(arm := UrArm(), UrServer(arm)).verbs
    page = (ROOT / "docs" / "emulated-ur-arm.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\| `(\w+)` \|", page, re.M)) == sorted(verbs)


async def test_every_verb_does_what_it_says() -> None:
    arm = running_arm(gripper=RobotiqDevice())
    verbs = UrVerbs(arm, UrServer(arm))

    def do(verb: str, **order: object) -> dict[str, object]:
        answer = verbs.obey(json.dumps({"do": verb, **order}).encode())
        assert answer.pop("ok"), answer
        return answer

    do("arm_slider", fraction=0.3)
    do("arm_input", number=4)
    do("arm_gripper", jammed=True)
    do("arm_mode", remote=False)
    assert (arm.slider, arm.digital_inputs, arm.is_remote) == (0.3, 1 << 4, False)
    assert arm.gripper is not None
    assert arm.gripper.jaws.jammed
    do("arm_protective_stop", cause="a hand")
    state = do("arm_state")
    assert (state["safety_mode"], state["stop_cause"]) == ("PROTECTIVE_STOP", "a hand")
    do("estop")
    assert do("arm_state")["safety_mode"] == "ROBOT_EMERGENCY_STOP"
    do("estop", pressed=False)
    do("arm_safeguard")
    assert do("arm_state")["safety_mode"] == "SAFEGUARD_STOP"
    do("arm_safeguard", is_open=False)
    do("arm_jam", joint="elbow")
    do("arm_jam", joint="elbow", jammed=False)


def test_the_command_serves_one_arm_and_ends_with_a_signal() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "emulators.ur_arm", "--model", "ur10e", "--running"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    ready = json.loads(process.stdout.readline())
    process.terminate()
    process.stdout.close()
    assert process.wait(PATIENCE_WALL_S) == 0
    assert (ready["event"], ready["model"]) == ("ready", "ur10e")
    assert ready["rtde"] > 0


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--software", "new"], "numbers between dots"),
        (["--speed", "0"], "a factor above 0"),
        (["--host", "192.0.2.1"], "192.0.2.1"),
    ],
)
def test_the_command_says_what_is_wrong(arguments: list[str], word: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "emulators.ur_arm", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert word in done.stderr
    assert "Traceback" not in done.stderr
