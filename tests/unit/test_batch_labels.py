"""Serial numbers of a batch: given, counted, listed, read; and never mixed up."""

import asyncio
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from results_bench import RunWriter

from controller.cell.errors import PartProblemError
from controller.cell.operator import Answer, Desk
from controller.cell.services.records import PartRecord
from controller.cell.services.table import Label, LabelOrder, Labels, counted
from controller.cli.inputs.parts_list import load_parts_list
from controller.cli.inputs.recipes import asked_recipes, ordered_recipes
from controller.cli.inputs.serials import papers_of
from controller.cli.options import SerialOptions
from controller.config import ConfigError

ANY: Any = SimpleNamespace
PLAIN = ANY(serial_code=None)
HOLDER, RISER = ANY(number=0, recipe=PLAIN), ANY(number=1, recipe=PLAIN)
LIST = (
    (0, Label("H1", "L1")),
    (1, Label("R1", "L2")),
    (0, Label("H2", "L1")),
)


def listed(**more: Any) -> Labels:
    return Labels(LabelOrder(listed=LIST, **more))


def part(number: int = 1, **more: Any) -> PartRecord:
    return PartRecord(number=number, **more)


@pytest.mark.parametrize(
    ("first", "count", "then"),
    [("A0001", 0, "A0001"), ("A0001", 9, "A0010"), ("A9999", 1, "A10000"), ("7-08", 2, "7-10")],
)
def test_the_digits_at_the_end_count_up_and_keep_their_zeros(
    first: str, count: int, then: str
) -> None:
    assert counted(first, count) == then


def test_a_listed_number_is_that_of_the_next_part_of_its_recipe() -> None:
    labels = listed()
    assert labels.in_advance(part(), HOLDER) == Label("H1", "L1")
    assert labels.assign(part(1), RISER) == Label("R1", "L2")
    assert labels.assign(part(2), HOLDER) == Label("H1", "L1")
    assert labels.in_advance(part(3), HOLDER) == Label("H2", "L1")
    assert labels.assign(part(3), HOLDER) == Label("H2", "L1")
    assert labels.assign(part(4), HOLDER) == Label()


def test_a_part_that_is_left_gives_its_listed_number_back() -> None:
    labels, one = listed(), part()
    one.serial = labels.assign(one, HOLDER).serial
    labels.give_back(one)
    assert labels.assign(part(2), HOLDER) == Label("H1", "L1")


def test_counted_numbers_are_given_as_parts_are_begun_whichever_their_recipe() -> None:
    labels = Labels(LabelOrder(counted_from="A09"))
    assert labels.in_advance(part(), HOLDER) is None
    given = [labels.assign(part(n), p).serial for n, p in ((1, HOLDER), (2, RISER), (3, HOLDER))]
    assert given == ["A09", "A10", "A11"]
    taken = part(4, serial="A12")  # for a part that was then left for another
    assert labels.assign(taken, RISER) == Label("A12")


def test_a_number_of_the_interrupted_run_is_not_given_again() -> None:
    labels = Labels(LabelOrder(counted_from="A1"))
    assert labels.take_over("A2", ["A1"]) == ()
    assert labels.assign(part(), HOLDER).serial == "A3"
    again = listed()
    assert again.take_over("R1", ["H1"]) == (0,)  # one part of the first recipe is done
    assert again.in_advance(part(), HOLDER) == Label("H2", "L1")


def read_by(labels: Labels, *typed: str) -> tuple[str, list[str]]:
    """Return the number that is read of what is typed, and what is refused."""
    desk, refused = Desk(is_attended=True), []

    async def story() -> str:
        labels.operator, one = desk, part()
        reading = asyncio.create_task(labels.read(one))
        await asyncio.sleep(0)
        for text in typed:
            refused.append(desk.answer(None, Answer(text, "a person")))
        await reading
        return one.scanned

    return asyncio.run(story()), [one for one in refused if one]


def test_a_wrong_or_repeated_number_is_refused_and_asked_again() -> None:
    labels = Labels(LabelOrder(is_read=True))
    labels.used.add("A1")
    found, refused = read_by(labels, "A1", " ", "x" * 81, "a\x07b", "A2")
    assert found == "A2"
    assert len(refused) == 4
    assert "already" in refused[0]


def test_a_number_that_is_read_must_be_in_the_list_and_names_recipe_and_lot() -> None:
    labels = listed(is_read=True)
    found, refused = read_by(labels, "H3", "R1")
    assert (found, labels.recipe_of(found)) == ("R1", 1)
    assert "no such number" in refused[0]
    assert labels.assign(part(scanned="R1"), RISER) == Label("R1", "L2")


def test_where_nobody_reads_a_number_the_cell_holds() -> None:
    labels = Labels(LabelOrder(is_read=True))
    with pytest.raises(PartProblemError) as e:
        asyncio.run(labels.read(part()))
    assert e.value.code == "no_serial"


def test_a_part_that_goes_on_or_has_its_number_is_not_read_again() -> None:
    labels = Labels(LabelOrder(is_read=True))
    for one in (part(serial="A1"), part(scanned="A1"), part(interrupted="run")):
        asyncio.run(labels.read(one))


# --- the list -----------------------------------------------------------------------------------


def parts_list(folder: Path, text: str) -> Path:
    file = folder / "parts.csv"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("mark", [",", ";"])
def test_a_list_names_recipes_numbers_and_lots(tmp_path: Path, mark: str) -> None:
    text = "\ufeffrecipe,serial,lot\nholder,H1,L1\n\nidler_riser,R1,\nholder,H2,L3\n"
    found = load_parts_list(parts_list(tmp_path, text.replace(",", mark)), lot="L9")
    assert [(one.path.stem, one.count) for one in found.recipes] == [
        ("holder", 2),
        ("idler_riser", 1),
    ]
    assert found.labels == (
        (0, Label("H1", "L1")),
        (1, Label("R1", "L9")),
        (0, Label("H2", "L3")),
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected the column titles recipe, serial and lot"),
        ("recipe,number\nholder,1\n", "unknown or repeated title `number`"),
        ("recipe,serial\n", "no parts"),
        ("recipe,serial\nholder,A\nholder,B\nholder,A\n", "line 4: .* A is in line 2 already"),
        ("recipe,serial\nholder\n", "line 2: more or fewer values"),
        ("recipe,serial\nnosuch,A\n", "line 2: nosuch: no such file"),
        ("recipe,serial\n,A\n", "line 2: no recipe"),
        ("recipe,serial\nholder,A\nholder,\n", "line 3: some parts of holder"),
        ("recipe,lot\nholder,A\nholder,B\n", "line 3: .* several lots"),
        ("recipe,serial\nholder,a\x07\n", "line 2: a serial number is printable"),
        ('recipe,serial\nholder,"A\n', "line 2"),
    ],
)
def test_a_list_is_refused_whole_with_the_lines_that_are_wrong(
    tmp_path: Path, text: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        load_parts_list(parts_list(tmp_path, text))


def test_a_list_that_is_no_text_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "parts.csv"
    file.write_bytes(b"recipe,serial\nholder,\xff\n")
    with pytest.raises(ConfigError, match="not text in UTF-8"):
        load_parts_list(file)


def test_a_list_that_is_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "parts.csv")
    with pytest.raises(ConfigError, match="is not a plain file"):
        load_parts_list(tmp_path / "parts.csv")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_of_a_list_end_as_any_system_ends_them(tmp_path: Path, end: str) -> None:
    file = tmp_path / "parts.csv"
    file.write_bytes(end.join(("recipe;serial", "holder;H1", "holder;H2", "")).encode())
    assert load_parts_list(file).labels == ((0, Label("H1")), (0, Label("H2")))


# --- the command line ---------------------------------------------------------------------------


def test_a_count_stands_behind_its_recipe() -> None:
    asked = asked_recipes(["holder=5", "idler_riser"])
    assert [(one.path.stem, one.count) for one in asked] == [("holder", 5), ("idler_riser", None)]
    assert [one.count for one in ordered_recipes(asked, 3)] == [5, 3]
    assert [one.count for one in ordered_recipes(asked)] == [5, 1]


@pytest.mark.parametrize("word", ["holder=0", "holder=x", "holder=", "holder=1000000", "holder=-1"])
def test_what_is_no_number_of_parts_is_refused(word: str) -> None:
    with pytest.raises(ConfigError, match="expected a number of parts"):
        asked_recipes([word])


def test_two_recipes_of_one_part_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(b"")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.stl").write_bytes(b"")

    def recipe(file: str, name: str, part: str) -> str:
        (tmp_path / file).write_text(f"name: {name}\npart: {part}\n", encoding="utf-8")
        return str(tmp_path / file)

    one = recipe("one.yaml", "one", "a.stl")
    with pytest.raises(ConfigError, match="recipes of the same part"):
        ordered_recipes(asked_recipes([one, recipe("two.yaml", "two", "a.stl")]))
    with pytest.raises(ConfigError, match="have the same name"):
        ordered_recipes(asked_recipes([one, recipe("two.yaml", "two", "sub/a.stl")]))
    with pytest.raises(ConfigError, match="have the same name, one"):
        ordered_recipes(asked_recipes([one, recipe("two.yaml", "one", "sub/a.stl")]))


def papers(runs: Path, recipe_count: int = 1, part_count: int = 3, **more: Any) -> Any:
    from controller.cell.batch import Papers

    return papers_of(SerialOptions(**more), Papers(), None, recipe_count, part_count, runs)


def numbered_run(runs: Path, *serials: str) -> None:
    from controller.cell.journal import rows

    writer = RunWriter(runs, "20260301-a")
    for number, serial in enumerate(serials, 1):
        writer.number = number
        writer.write(rows.PartIdentified(recipe=0, name="featuretype", serial=serial))
    writer.journal.close()


def test_more_numbers_than_parts_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="4 serial numbers for 3 parts"):
        papers(tmp_path, serials=["A", "B", "C", "D"])
    assert papers(tmp_path, serials=["A", "B"]).serials == ("A", "B")


def test_numbers_that_earlier_parts_have_are_not_counted_again(tmp_path: Path) -> None:
    numbered_run(tmp_path, "A0002", "A0007", "B9")
    with pytest.raises(ConfigError, match="have A0002 already"):
        papers(tmp_path, counted_from="A0001")
    assert papers(tmp_path, counted_from="A0003").counted_from == "A0003"
    assert papers(tmp_path, counted_from="A0001", goes_on=True).counted_from == "A0008"
    assert papers(tmp_path, counted_from="C1", goes_on=True).counted_from == "C1"


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"serials": ("A",), "is_read": True}, "exclude each other"),
        ({"serials": ("A", "A")}, "given twice"),
        ({"serials": ("A",), "recipe_count": 2}, "the order of the parts is not known"),
        ({"goes_on": True}, "requires --serial-from"),
        ({"counted_from": "A"}, "must end in a number"),
        ({"serials": ("",)}, "printable"),
    ],
)
def test_numbers_that_would_be_mixed_up_are_refused(
    tmp_path: Path, more: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        papers(tmp_path, **more)
