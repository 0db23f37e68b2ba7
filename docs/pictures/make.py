"""Takes the pictures of README and report: an emulated run, its page, its report, in Chromium.

``python docs/pictures/make.py`` from a checkout with ``pip install -e '.[dev]'``, Chromium at
/usr/bin/chromium and poppler's pdftoppm; a few minutes. Look at the four files before they are
committed.
"""

import json
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

PICTURES = Path(__file__).parent
CELLCTL = (sys.executable, "-m", "controller.cli")
RUN = ("run", "holder", "--count", "1", "--seed", "7", "--speed", "1", "--json")
VIEW_COUNT = 4  # views of the part on the page when the pictures are taken: the arm still holds it
PATIENT_MS = 900_000  # a guard against a hang, no measure
DRAWN_MS = 3000  # for WebGL in software to draw the scene
PACKED = {".png": (cv2.IMWRITE_PNG_COMPRESSION, 9), ".jpg": (cv2.IMWRITE_JPEG_QUALITY, 70)}
MAX_BYTES = 200_000  # of one picture: a README loads at once
NEARER_COUNT = 3  # steps of the scene's zoom
SCENE_WIDTH, SCENE_HEIGHT = 1000, 640
NOW_WIDTH, NOW_HEIGHT = 1440, 860
REPORT_WIDTH, REPORT_HEIGHT = 1100, 1050
PAPER_DPI = 62  # of the printed pages, of which three stand beside each other
PAPER_BORDER_PX = 4


def main() -> None:
    """Take the pictures."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        runs = Path(folder) / "runs"
        browser = playwright.chromium.launch(
            executable_path="/usr/bin/chromium", args=["--no-sandbox"]
        )
        context = browser.new_context(color_scheme="light", locale="en-GB")
        tab = context.new_page()
        tab.set_default_timeout(PATIENT_MS)
        with started(*RUN, "--runs", str(runs)) as run:
            with started(
                "serve", "--port", str(free_port()), "--runs", str(runs), "--json"
            ) as page:
                tab.goto(next(events(page, "ready"))["link"])
                take_now(tab)
            report = next(events(run, "result"))["report"]
        take_report(tab, Path(report))
        take_paper(tab, Path(folder))
        browser.close()


def take_report(tab: Page, report: Path) -> None:
    """Take the second view of the numbered drawing and the first values below it."""
    tab.set_viewport_size({"width": REPORT_WIDTH, "height": REPORT_HEIGHT})
    tab.goto(report.absolute().as_uri())
    tab.locator("h2, h3", has_text="Characteristics").first.evaluate(
        "title => { title.scrollIntoView(); window.scrollBy(0, -0.5 * window.innerHeight); }"
    )
    keep("report.png", tab.screenshot())


def take_paper(tab: Page, folder: Path) -> None:
    """Take the pages of the report as they are printed, beside each other."""
    tab.pdf(path=folder / "paper.pdf", prefer_css_page_size=True, print_background=True)
    command = ("pdftoppm", "-r", str(PAPER_DPI), "-png", "paper.pdf", "paper")
    subprocess.run(command, cwd=folder, check=True)
    pages = [cv2.imread(str(file)) for file in sorted(folder.glob("paper-*.png"))]
    width = PAPER_BORDER_PX
    framed = [
        cv2.copyMakeBorder(page, *(width,) * 4, cv2.BORDER_CONSTANT, value=(160, 160, 160))
        for page in pages
        if page is not None
    ]
    _, packed = cv2.imencode(".png", np.hstack(framed))
    keep("report_pages.jpg", packed.tobytes())


def take_now(tab: Page) -> None:
    """Take *Now* and its scene once the arm presents the part."""
    tab.set_viewport_size({"width": NOW_WIDTH, "height": NOW_HEIGHT})
    tab.locator("#views img").nth(VIEW_COUNT - 1).wait_for()
    tab.wait_for_timeout(DRAWN_MS)
    keep("now.png", tab.screenshot())
    tab.evaluate(
        """([width, height]) => {
            document.body.replaceChildren(document.getElementById("scene"));
            Object.assign(document.getElementById("scene").style,
                {position: "fixed", inset: 0, width: `${width}px`, height: `${height}px`});
        }""",
        [SCENE_WIDTH, SCENE_HEIGHT],
    )
    tab.set_viewport_size({"width": SCENE_WIDTH, "height": SCENE_HEIGHT})
    for _ in range(NEARER_COUNT):
        tab.locator("#scene").press("+")
    tab.wait_for_timeout(DRAWN_MS)
    keep("cell.png", tab.screenshot())


def keep(name: str, picture: bytes) -> None:
    """Write a picture as PNG or JPEG, by its suffix, packed small.

    Raises
    ------
    SystemExit : it is too large for a README
    """
    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None  # Chromium has just written it
    suffix = Path(name).suffix
    _, packed = cv2.imencode(suffix, pixels, PACKED[suffix])
    (PICTURES / name).write_bytes(packed.tobytes())
    if packed.size > MAX_BYTES:
        raise SystemExit(f"{name}: {packed.size} bytes, at most {MAX_BYTES}")


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command of cellctl beside; it is ended, and waited for, in the end."""
    process = subprocess.Popen([*CELLCTL, *words], stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def events(process: subprocess.Popen[str], name: str) -> Iterator[dict[str, Any]]:
    """Lines of one kind that a command prints in JSON."""
    assert process.stdout is not None
    for line in process.stdout:
        event = json.loads(line)
        if event["event"] == name:
            yield event


def free_port() -> int:
    """Port of this machine that nothing listens at."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


if __name__ == "__main__":
    main()
