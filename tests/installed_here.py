"""The package as `pip install` would register it now: what is installed may be older."""

from __future__ import annotations

import tomllib
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def register(folder: Path) -> Path:
    """Write the metadata of this checkout into a folder for `sys.path`, and return the folder."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    info = folder / f"cellctl-{project['version']}.dist-info"
    info.mkdir(parents=True)
    name = f"Name: cellctl\nVersion: {version('cellctl')}\n"
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\n{name}")
    groups = dict(project["entry-points"]) | {"console_scripts": project["scripts"]}
    lines = []
    for group, entries in groups.items():
        lines.append(f"[{group}]")
        lines += [f"{entry} = {value}" for entry, value in entries.items()]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder
