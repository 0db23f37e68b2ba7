"""Sentences as data: English and key together, kept in JSON, put into words where they are read."""

from __future__ import annotations

import copy
import io
import json
import pickle
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from string import Formatter

import numpy as np
import pytest
from babel.messages.pofile import read_po
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from controller.cell.alarms import ALARMS
from controller.cell.control.words import DecisionReply, reply_bytes, reply_of
from controller.cell.custody import Custody, GripperName, Held, known_words, where_it_is
from controller.cell.custody.openings import Occupancy
from controller.cell.devices.interlocks import REQUIRED_SIGNALS
from controller.cell.journal import JOURNAL_NAME, Journal, Once, read_row, read_rows
from controller.cell.journal.rows import PartJudged, StepDone
from controller.cell.machine.pauses import SafePoint
from controller.cell.machine.recovery import Act, PartFault
from controller.cell.operator.questions import question_for
from controller.cell.recovery.beside import back_evidence, why_not_back
from controller.cell.recovery.classify import Opens, WayOut
from controller.cell.recovery.homing import why_not_free
from controller.cell.recovery.world import Jaws
from controller.cell.services.trays import QUARANTINE, TRAYS
from controller.inspection import FindingKind, Unjudged
from controller.inspection.characteristics import CharacteristicKind
from controller.inspection.detection import WORDS as DEFECT_WORDS
from controller.planning.motion import ProvenMove, Swept
from messages import Message, joined, say, say_counted
from messages.fields import Sentence
from messages.form import as_json, from_said, of_json, with_said
from messages.words import DOMAIN, LANGUAGES, catalogue, teller, words_in

ROOT = Path(__file__).resolve().parents[2]
FOREIGN = sorted(set(LANGUAGES) - {"en"})
ENGLISH = re.compile(
    r"\b(the|of|is|are|not|with|to|and|from|its|or|by|which|no|at|it|be|than|plane|bore)\b"
)
FACE = "{label}: {compared_percent:.0f} % compared, {min_face_percent:.0f} % is required; {reason}"


def face() -> Message:
    kind = say("F{id} {kind}", id=11, kind="plane")
    reason = "too near to an edge for the smallest defect to show whole"
    return say(FACE, label=kind, compared_percent=44.6, min_face_percent=50.0, reason=reason)


def test_a_sentence_is_its_english() -> None:
    sentence = face()
    assert sentence == (
        "F11 plane: 45 % compared, 50 % is required; too near to an edge for the smallest defect "
        "to show whole"
    )
    assert sentence.key == FACE
    assert {sentence: 1}[str.__str__(sentence)] == 1
    assert say("{{at_end: loop}} {n:02X}", n=10) == "{at_end: loop} 0A"
    assert say("without values {as it is}") == "without values {as it is}"


def test_a_blank_without_its_value_is_a_bug() -> None:
    with pytest.raises(ValueError, match="has no value `n`"):
        say("{n} mm", m=1)


def test_key_and_values_stay_in_errors_sums_copies_and_other_processes() -> None:
    sentence = face()
    same = [
        str(sentence),
        str(RuntimeError(sentence)),
        copy.deepcopy(sentence),
        pickle.loads(pickle.dumps(sentence)),
    ]
    assert [(one, one.key, one.values) for one in same if isinstance(one, Message)] == [
        (sentence, sentence.key, sentence.values)
    ] * 4
    around = "before " + sentence + "."
    assert isinstance(around, Message)
    assert around == f"before {sentence}."
    assert teller("de")(around) == f"before {teller('de')(sentence)}."


def test_values_are_figures_names_and_sentences() -> None:
    made = say(
        "{a} {b} {c:.2f} {d} {e} {f}",
        a=Path("folder"),
        b=OSError("lost"),
        c=np.float32(1.5),
        d=True,
        e=say("{n} mm", n=np.int64(3)),
        f=np.array([1, 2]),
    )
    assert made == "folder lost 1.50 True 3 mm [1 2]"
    assert {name: type(one) for name, one in made.values.items()} == {
        "a": str, "b": str, "c": float, "d": str, "e": Message, "f": str,
    }  # fmt: skip


values = st.recursive(
    st.text(max_size=8) | st.integers() | st.floats(allow_nan=False, allow_infinity=False),
    lambda inner: st.lists(inner, min_size=1, max_size=3).map(
        lambda many: joined("; ", [say("{n}", n=one) for one in many])
    ),
    max_leaves=6,
)


