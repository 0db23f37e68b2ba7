"""The page in Chromium: what a person sees, clicks and loses, with the cell's end kept in hand."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")

from cad_solids import box, mesh_of
from page_bench import HERE, PASSWORD, RUN, bench, journal, picture
from playwright.sync_api import sync_playwright
from test_page_now import STATUS, plan_row

from controller.cell.alarms import BY_CODE
from controller.cell.control import (
    AnswerOrder,
    DecisionReply,
    NoRunError,
    Order,
    RunningCell,
    StatusReply,
)
from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.cell.operator.questions import question_for
from controller.cell.recovery.propose import listed
from controller.launching import LAST_NAME, LOG_FOLDER, Launcher, RunRequest
from controller.page import serving as serving_module
from controller.page.frame.screens import RequestRefusedError
from controller.page.now import live as live_module
from controller.page.security import Account, PageAddress, Role
from messages import say
from messages.words import teller

CHROMIUM = Path("/usr/bin/chromium")
pytestmark = pytest.mark.skipif(not CHROMIUM.is_file(), reason="no Chromium at /usr/bin/chromium")
AXE = Path(__file__).parents[1] / "data" / "axe" / "axe.min.js"
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
QUESTION = {
    "number": 4,
    "code": "no_part",
    "text": "no part <b>on</b> the table",
    "choices": [
        {"key": "look", "words": "look again", "first": "the arm parks"},
        {"key": "stop", "words": "end the run", "first": ""},
    ],
}
PATIENT_MS = 120_000  # a guard against a hang, no measure


def grave(tab: Any) -> list[Any]:
    """Return what axe finds serious or critical."""
    tab.evaluate(AXE.read_text(encoding="utf-8"))
    found = tab.evaluate("axe.run(document).then(found => found.violations)")
    return [
        (one["id"], [node["target"] for node in one["nodes"]])
        for one in found
        if one["impact"] in ("serious", "critical")
    ]


def require_sound_on_all_screens(tab: Any) -> None:
    """Check that what is shown is no wider than two screens, and that axe finds nothing grave."""
    for width in (1280, 390):
        tab.set_viewport_size({"width": width, "height": 844})
        assert tab.evaluate("document.documentElement.scrollWidth") <= width
        for scheme in ("dark", "light"):
            tab.emulate_media(color_scheme=scheme)
            assert grave(tab) == []


def until(tab: Any, is_so: Callable[[], bool]) -> None:
    """Wait until something is so; the page's policy allows no expression of the test's in it."""
    for _ in range(PATIENT_MS // 50):
        if is_so():
            return
        tab.wait_for_timeout(50)
    raise AssertionError("it did not become so")


class Served:
    """A page at a port, before a cell whose status and orders the test has."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.status: dict[str, Any] = dict(STATUS)
        self.has_run = True
        self.orders: list[tuple[str, Order]] = []
        monkeypatch.setattr(RunningCell, "status", lambda _: self._ask())
        monkeypatch.setattr(RunningCell, "order", lambda _, name, body: self._take(name, body))
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port: int = free.getsockname()[1]
        self.origin = f"http://127.0.0.1:{port}"
        page = bench(folder, PageAddress.served("127.0.0.1", port, with_tls=False)).page
        page.accounts.put("vera", Role.VIEWER, PASSWORD)
        self.sessions = page.sessions
        made: list[live_module.Live] = []
        begin = live_module.Live.run

        async def run(live: live_module.Live) -> None:
            made.append(live)
            await begin(live)

        monkeypatch.setattr(live_module.Live, "run", run)
        app = serving_module.build(folder / "runs", folder, page.site, page.accounts, page.sessions)
        self._server = serving_module.server_of(app, serving_module.Serving("127.0.0.1", port))
        self._thread = threading.Thread(target=self._server.run)
        self._thread.start()
        while not self._server.started:
            time.sleep(0.02)
        (self.live,) = made

    def _ask(self) -> StatusReply:
        if not self.has_run:
            raise NoRunError("no run")
        return StatusReply.model_validate(self.status)

    def _take(self, name: str, body: Order) -> DecisionReply:
        self.orders.append((name, body))
        return DecisionReply(decision="handled", state="suspending_grasping")

    def link(self, role: Role = Role.OPERATOR) -> str:
        return f"{self.origin}/enter?token={self.sessions.link(Account('ada', role))}"

    def end(self) -> None:
        self._server.should_exit = True
        self._thread.join()


SECOND_VIEW = ((0, 10, 40), (1, 25, 40), (2, 40, 40))
THERE = (0.25, 0.5, 0.25, -300.0, -0.5, 0.5)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    block = tmp_path / "block.stl"
    mesh_of(box(40, 30, 10)).export(block)
    writer = journal(tmp_path / "runs", part=block)
    picture(tmp_path / "runs", "pictures/a.png")
    writer.write(plan_row(), 1)
    writer.write(rows.StepDone(label="pick", forecast_s=9.0, seconds=9.5), 1)
    writer.write(
        rows.ViewPicturesTaken(view="V<1>", pictures={"ring": "pictures/a.png"}, q=HERE), 1
    )
    writer.write(rows.ViewJudged(view="V<1>", evaluated=True, faces=((0, 10, 40),)), 1)
    writer.close()
    found = Served(tmp_path, monkeypatch)
    yield found
    found.end()


@pytest.fixture
def tab(chromium: Any) -> Iterator[Any]:
    context = chromium.new_context(viewport={"width": 1280, "height": 900}, locale="en")
    context.set_default_timeout(PATIENT_MS)
    found = context.new_page()
    found.problems = []
    found.on("pageerror", lambda error: found.problems.append(str(error)))
    yield found
    assert found.problems == []
    context.close()


def test_every_button_reaches_the_cell_once_in_the_persons_name(served: Served, tab: Any) -> None:
    tab.goto(served.link())
    for kind in ("step", "safe", "now"):
        tab.fill("#why", f"because {kind}")
        tab.click(f"[data-pause={kind}]:enabled")
        until(tab, lambda: tab.input_value("#why") == "")
    tab.click("#stop")
    until(tab, lambda: len(served.orders) == 4)
    first = {"words": "the arm, 3 mm", "tcp_mm": 3.0, "turn_deg": 0.0, "seconds": 1.0}
    served.status |= {
        "state": "suspended_grasping",
        "pause_seconds": {},
        "first_motion": first,
        "question": QUESTION,
    }
    tab.wait_for_selector("#resume:enabled")
    assert "the arm, 3 mm" in tab.inner_text("#resume")
    tab.click("#resume")
    until(tab, lambda: len(served.orders) == 5)
    until(tab, lambda: tab.inner_text("#said").startswith("✓"))
    assert "no part <b>on</b> the table" in tab.inner_text("#question")
    tab.click("[data-answer=look]")
    until(tab, lambda: len(served.orders) == 6)
    assert [name for name, _ in served.orders] == [
        *["pause"] * 3,
        "stop",
        "resume",
        "answer",
    ]
    assert {order.who for _, order in served.orders} == {"ada, page"}
    assert [order.why for _, order in served.orders[:3]] == [
        f"because {kind}" for kind in ("step", "safe", "now")
    ]
    assert served.orders[4][1].model_dump()["first"] == "the arm, 3 mm"
    assert served.orders[5][1].model_dump()["number"] == 4


def test_after_an_open_door_resume_waits_for_the_acknowledgement_alone(
    served: Served, tab: Any
) -> None:
    served.status |= {"state": "suspended_grasping", "pause_seconds": {}, "barred": "look first"}
    tab.goto(served.link())
    tab.wait_for_selector("#ack:visible")
    assert "look first" in tab.inner_text("#resume")
    assert tab.is_disabled("#resume")
    tab.fill("#why", "nobody is in it")
    tab.click("#ack")
    until(tab, lambda: [name for name, _ in served.orders] == ["ack"])
    served.status |= {"barred": ""}
    tab.wait_for_selector("#resume:enabled")
    assert tab.is_hidden("#ack")


