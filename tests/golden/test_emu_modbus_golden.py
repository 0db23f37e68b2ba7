"""The manual's frames against the emulated devices: each request answered with its very bytes.

Every frame of modbus_devices.toml that concerns an emulated device is played; a test counts them,
so that none is left out in silence.

Sections (§) are those of modbus_devices.md.
"""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from emulators.gripper_modbus import Fault, JawModel, JawScale, RobotiqConfig, RobotiqDevice
from emulators.gripper_onrobot import ComputeBoxDevice, RgDevice
from emulators.io_modbus import E1212, E1214Device
from emulators.lighting_ledsc import LedscDevice
from emulators.lighting_modbus import AnalogOutput8Device, Relay8Device
from emulators.modbus import Bus, MbapReader, ModbusDevice, RtuReader, encode_mbap, encode_rtu

FRAMES = tomllib.loads((Path(__file__).parent / "modbus_devices.toml").read_text())["frame"]
EMULATED = {
    "robotiq",
    "ledsc",
    "onrobot_rg",
    "waveshare_analog",
    "waveshare_relay",
    "moxa_e1212",
    "moxa_e1214",
}
STEP_S = 1 / 240

# Sent by the test itself to bring a gripper into a state; bytes of 2.2.
CLEAR = bytes.fromhex("10 03E8 0003 06 0000 0000 0000")
ACTIVATE = bytes.fromhex("10 03E8 0003 06 0100 0000 0000")
CLOSE = bytes.fromhex("10 03E8 0003 06 0900 00FF FFFF")
OPEN = bytes.fromhex("10 03E8 0003 06 0900 0000 FFFF")
RELEASE_OPENING = bytes.fromhex("10 03E8 0003 06 3100 0000 0000")


def frames(device: str) -> list[Any]:
    return [pytest.param(f, id=f["name"]) for f in FRAMES if f["device"] == device]


def raw(text: str) -> bytes:
    return bytes.fromhex(text)


def ask_rtu(device: ModbusDevice, request: bytes) -> bytes | None:
    """Return the bytes that a line with this one device answers to these bytes."""
    reader = RtuReader()
    reader.feed(request)
    assert reader.is_complete
    frame = reader.silence()
    assert frame is not None, "the golden request is not a sound frame"
    reply = Bus([device]).request(frame.unit, frame.pdu, 0.0)
    return None if reply is None else encode_rtu(reply.unit, reply.pdu)


# --- the gripper ----------------------------------------------------------------------------------


def gripper(*, open_counts: int = 3, activation_s: float = 1.5) -> RobotiqDevice:
    config = RobotiqConfig(scale=JawScale(open_counts=open_counts), activation_s=activation_s)
    return RobotiqDevice(JawModel(), config=config)


def let(device: RobotiqDevice, duration_s: float) -> RobotiqDevice:
    """Let time pass while a master polls."""
    for step in range(round(duration_s / STEP_S)):
        if step % 60 == 0:
            device.request(bytes.fromhex("03 07D0 0003"), 0.0)
        device.advance(STEP_S)
    return device


def until(device: RobotiqDevice, is_so: Callable[[RobotiqDevice], bool]) -> RobotiqDevice:
    for _ in range(2400):
        if is_so(device):
            return device
        device.advance(STEP_S)
        device.request(bytes.fromhex("03 07D0 0003"), 0.0)
    raise AssertionError("the gripper never came there")


def send(device: RobotiqDevice, *pdus: bytes) -> RobotiqDevice:
    for pdu in pdus:
        assert device.request(pdu, 0.0) is not None
    return device


def active(device: RobotiqDevice | None = None) -> RobotiqDevice:
    return let(send(device or gripper(), CLEAR, ACTIVATE), 2.0)


def activating(device: RobotiqDevice | None = None) -> RobotiqDevice:
    return let(send(device or gripper(), CLEAR, ACTIVATE), 0.1)


def shows(counts: int) -> Callable[[RobotiqDevice], bool]:
    def is_so(device: RobotiqDevice) -> bool:
        return device.request(bytes.fromhex("03 07D2 0001"), 0.0)[2] == counts

    return is_so


