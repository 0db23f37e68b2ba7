"""Make what a release consists of (docs/releasing.md).

    python packaging/release.py constraints   pin what a cell installs, with hashes: asks the index
    python packaging/release.py build dist    sdist, wheel, bill of materials, checksums: no network

The wheel is built from the sdist, so that the sdist is known to be complete. Both name the commit
(`setup.py`). The setuptools of this environment builds (`pip install -e '.[test]'`).
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import licences
from packaging.markers import Marker

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = ROOT / "packaging" / "constraints.txt"
# what a cell may have installed; the extras `test` and `dev` are for checkouts, `dask` for farms
EXTRAS = ("codes", "page", "parquet", "postgres", "step")


class ReleaseError(Exception):
    """The release cannot be made of this checkout; the message says what to do."""


@dataclass(frozen=True)
class Pin:
    """One version of one package.

    Attributes
    ----------
    marker : of the environments for which the version is meant, None for all
    sha256 : of every file of that version, as hex digits
    """

    name: str
    version: str
    marker: str | None
    sha256: tuple[str, ...]

    @property
    def is_for_this_python(self) -> bool:
        """Whether the marker is true here."""
        return self.marker is None or Marker(self.marker).evaluate()


def pins(text: str) -> list[Pin]:
    """Return the packages of a constraints file, in its order."""
    found = []
    for line in re.sub(r"\\\n", " ", text).splitlines():
        match = re.match(r"([a-z0-9._-]+)==([^\s;]+)\s*(?:;\s*(.*?))?\s*(--hash.*)?$", line.strip())
        if match:
            name, version, marker, hashes = match.groups()
            found.append(
                Pin(name, version, marker, tuple(re.findall(r"sha256:([0-9a-f]+)", hashes or "")))
            )
    return found


def write_constraints() -> None:
    """Pin what pyproject.toml allows, for every Python and Linux, and each file by its hash."""
    arguments = [arg for extra in EXTRAS for arg in ("--extra", extra)]
    done = subprocess.run(
        ["uv", "pip", "compile", "pyproject.toml", "--universal", "--generate-hashes", "--upgrade",
         "--no-annotate", "--quiet", "--custom-compile-command",
         "python packaging/release.py constraints", *arguments,
         "--output-file", str(CONSTRAINTS.relative_to(ROOT))],
        cwd=ROOT, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise ReleaseError("uv could not resolve what pyproject.toml asks for; see above")


def build(source: Path, out: Path) -> tuple[Path, Path]:
    """Build sdist and wheel.

    Parameters
    ----------
    source : a checkout, or a copy of one; setuptools leaves `*.egg-info` in it
    out : folder for both files

    Raises
    ------
    ReleaseError : with what setuptools printed
    """
    sdist = out / _setuptools("sdist", source, out)
    with tempfile.TemporaryDirectory() as scratch:
        with tarfile.open(sdist) as archive:
            archive.extractall(scratch, filter="data")
        (unpacked,) = Path(scratch).iterdir()
        wheel = out / _setuptools("wheel", unpacked, out)
    return sdist, wheel


def _setuptools(what: str, source: Path, out: Path) -> str:
    """Build with setuptools in a process of its own; returns the file's name."""
    script = (
        "import sys; from setuptools import build_meta;"
        f"print('\\n' + build_meta.build_{what}(sys.argv[1]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(out.resolve())],
        cwd=source, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise ReleaseError(f"{what} of {source}:\n{done.stdout}{done.stderr}")
    return done.stdout.splitlines()[-1]


def bill_of_materials(
    version: str, commit: str, sha256: Mapping[str, str], at: datetime
) -> dict[str, Any]:
    """CycloneDX 1.6 of what a cell installs with this Python: versions, licences, who needs whom.

    Parameters
    ----------
    version, commit : of cellctl
    sha256 : of each released file, by name
    at : when it was made

    Raises
    ------
    ReleaseError : something that is needed is not pinned
    """
    pinned = {
        pin.name: pin for pin in pins(CONSTRAINTS.read_text("utf-8")) if pin.is_for_this_python
    }
    parents = {
        name: by for name, by in licences.needed(EXTRAS).items() if licences.is_installed(name)
    }
    if missing := sorted(parents.keys() - pinned.keys()):
        raise ReleaseError(
            f"not pinned: {', '.join(missing)}; python packaging/release.py constraints"
        )
    root = f"pkg:pypi/{licences.PROJECT}@{version}"
    refs = {licences.PROJECT: root} | {
        name: f"pkg:pypi/{name}@{pinned[name].version}" for name in sorted(parents)
    }
    components = [_library(name, pinned[name].version, refs[name]) for name in sorted(parents)]
    for name, (licence, kept_version, _, use) in licences.KEPT.items():
        if use == "the page":
            purl = f"pkg:npm/{name}@{kept_version}"
            refs[name] = purl
            parents[name] = {licences.PROJECT}
            components.append(_component(name, kept_version, purl, licence))
    content = {
        "components": components,
        "dependencies": [
            {
                "ref": ref,
                "dependsOn": sorted(refs[child] for child, by in parents.items() if name in by),
            }
            for name, ref in refs.items()
        ],
    }
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, root + json.dumps(content))}",
        "version": 1,
        "metadata": {
            "timestamp": at.isoformat(timespec="seconds"),
            "component": _component(licences.PROJECT, version, root, "Apache-2.0", "application"),
            "properties": [
                {"name": "cellctl:commit", "value": commit},
                {"name": "cellctl:python", "value": ".".join(map(str, sys.version_info[:2]))},
                *({"name": f"cellctl:sha256:{k}", "value": v} for k, v in sha256.items()),
            ],
        },
        **content,
    }


