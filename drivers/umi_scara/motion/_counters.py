"""Judges whether counters can still be trusted after a request that may have changed them.

Define home (`21`, umi_rtx.md 2.3) makes all counters of an IP zero, and it is one wrong bit away
from other commands. The arm has no other memory of where it is, so the counters themselves are the
only witnesses: an axis that rested far from zero and still reads so excludes it.
"""

from collections.abc import Iterable, Mapping

from messages import say

from ..protocol.constants import ADDRESSES, Axis, Ip

Known = dict[Axis, tuple[int, int]]
"""Range that each axis must be found in [counts]; both ends are equal where it rests."""

_SLACK_COUNTS = 8  # DEAD_BAND, arrival slack, and the counts of a late stop


def judge_counters(
    known: Mapping[Axis, tuple[int, int]], counts: Mapping[Axis, int], may_be_zeroed: bool
) -> str:
    """Return the reason why counters cannot be trusted, or "" if they can.

    Parameters
    ----------
    known : range that each axis must be found in [counts]; axes that are left out prove nothing
    counts : readings of all axes [counts]
    may_be_zeroed : define home may have been carried out, so that each IP needs a witness
    """
    for axis, (low, high) in known.items():
        if not low - _SLACK_COUNTS <= counts[axis] <= high + _SLACK_COUNTS:
            return say(
                "{name} reads {counts} counts, it was last at {low} to {high}",
                name=axis.name.lower(),
                counts=counts[axis],
                low=low,
                high=high,
            )
    for ip in Ip if may_be_zeroed else ():
        witnesses = [
            axis
            for axis, (low, high) in known.items()
            if ADDRESSES[axis].ip is ip and low == high and abs(low) > _SLACK_COUNTS
        ]
        if not witnesses:
            return say(
                "no axis of IP{ip:d} rests far enough from zero to prove its counters", ip=ip
            )
    return ""


def judge_kept_counters(
    between: Mapping[Axis, tuple[int, int]], counts: Mapping[Axis, int], ips: Iterable[Ip] = Ip
) -> str:
    """Return why an earlier session's counters cannot be trusted, or "" if they can.

    A restart makes all counters of an IP zero (umi_rtx.md 1.5, 9.23), and a GO of somebody else
    hides it. An axis that reads far from zero, where it was last sent, excludes that. Where all
    axes of an IP were sent to zero they read the same either way.

    Parameters
    ----------
    between : range that each axis was last sent to [counts]; axes that are left out prove nothing
    counts : readings of all axes at rest [counts]
    ips : boards with doubtful counters
    """
    boards = set(ips)
    for axis, (low, high) in between.items():
        if ADDRESSES[axis].ip not in boards:
            continue
        if not low - _SLACK_COUNTS <= counts[axis] <= high + _SLACK_COUNTS:
            return say(
                "{name} reads {counts} counts, it was sent between {low} and {high}",
                name=axis.name.lower(),
                counts=counts[axis],
                low=low,
                high=high,
            )
    for ip in sorted(boards):
        of_ip = {axis: ends for axis, ends in between.items() if ADDRESSES[axis].ip is ip}
        is_far = any(abs(counts[axis]) > _SLACK_COUNTS for axis in of_ip)
        is_zero = all(max(map(abs, ends)) <= _SLACK_COUNTS for ends in of_ip.values())
        if not of_ip or not (is_far or is_zero):
            return say("all axes of IP{ip:d} read zero, as after a restart", ip=ip)
    return ""
