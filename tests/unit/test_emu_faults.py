"""Every verb of the control port acts: seen in what a driver or a person would notice."""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emu_faults_bench import AT_REST_MM, BYTE_S, ROOT, StillCell
from numpy.typing import NDArray

from emulators.umi_scara import Axis
from emulators.world.chain import TCP
from emulators.world.poses import forward

Array = NDArray[np.float64]

IDENT = b"\x00"  # umi_rtx.md 2.3: an IP answers 20 or 21 with its number
IDENTIFIED = b"\x20"
READ_3 = bytes((0x03, 0x07, 0xD0, 0x00, 0x03))  # modbus_devices.md 2.7
READ_INPUTS = bytes((0x02, 0x00, 0x00, 0x00, 0x06))
READ_VERSION = bytes((0x03, 0x80, 0x00, 0x00, 0x01))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("cell")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture
def cell(folder: Path) -> Iterator[StillCell]:
    cell = StillCell(folder)
    cell.arm_reply(IDENT)  # the first byte after power-up acknowledges the restart
    cell.signals.is_operator_acknowledging = False
    yield cell
    cell.desk.close()
    cell.world.close()
    cell.clock.close()


def gripper_status(cell: StillCell) -> tuple[int, int] | None:
    """Return gSTA and gFLT, None without an answer; modbus_devices.md 2.3."""
    reply = cell.gripper_bus.request(cell.gripper.unit, READ_3, 0.0)
    return None if reply is None else (reply.pdu[2] >> 4 & 3, reply.pdu[4])


def write_gripper(cell: StillCell, action: int, position: int = 0) -> None:
    pdu = bytes((0x10, 0x03, 0xE8, 0, 3, 6, action, 0, 0, position, 255, 255))
    assert cell.gripper_bus.request(cell.gripper.unit, pdu, 0.0) is not None


def activate(cell: StillCell) -> None:
    write_gripper(cell, 0)
    write_gripper(cell, 1)
    cell.pass_time(3.0)
    assert gripper_status(cell) == (3, 0x09)  # nothing heard for a second, modbus_devices.md 2.4
    cell.pass_time(0.1)
    assert gripper_status(cell) == (3, 0)


def inputs(cell: StillCell) -> int | None:
    reply = cell.io_bus.request(1, READ_INPUTS, 0.0)
    return None if reply is None else reply.pdu[-1]


def version(cell: StillCell, unit: int) -> bytes | None:
    reply = cell.lights_bus.request(unit, READ_VERSION, 0.0)
    return None if reply is None else reply.pdu


def light(cell: StillCell, name: str) -> float:
    lamp = cell.lamps[name]
    relays: Any = cell.lamp_modules["relays"]
    relays._switch(lamp.wiring.relay_channel, is_closed=True)
    cell.lamp_modules["dimmer"].request(
        bytes((0x06, 0, lamp.wiring.analog_channel, 0x27, 0x10)), 0.0
    )
    for _ in range(30):
        lamp.advance(0.01)
    return lamp.level


def true_counts(cell: StillCell, axis: Axis) -> float:
    return cell.arm.axes[axis].position


def drive_zed(cell: StillCell) -> float:
    """Return how far zed gets in half a second of manual go."""
    before = true_counts(cell, Axis.ZED)
    cell.arm.set_power(1, True)
    cell.arm.go_manual(1, [0, 0, 2, 0, 0])
    cell.pass_time(0.5)
    return before - true_counts(cell, Axis.ZED)


@dataclass(frozen=True)
class Acts:
    """One order, and what is seen before and after it.

    `before` and `after` are values of `seen`; a verb that did nothing would leave `before`.
    """

    verb: str
    order: dict[str, Any]
    seen: Callable[[StillCell], Any]
    before: Any
    after: Any
    first: Callable[[StillCell], Any] = lambda _: None

    def __str__(self) -> str:
        return self.verb + " " + " ".join(str(value) for value in self.order.values())


def custody(cell: StillCell) -> str:
    answer = cell.verbs.do("truth")
    return str(answer["parts"][0]["custody"])


