"""The arm's worked sessions (umi_rtx.md 3) as the driver runs them, against the reference's bytes.

python benchmarks/wire_trace.py [--json] [--bytes] [--speed 30]

Driver and emulated arm meet on a pseudo-terminal. Exit code 1 when an exchange differs for which
neither the reference (a dagger) nor a section of it gives the reason.
"""

import argparse
import asyncio
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "cross")]

from umi_sessions import Comparison, Verdict, run_sessions  # noqa: E402  (path set above)


def as_row(one: Comparison, with_bytes: bool) -> dict[str, Any]:
    row: dict[str, Any] = {
        "section": one.section,
        "session": one.name,
        "compared": one.compared_count,
        "equal": one.count(Verdict.EQUAL),
        "illustrative": one.count(Verdict.ILLUSTRATIVE),
        "unexplained": one.count(Verdict.DIFFERENT, Verdict.MISSING),
        "extra": one.count(Verdict.EXTRA),
        "reasons": dict(one.reasons),
        "skipped": one.skipped or None,
    }
    if with_bytes:
        row["lines"] = [asdict(line) | {"verdict": line.verdict.value} for line in one.lines]
    return row


def print_table(found: list[Comparison], with_bytes: bool) -> None:
    print("sect  compared  equal  illustr.  unexplained  extra  session")
    for one in found:
        if one.skipped:
            print(f"{one.section:4}  not run: {one.name}: {one.skipped}")
            continue
        row = as_row(one, with_bytes=False)
        print(
            f"{one.section:4}  {row['compared']:8d}  {row['equal']:5d}  {row['illustrative']:8d}"
            f"  {row['unexplained']:11d}  {row['extra']:5d}  {one.name}"
        )
        for reason, count in one.reasons.items():
            print(f"      {count:4d} x {reason}")
        for line in one.lines:
            if with_bytes or line.verdict in (Verdict.DIFFERENT, Verdict.MISSING):
                ours = f"{line.request} -> {line.reply}"
                print(f"        {line.verdict.value:12s} {ours:24s} {line.expected}")
    runs = [one for one in found if not one.skipped]
    print(
        f"all   {sum(one.compared_count for one in runs):8d}"
        f"  {sum(one.count(Verdict.EQUAL) for one in runs):5d}"
        f"  {sum(one.count(Verdict.ILLUSTRATIVE) for one in runs):8d}"
        f"  {sum(one.count(Verdict.DIFFERENT, Verdict.MISSING) for one in runs):11d}"
        f"  {sum(one.count(Verdict.EXTRA) for one in runs):5d}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object a session")
    parser.add_argument("--bytes", action="store_true", help="every exchange too")
    parser.add_argument("--speed", type=float, default=30.0)
    args = parser.parse_args()
    found = asyncio.run(run_sessions(args.speed))
    if args.json:
        for one in found:
            print(json.dumps(as_row(one, args.bytes)))
    else:
        print_table(found, args.bytes)
    return 0 if all(one.is_explained for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())