def _component(
    name: str, version: str, purl: str, licence: str, kind: str = "library"
) -> dict[str, Any]:
    return {
        "type": kind,
        "bom-ref": purl,
        "name": name,
        "version": version,
        "purl": purl,
        "licenses": [{"expression": licence}],
    }


def _library(name: str, version: str, purl: str) -> dict[str, Any]:
    found = _component(name, version, purl, licences.licence_of(distribution(name)))
    if bundled := licences.BUNDLED.get(name):
        what, licence, *_ = (part.strip() for part in bundled.split(","))
        inside = {"type": "library", "name": what, "licenses": [{"expression": licence}]}
        found["components"] = [inside]
    return found


def release(out: Path) -> list[Path]:
    """Write all files of a release to a folder, and return them.

    Raises
    ------
    ReleaseError : the checkout has changes that are not committed, or not in the changelog
    """
    sys.path.insert(0, str(ROOT))
    from controller.setup.software import UNKNOWN, commit_of

    commit = commit_of(ROOT)
    if commit == UNKNOWN or commit.endswith("-dirty"):
        raise ReleaseError(f"commit {commit}: a release is built of a commit; commit first")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    unreleased = re.search(
        r"^## Unreleased\n(.*?)^## ", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.M | re.S
    )
    if unreleased is None or unreleased[1].strip():
        raise ReleaseError("CHANGELOG.md: move what is under *Unreleased* to the new version")
    out.mkdir(parents=True, exist_ok=True)
    files = [*build(ROOT, out)]
    at = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", time.time())), UTC)
    bill = out / f"cellctl-{version}.cdx.json"
    bill.write_text(
        json.dumps(bill_of_materials(version, commit, _sha256(files), at), indent=1) + "\n"
    )
    constraints = out / f"constraints-{version}.txt"
    constraints.write_bytes(CONSTRAINTS.read_bytes())
    files += [bill, constraints]
    sums = out / "SHA256SUMS"
    sums.write_text("".join(f"{digest}  {name}\n" for name, digest in _sha256(files).items()))
    return [*files, sums]


def _sha256(files: list[Path]) -> dict[str, str]:
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def main(words: list[str]) -> int:
    """Run one of the two commands; returns the exit code."""
    try:
        match words:
            case ["constraints"]:
                write_constraints()
            case ["build", out]:
                for file in release(Path(out)):
                    print(file)
            case _:
                print(__doc__, file=sys.stderr)
                return 2
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
