"""As-built twins of NIST's plate, judged by `cellctl inspect`, beside the published results.

    python benchmarks/bench_nist_plate.py FOLDER [--smstestbed DATA] [--jobs 1] [--json]

FOLDER is as `trace_nist_plate.py` writes it: pictures of plates built as 20 real ones were measured
(github.com/usnistgov/smstestbed), with the published limits. Every characteristic on which the cell
says PASS or FAIL must have the published verdict; what it leaves open is counted, and how far its
values are from the published ones, which are the twins' true ones. With --smstestbed, the QIF file
that `cellctl inspect --report` writes is read again, and counted beside the published one.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from bench_inspect import run_command
from nist_plate import QIF

ROOT = Path(__file__).resolve().parents[1]
Words = dict[str, Any]
RADIAL = ("position",)  # published as the diameter of a zone, measured as its radius


def judge(folder: Path, truth: Words) -> list[Words]:
    """Return one row for each published characteristic that was asked for."""
    lines, message = run_command(folder / "SET.json", None)
    if message:
        raise SystemExit(f"{folder.name}: {message}")
    measured = {line["id"]: line for line in lines if line["event"] == "characteristic"}
    rows = []
    for published in truth["published"]:
        line = measured.get(published["id"])
        if line is None:
            continue
        true = published["value_mm"] / 2 if published["kind"] in RADIAL else published["value_mm"]
        rows.append(
            {
                "plate": truth["serial"],
                "id": published["id"],
                "kind": published["kind"],
                "published": published["verdict"],
                "verdict": line["verdict"],
                "error_mm": None if line["measured_mm"] is None else line["measured_mm"] - true,
                "U_mm": line["U_mm"],
            }
        )
    return rows


def statuses(path: Path) -> dict[str, int]:
    """Return how many measured characteristics a QIF file has, by status."""
    # QIF 2 and QIF 3 have their own word for it
    ends = ("CharacteristicActual", "CharacteristicMeasurement")
    words = [e for e in ET.parse(path).getroot().iter() if e.tag.endswith(ends)]
    found = (e.find(".//{*}CharacteristicStatusEnum") for e in words)
    return dict(Counter("" if e is None else str(e.text) for e in found))


def qif_of(folder: Path) -> dict[str, int]:
    """Return what `cellctl inspect --report X.qif` writes of a set, by status."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "plate.qif"
        command = [sys.executable, "-m", "controller.cli", "inspect", str(folder / "SET.json")]
        subprocess.run(
            [*command, "--report", str(path)], cwd=ROOT, capture_output=True, check=False
        )
        return statuses(path)


def summary(rows: list[Words]) -> Words:
    """Return agreement by kind, and errors against U."""
    out: Words = {}
    for kind in ("all", *sorted({row["kind"] for row in rows})):
        mine = [row for row in rows if kind in ("all", row["kind"])]
        decided = [row for row in mine if row["verdict"] in ("pass", "fail")]
        known = [row for row in mine if row["error_mm"] is not None]
        errors = np.array([row["error_mm"] for row in known])
        U = np.array([row["U_mm"] for row in known])
        out[kind] = {
            "n": len(mine),
            "published_fail": sum(row["published"] == "FAIL" for row in mine),
            "decided": len(decided),
            "agree": sum(row["verdict"].upper() == row["published"] for row in decided),
            "wrong_pass": sum(
                row["verdict"] == "pass" and row["published"] == "FAIL" for row in decided
            ),
            "inside_U": float(np.mean(np.abs(errors) <= U)) if len(errors) else None,
            "median_um": float(1000 * np.median(np.abs(errors))) if len(errors) else None,
            "largest_um": float(1000 * np.abs(errors).max()) if len(errors) else None,
            "U_um": float(1000 * np.median(U)) if len(errors) else None,
        }
    return out


def main() -> int:
    """Judge every plate, print agreement."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--smstestbed", type=Path, help="a checkout of usnistgov/smstestbed")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    truth = json.loads((args.folder / "truth.json").read_text())
    names = sorted(name for name in truth if (args.folder / name / "SET.json").exists())
    with ThreadPoolExecutor(args.jobs) as pool:
        every = list(pool.map(lambda name: judge(args.folder / name, truth[name]), names))
    rows = [row for one in every for row in one]
    told: Words = {"plates": len(names), "kinds": summary(rows)}
    told["disagree"] = [
        row for row in rows
        if row["verdict"] in ("pass", "fail") and row["verdict"].upper() != row["published"]
    ]  # fmt: skip
    if args.smstestbed and names:
        told["qif"] = {
            "published, all plates": statuses(args.smstestbed / QIF),
            "cellctl, first plate": qif_of(args.folder / names[0]),
        }
    if args.json:
        print(json.dumps(told))
        return 0
    print(f"{len(names)} plates\n")
    print(f"{'kind':9} {'n':>4} {'publ. FAIL':>10} {'decided':>8} {'agree':>6} {'wrong PASS':>10} "
          f"{'inside U':>9} {'median':>7} {'largest':>8} {'U [um]':>7}")  # fmt: skip
    for kind, k in told["kinds"].items():
        known = k["inside_U"] is not None
        sizes = (f"{k['inside_U']:9.1%} {k['median_um']:7.0f} {k['largest_um']:8.0f} "
                 f"{k['U_um']:7.0f}") if known else ""  # fmt: skip
        print(f"{kind:9} {k['n']:4} {k['published_fail']:10} {k['decided']:8} {k['agree']:6} "
              f"{k['wrong_pass']:10} {sizes}")  # fmt: skip
    for row in told["disagree"]:
        print(f"disagrees: {row}")
    for name, counts in told.get("qif", {}).items():
        print(f"QIF, {name}: {counts}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
