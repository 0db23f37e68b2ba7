"""Judges whether counters can still be trusted after a request that may have changed them.

Define home (`21`, umi_rtx.md 2.3) makes all counters of an IP zero, and it is one wrong bit away
from other commands. The arm has no other memory of where it is, so the counters themselves are the
only witnesses: an axis that rested far from zero and still reads so excludes it.
"""

from collections.abc import Mapping

from ..protocol.constants import ADDRESSES, Axis, Ip

Known = dict[Axis, tuple[int, int]]
"""Range that each axis must be found in [counts]; both ends are equal where it rests."""

_SLACK_COUNTS = 8  # DEAD_BAND, arrival slack, and the counts of a late stop


def judge_counters(
    known: Mapping[Axis, tuple[int, int]], counts: Mapping[Axis, int], may_be_zeroed: bool
) -> str:
    """Return why counters cannot be trusted, or "" if they can.

    Parameters
    ----------
    known : range that each axis must be found in [counts]; axes that are left out prove nothing
    counts : what all axes read [counts]
    may_be_zeroed : define home may have been carried out, so that each IP needs a witness
    """
    for axis, (low, high) in known.items():
        if not low - _SLACK_COUNTS <= counts[axis] <= high + _SLACK_COUNTS:
            return (
                f"{axis.name.lower()} reads {counts[axis]} counts, it was last at {low} to {high}"
            )
    for ip in Ip if may_be_zeroed else ():
        witnesses = [
            axis
            for axis, (low, high) in known.items()
            if ADDRESSES[axis].ip is ip and low == high and abs(low) > _SLACK_COUNTS
        ]
        if not witnesses:
            return f"no axis of IP{ip:d} rests far enough from zero to prove its counters"
    return ""