def closing() -> RobotiqDevice:
    # slow, so that no count is jumped over between two refreshes
    return until(send(active(), bytes.fromhex("10 03E8 0003 06 0900 00FF 0000")), shows(0x0E))


def gripping() -> RobotiqDevice:
    device = active()
    device.jaws.grasp_limit_mm = device.jaws.opening_mm - (0xBD - 3) * 85 / 227
    return let(send(device, CLOSE), 2.0)


def opening() -> RobotiqDevice:
    device = let(send(active(), CLOSE), 2.0)
    return until(send(device, bytes.fromhex("10 03E8 0003 06 0900 0000 0000")), shows(0xBB))


def gripping_inside() -> RobotiqDevice:
    device = let(send(active(), CLOSE), 2.0)
    device.jaws.inner_limit_mm = 85 - (0x5A - 3) * 85 / 227
    return let(send(device, OPEN), 2.0)


def silent_for_a_second() -> RobotiqDevice:
    # power came back, rACT was set without being cleared first: the gripper stays in reset
    device = send(gripper(), bytes.fromhex("06 03E8 0100"))
    for _ in range(241):
        device.advance(STEP_S)
    return device


def not_activated() -> RobotiqDevice:
    device = send(gripper(), bytes.fromhex("06 03E8 0800"), bytes.fromhex("06 03E8 0000"))
    return let(device, 0.1)


def action_delayed() -> RobotiqDevice:
    device = send(gripper(open_counts=0, activation_s=10.0), CLEAR, ACTIVATE)
    device.jaws.closing_current_ma = 0.0  # only the fault byte is the manual's, says the page
    send(device, bytes.fromhex("06 03E8 0900"), bytes.fromhex("06 03E8 0100"))
    return let(device, 2 * STEP_S)  # 17 mm/s have not yet made a count of 0.37 mm


def releasing() -> RobotiqDevice:
    device = let(send(active(), CLOSE), 2.0)
    device.jaws.opening_current_ma = 0.0  # only the fault byte is the manual's, says the page
    return until(send(device, RELEASE_OPENING), shows(0x50))


def activation_failed() -> RobotiqDevice:
    device = gripper(open_counts=0)
    device.jaws.jammed = True
    return let(send(device, CLEAR, ACTIVATE), 1.0)


def over_current() -> RobotiqDevice:
    slow_close = bytes.fromhex("10 03E8 0003 06 0900 00FF 0000")
    device = until(send(active(), slow_close), shows(0x80))
    device.jaws.current_ma = 640.0
    device.raise_fault(Fault.OVER_CURRENT)
    return let(device, 0.1)


def under_voltage() -> RobotiqDevice:
    device = active()
    device.raise_fault(Fault.UNDER_VOLTAGE)
    return let(device, 0.1)


def open_at_0d() -> RobotiqDevice:
    return let(send(active(gripper(open_counts=0x0D)), OPEN), 2.0)


ROBOTIQ_STATES: dict[str, Callable[[], RobotiqDevice]] = {
    "read_status_word_activating": activating,
    "read_status_word_active": active,
    "status_closing": closing,
    "status_gripped": gripping,
    "status_gripped_fc04": gripping,
    "status_opening": opening,
    "status_open": open_at_0d,
    "status_closed_on_nothing": lambda: let(send(active(), CLOSE), 2.0),
    "status_gripped_inside": gripping_inside,
    "read_write_e6": silent_for_a_second,
    "read_write_close": activating,
    "fault_07": not_activated,
    "fault_05": action_delayed,
    "fault_0b": releasing,
    "fault_0f": lambda: let(send(active(), RELEASE_OPENING), 2.0),
    "fault_0d": activation_failed,
    "fault_0e": over_current,
    "fault_0a": under_voltage,
}


@pytest.mark.parametrize("frame", frames("robotiq"))
def test_the_gripper_answers_as_its_manual_prints(frame: dict[str, Any]) -> None:
    device = ROBOTIQ_STATES.get(frame["name"], active)()
    if frame["name"] == "read_status_word_in_reset":
        device = gripper()
    request = raw(frame["request"])
    # FC06 of §2.7 is printed without its reply, which the standard makes an echo
    expected = raw(frame["reply"]) if "reply" in frame else request
    assert ask_rtu(device, request) == expected


