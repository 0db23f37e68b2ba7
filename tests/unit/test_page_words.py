"""The page's texts: each is in a catalogue, and each compiled catalogue is its source's."""

from __future__ import annotations

import ast
import io
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from babel.messages.pofile import read_po

from controller.cell.alarms import ALARMS, Severity
from controller.cell.custody import Custody, GripperName, Held, where_it_is
from controller.cell.custody.openings import Occupancy
from controller.cell.custody.start_check import known_words
from controller.cell.devices.interlocks import REQUIRED_SIGNALS
from controller.cell.journal import Once
from controller.cell.machine.pauses import SafePoint
from controller.cell.machine.recovery import Act, PartFault
from controller.cell.machine.table import WORK
from controller.cell.operator.questions import question_for
from controller.cell.recovery.beside import back_evidence, why_not_back
from controller.cell.recovery.classify import Opens, WayOut
from controller.cell.recovery.homing import why_not_free
from controller.cell.recovery.world import Jaws
from controller.cell.services.trays import QUARANTINE, TRAYS
from controller.config.interlock_rules import SIGNALS
from controller.inspection import FindingKind, Unjudged
from controller.inspection.characteristics import CharacteristicKind
from controller.inspection.detection import WORDS as DEFECT_WORDS
from controller.page.app import build_screens
from controller.page.frame import Setting
from controller.page.frame.words import (
    LANGUAGES,
    cell_words,
    chosen,
    count_in,
    every_word,
    teller,
    translator,
    value_in,
)
from controller.planning.motion import ProvenMove, Swept

PAGE = Path(__file__).resolve().parents[2] / "controller" / "page"
TEXT = r'"((?:[^"\\]|\\.)*)"'
SCREENS = build_screens(Setting(Path("nowhere"), Path("nowhere")))
PACKAGES = ["frame", *(screen.name for screen in SCREENS)]
FOREIGN = sorted(set(LANGUAGES) - {"en"})


def read(package: str, pattern: str) -> str:
    found = sorted((PAGE / package).rglob(pattern))
    return "\n".join(
        path.read_text(encoding="utf-8") for path in found if "three" not in path.parts
    )


def texts(package: str) -> set[str]:
    """Return every text of a screen or of the frame, as the sources have it.

    In templates `_("...")`, in scripts `t("...")` and tables named `..._WORDS`, in Python
    `word("...")`.
    """
    script = read(package, "*.js")
    found = set(re.findall(rf"_\({TEXT}\)", read(package, "*.j2")))
    found |= set(re.findall(rf"\bt\({TEXT}", script))
    for table in re.findall(r"^const \w+_WORDS = \{(.*?)^\};", script, re.M | re.S):
        found |= set(re.findall(rf": {TEXT}", table))
    if package == "now":  # what it answers when a start is refused
        code = (PAGE.parent / "launching" / "launcher.py").read_text(encoding="utf-8")
        found |= set(re.findall(rf"LaunchRefusedError\(\s*\d+, {TEXT}", code))
    return found | set(re.findall(rf"\bword\(\s*{TEXT}", read(package, "*.py")))


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_every_text_is_in_the_catalogue(package: str, language: str) -> None:
    known = every_word(language, package)
    wanted = texts(package)
    assert len(wanted) > 5
    assert sorted(wanted - set(known)) == []
    assert [text for text in wanted if not known[text]] == []


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_a_screens_title_is_known_on_all_screens(package: str, language: str) -> None:
    assert package == "frame" or package.capitalize() in every_word(language)


