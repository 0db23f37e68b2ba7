"""Faults of the line, the boards and the supply, as ordinary inputs. umi_rtx.md 7, 8."""

import pytest
from emu_umi_line import Line

from emulators.umi_scara import ArmModel, ArmWire, Axis


def checksum_fits(reply: str) -> bool:
    first, low, high = (int(byte, 16) for byte in reply.split())
    folded = low ^ high
    return first & 0x0F == (folded >> 4) ^ (folded & 0x0F)


@pytest.mark.parametrize(("index", "left"), [(0, "18 fc"), (1, "8a fc"), (2, "8a 18")])
def test_one_reply_byte_gets_lost(index: int, left: str) -> None:
    line = Line(listening=1)
    line.label(Axis.ZED, -1000)
    line.faults.drop_reply_byte = index
    line.run(("4a", left), ("4a", "8a 18 fc"))


def test_a_lost_byte_of_a_long_reply_waits_for_one() -> None:
    line = Line(listening=1)
    line.faults.drop_reply_byte = 1
    line.run(("01", "21"), ("38", "21 03"), ("38", "21 02 03"))


def test_a_corrupted_read_contradicts_its_checksum_once() -> None:
    line = Line(listening=1)
    line.label(Axis.ZED, -1000)
    line.faults.corrupt_next_read = True
    line.run(("12", "12 00 00"))
    reply = line.ask("4a")
    assert reply != "8a 18 fc"
    assert not checksum_fits(reply)
    line.run(("4a", "8a 18 fc"))


def test_a_corrupted_write_is_acknowledged_with_the_checksum_of_what_arrived() -> None:
    line = Line(listening=1)
    for frame1, frame2, good in (("", "5a 18 fc", "aa"), ("70 03 00", "7a 18 fc", "fa")):
        if frame1:
            line.run((frame1, "e0"))
        line.faults.corrupt_next_write = True
        reply = line.ask(frame2)
        assert reply[0] == good[0]
        assert reply != good
        assert not line.faults.corrupt_next_write


def test_an_ip_that_restarts_in_mid_move_stops_dead_and_knows_nothing() -> None:
    line = Line(listening=1)
    line.model.reference()
    line.drive({Axis.SHOULDER: +1})
    line.pass_time(0.3)
    line.wire.restart(1)
    at = line.model.joints()
    line.run(("11", "0f"))
    line.pass_time(1.0)
    assert line.model.joints() == at
    line.run(("29", "0f"), ("00", "00"), ("49", "80 00 00"), ("17", "17 00 00"))
    assert line.true(Axis.SHOULDER) != 0.0


def test_restarted_may_be_said_as_0e() -> None:
    line = Line(warm=False)
    line.faults.restart_code = 0x0E
    line.run(("28", "0e"), ("01", "0e"), ("00", "00"), ("01", "20"))


def test_the_restart_of_one_ip_leaves_the_other_running() -> None:
    line = Line(listening=1)
    line.drive({Axis.SHOULDER: -1})
    line.wire.restart(0)
    line.run(("11", "11 01 00"), ("29", "00"), ("01", "0f"))


def test_a_dead_ip_is_silent_and_its_motors_do_not_run() -> None:
    line = Line(listening=0)
    line.drive({Axis.WRIST1: -1})
    line.wire.kill(0)
    at = line.model.joints()
    line.run(("01", ""), ("28", ""), ("00", ""), ("70 04 00", ""), ("7a 18", ""))
    line.pass_time(0.5)
    assert line.model.joints() == at
    line.wire.revive(0)
    line.run(("01", "0f"), ("00", "00"), ("01", "20"))


def test_a_line_handed_to_a_dead_ip_falls_silent() -> None:
    line = Line(listening=0)
    line.wire.kill(1)
    line.run(("01", "20"), ("29", "00"), ("01", ""), ("29", ""), ("01", ""))


def test_with_both_boards_dead_there_is_total_silence() -> None:
    line = Line(warm=False)
    line.wire.kill(0)
    line.wire.kill(1)
    line.run(("28", ""), ("28", ""), ("01", ""))


