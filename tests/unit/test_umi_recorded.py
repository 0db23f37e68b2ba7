"""The arm as a recording: what is read follows the recording's time, orders have to be its own.

Requests and replies are written from umi_rtx.md 2: `29` hands the line over, `01` asks who listens,
`12` is the status of controller 2 (bit 0: it moves), `4A` its position, `60` selects what `6A`
reads, `A4` starts controller 2, `24` stops dead, `00` is GO after a restart (answered `0F` before).
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.clock import CellClock
from drivers.errors import LinkError, UnpluggedError
from drivers.umi_scara.line import Exchanged, RecordedArm, RecordedLine, RecordedTransport
from drivers.wire_file import WireWriter


def said(at_s: float, request: str, reply: str) -> Exchanged:
    return Exchanged(at_s, bytes.fromhex(request), bytes.fromhex(reply), 0.003)


BEGIN = (said(10.0, "01", "20"), said(10.1, "4A", "80 00 00"))
MOVE = (
    *BEGIN,
    said(20.0, "A4", "A4"),
    said(20.1, "12", "12 01 00"),
    said(20.5, "4A", "8A 0A 00"),
    said(21.0, "12", "12 01 00"),
    said(21.5, "12", "12 00 00"),
    said(21.6, "4A", "84 14 00"),
)
REVERSE = (*MOVE, said(30.0, "A2", "A2"))


def asked(line: RecordedLine, now_s: float, request: str) -> str:
    return line.answer(bytes.fromhex(request), now_s)[0].hex(" ").upper()


def begun(exchanges: tuple[Exchanged, ...]) -> RecordedLine:
    line = RecordedLine(exchanges, "run.wires")
    assert asked(line, 0.0, "01") == "20"
    return line


@pytest.mark.parametrize(
    ("after_s", "status", "position"),
    [
        (0.0, "12 01 00", "8A 0A 00"),  # nothing yet: the first one after the order
        (0.6, "12 01 00", "8A 0A 00"),
        (1.45, "12 01 00", "8A 0A 00"),
        (1.55, "12 00 00", "8A 0A 00"),
        (1.7, "12 00 00", "84 14 00"),
        (99.0, "12 00 00", "84 14 00"),  # at rest for as long as no order comes
    ],
)
def test_what_is_read_follows_the_time_since_the_last_order(
    after_s: float, status: str, position: str
) -> None:
    line = begun(REVERSE)
    assert asked(line, 5.0, "A4") == "A4"
    for _ in range(3):  # however often
        assert asked(line, 5.0 + after_s, "12") == status
        assert asked(line, 5.0 + after_s, "4A") == position


def test_before_an_order_comes_what_follows_it_is_not_known() -> None:
    line = begun(MOVE)
    assert asked(line, 1e6, "4A") == "80 00 00"
    with pytest.raises(UnpluggedError, match="no answer of IP0 to 4B"):
        asked(line, 0.0, "4B")


def test_an_order_that_is_not_the_recorded_one_ends_it_with_both() -> None:
    line = begun(REVERSE)
    with pytest.raises(UnpluggedError, match=r"IP0 is sent A8; the recording has A4 there.*20\.00"):
        asked(line, 1.0, "A8")
    asked(line, 1.0, "A4")
    asked(line, 9.0, "A2")
    with pytest.raises(UnpluggedError, match="has ended, and IP0 is sent A4"):
        asked(line, 20.0, "A4")


def test_an_order_to_the_other_board_is_another_order() -> None:
    line = begun((*MOVE[:-1], said(22.0, "29", "00"), said(22.1, "01", "21")))
    assert asked(line, 0.0, "29") == "00"
    assert asked(line, 0.0, "01") == "21"
    with pytest.raises(UnpluggedError, match="ended, and IP1 is sent A4"):
        asked(line, 0.0, "A4")
    assert asked(line, 0.0, "29") == "00"
    assert asked(line, 0.0, "A4") == "A4"


def test_which_board_gets_its_order_first_does_not_matter() -> None:
    both = (
        *BEGIN,
        said(11.0, "A4", "A4"),
        said(11.1, "29", "00"),
        said(11.2, "A2", "A2"),
        said(11.3, "12", "12 00 00"),
    )
    line = begun(both)
    asked(line, 0.0, "29")
    assert asked(line, 0.0, "A2") == "A2"
    asked(line, 0.0, "29")
    assert asked(line, 0.0, "A4") == "A4"
    asked(line, 0.0, "29")
    assert asked(line, 0.5, "12") == "12 00 00"


def test_who_heard_the_first_requests_is_known_from_who_is_named_later() -> None:
    # two hand-overs before anybody is named as IP1: so IP1 heard the first request
    line = RecordedLine(
        (
            said(0.0, "4A", "80 00 00"),
            said(0.1, "29", "00"),
            said(0.2, "29", "00"),
            said(0.3, "01", "21"),
        ),
        "run.wires",
    )
    assert asked(line, 0.0, "01") == "21"
    assert asked(line, 0.0, "4A") == "80 00 00"


def test_a_stop_of_ones_own_freezes_what_is_read() -> None:
    line = begun(REVERSE)
    asked(line, 5.0, "A4")
    assert asked(line, 5.6, "24") == "00"
    assert asked(line, 50.0, "4A") == "8A 0A 00"
    assert asked(line, 50.0, "12") == "12 01 00"
    assert asked(line, 60.0, "A2") == "A2"  # and the run may go on


def test_a_recorded_stop_may_be_left_out() -> None:
    line = begun((*MOVE, said(22.0, "24", "00"), said(22.5, "25", "00"), said(30.0, "A2", "A2")))
    asked(line, 0.0, "A4")
    assert asked(line, 9.0, "A2") == "A2"


def test_a_deferred_read_answers_for_what_was_selected() -> None:
    line = begun(
        (
            *BEGIN,
            said(11.0, "60 02 00", "C0"),
            said(11.1, "6A", "D5 E8 03"),
            said(11.2, "60 04 00", "C0"),
            said(11.3, "6A", "D2 64 00"),
        )
    )
    assert asked(line, 9.0, "60 04 00") == "C0"
    assert asked(line, 9.0, "6A") == "D2 64 00"
    asked(line, 9.0, "60 02 00")
    assert asked(line, 9.0, "6A") == "D5 E8 03"


def test_a_board_that_had_restarted_is_so_until_it_is_given_go_and_not_again() -> None:
    line = RecordedLine(
        (
            said(1.0, "14", "0F"),
            said(1.1, "28", "0F"),
            said(1.2, "00", "00"),
            said(1.3, "01", "20"),
            said(1.4, "14", "14 00 00"),
        ),
        "run.wires",
    )
    for request in ("14", "28", "29", "01"):
        assert asked(line, 0.0, request) == "0F"
    assert asked(line, 0.1, "00") == "00"
    assert asked(line, 0.1, "28") == "00"
    assert asked(line, 0.5, "14") == "14 00 00"
    assert asked(line, 90.0, "28") == "00"  # opened once more, it has not restarted


async def test_replies_take_as_long_as_they_took() -> None:
    exchanges = (said(1.0, "01", "20"), Exchanged(2.0, b"\x4a", b"\x80\x00\x00", 3600.0))
    transport = RecordedTransport(RecordedLine(exchanges, "run.wires"), CellClock())
    transport.write(b"\x4a")
    assert await transport.read(0.0) == b""
    transport.write(b"\x01")
    assert await transport.read(60.0) == b"\x20"
    await transport.aclose()
    with pytest.raises(UnpluggedError, match="closed"):
        await transport.read(0.0)


async def test_a_read_that_waits_ends_with_the_line() -> None:
    transport = RecordedTransport(RecordedLine(BEGIN, "run.wires"), CellClock())
    waiting = asyncio.create_task(transport.read(3600.0))
    await asyncio.sleep(0)
    await transport.aclose()
    with pytest.raises(UnpluggedError, match="closed"):
        await waiting


async def test_a_file_without_this_arm_and_no_file_are_named(tmp_path: Path) -> None:
    path = tmp_path / "run.wires"
    with pytest.raises(LinkError, match=r"run\.wires: No such file"):
        RecordedArm(path, "arm", CellClock()).open()
    path.write_text("no wires")
    with pytest.raises(LinkError, match="no file that `cellctl run --record` writes"):
        RecordedArm(path, "arm", CellClock()).open()
    path.unlink()
    writer = WireWriter(path)
    writer.write(1.0, "crane", "sent", None, b"\x01")
    writer.write(1.1, "crane", "got", None, b"\x20")
    writer.close()
    with pytest.raises(LinkError, match="no arm was recorded as `arm`"):
        RecordedArm(path, "arm", CellClock()).open()
    transport = RecordedArm(path, "crane", CellClock()).open()
    transport.write(b"\x01")
    assert await transport.read(60.0) == b"\x20"
    await transport.aclose()
