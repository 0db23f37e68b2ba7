"""Licences of all that cellctl needs, from the metadata of what is installed.

``python packaging/licences.py > docs/licences.md``: every package that the program, its extras
`objects`, `page` and `step`, and its tests need, directly or through another, with its licence and
who needs it, and the files of others that are kept in the repository. A licence that is not allowed
is an error; `tests/unit/test_licences.py` holds the page against what is installed.
"""

import sys
from collections.abc import Iterator
from hashlib import sha256
from importlib.metadata import Distribution, PackageNotFoundError, distribution, distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = "cellctl"
EXTRAS = ("objects", "page", "step", "test")
ALLOWED = frozenset(
    {
        *("0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "ISC", "MIT"),
        "MIT-0",
        *("MPL-2.0", "PSF-2.0", "Zlib"),
    }
)
# as the classifiers of PyPI and older metadata have it
SPDX = {
    "Apache 2.0": "Apache-2.0",
    "Apache Software License": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "GNU Lesser General Public License v3 or later": "LGPL-3.0-or-later",
    "BSD 3-Clause License": "BSD-3-Clause",
    "BSD License": "BSD-3-Clause",
    "BSD 2-Clause License": "BSD-2-Clause",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "PSFL": "PSF-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "zlib": "Zlib",
    "zlib/libpng License": "Zlib",
}
# metadata that names none; read in the package's own licence file
READ = {"embreex": "BSD-2-Clause", "atheris": "Apache-2.0", "manifold3d": "Apache-2.0"}
# each Python needs one of these and has metadata of no other (pyproject.toml)
BY_PYTHON = {"pybullet": "Zlib", "pybullet-arm64": "Zlib"}
# Under the LGPL: allowed as it is published, installed as an extra of its own, imported by one
# package, and never bundled (ADR 126).
SEPARATE = {"asyncua": ("LGPL-3.0-or-later", "opcua")}
BUNDLED = {
    "cadquery-ocp-novtk": "OpenCASCADE, LGPL-2.1-only WITH OCCT-exception-1.0",
    "opencv-python-headless": "FFmpeg, LGPL-2.1-or-later, as a library of its own",
}

# Kept in the repository as published: licence, version, where, and what stands in the package.
KEPT = {
    "three": ("MIT", "0.180.0", "controller/page/frame/static/three", "the page"),
    "node-opcua-nodesets": (
        "MIT",
        "2.182.0",
        "controller/plant/wires/opcua/nodesets",
        "OPC UA; each file is under the OPC Foundation MIT License 1.00 in its head",
    ),
    "axe-core": ("MPL-2.0", "4.14.1", "tests/data/axe", "tests of the page"),
}
ROOT = Path(__file__).resolve().parents[1]


def kept() -> Iterator[tuple[str, str, str]]:
    """Return each file that is kept: its path, the package with its version, its SHA-256."""
    for name, (_, version, folder, _) in KEPT.items():
        for path in sorted((ROOT / folder).iterdir()):
            digest = sha256(path.read_bytes()).hexdigest()
            yield path.relative_to(ROOT).as_posix(), f"{name} {version}", digest


def is_installed(name: str) -> bool:
    """Return whether a package that is needed is here; some are of another platform."""
    try:
        distribution(name)
    except PackageNotFoundError:
        return False
    return True


def licence_of(package: Distribution) -> str:
    """Return the SPDX expression of an installed package's licence.

    Raises
    ------
    ValueError : its metadata names none that is known here
    """
    meta = package.metadata
    name = canonicalize_name(meta["Name"])
    if expression := meta.get("License-Expression"):
        return str(expression)
    if name in READ:
        return READ[name]
    stated = [
        one.split("::")[-1].strip()
        for one in meta.get_all("Classifier", [])
        if one.startswith("License ::")
    ]
    lines = (meta.get("License") or "").strip().splitlines()
    for text in (*lines[:1], *stated):
        if text in ALLOWED:
            return text
        if text in SPDX:
            return SPDX[text]
    raise ValueError(f"{name}: no licence is known of `{lines[:1]}`, {stated}")


def is_allowed(expression: str) -> bool:
    """Return whether all of an expression's licences are allowed; of an OR, one is enough."""
    text = expression.replace("(", " ").replace(")", " ")
    return all(
        any(word.strip() in ALLOWED for word in either.split(" OR "))
        for either in text.split(" AND ")
    )


def is_allowed_of(name: str, expression: str) -> bool:
    """Return whether a package may be needed: by its licence, or as one that stands apart."""
    apart, _ = SEPARATE.get(canonicalize_name(name), (None, None))
    return is_allowed(expression) or (apart is not None and expression == apart)


def needed(extras: tuple[str, ...] = EXTRAS) -> dict[str, set[str]]:
    """Return every package that the project needs, and by whom each is needed."""
    found: dict[str, set[str]] = {}
    open_ends = [(PROJECT, frozenset(extras))]
    seen: set[tuple[str, frozenset[str]]] = set()
    while open_ends:
        name, wanted = open_ends.pop()
        if (name, wanted) in seen:
            continue
        seen.add((name, wanted))
        for one in _requirements(name, wanted):
            child = canonicalize_name(one.name)
            if child != PROJECT:
                found.setdefault(child, set()).add(name)
            open_ends.append((child, frozenset(one.extras)))
    return found


def _requirements(name: str, extras: frozenset[str]) -> Iterator[Requirement]:
    try:
        texts = distribution(name).requires or []
    except PackageNotFoundError:
        return
    for text in texts:
        one = Requirement(text)
        if one.marker is None or any(
            one.marker.evaluate({"extra": extra}) for extra in (*extras, "")
        ):
            yield one


def page() -> str:
    """Return docs/licences.md.

    Raises
    ------
    ValueError : a licence is unknown, or not allowed
    """
    lines = [
        "# Licences of what cellctl needs",
        "",
        "cellctl itself is under Apache-2.0. Made by `python packaging/licences.py` from the",
        "metadata of what is installed; a test holds it against that, and every licence against",
        "those allowed: " + ", ".join(sorted(ALLOWED)) + ". Tools that only",
        "developers install are checked, too, where they are installed.",
        "",
        "A package under the LGPL is allowed as it is published, as an extra that is installed on",
        "its own, imported by one package of ours and bundled nowhere: "
        + ", ".join(f"{name} ({of}, extra `{extra}`)" for name, (of, extra) in SEPARATE.items())
        + " (ADR 126).",
        "",
        "| package | licence | needed by | holds as well |",
        "|---|---|---|---|",
    ]
    listed = {name: {PROJECT} for name in BY_PYTHON} | needed()
    for name, parents in sorted(listed.items()):
        if name not in BY_PYTHON and not is_installed(name):
            continue
        licence = BY_PYTHON.get(name) or licence_of(distribution(name))
        if not is_allowed_of(name, licence):
            raise ValueError(f"{name}: {licence} is not allowed")
        by = ", ".join(sorted(parents))
        lines.append(f"| {name} | {licence} | {by} | {BUNDLED.get(name, '')} |")
    lines += [
        "",
        "## Kept in the repository",
        "",
        "Files of npm packages, as published, with their licence; nothing is fetched at run time.",
        "",
        "| npm package | licence | used by |",
        "|---|---|---|",
    ]
    for name, (licence, version, _, use) in KEPT.items():
        if not is_allowed(licence):
            raise ValueError(f"{name}: {licence} is not allowed")
        lines.append(f"| `{name}` {version} | {licence} | {use} |")
    lines += ["", "| file | of | SHA-256 |", "|---|---|---|"]
    lines += [f"| `{path}` | {of} | `{digest}` |" for path, of, digest in kept()]
    return "\n".join(lines) + "\n"


def not_allowed() -> dict[str, str]:
    """Return the packages of this environment whose licence is unknown or not allowed."""
    wrong: dict[str, str] = {}
    for package in distributions():
        try:
            licence = licence_of(package)
        except ValueError as error:
            wrong[package.metadata["Name"]] = str(error)
            continue
        if not is_allowed_of(package.metadata["Name"], licence):
            wrong[package.metadata["Name"]] = licence
    return wrong


if __name__ == "__main__":
    sys.stdout.write(page())