def spot(cell: StillCell) -> tuple[float, float]:
    cell.world.settle()
    x_mm, y_mm = (round(float(v)) for v in cell.centre_mm()[:2])
    return x_mm, y_mm


def missed(cell: StillCell) -> bool:
    cell.jaws.opening_mm = 85.0
    cell.world.advance(1 / 240)
    try:
        cell.hold_block()
    except AssertionError:
        return True
    return False


def unplugged(cell: StillCell) -> bool:
    return not cell.cameras["overhead"].is_plugged


def held(cell: StillCell) -> None:
    cell.hold_block()


def taken(cell: StillCell) -> None:
    cell.hold_block()
    cell.jaws.stop()
    cell.verbs.do("remove")


def in_front_mm(cell: StillCell) -> int:
    return round(float(cell.centre_mm()[1]))


def over_the_tray(cell: StillCell) -> None:
    """Let the gripper hang some 20 mm over the floor of the tray `accept`, without power."""
    cell.arm.place(
        {
            Axis.SHOULDER: 16.2 * 29.221,
            Axis.ELBOW: 89.5 * 14.611,
            Axis.YAW: 0.0,
            Axis.ZED: -718.0 * 3.75,
            Axis.WRIST1: -90.0 * 13.487,
            Axis.WRIST2: -90.0 * 13.487,
        }
    )


def is_in_its_corner(cell: StillCell) -> bool:
    # centre 100, 390, size 150; recipes/cells/emulated.yaml
    tips = forward(cell.layout.arm, cell.arm.joints())[TCP][:3, 3]
    return bool(np.abs(tips - (175.0, 315.0, 0.0)).max() < 0.6)