@pytest.mark.parametrize("language", FOREIGN)
def test_what_the_cell_may_be_in_is_in_the_catalogue(language: str) -> None:
    known = every_word(language, "now")
    named = {one.value for one in Custody} | set(WORK)
    named |= {one.value for one in Severity}
    assert sorted(named - set(known)) == []
    script = (PAGE / "now" / "static" / "now.js").read_text(encoding="utf-8")
    assert [name for name in SIGNALS if f"{name}: " not in script] == []


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_a_text_keeps_its_blanks_to_fill_in(package: str, language: str) -> None:
    for text, word in every_word(language, package).items():
        assert set(re.findall(r"\{\w+\}", text)) == set(re.findall(r"\{\w+\}", word)), text


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_the_compiled_catalogue_is_that_of_its_source(package: str, language: str) -> None:
    source = PAGE / package / "catalogues" / language / "LC_MESSAGES" / "page.po"
    read_ = read_po(io.BytesIO(source.read_bytes()))
    own = {one.id: one.string for one in read_ if one.id}
    shared = {} if package == "frame" else every_word(language)
    assert {**shared, **own} == dict(every_word(language, package))


def test_a_language_is_chosen_by_the_person_then_by_the_browser() -> None:
    assert chosen("de", "en") == "de"
    assert chosen(None, "fr-FR, de-AT;q=0.8, en;q=0.5") == "de"
    assert chosen("klingon", "fr") == "en"
    assert translator("de", "now")("Stop") == "Halt"
    assert translator("en", "now")("Stop") == "Stop"


def test_a_screen_without_a_text_has_that_of_the_frame() -> None:
    assert translator("de", "now")("Log out") == translator("de")("Log out") == "Abmelden"


CELL = Path(__file__).resolve().parents[2] / "controller" / "cell"
# Of the journals of shifts of four recipes: one sentence for each of the forms that they took.
REASONS = Path(__file__).resolve().parents[1] / "data" / "said" / "reasons.txt"
# Of recoveries, starts refused, devices that failed and parts without a grasp: one for each form.
MESSAGES = REASONS.parent / "messages.txt"
ENGLISH = re.compile(
    r"\b(the|of|is|are|not|with|to|and|from|its|or|by|which|no|at|it|be|than|plane|bore)\b"
)
# Where the cell makes what a person reads: name of the call, place and name of the text.
SAYING = {
    "Choice": (1, "words"),
    "Question": (1, "text"),
    "NextMotion": (0, "words"),
    "PartProblemError": (1, "message"),
    "PartFaultError": (1, "message"),
    "show": (0, "label"),
    "_move": (1, "words"),
}


def written(node: ast.expr | None) -> str:
    """Return a text as the catalogue has it, its blanks without names; empty for no literal."""
    match node:
        case ast.Constant(value=str() as text):
            return text
        case ast.JoinedStr(values=values):
            return "".join(written(one) or "{}" for one in values)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            both = written(left), written(right)
            return "".join(both) if all(both) else ""
    return ""


