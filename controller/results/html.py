"""A run as one HTML page that needs nothing else: no network, no script, pictures inside.

Everything the page says comes from the journal and the run's pictures. All text is escaped by the
template engine, since names in a recipe are whatever somebody wrote there.
"""

import os
import tempfile
from collections.abc import Sequence
from datetime import datetime
from importlib import resources
from pathlib import Path

from jinja2 import DictLoader, Environment, StrictUndefined

from ._model import RunRecord
from ._optics import Optics
from ._page import lamp_words, make_part_page
from ._words import END_WORDS, cautions, count_of, headline, say_row, stage_words
from .pictures import QUALITIES, Pictures, Quality

MAX_BYTES = 10_000_000  # what still goes through a mail gateway
PICTURE_BYTES = 8_000_000  # the share of it that pictures may take
LOG_ROWS = 3000
TEMPLATES = ("report.html.j2", "part.html.j2")
STYLE = "report.css"


def write_html(record: RunRecord, path: Path) -> Path:
    """Write the report of a run and return its path.

    The file is whole or not there: it is written beside its place and moved into it.

    Raises
    ------
    OSError : the file cannot be written
    """
    return write_page(render(record), path)


def write_page(text: str, path: Path) -> Path:
    """Write a page beside its place, move it into it, and return its path.

    Raises
    ------
    OSError : the file cannot be written
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", dir=path.parent, suffix=".part", delete=False
    ) as file:
        file.write(text)
    part = Path(file.name)
    # a temporary file is private to its owner; a report is for everybody who may read the runs
    umask = os.umask(0)
    os.umask(umask)
    part.chmod(0o666 & ~umask)
    return part.replace(path)


def render(record: RunRecord, max_bytes: int = MAX_BYTES) -> str:
    """Return the page; pictures are made smaller until it is small enough."""
    count = sum(
        len(part.table_pictures)
        + len(part.findings)
        + sum(len(view.pictures) for view in part.views)
        for part in record.parts
    )
    budget = min(PICTURE_BYTES, max_bytes)
    fitting = [q for q in QUALITIES if count * q.typical_bytes <= budget]
    text = ""
    for quality in fitting:
        text = _render(record, quality)
        if len(text.encode()) <= max_bytes:
            return text
    return text


def _render(record: RunRecord, quality: Quality) -> str:
    pictures, optics = Pictures(record.folder, quality), Optics.of(record.cell)
    word, sentence = headline(record)
    left_out = max(0, len(record.log) - LOG_ROWS)
    return (
        make_environment(__package__, TEMPLATES)
        .get_template("report.html.j2")
        .render(
            record=record,
            word=word,
            why=sentence,
            end_words=END_WORDS[record.outcome.end],
            cautions=cautions(record),
            parts=[make_part_page(record, part, pictures, optics) for part in record.parts],
            log=record.log[left_out:],
            log_left_out=left_out,
            is_reduced=quality is not QUALITIES[0],
        )
    )


def make_environment(package: str, names: Sequence[str]) -> Environment:
    """Return an engine with a package's templates, the house's style sheet and its filters."""
    folder = resources.files(package)
    texts = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in names}
    texts[STYLE] = resources.files(__package__).joinpath(STYLE).read_text(encoding="utf-8")
    env = Environment(
        loader=DictLoader(texts),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {
        "num": _num,
        "utc": _utc,
        "span": _span,
        "say_row": say_row,
        "stage": stage_words,
        "count_of": count_of,
        "css": css_class,
        "lamp_words": lamp_words,
    }
    return env


def _num(value: float | None, decimals: int = 1) -> str:
    """Return a number with a fixed count of decimals; a dash for what is not known."""
    return "–" if value is None else f"{value:.{decimals}f}"


def _utc(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M:%S} UTC"


def _span(seconds: float) -> str:
    """Return a duration as people say it."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min"


def css_class(verdict: str) -> str:
    """Return the class that colours a verdict; the verdict itself always stands beside it."""
    return {"pass": "pass", "fail": "fail", "indeterminate": "doubt"}.get(verdict, "none")