def test_the_coverage_of_the_part_fills_and_the_next_part_begins_with_none(
    served: Served, tab: Any, tmp_path: Path
) -> None:
    def shares() -> list[str]:
        return [row.split("\t")[1].strip() for row in tab.inner_text("#coverage-rows").split("\n")]

    tab.goto(served.link())
    tab.wait_for_selector("#coverage[data-drawn]")
    tab.click("#coverage-table summary")
    until(tab, lambda: sorted(shares()) == sorted(["25 %", *["0 %"] * 5]))
    # the two largest of six faces have 1200 mm² of 3800 each
    assert "8 % of the surface" in tab.inner_text("#coverage-words")
    third = "up to a third: 1 face, 1,200 mm²"
    until(tab, lambda: third in tab.inner_text("#coverage-legend"))
    writer = Journal(tmp_path / "runs" / JOURNAL_NAME, RUN)
    writer.write(rows.ViewJudged(view="V2", evaluated=True, faces=SECOND_VIEW), 1)
    until(tab, lambda: shares()[:4] == ["25 %", "63 %", "100 %", "0 %"])
    most = "more than two thirds: 1 face,"
    until(tab, lambda: most in tab.inner_text("#coverage-legend"))
    writer.write(rows.TablePictures({"ring": "pictures/a.png"}), 2)
    writer.close()
    until(tab, lambda: set(shares()) == {"0 %"})
    assert "Part 2" in tab.inner_text("#coverage-words")


def test_what_moves_first_is_drawn_while_the_cell_is_paused_and_gone_afterwards(
    served: Served, tab: Any
) -> None:
    first = {
        "words": "the arm", "tcp_mm": 3.0, "turn_deg": 0.0, "seconds": 1.0,
        "waypoints": [HERE, THERE],
    }  # fmt: skip
    tab.goto(served.link())
    tab.wait_for_selector("#scene[data-preview=no]")
    served.status |= {"state": "suspended_grasping", "first_motion": first}
    tab.wait_for_selector("#scene[data-preview=yes]")
    assert "what moves first" in tab.inner_text("#scene-words")
    served.status |= {"state": "execute_grasping", "first_motion": None}
    tab.wait_for_selector("#scene[data-preview=no]")
    assert "what moves first" not in tab.inner_text("#scene-words")