def said_by_the_cell() -> Iterator[str]:
    """Yield every text that the cell makes in place."""
    for path in sorted(CELL.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            func = node.func
            name = func.attr if isinstance(func, ast.Attribute) else getattr(func, "id", "")
            if name in SAYING:
                place, key = SAYING[name]
                named = next((one.value for one in node.keywords if one.arg == key), None)
                yield written(node.args[place] if len(node.args) > place else named)


@pytest.mark.parametrize("language", FOREIGN)
def test_every_alarm_has_its_words_in_each_language(language: str) -> None:
    known, told = cell_words(language), teller(language)
    for alarm in ALARMS:
        texts_ = (alarm.words, alarm.unknown, alarm.action)
        assert [text for text in texts_ if not known.get(text)] == [], alarm.code
        assert [text for text in texts_ if told(text) == text] == [], alarm.code
    assert [alarm.device for alarm in ALARMS if alarm.device not in known] == []


@pytest.mark.parametrize("language", FOREIGN)
def test_every_question_of_a_part_has_its_choices_in_each_language(language: str) -> None:
    known, told = cell_words(language), teller(language)
    for alarm in ALARMS:
        for custody, sweeps in product(Custody, (True, False)):
            question = question_for(
                alarm.code, "no part <here>", custody.value, sweeps_to_home=sweeps
            )
            named = [*(one.words for one in question.choices), *(w for _, w in question.preview)]
            assert [text for text in named if text not in known] == []
            frame = question.text.partition("no part <here>.")[2].partition(" (by the")[0]
            assert not frame or frame not in told(question.text)
            assert "no part <here>" in told(question.text)


@pytest.mark.parametrize("language", FOREIGN)
def test_what_the_cell_says_is_in_the_catalogue_with_its_blanks(language: str) -> None:
    known = {re.sub(r"\{\w+\}", "{}", text) for text in cell_words(language)}
    wanted = {text for text in said_by_the_cell() if re.search("[a-z]{3}", text)}
    wanted -= {"{} and now waits for you)"}  # the end of a sentence that the catalogue has whole
    missing = wanted - known
    assert len(wanted) > 60
    assert missing == set()
    data = [one.value for one in (*SafePoint, *FindingKind)]
    assert [text for text in data if text not in cell_words(language)] == []


def test_a_text_with_names_and_figures_is_put_into_words_with_them() -> None:
    told = teller("de")
    assert told("place in tray accept") == "in die Ablage Gut legen"
    assert told("place in tray <b>") == "in die Ablage <b> legen"
    assert told("show with grasp A15, square to F2 plane") == (
        "zeigen mit Griff A15, gerade vor F2 Ebene"
    )
    why = "the object at x 12, y -3 mm: no such shape; take it away, or check the recipe's `part:`"
    assert told(f"{why}.") == (
        "der Gegenstand bei x 12, y -3 mm: no such shape; wegnehmen, oder `part:` des Rezepts "
        "prüfen."
    )
    assert told("whatever nobody has written") == "whatever nobody has written"
    assert teller("en")("place in tray accept") == "place in tray accept"


CONTROLLER = CELL.parent
# Whose every sentence a page may show: reasons of verdicts and of what no view shows, names of
# faces and characteristics, recoveries, refusals.
REASONING = (
    "inspection", "recognition/identification", "planning/planner/why.py",
    "planning/views/visibility/_hidden.py", "cad/boundary/_types.py", "cad/surfaces/_counted.py",
    "cad/surfaces/features.py", "cell/batch/starting.py", "cell/compute/checks",
    "cell/devices/interlocks", "cell/machine/recovery.py", "cell/machine/table.py",
    "cell/operator/desk.py", "cell/operator/latch.py", "cell/services/table/choosing.py",
    "cell/services/table/labels.py", "page/frame/drawn.py", "results/judged/cad.py",
    # for and against going on after a crash
    "cell/custody", "cell/recovery", "cell/actions/recover.py",
    # why there is no grasp, no path, no plan
    "planning/disambiguation/_reasons.py", "planning/grasps/_synthesis.py",
    "planning/grasps/judge.py", "planning/motion/_paths.py", "planning/planner/beginning.py",
    "planning/planner/build.py", "planning/regrasps",
    # what messages of devices are put together from
    "../drivers/gripper_modbus/_registers.py", "../drivers/modbus_link/_address.py",
    "../drivers/umi_scara/model/limits.py", "../drivers/umi_scara/motion/_counters.py",
    "../drivers/umi_scara/motion/_moves.py", "../drivers/umi_scara/protocol/constants.py",
    "../drivers/ur_arm/protocol/modes.py",
    # calibrations, steps of commissioning, the doctor
    "cli/devices/doctor_checks.py", "bring_up/procedure/_status.py",
    "config/calibrations/_standing.py",
)  # fmt: skip
# Whose errors a page may show within a sentence: as what stopped a run, as why a step failed.
RAISING = (
    "../drivers", "bring_up", "calibration", "cell", "planning", "config/calibrations",
)  # fmt: skip
# Whose errors are met at a terminal alone: recorded lines, jogging, sheets to print.
AT_A_TERMINAL = {
    "_models.py", "_recorded.py", "jogger.py", "areas.py", "orders.py", "goals.py", "session.py",
    "wire_file.py",
}  # fmt: skip
# What is wrong in a file or with the program itself stays English.
NOT_TOLD = {
    "AssertionError", "ConfigError", "KeyError", "NotImplementedError", "RuntimeError",
    "TypeError", "ValueError",
}  # fmt: skip
# Sentences that are put together from more than one place: what the catalogue has for each.
COMPOSED: dict[str, tuple[str, ...]] = {
    "; shown in {} pictures": ("shown in {k} pictures",),
    "{} edges": ("{m} edges, {n} mm long, shown by none of {k} pictures that must show it",),
    "an edge": ("an edge, {n} mm long, shown by none of {k} pictures that must show it",),
    "left out by the recipe: {}": ("left out by the {source_id}: {own}",),
    "slot {} x {}": ("slot {n} x {m} mm",),
    "chamfer {} F{}": ("chamfer {n} mm", "{feature} F{a}"),
    "{}, position {}": (
        "{feature}, position from {datum}", "{feature}, position from the outline",
    ),
    "from {}": ("{feature}, position from {datum}",),
    "from the outline": ("{feature}, position from the outline",),
    "{} mm with U = {} mm": ("{label}: {n} mm with U = {u} mm, {items}",),
    "too near the limits {} to decide": (
        "{label}: {n} mm with U = {u} mm, too near the limits {limits} to decide",
    ),
    "{}: {}, beyond {}": ("{label}: {n} mm with U = {u} mm, beyond {limits}",),
    "{}: {}, not proven; {}": ("{label}: {n} mm with U = {u} mm, not proven; {items}",),
    "2 U is {} of the tolerance, above {}": ("2 U is {n}% of the tolerance, above {m}%",),
    "{} of {} mm on {} % of {}": tuple(
        f"{{what}} of {{n}} mm on {{p}} % of the {of}{half}"
        for of in ("edges", "surface")
        for half in ("", " (half of that: {m} mm)")
    ),
    "the edges": ("{what} of {n} mm on {p} % of the edges",),
    "the surface": ("{what} of {n} mm on {p} % of the surface",),
    " and {} more faces": ("{k} more faces", " and "),
    "{} of its edge to decide: {}": ("light hides too much of its edge to decide: {items}",),
    "light hides too much": ("light hides too much of its edge to decide: {items}",),
    "{} is {} the {} limit {}, U {}": tuple(
        f"{{n}} is {word} the {side} limit {{m}}, U {{u}}"
        for word in ("beyond", "too near to")
        for side in ("upper", "lower")
    ),
    "too near to": ("{n} is too near to the upper limit {m}, U {u}",),
    "F{} {} R{} mm": ("F{a} fillet R{n} mm", "F{a} round R{n} mm"),
    "F{} {} {} mm": ("F{a} bore {n} mm", "F{a} boss {n} mm"),
    "{} {} mm {}": tuple(
        f"{name} {{n}} mm {depth}"
        for name in ("hole", "stepped hole")
        for depth in ("through", "{m} mm deep")
    ),
    "{} mm deep{}": ("{n} mm deep", "{n} mm deep, through"),
    "stepped hole": ("stepped hole {n} mm through",),
    "left out: a further view would add less than {} of the surface": (
        "left out: a further view would add less than {n}% of the surface",
    ),
    "{} to {} mm": ("{a} to {size}",),
    "planning from pose {} ({})": ("planning from pose {k} ({p}%)",),
    "hidden by the part itself: no place of the camera sees it at all{}": (
        "hidden by the part itself: no place of the camera sees it at all",
    ),
    "hidden by the part itself: seen {} degrees from its normal at best, where {} count as "
    "seen{}": (
        "hidden by the part itself: seen {d} degrees from its normal at best, where {n} count as "
        "seen",
    ),
    "do not press": ("arm gripper: its jaws stand at {n} mm and do not press",),
    "; on the part its jaws stood at {} mm{}": (
        "fixed gripper: its jaws stand at {n} mm and {touch}; its light barrier {sees}; on the "
        "part its jaws stood at {m} mm; it is not ready",
    ),
    "the {}": (
        "The arm gripper holds", "The fixed gripper holds",
        "The arm gripper and the fixed gripper hold",
    ),
    "may hold": (
        "The arm gripper may hold", "The fixed gripper may hold",
        "The arm gripper and the fixed gripper may hold",
    ),
    "{} {} a part: {}": tuple(
        f"{{holders}} a part: {{items}}. Nothing has moved. {on}To take the part out: {{order}} "
        f"opens the gripper while you hold it; then start again{again}"
        for on in ("", "{on} ")
        for again in ("", " with --part-removed")
    ),
    "To go on with the part, start with --auto-recover, or use `cellctl recover --accept`. ": (
        "To go on with the part, start with --auto-recover, or use `cellctl recover --accept`",
    ),
    "The cell does not go on by itself: {}. ": ("The cell does not go on by itself: {why}",),
    **{
        f"path {where}": (f"{{part}}: path {where}",)
        for where in ("to the pick", "round the fixed gripper", "to the fixed gripper",
                      "to the table")
    },
    "path to view {}": ("{part}: path to view {view_id}",),
    "{}: the {} cannot hold it": (
        "{part}: the {gripper} cannot hold it; grasps left by each requirement: {items}; fit other "
        "fingers or pads",
        "arm", "fixture",
    ),
    "grasps left by each requirement: {}": (
        "{part}: the {gripper} cannot hold it; grasps left by each requirement: {items}; fit other "
        "fingers or pads",
    ),
    "grasps round seeds": ("grasps round seeds {k}",),
    "approach seems free": ("approach seems free {k}",),
    "clear of the part": ("clear of the part {k}",),
    "little enough weight": ("little enough weight {k} {how}",),
    "enough contact off the table": ("enough contact off the table {k} {how}",),
    "strong enough": ("strong enough {k} {how}",),
    "{}strong enough": ("strong enough {k} {how}", "on the table: {stage}"),
    "{}enough contact": ("enough contact {k} {how}", "measured finely: {stage}"),
    "{}contacts opposite": ("contacts opposite {k} {how}",),
    "{}touched by both pads": ("touched by both pads {k}",),
    "{}sure": ("sure {k} {how}",),
    "best {}": ("(best {n}, {m} required)",),
    "none came so far": ("(none came so far, {m} required)",),
    "{} {} ({}, {} required)": tuple(
        f"({how}, {{m}}{unit} required)"
        for how in ("best {n}", "none came so far")
        for unit in ("", " mm2", " mm apart", " of the friction limit", " of wrong poses")
    ),
    "no pick in this pose: in it the part is {} mm high": (
        "no pick in this pose: in it the part is {n} mm high, and none of its {k} grasps from "
        "above clears the table by {m} mm{how}",
    ),
    " and others": ("others", " and "),
    "{} of {}": tuple(f"F{{a}} {kind} of {{part}}" for kind in ("plane", "cone", "bore {n} mm")),
    ", passed by {} {} ({} {} is the end)": tuple(
        f"{{axis}}: {{n}} counts required, the limit is {{m}}, passed by {{u}} {unit} ({{e}} "
        f"{unit} is the end)"
        for unit in ("deg", "mm")
    ),
    " (no such pose)": ("{axis}: {n} counts required, the limit is {m} (no such pose)",),
    "ioctl 0x{}: {} bytes came back, not {}": ("ioctl {code}: {n} bytes came back, not {m}",),
    "is gone": ("the calibration `{name_id}` is gone since {when}",),
    "is another one": ("the calibration `{name_id}` is another one since {when}",),
    "is not there": ("{path_id}: is not there",),
    "may be used": ("{path_id}: may be used",),
    "may not be used": ("{path_id}: may not be used",),
    "from files": ("{what} (from files)",),
    "{} is {}: {}": ("{name_id} is not ok: {advice}", "{name_id} is unknown: {advice}"),
    "{} by {}": ("{y}-{m}-{d} {h}:{i} by {who}",),
    "{}, {}, {} mm": ("{model}, active, {n} mm", "{model}, not activated, {n} mm"),
}  # fmt: skip
# What reads like a sentence and is shown on no page: errors of recipes, rules, events nobody sees.
UNSEEN = {
    "; nearest: {}",
    "fixed_gripper_free | custody_in_fixed | custody_in_both | custody_lost",
    "moves_arm & near_hand_off",
    "a forecast",  # a file of the cache, in a log
    "outcome of a task that was stopped",
    "private, max-age=86400, immutable",
    # addresses, files, and how the doctor prints
    "Modbus RTU over TCP {}:{}",
    "Modbus RTU {} at {} 8{}",
    "Modbus TCP {}:{}",
    "all well",
    "bold red",
    "cellctl commission --step verify",
    "emulator {} {}",
    "in {}",
    "ok  ",
    "picture: {} camera, {}: {}",
    "pip install {}",
    "tray {}",
    "{} of {} checks failed",
    "{}, {} x {} px",
    # how `cellctl learn` prints
    "; {} differs from the others",
    "view {}, {} parts",
    "{} differs from the others and is left out",
    "{}: shown alike by {} parts",
    "{}-{}-recover",
    "{}.json",
    # how an arm stands to its path: for the code alone
    "each axis stands between the two ends, on a share of its own",
    "on its line",
    "some axes have gone their share of the way, the others have not set out",
}


def unnamed(text: str) -> str:
    """Return a text of the catalogue with blanks as a source has them."""
    return re.sub(r"(\{\})+", "{}", re.sub(r"\{\w*\}", "{}", text))


def sentences(path: Path) -> Iterator[str]:
    """Yield every text of several words or with blanks; no documentation, log, or raised text."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    silent: set[int] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Raise() | ast.Assert() | ast.Expr(value=ast.Constant()):
                silent |= {id(one) for one in ast.walk(node)}
            case ast.Call(func=ast.Attribute(value=ast.Name(id="log"))):
                silent |= {id(one) for one in ast.walk(node)}
            case ast.FunctionDef(returns=ast.expr() as returns):
                silent |= {id(one) for one in ast.walk(returns)}
            case ast.JoinedStr(values=values):
                silent |= {id(one) for one in values if isinstance(one, ast.Constant)}
            case ast.FormattedValue(format_spec=ast.expr() as how):
                silent |= {id(one) for one in ast.walk(how)}
    for node in ast.walk(tree):
        text = "" if id(node) in silent or not isinstance(node, ast.expr) else written(node)
        if re.search("[a-z]{2}", text) and re.search("[ {]", text):
            yield text


def modules(*places: str) -> Iterator[Path]:
    """Yield the modules of packages and modules, by their paths within the controller."""
    for place in places:
        path = CONTROLLER / place
        yield from sorted(path.rglob("*.py")) or [path]


def messages(path: Path) -> Iterator[str]:
    """Yield every message that errors are made with, but those of `NOT_TOLD`."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", "") or getattr(node.func, "id", "")
        if name.endswith("Error") and name not in NOT_TOLD:
            yield from (text for one in node.args if re.search("[a-z]{2}", text := written(one)))