@given(st.dictionaries(st.from_regex(r"[a-z]{1,6}", fullmatch=True), values, min_size=1))
def test_json_keeps_every_sentence(content: dict[str, object]) -> None:
    sentence = say(" ".join(f"{{{name}}}" for name in content), **content)
    through = of_json(json.loads(json.dumps(as_json(sentence))))
    assert (through, through.key, through.values) == (sentence, sentence.key, sentence.values)
    body = json.loads(json.dumps(with_said({"reasons": [sentence, "plain"], "n": 1})))
    assert body["reasons"] == [str.__str__(sentence), "plain"]
    restored = from_said(body)["reasons"]
    assert restored == [sentence, "plain"]
    assert isinstance(restored[0], Message)
    assert restored[0].values == sentence.values


def test_an_object_from_before_there_were_keys_is_read_as_english() -> None:
    before = {"reason": "F11 plane: 45 % compared", "said_by": "nobody"}
    assert from_said(before) == before
    assert not isinstance(from_said(before)["reason"], Message)


def test_what_makes_no_sentence_is_not_read() -> None:
    with pytest.raises(ValueError, match="no key with values"):
        from_said({"reason": "x", "said": {"x": {"values": {"n": 1}}}})
    with pytest.raises(ValueError, match="no sentences"):
        from_said({"reason": "x", "said": ["x"]})
    with pytest.raises(ValueError, match="no template has the format"):
        of_json({"key": "{n:999999999d}", "values": {"n": 1}})


class Held_(BaseModel):  # noqa: N801
    reason: Sentence
    reasons: tuple[Sentence, ...] = ()


def test_a_model_keeps_sentences_and_takes_texts() -> None:
    model = Held_.model_validate({"reason": face(), "reasons": ["plain", face()]})
    assert isinstance(model.reason, Message)
    assert [isinstance(one, Message) for one in model.model_dump()["reasons"]] == [False, True]
    with pytest.raises(ValueError, match="reason"):
        Held_.model_validate({"reason": 1})


def test_the_journal_keeps_keys_beside_sentences(tmp_path: Path) -> None:
    path = tmp_path / JOURNAL_NAME
    journal = Journal(path, "run")
    journal.write(StepDone(label=say("place in tray {tray}", tray="accept"), seconds=1.0), 1)
    journal.record("outcome", StepDone.row_name, {"label": "place in tray accept", "seconds": 1.0})
    journal.close()
    new, old = read_rows(path)
    assert new.body["label"] == old.body["label"] == "place in tray accept"
    read = [read_row(row.kind, row.name, row.body) for row in (new, old)]
    labels = [one.label for one in read if isinstance(one, StepDone)]
    assert [teller("de")(label) for label in labels] == [
        "in die Ablage Gut legen",
        "place in tray accept",
    ]


def test_the_control_socket_keeps_keys() -> None:
    reply = DecisionReply(decision="refused", state="idle", reason=face())
    back = reply_of(DecisionReply, reply_bytes(reply))
    assert back == reply
    assert isinstance(back.reason, Message)
    assert back.reason.values == face().values


def test_a_sentence_is_put_into_words_with_its_figures() -> None:
    told = teller("de")
    assert told(face()) == (
        "F11 Ebene: 45 % verglichen, 50 % sind nötig; zu nah an einer Kante, als dass der kleinste "
        "Fehler ganz zu sehen wäre"
    )
    value = say("{measured_mm:.3f} mm with U = {u_mm:.3f} mm", measured_mm=1234.5, u_mm=0.304)
    assert told(value) == "1234,500 mm mit U = 0,304 mm"
    share = say(
        "2 U is {share:.1%} of the tolerance, above {max_share:.0%}", share=0.496, max_share=0.3
    )
    assert told(share) == "2 U ist 49,6 % der Toleranz, mehr als 30 %"
    assert told(say("nobody has written {n:.1f} of it", n=1.5)) == "nobody has written 1,5 of it"
    assert told("whatever") == "whatever"
    assert told("") == ""
    # a name that looks like a figure, and one in brackets, is a name
    assert told(say("{label} of {name}", label="1.50", name="<b>")) == "1.50 von <b>"
    assert teller("en")(value) == value


@pytest.mark.parametrize(
    ("count", "english", "german"),
    [
        (1, "bar is full; the next part may have to go there", "bar ist voll; "),
        (2, "bar are full; the next part may have to go there", "bar sind voll; "),
    ],
)
def test_a_number_decides_on_the_words(count: int, english: str, german: str) -> None:
    made = say_counted(
        "{trays} is full; the next part may have to go there",
        "{trays} are full; the next part may have to go there",
        count=count,
        trays="bar",
    )
    assert made == english
    assert of_json(as_json(made)).many == made.many
    assert teller("de")(made).startswith(german)