def test_the_emergency_stop_kills_the_motors_but_not_the_ips() -> None:
    line = Line(listening=1)
    line.model.reference()
    line.run(("60 0e 00", "c0"), ("6a", "d1 01 00"), ("17", "17 00 00"))
    line.drive({Axis.SHOULDER: -1})
    line.drive({Axis.WRIST1: +1})
    line.pass_time(0.5)
    line.model.press_estop()
    at = line.model.joints()
    assert line.status(Axis.SHOULDER) & 0x01  # it has not noticed yet
    line.pass_time(0.5)
    assert line.model.joints() == at
    assert line.status(Axis.SHOULDER) == 0x0A
    assert line.status(Axis.WRIST1) == 0x0A
    line.on(1).run(("60 0e 00", "c0"), ("6a", "d0 00 00"), ("17", "17 1a 00"), ("17", "17 0a 00"))
    assert line.counter(Axis.SHOULDER) == round(line.true(Axis.SHOULDER))  # no position was lost


def test_after_the_emergency_stop_nothing_moves_until_27() -> None:
    line = Line(listening=1)
    line.model.reference()
    line.model.press_estop()
    line.run(("27", "00"), ("80 10 00", "00"))  # power that is not there cannot be allowed
    at = line.model.joints()
    line.pass_time(0.5)
    assert line.model.joints() == at
    line.model.release_estop()
    line.run(("60 0e 00", "c0"), ("6a", "d1 01 00"), ("80 10 00", "00"))
    line.pass_time(0.5)
    assert line.model.joints() == at
    line.run(("27", "00"))
    line.pass_time(0.5)
    assert line.model.joints() == at
    line.run(("80 10 00", "00"))
    line.pass_time(0.5)
    assert line.model.joints().zed_mm > at.zed_mm


def test_a_jammed_axis_stalls_both_ways() -> None:
    line = Line(listening=1)
    line.model.jam(Axis.ELBOW)
    at = line.true(Axis.ELBOW)
    for direction in (+1, -1):
        line.drive({Axis.ELBOW: direction})
        line.wait_for(3, 1, Axis.ELBOW, limit_s=1.0)
        assert line.true(Axis.ELBOW) == at


def test_sticky_03_refuses_every_numeric_go_and_moves_nothing() -> None:
    line = Line(listening=1)
    line.write(Axis.ZED, 3, -500)
    line.faults.sticky_busy = True
    at = line.model.joints()
    for _ in range(5):
        line.run(("a4", "03"))
        line.pass_time(0.1)
    assert line.model.joints() == at
    line.faults.sticky_busy = False
    line.run(("a4", "00"))


def test_a_reset_that_toggles_hands_the_line_over() -> None:
    line = Line(listening=0)
    line.faults.reset_toggles = True
    line.run(("20", "00"), ("01", "21"), ("20", "00"), ("01", "0f"), ("00", "00"), ("01", "20"))


def test_a_reply_may_be_delayed_and_replies_do_not_overtake_each_other() -> None:
    wire = ArmWire(ArmModel())
    wire.run_warm()
    wire.faults.reply_delay_s = 0.050
    wire.feed(b"\x38", 0.0)
    wire.faults.reply_delay_s = 0.0
    wire.feed(b"\x01", 0.010)
    assert wire.due(0.051) == b""
    assert wire.due(0.060) == bytes.fromhex("20 02 03 20")


def test_a_monitor_rom_talks_in_printable_text() -> None:
    line = Line(warm=False)
    line.faults.monitor_rom = True
    banner = bytes.fromhex(line.ask("28", wait_s=0.5)).decode("ascii")
    assert "MSP" in banner
    assert "1987" in banner
    assert bytes.fromhex(line.ask("01", wait_s=0.5)).decode("ascii") == "ERROR\r\n"


def test_a_power_cycle_forgets_everything_but_where_the_arm_stands() -> None:
    line = Line(listening=1)
    line.label(Axis.ZED, -1000)
    at = line.model.joints()
    line.wire.feed(bytes.fromhex("70 04"), line.now_s)
    line.wire.power_cycle()
    assert line.model.joints() == at
    line.run(("01", "0f"), ("00", "00"), ("01", "20"), ("29", "00"), ("4a", "0f"))
    line.run(("00", "00"), ("4a", "80 00 00"))