# --- the gripper behind a box ---------------------------------------------------------------------


@pytest.mark.parametrize("frame", frames("onrobot_rg"))
def test_the_gripper_behind_a_box_answers_as_the_page_has_it(frame: dict[str, Any]) -> None:
    jaws = JawModel(opening_mm=110.0, target_mm=110.0, stroke_mm=110.0)
    device = RgDevice(jaws)
    bus = Bus([device, ComputeBoxDevice(device)])

    def ask(request: bytes) -> bytes:
        [got] = MbapReader().feed(request)
        reply = bus.request(got.unit, got.pdu, 0.0)
        assert reply is not None
        return encode_mbap(got.transaction, reply.unit, reply.pdu)

    if frame["name"].startswith("status_"):
        [close] = [f for f in FRAMES if f["name"] == "close_40_n"]
        ask(raw(close["request"]))
        jaws.grasp_limit_mm = 100.0
        for _ in range(1 if frame["name"] == "status_busy" else 240):
            device.advance(STEP_S)
    # nothing is at 0x0300; writes of one register are echoed, of three with address and count
    request = raw(frame.get("request", "00 09 00 00 00 06 41 03 03 00 00 01"))
    echo = request[:12] if request[7] == 0x06 else raw("00 02 00 00 00 06 41 10 00 00 00 03")
    assert ask(request) == (raw(frame["reply"]) if "reply" in frame else echo)
    if frame["name"] == "go_to_80_mm":
        assert (jaws.target_mm, jaws.force_limit_n) == (80.0, 40.0)
    if frame["name"] == "power_cycle":
        [status] = MbapReader().feed(raw("00 04 00 00 00 06 41 03 01 0C 00 01"))
        assert bus.request(status.unit, status.pdu, 0.0) is None


# --- lamps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", frames("waveshare_analog"))
def test_the_analog_module_answers_as_its_manual_prints(frame: dict[str, Any]) -> None:
    device = AnalogOutput8Device()
    if frame["name"] == "read_all_5000_mv":
        device.request(bytes.fromhex("10 0000 0008 10") + bytes.fromhex("1388") * 8, 0.0)
    if frame["name"] == "illegal_value":
        request = encode_rtu(1, bytes.fromhex("06 0000 2711"))  # 10001 mV, one too many
    else:
        request = raw(frame["request"])
    expected = raw(frame["reply"]) if "reply" in frame else request  # FC06 is an echo
    assert ask_rtu(device, request) == expected


def test_the_analog_modules_outputs_follow_the_printed_writes() -> None:
    device = AnalogOutput8Device()
    by_name = {
        f["name"]: raw(f["request"])
        for f in FRAMES
        if f["device"] == "waveshare_analog" and "request" in f
    }
    ask_rtu(device, by_name["channel_1_1000_mv"])
    ask_rtu(device, by_name["channel_2_5000_mv"])
    assert device.output_mv(0) == pytest.approx(1000, abs=1.3)  # half a DAC step is 1.22 mV
    assert device.output_mv(1) == pytest.approx(5000, abs=1.3)
    ask_rtu(device, by_name["all_off"])
    assert [device.output_mv(n) for n in range(8)] == [0.0] * 8


@pytest.mark.parametrize("frame", frames("ledsc"))
def test_the_lamp_controller_answers_as_the_page_has_it(frame: dict[str, Any]) -> None:
    device = LedscDevice(1)

    def ask(request: bytes) -> bytes:
        [got] = MbapReader().feed(request)
        reply = Bus([device]).request(got.unit, got.pdu, 0.0)
        assert reply is not None
        return encode_mbap(got.transaction, reply.unit, reply.pdu)

    [write] = [f for f in FRAMES if f["name"] == "red_128_white_255"]
    ask(raw(write["request"]))
    assert ask(raw(frame["request"])) == raw(frame["reply"])
    assert [device.duty(n) for n in range(4)] == [128 / 255, 0.0, 0.0, 1.0]


