"""The two transcripts of Universal Robots' guides: what stands in both is the same in both."""

from __future__ import annotations

import re
from pathlib import Path

PAGES = Path(__file__).resolve().parents[2] / "docs" / "protocols"
DRIVER = (PAGES / "ur.md").read_text(encoding="utf-8")
EMULATOR = (PAGES / "universal_robots.md").read_text(encoding="utf-8")


def section(page: str, number: str) -> str:
    """Return the text below a heading that begins with a number, up to the next heading."""
    found = re.search(rf"(?ms)^#+ {re.escape(number)} [^\n]*\n(.*?)(?=^#|\Z)", page)
    assert found is not None, number
    return found[1]


def cells(page: str, number: str) -> list[list[str]]:
    """Return the rows of the tables of a section, heads among them, rules left out."""
    rows = [row.strip()[1:-1] for row in section(page, number).splitlines() if row[:1] == "|"]
    return [[cell.strip() for cell in row.split("|")] for row in rows if set(row) - set("-| ")]


def frames(page: str, number: str) -> set[str]:
    """Return the frames of a page's table, as hexadecimal bytes."""
    found = {row[1].strip("`") for row in cells(page, number) if row[1].startswith("`")}
    assert all(re.fullmatch(r"[0-9A-F]{2}( [0-9A-F]{2})+", frame) for frame in found)
    return found


def test_the_arms_have_the_same_lengths_and_joints_the_same_speeds() -> None:
    there = {row[0]: row for row in cells(EMULATOR, "1.") if row[0].startswith("UR")}
    lengths = {row[0]: row for row in cells(DRIVER, "1.1") if row[0].startswith("UR")}
    speeds = {
        name: row[1:]
        for row in cells(DRIVER, "1.2")
        for name in row[0].split(", ")
        if name.startswith("UR")
    }
    assert there.keys() == {"UR3e", "UR5e", "UR10e"}
    for name, row in there.items():
        assert [float(x) for x in lengths[name][1:7]] == [float(x) for x in row[1:7]], name
        joints = [float(x) for x in re.findall(r"\d+", row[7])]
        base, elbow, wrists = (float(x.removesuffix("°/s")) for x in speeds[name])
        of_driver = [base, base, elbow, wrists, wrists, wrists]
        assert (joints if len(joints) == 6 else joints * 6) == of_driver, name


def numbered(text: str) -> dict[int, str]:
    """Return words by the number before them: ``3 power off, 4 power on``."""
    found = re.findall(r"(-?\d+) ([a-z][^,.]*)", text.replace("\n", " "))
    # the list of a section comes first, numbers in its sentences after it
    return {int(number): words.partition(" (")[0].strip() for number, words in reversed(found)}


def test_modes_have_the_same_numbers() -> None:
    table = cells(EMULATOR, "3.2")
    for column, number_here in ((0, "5.1"), (2, "5.2"), (4, "5.3")):
        there = {
            int(row[column]): row[column + 1].lower().replace("_", " ")
            for row in table
            if re.fullmatch(r"-?\d+", row[column])
        }
        here = numbered(section(DRIVER, number_here))
        assert len(there) >= 6
        for number, words in there.items():
            first = words.split()[0]
            assert first in here[number], (number_here, number)
        assert there.keys() <= here.keys()


def test_frames_of_one_meaning_have_the_same_bytes() -> None:
    both = frames(DRIVER, "7.") & frames(EMULATOR, "2.5")
    # version 2 asked, accepted, controller's version asked, start
    assert both == {"00 05 56 00 02", "00 04 56 01", "00 03 76", "00 03 53"}


def test_packages_have_the_same_letters_and_ports_the_same_numbers() -> None:
    def letters(page: str) -> set[str]:
        return {x for row in cells(page, "2.1") for x in re.findall(r"\b[A-Za-z]\b", row[0])}

    assert letters(DRIVER) <= letters(EMULATOR)
    assert letters(DRIVER) >= set("VvOSPUM")
    for page in (DRIVER, EMULATOR):
        ports = {int(x) for x in re.findall(r"\b(?:2999\d|3000\d|6335\d)\b", page)}
        assert ports == {29999, 30001, 30002, 30003, 30004, 63352}