def is_part_of(text: str, known: frozenset[str]) -> bool:
    """Return whether a text, with something in its blanks, is or ends in a known one."""
    own = [re.escape(piece) for piece in text.split("{}")]
    if len("".join(own)) < 12:
        return False
    fits = re.compile(".*".join(own), re.DOTALL)
    return any(fits.fullmatch(one) for one in known)


@pytest.mark.parametrize("language", FOREIGN)
def test_every_message_of_an_error_is_in_the_catalogue(language: str) -> None:
    found = {
        unnamed(text).removesuffix(".")
        for path in modules(*RAISING)
        if path.name not in AT_A_TERMINAL
        for text in messages(path)
        if re.search("[ {]", text)
    }
    assert len(found) > 250
    known = frozenset(unnamed(text).removesuffix(".") for text in cell_words(language))
    missing = {
        text
        for text in found - known - UNSEEN - set(map(unnamed, COMPOSED))
        if not is_part_of(text, known)
    }
    assert missing == set()


def test_every_sentence_of_a_verdict_is_in_the_catalogue() -> None:
    found = {
        unnamed(text).removesuffix(".") for path in modules(*REASONING) for text in sentences(path)
    }
    assert len(found) > 400
    for language in FOREIGN:
        words = cell_words(language)
        known = {unnamed(text).removesuffix(".") for text in words}
        assert [text for texts in COMPOSED.values() for text in texts if text not in words] == []
        # what begins or ends within a sentence is a piece of one
        missing = {
            text
            for text in found - known - UNSEEN - set(map(unnamed, COMPOSED))
            if (text[0] not in " ,;" and text[-1] != " ") or not any(text in one for one in known)
            if not is_part_of(text, frozenset(known))
        }
        assert missing == set()