def test_a_run_is_started_with_what_the_person_filled_in(
    served: Served, tab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(_: RunningCell) -> StatusReply:
        raise NoRunError("no run at this cell")

    begun: list[tuple[RunRequest, str]] = []

    async def start(_: Launcher, body: RunRequest, who: str) -> None:
        begun.append((body, who))
        if len(begun) == 1:
            raise RequestRefusedError(409, "run <b>x</b> has the cell")

    monkeypatch.setattr(RunningCell, "status", nobody)
    monkeypatch.setattr(Launcher, "start", start)
    tab.goto(served.link())
    tab.wait_for_selector("#start-recipes select")
    assert not tab.is_visible("#stop")
    tab.select_option("#start-recipes select", "holder")
    assert "arm" in tab.inner_text("#start-devices")
    tab.fill("#start-recipes .count", "7")
    tab.click("#start-more")
    tab.fill("#start-lot", "L 7")
    tab.select_option("#start-serials-how", "listed")
    tab.fill("#start-serials", "A\n\n B ")
    tab.click("#start-form summary")
    tab.check("#start-trays")
    tab.click("#start")
    until(tab, lambda: "run <b>x</b> has the cell" in tab.inner_text("#start-said"))
    tab.click("#start")
    until(tab, lambda: tab.inner_text("#start-said") == "")
    tab.select_option("#start-serials-how", "across")
    tab.fill("#start-serial-from", "A001")
    tab.click("#start")
    until(tab, lambda: len(begun) == 3)
    until(tab, lambda: tab.inner_text("#start-said") == "")
    tab.select_option("#start-serials-how", "scan")
    tab.click("#start")
    until(tab, lambda: len(begun) == 4)
    (first, who), (second, _), (counted, _), (read, _) = begun
    assert (counted.serial_from, counted.goes_on, counted.serials) == ("A001", True, ())
    assert (read.is_read, read.serial_from, read.serials) == (True, "", ())
    assert (first, who) == (second, "ada")
    assert first.recipes[0].word == "holder=7"
    assert len(first.recipes) == 2
    assert (first.lot, first.serials, first.are_trays_empty) == ("L 7", ("A", "B"), True)


def test_the_same_batch_again_is_the_one_primary_button_and_one_click(
    served: Served, tab: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[RunRequest] = []

    async def start(_: Launcher, body: RunRequest, __: str) -> None:
        begun.append(body)

    monkeypatch.setattr(Launcher, "start", start)
    served.has_run = False
    last = RunRequest.model_validate(
        {"recipes": [{"recipe": "holder", "count": 7}, {"recipe": "holder", "count": 2}],
         "lot": "L 7", "serial_from": "A001", "speed": 5}
    )  # fmt: skip
    folder = tmp_path / "runs" / LOG_FOLDER
    folder.mkdir()
    (folder / LAST_NAME).write_text(last.model_dump_json())
    tab.goto(served.link())
    tab.wait_for_selector("#again", state="visible")
    assert tab.locator("button.primary:visible").count() == 1
    assert not tab.is_visible("#start")
    until(tab, lambda: "holder × 7 · holder × 2 · lot L 7" in tab.inner_text("#again-words"))
    assert "count on" in tab.inner_text("#again-words")
    tab.click("#again")
    again = last.again
    assert again is not None
    until(tab, lambda: [one.model_dump() for one in begun] == [again.model_dump()])


def test_a_run_that_is_being_prepared_says_for_how_long_and_is_cancelled(
    served: Served, tab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    cancelled: list[bool] = []

    async def cancel(_: Launcher) -> None:
        cancelled.append(True)

    facts = {
        "recipes": "holder", "who": "ada", "began": "2026-11-28T10:00:00+00:00", "code": None,
        "lines": ["checking holder"],
    }  # fmt: skip
    monkeypatch.setattr(Launcher, "cancel", cancel)
    served.has_run = False
    tab.goto(served.link())
    tab.wait_for_selector("#state-name")
    served.live._started = lambda: facts
    tab.wait_for_selector("#started-cancel", state="visible")
    assert tab.is_visible("#started-bar")
    until(tab, lambda: tab.inner_text("#started-now").startswith("for "))
    tab.click("#started-cancel")
    until(tab, lambda: cancelled == [True])
    served.has_run = True  # it can be asked now: it has orders of its own
    tab.wait_for_selector("#started-cancel", state="hidden")


def test_a_list_of_parts_is_sent_seen_and_started_and_a_dry_run_needs_none(
    served: Served, tab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody(_: RunningCell) -> StatusReply:
        raise NoRunError("no run at this cell")

    begun: list[RunRequest] = []

    async def start(_: Launcher, body: RunRequest, who: str) -> None:
        begun.append(body)

    monkeypatch.setattr(RunningCell, "status", nobody)
    monkeypatch.setattr(Launcher, "start", start)
    tab.goto(served.link())
    tab.wait_for_selector("#start-recipes select")
    tab.select_option("#start-serials-how", "file")
    assert not tab.is_visible("#start-recipes .count")
    bad = {"name": "list.csv", "mimeType": "text/csv", "buffer": b"recipe\n<b>x</b>\n"}
    tab.set_input_files("#start-list", bad)
    until(tab, lambda: "`<b>x</b>`: there is no such file" in tab.inner_text("#start-list-said"))
    tab.click("#start")
    assert "Choose the list" in tab.inner_text("#start-said")
    text = b"recipe,serial\nholder,A1\nholder,A2\n"
    tab.set_input_files("#start-list", {**bad, "buffer": text})
    until(tab, lambda: tab.inner_text("#start-list-said") == "✓ 2 parts: holder: 2")
    tab.click("#start")
    until(tab, lambda: len(begun) == 1)
    assert (begun[0].recipes, len(begun[0].parts_list)) == ((), 16)
    until(tab, lambda: tab.inner_text("#start-said") == "")
    tab.click("#start-form summary")
    tab.check("#start-dry")
    assert not tab.is_visible("#start-serials-how")
    assert not tab.is_visible("#start-list")
    assert tab.is_visible("#start-recipes select")
    tab.select_option("#start-recipes select", "holder")
    tab.click("#start")
    until(tab, lambda: len(begun) == 2)
    assert begun[1].is_dry
    assert [one.word for one in begun[1].recipes] == ["holder"]


SCAN: dict[str, Any] = {
    "number": 5,
    "code": "scan",
    "text": "read its serial number",
    "choices": [],
    "entry": "serial number",
}


def test_a_scanner_that_types_answers_and_a_refused_number_is_replaced_by_the_next(
    served: Served, tab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def take(_: RunningCell, name: str, body: AnswerOrder) -> DecisionReply:
        served.orders.append((name, body))
        if body.key == "A1":
            reason = "A1: a part of this run <b>has</b> this number already"
            return DecisionReply(decision="refused", state="execute_acquiring", reason=reason)
        served.status |= {"question": {**SCAN, "number": 6} if body.number == 5 else None}
        return DecisionReply(decision="handled", state="execute_acquiring")

    monkeypatch.setattr(RunningCell, "order", take)
    tab.goto(served.link())
    tab.wait_for_selector("#stop:enabled")
    assert not tab.is_visible("#entry")
    served.status |= {"question": SCAN}
    tab.wait_for_selector("#entry-text:focus")
    assert "Serial number" in tab.inner_text("#entry label")
    tab.keyboard.press("Enter")  # an empty line is no number
    tab.keyboard.type("A1\n")
    until(tab, lambda: "<b>has</b> this number already" in tab.inner_text("#entry-said"))
    tab.keyboard.type("B <2>\n")
    until(tab, lambda: tab.inner_text("#question-head") == "Question 6")
    assert (tab.input_value("#entry-text"), tab.inner_text("#entry-said")) == ("", "")
    tab.wait_for_selector("#entry-text:focus")
    tab.fill("#entry-text", "x" * 90)
    tab.click("#entry button")
    tab.wait_for_selector("#entry", state="hidden")
    answers = [body.model_dump() for name, body in served.orders if name == "answer"]
    expected = [("A1", 5), ("B <2>", 5), ("x" * 80, 6)]
    assert [(one["key"], one["number"]) for one in answers] == expected
    assert len(answers) == len(served.orders)


def test_a_german_page_asks_warns_and_counts_in_german(
    served: Served, tab: Any, tmp_path: Path
) -> None:
    told = teller("de")
    question = question_for(
        "many_parts",
        say(
            "{seen_count} objects on the table: {where}; no gripper reaches {part} between them: "
            "move them apart",
            seen_count=2,
            where="<b>bar</b> at x 1",
            part="bar",
        ),
        "on the table",
    )
    asked = {
        "number": 4, "code": question.code, "text": question.text,
        "choices": [
            {"key": one.key, "words": one.words, "first": dict(question.preview).get(one.key, "")}
            for one in question.choices
        ],
    }  # fmt: skip
    served.status |= {"question": asked, "alarms": ["411 many_parts"], "label": "planning"}
    tab.goto(served.link())
    tab.goto(f"{served.origin}/now?lang=de")
    tab.wait_for_selector("[data-answer=look]:enabled")
    assert tab.inner_text("#question-text") == told(question.text)
    assert told(question.text).startswith("2 Gegenstände auf dem Tisch: <b>bar</b> at x 1;")
    for one in question.choices:
        assert told(one.words) in tab.inner_text(f"[data-answer={one.key}]")
    assert told(BY_CODE["many_parts"].action) in tab.inner_text("#alarms")
    assert "plant" in tab.inner_text("#doing")
    lines = listed(["arm: not connected", "whatever"])
    served.status |= {"question": asked | {"number": 5, "text": lines}}
    until(tab, lambda: "Arm: nicht verbunden\n" in tab.inner_text("#question-text"))
    writer = Journal(tmp_path / "runs" / JOURNAL_NAME, RUN)
    labels = say("show with grasp {id}", id="A1"), say("place in tray {tray}", tray="accept")
    for label in labels:
        writer.write(rows.StepDone(label=label, forecast_s=1.0, seconds=1.0), 1)
    order = {"name": "pause_now", "answer": "handled", "from": "held", "to": "held", "who": "ada"}
    writer.write(rows.CellEvent.model_validate(order))
    writer.write(rows.QuestionAnswered(code=question.code, choice="look", who="ada"))
    writer.close()
    until(tab, lambda: "in die Ablage Gut legen" in tab.inner_text("#steps"))
    assert "zeigen mit Griff A1" in tab.inner_text("#steps")
    until(tab, lambda: "geantwortet: noch einmal ansehen" in tab.inner_text("#people"))
    assert "ada: Pause sofort" in tab.inner_text("#people")


def test_a_viewer_logs_in_by_password_sees_all_and_has_no_button(served: Served, tab: Any) -> None:
    served.status |= {"question": QUESTION}
    tab.goto(served.origin)
    tab.fill("[name=name]", "vera")
    tab.fill("[name=password]", PASSWORD)
    tab.click("button")
    tab.wait_for_selector("[data-answer=look]:disabled")
    served.status |= {"question": SCAN}
    tab.wait_for_selector("#entry-text:disabled")
    assert tab.query_selector("#stop") is None
    assert RUN in tab.inner_text("#run")


def test_what_is_shown_is_there_after_a_reload_and_a_lost_page_says_so(
    served: Served, tab: Any
) -> None:
    tab.goto(served.link())
    for _ in range(2):
        tab.wait_for_selector("#steps [aria-current=step]")
        assert "9.5 s / 9.0 s" in tab.inner_text("#steps")
        assert "Execute" in tab.inner_text("#state-name")
        assert "V<1>" in tab.inner_text("#views")
        tab.wait_for_selector("canvas[data-drawn]")
        assert not tab.is_visible("#lost")
        tab.reload()
    tab.wait_for_selector("#stop:enabled")
    served.end()
    tab.wait_for_selector("#lost", state="visible")
    assert tab.is_disabled("#stop")


def test_a_run_that_broke_off_is_not_taken_for_one_that_runs(
    served: Served, tab: Any, tmp_path: Path
) -> None:
    served.has_run = False
    tab.goto(served.link())
    until(tab, lambda: tab.inner_text("#state-name") == "Broken off")
    assert "cellctl recover" in tab.inner_text("#doing")
    writer = Journal(tmp_path / "runs" / JOURNAL_NAME, RUN)
    writer.write(rows.AtRest(state="complete", message="", code="", custody="NONE"))
    writer.write(rows.RunEnded(end="complete", message="all parts are done", parts=1))
    writer.close()
    until(tab, lambda: tab.inner_text("#state-name") == "Complete")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_screen(
    served: Served, tab: Any, scheme: str, width: int
) -> None:
    served.status |= {"question": {**QUESTION, "entry": "serial number"}}
    tab.emulate_media(color_scheme=scheme)
    tab.set_viewport_size({"width": width, "height": 844})
    tab.goto(served.link())
    tab.wait_for_selector("[data-answer=look]")
    tab.wait_for_selector("#steps li")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert grave(tab) == []


def test_a_stream_that_falls_silent_is_lost_after_three_seconds_and_found_again(
    served: Served, tab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tab.goto(served.link())
    tab.wait_for_selector("#stop:enabled")
    script = Path(live_module.__file__).parent / "static" / "stream.js"
    assert f"const LOST_MS = {1000 * live_module.FRESH_WALL_S:.0f};" in script.read_text()
    monkeypatch.setattr(live_module, "BEAT_WALL_S", 1e6)  # the stream stays open, and is silent
    tab.wait_for_selector("#lost", state="visible")
    assert tab.is_disabled("#stop")
    served.status |= {"seconds_left": 17.0}
    tab.wait_for_selector("#lost", state="hidden")
    assert not tab.is_disabled("#stop")


def test_a_browser_is_told_how_old_what_it_shows_is_while_the_journal_is_not_read(
    served: Served, tab: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tab.goto(served.link())
    tab.wait_for_selector("#stop:enabled")
    until(tab, lambda: "s ago" in tab.inner_text("#age"))
    goes_on = threading.Event()
    monkeypatch.setattr(live_module.Live, "look", lambda _: goes_on.wait() and False)
    try:
        tab.wait_for_selector("#lost", state="visible")
        assert "hears nothing new" in tab.inner_text("#lost")
        assert not tab.is_disabled("#stop")  # the cell is heard, and takes orders
    finally:
        goes_on.set()
    monkeypatch.undo()


def test_what_a_drawing_no_longer_shows_is_given_back(served: Served, tab: Any) -> None:
    first = {
        "words": "the arm", "tcp_mm": 3.0, "turn_deg": 0.0, "seconds": 1.0,
        "waypoints": [HERE, THERE],
    }  # fmt: skip
    tab.goto(served.link())
    tab.wait_for_selector("#scene[data-preview=no][data-held]")
    until(tab, lambda: tab.get_attribute("#coverage", "data-held") is not None)

    def held() -> list[str]:
        return [str(tab.get_attribute(f"#{one}", "data-held")) for one in ("scene", "coverage")]

    def preview(is_shown: bool) -> None:
        state = "suspended_grasping" if is_shown else "execute_grasping"
        served.status |= {"state": state, "first_motion": first if is_shown else None}
        drawn = int(tab.get_attribute("#scene", "data-drawn"))
        tab.wait_for_selector(f"#scene[data-preview={'yes' if is_shown else 'no'}]")
        until(tab, lambda: int(tab.get_attribute("#scene", "data-drawn")) > drawn)

    preview(is_shown=True)
    preview(is_shown=False)
    before = held()
    for _ in range(3):
        preview(is_shown=True)
        assert held() != before  # what is drawn is counted
        preview(is_shown=False)
    assert held() == before


def test_the_wall_says_verdict_counts_and_time_left_in_letters_that_carry_three_metres(
    served: Served, tab: Any, tmp_path: Path
) -> None:
    writer = Journal(tmp_path / "runs" / JOURNAL_NAME, RUN)
    writer.write(rows.PartDone(verdict="fail", tray="reject"), 1)
    writer.close()
    served.status |= {"seconds_left": 42.0}
    tab.set_viewport_size({"width": 1920, "height": 1080})
    tab.goto(served.link())
    tab.goto(f"{served.origin}/now/wall")
    until(tab, lambda: "FAIL" in tab.inner_text("#verdict"))
    until(tab, lambda: tab.inner_text("#left") == "42 s")
    assert tab.inner_text("#wall-counts").split("\n")[:4] == ["✓ PASS", "0", "✕ FAIL", "1"]
    assert tab.locator("[data-light=working].lit").count() == 1
    small = tab.evaluate(
        "[...document.querySelectorAll('main.wall :is(h2, p, dt, dd)')]"
        ".filter(one => one.offsetParent && !one.closest('.back, .unseen'))"
        ".filter(one => parseFloat(getComputedStyle(one).fontSize) < 72).map(one => one.outerHTML)"
    )
    assert small == []
    assert tab.evaluate("document.documentElement.scrollHeight") <= 1080
    require_sound_on_all_screens(tab)