ACTS = [
    Acts("estop", {"pressed": True}, lambda c: inputs(c) & 1, 1, 0),
    Acts("estop", {"pressed": True}, lambda c: drive_zed(c) > 1.0, True, False),
    Acts(
        "reset",
        {},
        inputs,
        0b110110 & 0b010010,
        0b010011,
        lambda c: [c.verbs.do("estop"), c.verbs.do("estop", pressed=False)],
    ),
    Acts("door", {}, lambda c: inputs(c) >> 1 & 1, 1, 0),
    Acts("supply", {}, lambda c: inputs(c) >> 4 & 1, 1, 0),
    Acts("supply", {}, lambda c: light(c, "table_ring") > 0.9, True, False),
    Acts("acknowledge", {"down": True}, lambda c: inputs(c) >> 5, 0, 1),
    Acts("drop", {"x_mm": 300, "y_mm": -50, "rest": 0}, spot, AT_REST_MM, (300, -50)),
    Acts(
        "place",
        {"T_world_part": [[1, 0, 0, 280], [0, 1, 0, 60], [0, 0, 1, 10.5], [0, 0, 0, 1]]},
        spot,
        AT_REST_MM,
        (280, 60),
    ),
    Acts("shift", {"x_mm": 30, "y_mm": -10, "turn_deg": 40}, spot, AT_REST_MM, (380, 10)),
    Acts("remove", {}, custody, "free", "away"),
    Acts("remove", {}, custody, "fixture", "away", held),
    Acts("put_back", {"gripper": "fixture"}, custody, "away", "fixture", taken),
    Acts(
        "guide", {"tray": "accept", "corner": [1, -1]}, is_in_its_corner, False, True, over_the_tray
    ),
    Acts("lose_part", {"gripper": "fixture"}, custody, "fixture", "free", held),
    Acts("slip", {"gripper": "fixture", "along_mm": -6}, in_front_mm, -340, -346, held),
    Acts("miss", {"gripper": "fixture"}, missed, False, True),
    Acts("arm_line", {"mute": True}, lambda c: c.arm_reply(IDENT), IDENTIFIED, b""),
    Acts("arm_ip", {"ip": 0}, lambda c: c.arm_reply(b"\x10"), b"\x10\x00\x00", b"\x0f"),
    Acts("arm_ip", {"ip": 0, "what": "kill"}, lambda c: c.arm_reply(IDENT), IDENTIFIED, b""),
    Acts(
        "arm_ip",
        {"ip": 0, "what": "revive"},
        lambda c: c.arm_reply(b"\x10"),
        b"",
        b"\x0f",
        lambda c: c.verbs.do("arm_ip", ip=0, what="kill"),
    ),
    Acts("arm_jam", {"axis": "zed"}, lambda c: drive_zed(c) > 1.0, True, False),
    Acts(
        "arm_push",
        {"axis": "zed", "counts": -30},
        lambda c: round(true_counts(c, Axis.ZED) - c.arm.axes[Axis.ZED].origin),
        0,
        -30,
    ),
    Acts(
        "byte",
        {"harm": "lost", "direction": "from", "skip": 1},
        lambda c: c.arm_reply(b"\x10"),
        b"\x10\x00\x00",
        b"\x10\x00",
    ),
    Acts(
        "byte",
        {"harm": "doubled", "direction": "from"},
        lambda c: c.arm_reply(IDENT),
        IDENTIFIED,
        IDENTIFIED * 2,
    ),
    Acts(
        "byte",
        {"harm": "flipped", "direction": "from", "bit": 0},
        lambda c: c.arm_reply(IDENT),
        IDENTIFIED,
        b"\x21",
    ),
    Acts(
        "byte",
        {"harm": "late", "direction": "from", "late_s": 0.2},
        lambda c: c.arm_reply_by(IDENT, 0.1),
        IDENTIFIED,
        b"",
    ),
    Acts(
        "byte", {"harm": "lost", "direction": "to"}, lambda c: c.arm_reply(IDENT), IDENTIFIED, b""
    ),
    Acts(
        "byte",
        {"harm": "doubled", "direction": "to"},
        lambda c: c.arm_reply(IDENT),
        IDENTIFIED,
        IDENTIFIED * 2,
    ),
    Acts(
        "byte",
        {"harm": "flipped", "direction": "to", "bit": 6},
        lambda c: c.arm_reply(IDENT),
        IDENTIFIED,
        b"\x80\x00\x00",
    ),
    Acts(
        "byte",
        {"harm": "late", "direction": "to", "late_s": 0.2},
        lambda c: c.arm_reply_by(IDENT, 0.1),
        IDENTIFIED,
        b"",
    ),
    Acts("byte", {"harm": "flipped", "device": "io"}, lambda c: 0, 0, ValueError),
    Acts(
        "byte",
        {"harm": "flipped", "device": "gripper"},
        lambda c: c.gripper_bus.request(9, READ_3, 0.0).is_sound,
        True,
        False,
    ),
    Acts(
        "byte",
        {"harm": "lost", "device": "relays", "direction": "to"},
        lambda c: version(c, 2) is None,
        False,
        True,
    ),
    Acts(
        "noise",
        {"probability": 1.0, "harms": ["lost"]},
        lambda c: c.arm_reply(IDENT),
        IDENTIFIED,
        b"",
    ),
    Acts(
        "noise",
        {"probability": 1.0, "harms": ["doubled"], "direction": "to"},
        lambda c: c.arm_reply(IDENT),
        IDENTIFIED,
        IDENTIFIED * 2,
    ),
    Acts(
        "line",
        {"device": "io", "exception_code": 4},
        lambda c: c.io_bus.request(1, READ_INPUTS, 0.0).pdu[0],
        0x02,
        0x82,
    ),
    Acts("line", {"device": "gripper", "is_deaf": True}, gripper_status, (0, 0), None),
    Acts(
        "line",
        {"device": "dimmer", "reply_delay_s": 0.7},
        lambda c: c.lights_bus.request(1, READ_VERSION, 0.0).delay_s,
        0.0,
        0.7,
    ),
    Acts(
        "line",
        {"device": "io", "is_connection_dropped": True},
        lambda c: c.io_bus.request(1, READ_INPUTS, 0.0).is_connection_dropped,
        False,
        True,
    ),
    Acts(
        "cut",
        {"line": "io"},
        lambda c: (c.io_network.is_reachable, c.io_network.cut_count),
        (True, 0),
        (False, 1),
    ),
    Acts(
        "cut",
        {"line": "io", "reachable": True},
        lambda c: c.io_network.is_reachable,
        False,
        True,
        lambda c: c.verbs.do("cut", line="io"),
    ),
    Acts("gripper", {"jammed": True}, lambda c: c.jaws.jammed, False, True),
    Acts(
        "lamp",
        {"name": "table_ring", "dead": True},
        lambda c: light(c, "table_ring") > 0.9,
        True,
        False,
    ),
    Acts(
        "lamp",
        {"name": "table_ring", "strength": 0.4},
        lambda c: round(light(c, "table_ring"), 1),
        1.0,
        0.4,
    ),
    Acts(
        "lamp",
        {"name": "table_side", "wire_broken": True},
        lambda c: c.lamps["table_side"].is_dimming_wire_broken,
        False,
        True,
    ),
    Acts(
        "camera",
        {"camera": "overhead", "is_dark": True},
        lambda c: c.cameras["overhead"].faults.is_dark,
        False,
        True,
    ),
    Acts("unplug", {"camera": "overhead"}, unplugged, False, True),
    Acts(
        "plug",
        {"camera": "overhead"},
        unplugged,
        True,
        False,
        lambda c: c.verbs.do("unplug", camera="overhead"),
    ),
    Acts("power", {"device": "arm"}, lambda c: c.arm_reply(IDENT), IDENTIFIED, b""),
    Acts("power", {"device": "gripper"}, gripper_status, (0, 0), None),
    Acts("power", {"device": "dimmer"}, lambda c: version(c, 1) is None, False, True),
    Acts("power", {"device": "relays"}, lambda c: version(c, 2) is None, False, True),
    Acts(
        "power",
        {"device": "io"},
        lambda c: (inputs(c) is None, c.io_network.is_reachable),
        (False, True),
        (True, False),
    ),
    Acts("power", {"device": "overhead"}, unplugged, False, True),
    Acts(
        "power",
        {"device": "all"},
        lambda c: (gripper_status(c), inputs(c), unplugged(c)),
        ((0, 0), 0b010011, False),
        (None, None, True),
    ),
]


