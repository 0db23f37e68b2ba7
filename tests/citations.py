"""Which sources the files of a checkout cite, and which of these citations lead nowhere.

The forms are those of `docs/references.md`: a page with numbers or a heading, § with a
number where the file names the page, an ADR by its number, a table of the paper, a standard that
is listed.
"""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from os.path import normpath
from pathlib import Path

PLACES = (
    "controller",
    "drivers",
    "emulators",
    "messages",
    "tests",
    "benchmarks",
    "recipes",
    "docs",
)
ENDINGS = {".py", ".md", ".toml", ".yaml", ".j2", ".html", ".css"}
SHORT_FORM_ONLY = ("drivers", "emulators")  # where a number in brackets may not stand without §
FREE_TO_LOOK_OUTSIDE = "benchmarks"
PLACEHOLDER = "page.md"  # stands for any page where the form itself is explained

KEY = r"[A-Z]{0,2}\d+(?:\.\d+)*(?![\w.]*\w)"
GAP = r"\s+(?:\#\s+)?"  # a citation may go on in the next line, be that a comment's
MORE = rf"(?:(?:,|,?{GAP}(?:and|to|or)){GAP}{KEY})*"
PAGE = re.compile(rf"([\w./-]*[\w-]\.md)\b(?:`?{GAP}({KEY}{MORE}))?")
HEADED = re.compile(rf"([\w./-]*[\w-]\.md)`?,{GAP}\*([^*`]+)\*")  # a page, *A heading* of it
NAMED = re.compile(rf"Sections{GAP}\(§\){GAP}are{GAP}those{GAP}of{GAP}`?([\w./-]+\.md)")
SHORT = re.compile(rf"§\s?({KEY})")
GOLDEN = re.compile(r'^section = "([\d.]+)"$', re.MULTILINE)
ADR = re.compile(rf"\bADRs?{GAP}(\d+(?:(?:,|{GAP}(?:and|to|or)){GAP}\d+)*)")
ADR_HEADED = re.compile(  # an ADR, *A heading* and *Another* of it
    rf"\bADR{GAP}(\d+),{GAP}\*([^*`]+)\*(?:{GAP}and{GAP}\*([^*`]+)\*)?"
)
PAPER = re.compile(rf"\b[Pp]aper's{GAP}(Table|[Ff]igure){GAP}(\d+)")
STANDARD = re.compile(r"\b(?:(?:ISO(?:/IEC)?|RFC|OPC) \d[\d-]*\d|ITU-T T\.\d+|V1\.(?:1b3|02|0b)\b)")
OTHER_FORM = re.compile(
    rf"\.md`?,{GAP}(?:sections?|sec\.|chapter)\b"
    rf"|\b[Pp]aper(?:'s)?,?{GAP}(?:sections?{GAP}\d|\d\.\d)"
)
OUTSIDE = re.compile(
    r"(?:^|[\s\"'`(/])shared/|/\s*[\"']shared[\"']|\b(?:DESIGN|STYLE|GLOSSARY)\.md"
)
BARE = re.compile(r"(?:\(|#\s|;\s)\d{1,2}\.\d{1,2}(?=[),;]|\s*$)")
HEADING = re.compile(r"^#+\s+([A-Z]{0,2}\d+(?:\.\d+)*)\.?\s")
ROW = re.compile(r"^\|\s*([A-Z]{0,2}\d+(?:\.\d+)*)\s*\|")


@dataclass(frozen=True)
class Problem:
    """A citation that leads nowhere, or has a form nobody can follow."""

    path: Path
    line: int
    why: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.why}"


def files_of(root: Path) -> Iterator[Path]:
    """Return the text files of a checkout that may cite."""
    yield from sorted(root.glob("*.md"))
    for place in PLACES:
        for path in sorted((root / place).rglob("*")):
            parts = path.relative_to(root).parts
            is_hidden = any(part.startswith((".", "__pycache__")) for part in parts)
            # as other programs write them, in any encoding: they cite nothing of ours
            is_hidden |= parts[:3] == ("tests", "data", "foreign") and path.suffix != ".py"
            if path.suffix in ENDINGS and path.is_file() and not is_hidden:
                yield path


def keys_of(text: str) -> set[str]:
    """Return the numbers of a page's headings and numbered rows.

    A row is numbered if it begins as its section does (8.10 in section 8) or by a letter (P3.1);
    a table of values is none.
    """
    keys, section = set(), ""
    for line in text.splitlines():
        if heading := HEADING.match(line):
            section = heading[1]
            keys.add(section)
        elif (row := ROW.match(line)) and (row[1].startswith(f"{section}.") or row[1][0].isalpha()):
            keys.add(row[1])
    return keys


def headings_of(text: str) -> set[str]:
    """Return the texts of a page's headings, without their numbers."""
    return {
        re.sub(r"^[A-Z]{0,2}[\d.]+ ", "", found) for found in re.findall(r"(?m)^#+ +(.+?) *$", text)
    }


def without_breaks(*headings: str | None) -> list[str]:
    """Return headings as cited, in one line each; a comment may break them."""
    return [" ".join(re.sub(r"\n\s*#?", " ", one).split()) for one in headings if one]