RELAYS_AFTER = {
    "relay_1_on": {0},
    "relay_1_off": set(),
    "relay_2_on": {1},
    "relay_1_toggle": {0},
    "all_on": set(range(8)),
    "all_on_ffff": set(range(8)),
    "all_off": set(),
    "relays_1_and_3_on": {0, 2},
    "read_relays_1_and_3": {0, 2},
    "relay_1_flash_on_700_ms": {0},
    "version_1_00": set(),
    "ask_address": set(),
}


@pytest.mark.parametrize("frame", frames("waveshare_relay"))
def test_the_relay_module_answers_and_switches_as_its_manual_prints(frame: dict[str, Any]) -> None:
    device = Relay8Device()
    if frame["name"] == "read_relays_1_and_3":
        device.request(bytes.fromhex("0F 0000 0008 01 05"), 0.0)
    request = raw(frame["request"])
    if "reply" in frame:
        expected = raw(frame["reply"])
    elif frame["name"] == "ask_address":
        expected = encode_rtu(1, bytes.fromhex("03 02 0001"))  # under its own number
    else:
        expected = request  # FC05 is an echo
    assert ask_rtu(device, request) == expected
    assert {n for n in range(8) if device.is_closed(n)} == RELAYS_AFTER[frame["name"]]


# --- the I/O block --------------------------------------------------------------------------------

MOXA_REPLIES = {  # printed without reply: FC05 and FC06 echo, FC0F echoes address and count
    "output_0_on": "00 02 00 00 00 06 01 05 00 00 FF 00",
    "relays_0_and_1_on": "00 03 00 00 00 06 01 0F 00 00 00 06",
    "relays_0_and_1_on_word": "00 05 00 00 00 06 01 06 00 20 00 03",
}


def e1214() -> E1214Device:
    """Return a block with inputs 0, 1 and 2 on and the rest off, as the printed replies show."""
    device = E1214Device()
    device.signals.is_part_in_nest = True
    device.signals.is_24v_ok = False
    return device


@pytest.mark.parametrize("frame", frames("moxa_e1214"))
def test_the_io_block_answers_as_the_page_prints(frame: dict[str, Any]) -> None:
    [request] = MbapReader().feed(raw(frame["request"]))
    device = e1214()
    reply = Bus([device]).request(request.unit, request.pdu, 0.0)
    assert reply is not None
    expected = raw(frame.get("reply") or MOXA_REPLIES[frame["name"]])
    assert encode_mbap(request.transaction, reply.unit, reply.pdu) == expected
    closed = {n for n in range(6) if device.is_closed(n)}
    assert closed == {"output_0_on": {0}}.get(
        frame["name"], {0, 1} if "relays" in frame["name"] else set()
    )


@pytest.mark.parametrize("frame", frames("moxa_e1212"))
def test_the_block_with_eight_channels_answers_as_the_page_prints(frame: dict[str, Any]) -> None:
    [request] = MbapReader().feed(raw(frame["request"]))
    device = E1214Device(config=E1212)
    device.signals.is_part_in_nest, device.signals.is_24v_ok = True, False
    reply = Bus([device]).request(request.unit, request.pdu, 0.0)
    assert reply is not None
    # FC0F is acknowledged with address and count
    expected = raw(frame.get("reply") or "00 03 00 00 00 06 01 0F 00 00 00 08")
    assert encode_mbap(request.transaction, reply.unit, reply.pdu) == expected
    closed = {n for n in range(8) if device.is_closed(n)}
    assert closed == ({0, 1} if frame["name"] == "outputs_0_and_1_on" else set())


def test_eight_inputs_asked_of_an_e1214_are_an_illegal_address() -> None:
    [frame] = [f for f in FRAMES if f["device"] == "moxa_e1212" and f["name"] == "read_inputs"]
    [request] = MbapReader().feed(raw(frame["request"]))
    assert e1214().request(request.pdu, 0.0) == bytes.fromhex("82 02")


def test_every_golden_frame_of_an_emulated_device_is_played() -> None:
    others = {f["device"] for f in FRAMES} - EMULATED
    assert others == {"moxa_e1241"}, "a device came into the file: emulate it or list it"
    assert set(ROBOTIQ_STATES) <= {f["name"] for f in FRAMES if f["device"] == "robotiq"}