def roll_deg(cell: StillCell) -> float:
    """Return where the roll comes to rest that leaves a place upwards and comes back to it."""
    motors = (Axis.WRIST1, Axis.WRIST2)
    at = [cell.arm.axes[one].position for one in motors]
    for off in (40.0, 0.0):
        cell.arm.place({motors[0]: at[0] + off, motors[1]: at[1] - off})
        cell.pass_time(0.05)
    return round(math.degrees(cell.arm.joints().roll_rad), 2)


def jaw_mm(cell: StillCell) -> float:
    cell.arm.place({Axis.GRIPPER: 600.0})
    return round(cell.arm.joints().jaw_opening_mm, 3)


def still_corner(cell: StillCell) -> Array:
    return cell.desk._scene.cameras[0].T_world_cam


OTHERWISE = {  # with a test of their own below
    "arm_stops",
    *("truth", "time", "as_built", "script", "script_log", "gripper_fault", "arm_jump"),
    *("add", "board", "give", "misprint"),  # test_emu_boards.py
    *("knock", "gear_play", "pads", "swap_lamps"),
    "io_watchdog",
}


@pytest.mark.parametrize("acts", ACTS, ids=str)
def test_a_verb_acts(cell: StillCell, acts: Acts) -> None:
    acts.first(cell)
    if acts.after is ValueError:
        with pytest.raises(ValueError, match="no byte"):
            cell.verbs.do(acts.verb, **acts.order)
        return
    if acts.verb not in ("miss", "drop", "place", "shift"):
        assert acts.seen(cell) == acts.before
    cell.verbs.do(acts.verb, **acts.order)
    assert acts.seen(cell) == acts.after
    assert acts.before != acts.after