class Checkout:
    """The files of a checkout, and what of it can be cited: pages, ADRs, standards."""

    def __init__(self, root: Path) -> None:
        self.texts = {
            path.relative_to(root): path.read_text(encoding="utf-8") for path in files_of(root)
        }
        self.keys = {p: keys_of(text) for p, text in self.texts.items() if p.suffix == ".md"}

    @cached_property
    def adrs(self) -> dict[int, list[Path]]:
        found: dict[int, list[Path]] = {}
        for path in self.keys:
            if re.match(r"\d{4}-", path.name):
                found.setdefault(int(path.name[:4]), []).append(path)
        return found

    @cached_property
    def standards(self) -> str:
        return self.texts.get(Path("docs/references.md"), "")

    @cached_property
    def problems(self) -> list[Problem]:
        """All citations that lead nowhere."""
        return [problem for path in self.texts for problem in self.problems_of(path)]

    def pages_of(self, name: str, by: Path) -> list[Path]:
        """Return the pages that a name may be: from the root, from the file's folder, or bare."""
        paths = [Path(normpath(by.parent / name)), Path(name)] if "/" in name else self.keys
        return [page for page in paths if page in self.keys and page.name == Path(name).name]

    def why_not(self, name: str, keys: list[str], by: Path) -> list[str]:
        """Return what is wrong with citing sections of a page from the file `by`.

        A name is a path from the root or from the file's folder, or a bare name that is unique.
        """
        if name == PLACEHOLDER:
            return []
        found = self.pages_of(name, by)
        if not found:
            return [f"{name} is not in the repository"]
        if len(found) > 1 and keys:
            return [f"{name} may be any of {', '.join(map(str, found))}"]
        return [f"{name} has no section {key}" for key in keys if key not in self.keys[found[0]]]

    def problems_of(self, path: Path) -> Iterator[Problem]:
        """Return the citations of one file that lead nowhere."""
        text = self.texts[path]
        for number, same in self.adrs.items():
            if path in same[1:]:
                yield Problem(path, 1, f"{same[0]} is ADR {number}, too")
        for offset, why in self._dangling(path, text):
            yield Problem(path, text.count("\n", 0, offset) + 1, why)
        if path.suffix == ".py" and (path.parts[0] in SHORT_FORM_ONLY or NAMED.search(text)):
            for line, words in prose_of(text):
                for bare in BARE.finditer(words):
                    yield Problem(path, line, f"write §, not {bare[0].strip()!r} alone")

    def _dangling(self, path: Path, text: str) -> Iterator[tuple[int, str]]:
        for cited in PAGE.finditer(text):
            for why in self.why_not(cited[1], re.findall(KEY, cited[2] or ""), path):
                yield cited.start(), why
        for cited in HEADED.finditer(text):
            (heading,) = without_breaks(cited[2])
            found = self.pages_of(cited[1], path)
            if len(found) == 1 and heading not in headings_of(self.texts[found[0]]):
                yield cited.start(), f"{cited[1]} has no heading {heading!r}"
        named = NAMED.search(text)
        page = str(path) if path.suffix == ".md" else named and named[1]
        for cited in short_forms(path, text):
            if page is None:
                yield cited.start(), "§ without 'Sections (§) are those of' a page"
            else:
                for why in self.why_not(page, [cited[1]], path):
                    yield cited.start(), why
        for cited in ADR.finditer(text):
            for number in re.findall(r"\d+", cited[1]):
                if int(number) not in self.adrs:
                    yield cited.start(), f"there is no ADR {number}"
        for cited in ADR_HEADED.finditer(text):
            for page in self.adrs.get(int(cited[1]), []):
                for heading in without_breaks(*cited.groups()[1:]):
                    if heading not in headings_of(self.texts[page]):
                        yield cited.start(), f"{page.name} has no heading {heading!r}"
        for cited in PAPER.finditer(text):
            for why in self.why_not("references.md", [f"P{cited[1][0].upper()}{cited[2]}"], path):
                yield cited.start(), why
        for cited in STANDARD.finditer(text):
            if cited[0] not in self.standards:
                yield cited.start(), f"docs/references.md does not list {cited[0]}"
        for cited in OTHER_FORM.finditer(text):
            yield cited.start(), f"{cited[0]!r} is not the form of docs/references.md"
        if path.parts[0] != FREE_TO_LOOK_OUTSIDE:
            for cited in OUTSIDE.finditer(text):
                yield cited.start(), f"{cited[0].strip()!r} is outside the repository"

    def count_in(self, path: Path) -> int:
        """Return how many citations a file has: of sections or whole pages, ADRs, standards."""
        text = self.texts[path]
        total = sum(len(re.findall(KEY, c[2] or "")) or 1 for c in PAGE.finditer(text))
        total += len(list(short_forms(path, text)))
        total += sum(len(re.findall(r"\d+", c[1])) for c in ADR.finditer(text))
        return total + len(PAPER.findall(text)) + len(STANDARD.findall(text))


def short_forms(path: Path, text: str) -> Iterator[re.Match[str]]:
    """Return the numbers with §, and a golden file's sections."""
    yield from SHORT.finditer(text)
    if path.suffix == ".toml":
        yield from GOLDEN.finditer(text)


def prose_of(text: str) -> Iterator[tuple[int, str]]:
    """Return the lines of a module's comments and docstrings, with their numbers."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        is_docstring = token.type == tokenize.STRING and token.string.lstrip("r").startswith('"""')
        if token.type == tokenize.COMMENT or is_docstring:
            for i, line in enumerate(token.string.splitlines()):
                yield token.start[0] + i, line
