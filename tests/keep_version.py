"""Keep what a version writes, for the versions after it to read (docs/promises.md).

python tests/keep_version.py /opt/cellctl/bin/cellctl /srv/cell

The first argument is the command of the version as released, in an environment of its own; the
second a new folder. Journals hold that path and the names of user and computer: choose ones that
may be published. Two runs of an emulated cell: one to its end, one killed with the part in the arm
gripper.
"""

from __future__ import annotations

import json
import lzma
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

DATA = Path(__file__).resolve().parent / "data"
REPORTED = ("serial", "lot", "verdict", "tray", "custody", "covered_fraction")
MEASURED = ("id", "measured", "U", "verdict")


def reduced(report: dict[str, Any]) -> dict[str, Any]:
    """Return what a report states of its parts: verdicts and measured values."""
    return {
        "verdict": report["verdict"],
        "parts": [
            {key: part[key] for key in REPORTED}
            | {
                "characteristics": [
                    {key: one.get(key) for key in MEASURED} for one in part["characteristics"]
                ]
            }
            for part in report["parts"]
        ],
    }


def main(cellctl: str, folder: Path) -> None:
    """Run the emulated cell twice, and pack what it left."""
    import surface  # of this checkout, which has to be the version's own

    folder.mkdir(parents=True)
    version = subprocess.check_output([cellctl, "--version"], text=True).split()[1].rstrip(",")
    project = folder / "project"
    subprocess.run([cellctl, "init", str(project)], check=True)
    run = [cellctl, "run", "--speed", "10", "--json", "--operator", "Ada"]
    whole = ["--seed", "5", "--lot", "L7", "--serial", "A0001"]
    subprocess.run([*run, *whole], cwd=project, stdout=subprocess.DEVNULL, check=False)
    (first,) = (project / "runs").glob("*-holder")
    cut_off = ["--seed", "6", "--lot", "L8", "--serial", "A0002"]
    with subprocess.Popen([*run, *cut_off], cwd=project, stdout=subprocess.PIPE) as killed:
        assert killed.stdout is not None
        for line in killed.stdout:
            if json.loads(line).get("custody") == "in_arm":
                killed.kill()
                break
    second = max(one.name for one in (project / "runs").glob("*-holder"))
    pack(cellctl, project, first.name, second, DATA / version)
    (DATA / version / "surface.json").write_text(
        json.dumps(surface.surface(), indent=1, sort_keys=True) + "\n"
    )


def pack(cellctl: str, project: Path, first: str, second: str, to: Path) -> None:
    """Write the folder of a version.

    Parameters
    ----------
    first, second : the whole run, and the one that was killed
    """
    printed = subprocess.check_output(
        [cellctl, "report", first, "--format", "json"], cwd=project, text=True
    )
    with sqlite3.connect(project / "runs" / "journal.sqlite") as db:  # with what its WAL has
        journal = db.serialize()
        (row_count,) = db.execute("SELECT count(*) FROM journal").fetchone()
    db.close()
    views = (project / "runs" / first / "part001.views.json").read_bytes()
    stated = {
        "run": first,
        "killed": second,
        "rows": row_count,
        "views": len(json.loads(views)["views"]),
        "report": reduced(json.loads(printed)),
    }
    shutil.copytree(project, to / "project", ignore=shutil.ignore_patterns("runs", "*.md", "*.py"))
    shutil.copy(project / "runs" / "journal.sqlite.head", to)
    (to / "stated.json").write_text(json.dumps(stated, indent=1) + "\n")
    for name, data in (
        ("journal.sqlite", journal),
        ("part001.views.json", views),
    ):
        (to / f"{name}.xz").write_bytes(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