@pytest.mark.parametrize("verb", ["miss", "drop", "shift"])
def test_without_the_verb_all_is_as_before(cell: StillCell, verb: str) -> None:
    acts = next(one for one in ACTS if one.verb == verb)
    assert acts.seen(cell) == acts.before


def test_the_stops_that_the_arm_has_heard_are_asked_for(cell: StillCell) -> None:
    cell.rtx.wire.run_warm()
    assert cell.verbs.do("arm_stops")["stops"] == []
    cell.rtx.wire.feed(b"\x24", 5.0)
    (stop,) = cell.verbs.do("arm_stops")["stops"]
    assert (stop["ip"], stop["kind"]) == (0, "dead")
    assert stop["at_s"] == pytest.approx(5.0 + BYTE_S)


def test_the_loss_of_motor_supply_is_dated(cell: StillCell) -> None:
    cell.advance()
    cell.verbs.do("estop", pressed=True)
    at_s = cell.now_s
    cell.advance()
    (change,) = cell.verbs.do("arm_stops")["supply"]
    assert not change["on"]
    assert at_s <= change["at_s"] <= cell.now_s


def test_a_watchdog_is_switched_off_or_its_relay_bridged(cell: StillCell) -> None:
    cell.verbs.do("io_watchdog", off=True)
    assert (cell.io.is_watchdog_off, cell.io.is_motor_relay_bridged) == (True, False)
    cell.verbs.do("io_watchdog", bridged=True)
    assert (cell.io.is_watchdog_off, cell.io.is_motor_relay_bridged) == (False, True)


def test_every_verb_has_a_test_and_a_row_in_the_table(cell: StillCell) -> None:
    assert {acts.verb for acts in ACTS} | OTHERWISE == set(cell.verbs.names)
    page = (ROOT / "docs" / "emulator-faults.md").read_text()
    tables = page.split("| verb |")[1:]
    rows = [
        name
        for table in tables
        for name in re.findall(r"^\| `(\w+)` \|", table.split("\n\n")[0], re.M)
    ]
    assert sorted(rows) == sorted(cell.verbs.names)


def test_a_worn_gear_lags_by_half_its_play_where_it_is_left(cell: StillCell) -> None:
    before = roll_deg(cell)
    for axis in ("wrist1", "wrist2"):
        cell.verbs.do("gear_play", axis=axis, deg=1.0)
    # the motors came back from opposite sides: one far side is 0.5 deg ahead, one behind, and
    # the roll is half their difference
    assert roll_deg(cell) - before == pytest.approx(0.5, abs=0.02)
    with pytest.raises(ValueError, match="does not turn"):
        cell.verbs.do("gear_play", axis="zed", deg=1.0)


def test_thinner_pads_leave_the_jaws_wider_open(cell: StillCell) -> None:
    before = jaw_mm(cell)
    cell.verbs.do("pads", thinner_mm=1.5)
    assert jaw_mm(cell) - before == pytest.approx(3.0)


def test_swapped_lamps_answer_to_each_others_outputs(cell: StillCell) -> None:
    assert light(cell, "table_ring") > 0.9
    was = cell.lamps["table_ring"].wiring, cell.lamps["table_side"].wiring
    cell.verbs.do("swap_lamps", one="table_ring", other="table_side")
    now = cell.lamps["table_side"].wiring, cell.lamps["table_ring"].wiring
    assert [(a.analog_channel, a.relay_channel) for a in was] == [
        (b.analog_channel, b.relay_channel) for b in now
    ]
    for _ in range(30):
        cell.lamps["table_side"].advance(0.01)
    assert cell.lamps["table_side"].level > 0.9  # of the ring's output, which is on


def test_a_knocked_camera_stands_elsewhere(cell: StillCell) -> None:
    before = still_corner(cell)
    cell.verbs.do("knock", camera="overhead", mm=[3.0, 0.0, 4.0])
    moved = still_corner(cell)
    assert np.linalg.norm(moved[:3, 3] - before[:3, 3]) == pytest.approx(5.0)
    cell.verbs.do("knock", camera="overhead", turn_deg=[0.0, 0.0, 90.0])
    assert still_corner(cell)[:3, 0] == pytest.approx(moved[:3, 1])
    with pytest.raises(KeyError):
        cell.verbs.do("knock", camera="side", mm=[1, 0, 0])
    with pytest.raises(ValueError, match="three numbers"):
        cell.verbs.do("knock", camera="overhead", mm=[1, 0])