@pytest.mark.parametrize("language", FOREIGN)
def test_names_of_kinds_faults_and_trays_are_in_the_catalogue(language: str) -> None:
    named = {one.value for one in (*Unjudged, *FindingKind, *CharacteristicKind, *PartFault, *Act)}
    named |= {one.name.lower() for one in FindingKind} | {"identity", "backlit"}
    named |= {*DEFECT_WORDS.values(), *TRAYS.values(), QUARANTINE}
    assert sorted(named - set(cell_words(language))) == []


def test_reasons_of_real_runs_keep_no_english_in_german() -> None:
    reasons = REASONS.read_text(encoding="utf-8").splitlines()
    told = teller("de")
    assert len(reasons) > 50
    assert [reason for reason in reasons if ENGLISH.search(told(reason))] == []
    assert [reason for reason in reasons if re.search(r"\d\.\d", told(reason))] == []


def test_messages_of_recoveries_and_devices_keep_no_english_in_german() -> None:
    messages_ = MESSAGES.read_text(encoding="utf-8").splitlines()
    told = teller("de")
    assert len(messages_) > 200
    assert [one for one in messages_ if told(one) == one or ENGLISH.search(told(one))] == []


def everything_about_the_custody() -> Iterator[str]:
    """Yield what is said of where a part is, from each custody and each way a start is refused."""
    detail = "the hand-off was reversed"
    since = "2026-01-02T03:04:05+00:00"
    for custody in Custody:
        yield from (where_it_is(custody), where_it_is(custody, detail))
        held = Held(GripperName.ARM, custody, "run-1", 2, since, detail)
        yield from (known_words(held), known_words(replace(held, part=0, detail="")))
    for jaws in Jaws:
        yield f"the arm gripper's jaws {jaws.value}"
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