def test_an_answer_has_the_words_of_its_texts_alone() -> None:
    content = {"n": [1, 2], "steps": [{"label": face()}, {"label": "park"}], "name": "bar"}
    assert words_in("de", content) == {
        str.__str__(face()): teller("de")(face()), "park": "parken"
    }  # fmt: skip
    assert words_in("en", content) == {}


def blanks(text: str) -> set[str | None]:
    return {name for _, name, _, _ in Formatter().parse(text)} - {None}


@pytest.mark.parametrize("language", FOREIGN)
def test_the_compiled_catalogue_is_that_of_its_source(language: str) -> None:
    source = ROOT / "messages" / "catalogues" / language / "LC_MESSAGES" / f"{DOMAIN}.po"
    known = catalogue(language)
    translated = 0
    for one in read_po(io.BytesIO(source.read_bytes())):
        if one.id and isinstance(one.id, str):
            assert known.gettext(one.id) == (one.string or one.id)
            assert not one.string or blanks(one.string) == blanks(one.id), one.id
            translated += bool(one.string)
        elif one.id:
            each = [known.ngettext(*one.id, count) for count in (1, 2)]
            assert each == [text or key for text, key in zip(one.string, one.id, strict=True)]
    assert translated > 1000


@pytest.mark.parametrize("language", FOREIGN)
def test_every_alarm_has_its_words_in_each_language(language: str) -> None:
    told = teller(language)
    for alarm in ALARMS:
        texts = (alarm.words, alarm.unknown, alarm.action, alarm.device)
        assert [text for text in texts if told(text) == text] == [], alarm.code


@pytest.mark.parametrize("language", FOREIGN)
def test_every_question_of_a_part_has_its_choices_in_each_language(language: str) -> None:
    told = teller(language)
    for alarm in ALARMS:
        for custody, sweeps in product(Custody, (True, False)):
            question = question_for(
                alarm.code, "no part <here>", custody.value, sweeps_to_home=sweeps
            )
            named = [*(one.words for one in question.choices), *(w for _, w in question.preview)]
            assert [text for text in named if told(text) == text] == []
            assert "no part <here>" in told(question.text)
            rest = told(question.text).replace("no part <here>", "")
            assert not ENGLISH.search(rest)


@pytest.mark.parametrize("language", FOREIGN)
def test_names_of_kinds_faults_and_trays_have_words(language: str) -> None:
    kinds = (*Unjudged, *FindingKind, *CharacteristicKind, *PartFault, *Act, *SafePoint)
    named = {one.value for one in (*kinds, *Occupancy, *Custody)}
    named |= {one.name.lower() for one in FindingKind} | {"identity", "backlit"}
    named |= {*DEFECT_WORDS.values(), *TRAYS.values(), QUARANTINE, *REQUIRED_SIGNALS}
    named |= {one.value.replace("_", " ") for one in Once}
    known = catalogue(language)
    assert sorted(one for one in named if known.gettext(one) == one) == []


def everything_about_the_custody() -> Iterator[str]:
    """Yield what is said of where a part is, from each custody and each way a start is refused."""
    detail = "the hand-off was reversed"
    since = "2026-01-02T03:04:05+00:00"
    for custody in Custody:
        yield from (where_it_is(custody), where_it_is(custody, detail))
        held = Held(GripperName.ARM, custody, "run-1", 2, since, detail)
        yield from (known_words(held), known_words(replace(held, part=0, detail="")))
    for jaws in Jaws:
        yield say("the arm gripper's jaws {value}", value=jaws.value)
    yield from (step for one in (Opens, WayOut) for step in map(str, one) if step)
    yield why_not_free(None)
    yield why_not_free(Swept("zed goes up to its stop", "the arm itself", (1.0, -2.0, 3.0)))
    yield why_not_back(ProvenMove((), Swept("", "column", (1.0, -2.0, 3.0))))
    yield back_evidence(ProvenMove((), Swept(pieces=7)))


@pytest.mark.parametrize("language", FOREIGN)
def test_what_is_said_of_the_custody_is_put_into_words_whole(language: str) -> None:
    told = teller(language)
    every = list(everything_about_the_custody())
    assert len(every) > 40
    assert [one for one in every if told(one) == one or ENGLISH.search(told(one))] == []


def test_a_verdicts_reasons_go_through_the_journal_to_a_person(tmp_path: Path) -> None:
    path = tmp_path / JOURNAL_NAME
    journal = Journal(path, "run")
    reasons = (joined("; ", [face(), "no edge of it is in sight"]),)
    journal.write(PartJudged.model_construct(verdict="fail", reasons=reasons), 1)
    journal.close()
    (row,) = read_rows(path)
    (reason,) = row.body["reasons"]
    assert teller("de")(reason) == (f"{teller('de')(face())}; keine Kante davon ist zu sehen")