def test_an_encoder_that_jumps_leaves_the_counter_and_moves_the_axis(cell: StillCell) -> None:
    zed = cell.arm.axes[Axis.ZED]
    cell.arm.set_power(1, True)
    before, counter = zed.position, zed.counter
    cell.verbs.do("arm_jump", axis="zed", counts=50)
    assert zed.error == -50  # umi_rtx.md 2.5: counter less encoder
    cell.pass_time(1.0)
    assert abs(zed.error) <= 2  # within the dead band
    assert zed.counter == counter
    assert zed.position == pytest.approx(before - 50.0, abs=2.5)


def test_an_encoder_that_jumps_too_far_trips_the_axis(cell: StillCell) -> None:
    cell.arm.set_power(1, True)
    cell.verbs.do("arm_jump", axis="zed", counts=1200)
    cell.pass_time(0.1)
    assert cell.arm.axes[Axis.ZED].is_error_exceeded  # umi_rtx.md 2.5: ERROR_LIMIT is 1000


@pytest.mark.parametrize("code", [0x0A, 0x0C, 0x0D, 0x0E])
def test_a_major_fault_of_the_gripper_stays_until_it_is_activated_anew(
    cell: StillCell, code: int
) -> None:
    activate(cell)
    cell.verbs.do("gripper_fault", code=code)
    assert gripper_status(cell) == (3, code)
    write_gripper(cell, 9, 255)
    cell.pass_time(1.0)
    assert gripper_status(cell) == (3, code)
    assert cell.jaws.opening_mm == pytest.approx(85.0, abs=0.1)
    activate(cell)


def test_a_gripper_that_delays_does_later_what_it_was_sent(cell: StillCell) -> None:
    activate(cell)
    cell.verbs.do("gripper_fault", code=0x05)
    write_gripper(cell, 9, 255)
    cell.pass_time(1.0)
    assert gripper_status(cell) == (3, 0x05)
    assert cell.jaws.opening_mm == pytest.approx(85.0, abs=0.1)
    cell.pass_time(3.0)
    assert gripper_status(cell) == (3, 0x09)  # idle for more than a second, modbus_devices.md 2.4
    assert gripper_status(cell) is not None
    assert cell.jaws.opening_mm < 1.0


def test_a_gripper_that_lost_its_activation_takes_no_order_and_keeps_its_jaws(
    cell: StillCell,
) -> None:
    activate(cell)
    cell.verbs.do("gripper_fault", code=0x07)
    assert gripper_status(cell) == (0, 0x07)
    write_gripper(cell, 9, 255)
    cell.pass_time(2.0)
    assert cell.jaws.opening_mm == pytest.approx(85.0, abs=0.1)
    activate(cell)


def test_a_hot_gripper_cools_and_a_deaf_one_recovers_by_the_next_message(cell: StillCell) -> None:
    activate(cell)
    cell.verbs.do("gripper_fault", code=0x08)
    assert gripper_status(cell) == (3, 0x08)
    cell.verbs.do("gripper_fault", code=0x00)
    assert gripper_status(cell) == (3, 0x00)
    cell.verbs.do("gripper_fault", code=0x09)
    assert gripper_status(cell) == (3, 0x09)
    cell.pass_time(0.1)
    assert gripper_status(cell) == (3, 0x00)