@pytest.mark.parametrize("language", FOREIGN)
def test_what_is_cut_off_is_named_in_each_language(language: str) -> None:
    known = cell_words(language)
    assert [one for one in Once if one.value.replace("_", " ") not in known] == []
    assert [one for one in (*Occupancy, *Custody) if one.value not in known] == []
    assert [name for name in REQUIRED_SIGNALS if name not in known] == []


def test_lines_are_put_into_words_one_by_one() -> None:
    question = (
        "Run 7 has left a part. Evidence:\n  - arm: its counters read what it was last sent to, "
        "and it has not restarted\n  - a note by hand\nThe cell would:\n  - take the arm home: the "
        "part is in its tray"
    )
    assert teller("de")(question) == (
        "Lauf 7 hat ein Teil zurückgelassen. Was dafür spricht:\n  - Arm: seine Zähler zeigen, "
        "wohin er zuletzt geschickt wurde, und er hat nicht neu gestartet\n  - a note by hand\nDie "
        "Zelle würde:\n  - den Arm in die Parkstellung fahren: das Teil ist in seiner Ablage"
    )


@pytest.mark.parametrize(
    ("said", "word"),
    [
        (
            "width 7.46 mm F44 to F66: 7.096 mm with U = 0.304 mm, too near the limits 7.264 to "
            "7.664 mm to decide",
            "Breite 7,46 mm F44 bis F66: 7,096 mm mit U = 0,304 mm, zu nah an den Grenzen 7,264 "
            "bis 7,664 mm, um zu entscheiden",
        ),
        (
            "hole 3.4 mm (1) step 6.5 mm, position from boss 40 mm",
            "Bohrung 3,4 mm (1) Stufe 6,5 mm, Lage von Zapfen 40 mm",
        ),
        # several clauses are put into words all together, or none of them
        (
            "no edge of it is in sight; no view of it",
            "keine Kante davon ist zu sehen; keine Ansicht davon",
        ),
        ("no edge of it is in sight; rusty", "no edge of it is in sight; rusty"),
        (
            "light hides too much of its edge to decide: A2-V0 backlit: no edge of it is in sight",
            "Licht verdeckt zu viel von der Kante, um zu entscheiden: A2-V0 Gegenlicht: keine "
            "Kante davon ist zu sehen",
        ),
        (
            "they differ only at F1 plane of block and F2 bore 3.5 mm of block, by up to 2.5 mm, "
            "which the part or the gripper hides in all 12 views that can be reached; another "
            "grasp may show it",
            "sie unterscheiden sich nur an F1 Ebene von block und F2 Bohrung 3,5 mm von block, um "
            "bis zu 2,5 mm, und das verdeckt das Teil oder der Greifer in allen 12 erreichbaren "
            "Ansichten; ein anderer Griff zeigt es vielleicht",
        ),
        # a name that looks like a figure, or like a text of the cell, is a name
        ("the serial number 1.50", "die Seriennummer 1.50"),
        ("left out by the recipe: a rib 2.5 mm", "ausgelassen laut Rezept: a rib 2.5 mm"),
        # only what is known has a diameter
        ("its odd diameter", "its odd diameter"),
        ("stain at F1 plane and F2 cone: 3.5 mm across, 4 mm2, view A1-V2, backlit",
         "Fleck auf F1 Ebene und F2 Kegel: 3,5 mm groß, 4 mm², Ansicht A1-V2, Gegenlicht"),
        ("chip at F1 plane: 3.5 mm across, 4.0 mm2, view A1-V2, backlit; shown in 14 pictures",
         "Ausbruch auf F1 Ebene: 3,5 mm groß, 4,0 mm², Ansicht A1-V2, Gegenlicht; auf 14 Bildern "
         "zu sehen"),
        ("unconfirmed: face out of place at F8 plane and F9 plane: the floor shows about 1.0 mm "
         "higher, view v12, station_ring",
         "unbestätigt: Fläche am falschen Ort auf F8 Ebene und F9 Ebene: der Boden liegt auf "
         "Bildern etwa 1,0 mm höher, Ansicht v12, Ringlicht der Station"),
    ],
)  # fmt: skip
def test_a_reason_is_put_into_words_with_its_figures(said: str, word: str) -> None:
    assert teller("de")(said) == word
    assert teller("en")(said) == said


@pytest.mark.parametrize("language", FOREIGN)
def test_the_cells_catalogue_is_that_of_its_source_and_keeps_blanks(language: str) -> None:
    source = PAGE / "frame" / "catalogues" / language / "LC_MESSAGES" / "cell.po"
    read_ = read_po(io.BytesIO(source.read_bytes()))
    assert {one.id: one.string for one in read_ if one.id} == dict(cell_words(language))
    for text, word in cell_words(language).items():
        assert sorted(re.findall(r"\{\w+\}", text)) == sorted(re.findall(r"\{\w+\}", word)), text


@pytest.mark.parametrize(
    ("language", "number", "signed", "tally"),
    [("en", "1234.50", "+0.025", "100,000"), ("de", "1234,50", "+0,025", "100.000")],
)
def test_numbers_are_written_as_the_language_does(
    language: str, number: str, signed: str, tally: str
) -> None:
    assert value_in(language, 1234.5, 2) == number
    assert value_in(language, 0.025, is_signed=True) == signed
    assert value_in(language, None) == "–"
    assert count_in(language, 100_000) == tally
