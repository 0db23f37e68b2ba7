"""The common base of all pages: the template engine, the style sheet, and the writing.

A page needs nothing else: no network, no script, pictures inside. All text is escaped by the
template engine, since names in a recipe are whatever somebody wrote there.
"""

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import IO

from jinja2 import DictLoader, Environment, StrictUndefined
from markupsafe import Markup

from .wording import count_of, num, span

STYLES = ("page.css", "chart.css")


def write_page(text: str, path: Path) -> Path:
    """Write a page and return its path; the file is whole or not there.

    Raises
    ------
    OSError : the file cannot be written
    """
    return write_file(text.encode(), path)


def write_file(data: bytes, path: Path) -> Path:
    """Write bytes to a temporary file, move it to its path, and return that.

    Raises
    ------
    OSError : the file cannot be written; what was there before is still there
    """
    with whole_file(path) as file:
        file.write(data)
    return path


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """Yield a temporary file, and move it to its path once it is written.

    Raises
    ------
    OSError : the file cannot be written; what was there before is still there
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(
            "wb", dir=path.parent, suffix=".part", delete=False
        ) as file:
            part = Path(file.name)
            try:
                yield file
                file.flush()
            except BaseException:
                part.unlink(missing_ok=True)
                raise
        # a temporary file is private to its owner; a page is for everybody who may read the folder
        umask = os.umask(0)
        os.umask(umask)
        part.chmod(0o666 & ~umask)
        part.replace(path)
    except OSError as error:  # a full disk does not name the file
        raise OSError(error.errno, error.strerror, str(path)) from error


def render_page(package: str, template: str, path: Path, **values: object) -> Path:
    """Write a page made from a package's one template, and return its path.

    Parameters
    ----------
    package : package with the template
    template : its name
    path : path of the page
    values : values for the template, by name

    Raises
    ------
    OSError : the file cannot be written
    """
    made = make_environment(package, [template]).get_template(template)
    return write_page(made.render(**values), path)


def make_environment(
    package: str, names: Sequence[str], filters: Mapping[str, Callable[..., str]] | None = None
) -> Environment:
    """Return an engine with a package's templates, the common style sheet and filters.

    Parameters
    ----------
    package : package with the templates
    names : names of the templates
    filters : more filters for these templates, by name
    """
    folder = resources.files(package)
    texts = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in names}
    for style in STYLES:
        texts[style] = resources.files(__package__).joinpath(style).read_text(encoding="utf-8")
    env = Environment(
        loader=DictLoader(texts),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {"num": num, "span": span, "count_of": count_of, **(filters or {})}
    return env


def css_text(text: str) -> str:
    """Return a text for the inside of a quoted string of a style sheet, all signs escaped."""
    escaped = (c if c.isascii() and c.isalnum() else f"\\{ord(c):x} " for c in text)
    return Markup("".join(escaped))  # nosec B704: all but letters and digits is escaped