def test_an_automatic_release_opens_and_a_finished_one_keeps_what_is_held(
    cell: StillCell,
) -> None:
    cell.hold_block()
    cell.verbs.do("gripper_fault", code=0x0F)
    assert gripper_status(cell) == (0, 0x0F)
    cell.pass_time(1.0)
    assert custody(cell) == "fixture"
    cell.verbs.do("gripper_fault", code=0x00)
    cell.gripper.request(bytes((0x10, 0x03, 0xE8, 0, 3, 6, 0, 0, 0, 0, 0, 0)), 0.0)
    cell.verbs.do("gripper_fault", code=0x0B)
    assert gripper_status(cell) == (0, 0x0B)
    cell.pass_time(6.0)
    assert gripper_status(cell) == (0, 0x0F)
    assert custody(cell) == "free"


def test_an_unknown_code_of_the_gripper_is_refused(cell: StillCell) -> None:
    with pytest.raises(ValueError, match="17"):
        cell.verbs.do("gripper_fault", code=0x11)


def test_an_arm_without_power_is_limp_and_comes_back_with_counters_at_zero(
    cell: StillCell,
) -> None:
    zed = cell.arm.axes[Axis.ZED]
    cell.arm.set_power(1, True)
    zed.label(700)
    assert zed.counter == 700
    before = zed.position
    cell.verbs.do("power", device="arm")
    assert cell.arm.power_on == [False, False]
    cell.verbs.do("power", device="arm", on=True)
    assert (zed.counter, zed.position) == (0, before)
    assert cell.arm_reply(b"\x10") == b"\x0f"  # umi_rtx.md 2.9: restarted
    assert cell.arm.power_on == [False, False]


def test_a_gripper_keeps_its_part_without_power_and_wants_activation_after_it(
    cell: StillCell,
) -> None:
    cell.hold_block()
    cell.verbs.do("power", device="gripper")
    cell.pass_time(1.0)
    assert custody(cell) == "fixture"
    cell.verbs.do("power", device="gripper", on=True)
    assert gripper_status(cell) == (0, 0)


def test_lamps_come_back_dark(cell: StillCell) -> None:
    assert light(cell, "table_ring") > 0.9
    for device in ("dimmer", "relays"):
        cell.verbs.do("power", device=device)
        cell.verbs.do("power", device=device, on=True)
    cell.pass_time(0.2)
    assert cell.lamps["table_ring"].level == 0.0
    assert version(cell, 1) == version(cell, 2) == b"\x03\x02\x00\x64"


def test_a_part_is_not_put_back_between_jaws_that_have_moved(cell: StillCell) -> None:
    taken(cell)
    cell.jaws.opening_mm += 2.0
    cell.world.advance(1 / 240)
    with pytest.raises(ValueError, match="moved"):
        cell.verbs.do("put_back", gripper="fixture")


def test_an_order_that_makes_no_sense_is_an_answer(cell: StillCell) -> None:
    for line in (b"", b"[]", b"{}", b"nonsense", b'{"do": "fly"}', b'{"do": "lamp"}', b"[" * 10**5,
                 b'{"do": "power", "device": "moon"}', b'{"do": "byte", "harm": "eaten"}',
                 b'{"do": "noise", "probability": 2}', b'{"do": "cut", "line": "gripper"}',
                 b'{"do": "lamp", "name": "table_ring", "strength": 9}'):  # fmt: skip
        answer = cell.verbs.obey(line)
        assert answer["ok"] is False, line
        assert answer["error"]


# --- scripts ----------------------------------------------------------------------------------


def done(cell: StillCell) -> list[tuple[int, str]]:
    return [(one["step"], one["order"]["do"]) for one in cell.verbs.do("script_log")["done"]]


def test_steps_of_a_script_come_at_their_instants(cell: StillCell) -> None:
    steps = [{"at_s": 0.5, "do": "door"}, {"at_s": 0.2, "do": "arm_line", "mute": True}]
    cell.verbs.do("script", steps=steps)
    cell.pass_time(0.3)
    assert done(cell) == [(1, "arm_line")]
    assert inputs(cell) >> 1 & 1 == 1
    cell.pass_time(0.3)
    assert done(cell) == [(1, "arm_line"), (0, "door")]
    assert inputs(cell) >> 1 & 1 == 0


