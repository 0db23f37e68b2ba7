"""The driver's bytes are those of the worked sessions, umi_rtx.md 3; golden/umi_rtx.toml."""

from dataclasses import replace

from cross_bench import open_fds
from umi_sessions import COLD_OPEN, HOME_ZED, SESSIONS, Verdict, compare, run_sessions

from drivers.umi_scara import Ip, WireExchange


def as_trace(name: str) -> list[WireExchange]:
    """A trace that is a session's own exchanges."""
    return [
        WireExchange(0.0, Ip(x["ip"]), bytes.fromhex(x["request"]), bytes.fromhex(x["reply"]))
        for x in SESSIONS[name]["exchange"]
    ]


async def test_the_driver_exchanges_the_worked_sessions_byte_for_byte() -> None:
    before = open_fds()
    found = await run_sessions(line="socket")
    assert open_fds() - before == set()
    assert [one.name for one in found] == list(SESSIONS)
    unexplained = {
        one.name: [
            line for line in one.lines if line.verdict in (Verdict.DIFFERENT, Verdict.MISSING)
        ]
        for one in found
    }
    assert not any(unexplained.values()), unexplained
    for one in found:
        if not one.skipped:
            assert one.compared_count == len(SESSIONS[one.name]["exchange"])
            marked = sum(not x["exact"] for x in SESSIONS[one.name]["exchange"])
            assert one.count(Verdict.ILLUSTRATIVE) <= marked
    assert sum(bool(one.skipped) for one in found) == 3


def test_a_session_compared_with_itself_is_equal() -> None:
    for name, session in SESSIONS.items():
        assert compare(name, as_trace(name)).count(Verdict.EQUAL) == len(session["exchange"])


def test_a_wrong_byte_a_wrong_board_and_a_missing_exchange_are_told() -> None:
    trace = as_trace(COLD_OPEN)
    wrong_reply = [*trace[:3], replace(trace[3], reply=b"\x21"), *trace[4:]]
    assert compare(COLD_OPEN, wrong_reply).count(Verdict.DIFFERENT) == 1
    wrong_ip = [*trace[:3], replace(trace[3], ip=Ip.ARM), *trace[4:]]
    assert compare(COLD_OPEN, wrong_ip).count(Verdict.DIFFERENT) == 1
    assert not compare(COLD_OPEN, [*trace[:3], *trace[4:]]).is_explained
    assert compare(COLD_OPEN, trace[:-2]).count(Verdict.MISSING) == 2


def test_a_poll_may_be_repeated_but_not_skipped() -> None:
    trace = as_trace(HOME_ZED)
    moving = next(n for n, x in enumerate(trace) if x.reply[:1] == b"\x12")
    again = compare(HOME_ZED, [*trace[: moving + 1], *trace[moving:]])
    assert again.is_explained
    assert again.count(Verdict.EXTRA) == 1
    assert not compare(HOME_ZED, [*trace[:moving], *trace[moving + 2 :]]).is_explained
