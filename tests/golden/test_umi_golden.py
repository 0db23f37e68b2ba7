"""The arm's codec against the reference's own bytes: umi_rtx.md 2.2, 2.6, 2.7 and 3.

Sections (§) are those of umi_rtx.md.
"""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import PositionLostError, RefusedError
from drivers.umi_scara.protocol import codec
from drivers.umi_scara.protocol.constants import Drive, Ip, Mode, Parameter, Simple

GOLDEN: dict[str, Any] = tomllib.loads((Path(__file__).parent / "umi_rtx.toml").read_text())
EXCHANGES = [
    pytest.param(exchange, id=f"{session['section']} {session['name']} {number}")
    for session in GOLDEN["session"]
    for number, exchange in enumerate(session["exchange"])
]


def _bytes(text: str) -> bytes:
    return bytes.fromhex(text)


def every_request_of_the_encoders() -> set[bytes]:
    """All requests that carry no 16-bit value, and the value-carrying ones of the sessions."""
    requests = {codec.encode_simple(command) for command in Simple}
    drives = [Drive.HOLD, Drive.FORWARD, Drive.REVERSE]
    for ctl in range(5):
        requests.add(codec.encode_controller_status(ctl))
        requests |= {codec.encode_mode(mode, ctl) for mode in Mode}
        requests |= {codec.encode_manual_go({ctl: drive}) for drive in drives}
        for value in (0, 30, 1000, 459, 2630, -18, -2629, -1947, -3101):
            requests.add(codec.encode_immediate_write(ctl, value))
            requests |= set(codec.encode_deferred_write(Parameter.SPEED, ctl, value))
            requests |= set(codec.encode_deferred_write(Parameter.NEW_POSITION, ctl, value))
            requests |= set(codec.encode_deferred_write(Parameter.MAX_FORCE, ctl, value))
        for parameter in Parameter:
            if parameter in (Parameter.CP_ERROR, Parameter.CURRENT_POSITION):
                requests.add(codec.encode_immediate_read(parameter, ctl))
            else:
                requests |= set(codec.encode_deferred_read(parameter, ctl))
    for mask in range(1, 32):
        requests.add(codec.encode_numeric_go(ctl for ctl in range(5) if mask >> ctl & 1))
    return requests


@pytest.mark.parametrize("exchange", EXCHANGES)
def test_every_reply_of_the_worked_sessions_reads_as_one(exchange: dict[str, Any]) -> None:
    request, reply = _bytes(exchange["request"]), _bytes(exchange["reply"])
    if len(request) != codec.request_length(request[0]):
        assert (exchange["request"], exchange["reply"]) == ("7A 18", "0B")  # §3.9, cut on purpose
        request += b"\x00"
    reader = codec.ReplyReader(request)
    if reply == b"\x0f":
        with pytest.raises(PositionLostError):
            reader.feed(reply)
    elif len(reply) == 1 and 0 < reply[0] < 0x0E:
        with pytest.raises(RefusedError) as refusal:
            reader.feed(reply)
        assert refusal.value.code == reply[0]
    else:
        for cut in range(len(reply)):
            assert codec.ReplyReader(request).feed(reply[:cut]) is None
        assert reader.feed(reply) is not None


def test_the_encoders_can_say_every_request_of_the_worked_sessions() -> None:
    known = every_request_of_the_encoders()
    foreign_dialect = {bytes.fromhex("62 04 CC")}  # §2.5: iLab's and BS's frame 1
    cut_short = {bytes.fromhex("7A 18")}  # §3.9
    for session in GOLDEN["session"]:
        for exchange in session["exchange"]:
            request = _bytes(exchange["request"])
            assert request in known | foreign_dialect | cut_short, exchange


def test_the_sessions_are_all_there() -> None:
    assert {session["section"] for session in GOLDEN["session"]} == {
        f"3.{number}" for number in range(1, 10)
    }


@pytest.mark.parametrize("row", GOLDEN["checksum"], ids=lambda row: str(row["value"]))
def test_checksum_and_byte_order_are_the_tables(row: dict[str, Any]) -> None:
    assert codec.checksum(row["value"]) == row["checksum"]
    assert codec.encode_immediate_write(0, row["value"])[1:] == _bytes(row["data"])
    reply = bytes([0x80 | row["checksum"]]) + _bytes(row["data"])
    request = codec.encode_immediate_read(Parameter.CURRENT_POSITION, 2)
    assert codec.ReplyReader(request).feed(reply) == codec.Value(row["value"])


@pytest.mark.parametrize("row", GOLDEN["manual_go"], ids=lambda row: row["wanted"])
def test_manual_go_is_the_tables(row: dict[str, Any]) -> None:
    drives = {ctl: Drive[name.upper()] for ctl, name in enumerate(row["ctl"])}
    assert codec.encode_manual_go(drives) == _bytes(row["request"])


@pytest.mark.parametrize("row", GOLDEN["numeric_go"], ids=lambda row: row["wanted"])
def test_numeric_go_is_the_tables(row: dict[str, Any]) -> None:
    assert codec.encode_numeric_go(row["ctl"]) == _bytes(row["request"])


@pytest.mark.parametrize("row", GOLDEN["interpolation"], ids=lambda row: row["request"])
def test_interpolation_is_the_examples(row: dict[str, Any]) -> None:
    increments = dict(enumerate(row["increments"]))
    assert codec.encode_interpolation(increments) == _bytes(row["request"])


def test_typed_values_of_the_cold_open_and_the_zed_session() -> None:
    version = codec.encode_simple(Simple.VERSION)
    assert codec.ReplyReader(version).feed(_bytes("21 02 03")) == codec.Version(Ip.ARM, 2, 3)
    identify = codec.encode_simple(Simple.IDENTIFY)
    assert codec.ReplyReader(identify).feed(_bytes("20")) == codec.Identity(Ip.WRIST)
    select, read = codec.encode_deferred_read(Parameter.NEW_POSITION, 2)
    assert (select, read) == (_bytes("60 03 00"), _bytes("6A"))
    assert codec.ReplyReader(read).feed(_bytes("DA 18 FC")) == codec.Value(-1000)