def test_a_step_befalls_each_event_with_its_probability(cell: StillCell) -> None:
    step = {"when": "gripped", "by": "fixture", "after_s": 0.5, "do": "lose_part"}
    cell.verbs.do("script", steps=[{**step, "gripper": "fixture", "times": 1}])
    cell.hold_block()
    assert custody(cell) == "fixture"
    cell.pass_time(0.5)
    assert custody(cell) == "free"
    cell.jaws.opening_mm = 85.0
    cell.world.advance(1 / 240)
    cell.hold_block()
    cell.pass_time(1.0)
    assert custody(cell) == "fixture"  # once was enough
    assert done(cell) == [(0, "lose_part")]


def test_a_seed_gives_the_same_faults_again_and_another_one_others(cell: StillCell) -> None:
    steps = [{"at_s": [0.0, 50.0], "probability": 0.5, "do": "arm_ip", "ip": 0} for _ in range(40)]

    def drawn(seed: int) -> list[float]:
        due: list[float] = cell.verbs.do("script", steps=steps, seed=seed)["due_s"]
        return due

    assert drawn(7) == drawn(7) != drawn(8)
    assert 10 <= len(drawn(7)) <= 30
    longer = cell.verbs.do("script", steps=[*steps, steps[0]], seed=7)["due_s"]
    assert set(drawn(7)) <= set(longer)  # a step that is added moves no other


def test_a_step_again_and_again(cell: StillCell) -> None:
    cell.verbs.do("script", steps=[{"every_s": 0.1, "times": 4, "do": "door"}])
    cell.pass_time(1.0)
    assert done(cell) == [(0, "door")] * 4


def test_a_step_that_does_not_fit_the_moment_is_in_the_log(cell: StillCell) -> None:
    cell.verbs.do("script", steps=[{"at_s": 0.0, "do": "put_back", "gripper": "fixture"}])
    cell.pass_time(0.1)
    (entry,) = cell.verbs.do("script_log")["done"]
    assert "has not lost part 0" in entry["error"]


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ({"do": "door"}, "at_s, every_s, when"),
        ({"at_s": 1, "when": "lies", "do": "door"}, "at_s, every_s, when"),
        ({"at_s": 1, "do": "fly"}, "'fly'"),
        ({"at_s": 1, "do": "script"}, "'script'"),
        ({"at_s": -1, "do": "door"}, "at_s"),
        ({"at_s": [2, 1], "do": "door"}, "at_s"),
        ({"at_s": "soon", "do": "door"}, "at_s"),
        ({"every_s": 0, "do": "door"}, "every"),
        ({"when": "full moon", "do": "door"}, "full moon"),
        ({"at_s": 1, "probability": 2, "do": "door"}, "probability"),
        ({"at_s": 1, "times": -1, "do": "door"}, "times"),
        ("door", "object"),
    ],
)
def test_a_script_that_makes_no_sense_is_refused_whole(
    cell: StillCell, step: Any, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        cell.verbs.do("script", steps=[{"at_s": 0.0, "do": "door"}, step])
    cell.pass_time(0.1)
    assert done(cell) == []


def test_an_arm_whose_motors_hold_cannot_be_guided(cell: StillCell) -> None:
    over_the_tray(cell)
    cell.arm.power_on[:] = [True, True]
    with pytest.raises(ValueError, match=r"the finger tips stay .* mm off: motors hold the arm"):
        cell.faults.do("guide", tray="accept", corner=[1, -1])
    assert not is_in_its_corner(cell)


def test_a_guided_arm_as_built_is_set_down_where_its_tips_are_seen(folder: Path) -> None:
    cell = StillCell(folder, as_built=4)
    over_the_tray(cell)
    before = forward(cell.layout.arm, cell.arm.joints())[TCP][:3, 3]
    assert before[2] > 5.0
    cell.faults.do("guide")
    after = forward(cell.layout.arm, cell.arm.joints())[TCP][:3, 3]
    np.testing.assert_allclose(after[:2], before[:2], atol=0.1)
    assert 0.0 < after[2] < 0.6
    cell.desk.close()
    cell.world.close()
    cell.clock.close()
