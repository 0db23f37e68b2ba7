"""Choice of a body in a STEP file, and the message where the choice is not clear."""

import difflib
import shlex
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from controller.config.cad_files import body_name, body_path

from ...errors import EmptyCadError, ManySolidsCadError, OpenCadError, UnreadableCadError
from .bodies import Bodies, StepBody
from .texts import CODE_PAGE_TEXT

MAX_LISTED: Final = 60


def choose(path: Path, bodies: Bodies, name: str) -> StepBody:
    """Return the body of a name.

    Parameters
    ----------
    path : path of the file, for messages
    bodies : bodies of the file
    name : as `body_name` returns it

    Raises
    ------
    UnreadableCadError : there is no such body; the message has those there are
    ManySolidsCadError : the name is that of an assembly of several
    OpenCadError : its surfaces enclose nothing
    """
    every = (*bodies.distinct, *bodies.others)
    for body in every:
        if body.name == name:
            return body
    if name and name in map(body_name, bodies.open_names):
        raise OpenCadError(
            f"{body_path(path, name)}: its surfaces enclose no solid; export the solid body"
        )
    inside = [
        body.name
        for body in bodies.distinct
        if any(name in map(body_name, place.within) for place in body.occurrences)
    ]
    if name and inside:
        raise ManySolidsCadError(
            f"{body_path(path, name)}: is an assembly of the bodies {', '.join(inside)}; name one "
            "of them"
        )
    known = [body.name for body in every]
    by_small = {one.casefold(): one for one in reversed(known)}
    near = difflib.get_close_matches(name.casefold(), by_small, n=1, cutoff=0.5)
    what = f"has no body {name!r}" if name else "no body is named after the #"
    hint = f"; did you mean {body_path(path, by_small[near[0]])}?" if near else ""
    raise UnreadableCadError(f"{path}: {what}{hint}\n{listing(path, bodies)}")


def require_any(path: Path, bodies: Bodies) -> None:
    """Require that a file has a body.

    Raises
    ------
    UnreadableCadError : it has none, and files it names are missing
    EmptyCadError, OpenCadError : it has none
    """
    if bodies.missing and not bodies.distinct:
        raise UnreadableCadError(f"{path}: holds no shape of its own; {missing_text(path, bodies)}")
    if not bodies.distinct and bodies.open_names:
        names = ", ".join(map(body_name, bodies.open_names))
        raise OpenCadError(f"{path}: its surfaces enclose no solid ({names}); export the solid")
    if not bodies.distinct:
        raise EmptyCadError(f"{path}: holds no shape; export the solid body again")


def require_one(path: Path, bodies: Bodies) -> StepBody:
    """Return the only body of a file.

    Raises
    ------
    ManySolidsCadError : it has several; the message lists them
    UnreadableCadError : it has one or none, and files it names are missing
    EmptyCadError, OpenCadError : it has none
    """
    require_any(path, bodies)
    if bodies.count == 1 and not bodies.missing:
        return bodies.distinct[0]
    if bodies.count == 1:
        only = body_path(path, bodies.distinct[0].name)
        raise UnreadableCadError(f"{path}: {missing_text(path, bodies)}; what is here is {only}")
    raise ManySolidsCadError(many(path, bodies))


def many(path: Path, bodies: Bodies) -> str:
    """Return a sentence that refuses a file of several bodies, with their list."""
    shapes = len(bodies.distinct)
    of = f" of {shapes} shapes" if 1 < shapes < bodies.count else ""
    if shapes == 1 < bodies.count:
        of = " of one shape"
    lines = listing(path, bodies)
    how = "as below"
    if any(" " in str(body_path(path, body.name)) for body in bodies.distinct):
        how += " (in quotes on a command line, for its blanks)"
    return (
        f"{path}: holds {bodies.count} bodies{of}; a part is one. "
        f"Name one {how}, or compile each: "
        f"cellctl compile --all {shlex.quote(str(path))}\n{lines}"
    )


def listing(path: Path, bodies: Bodies) -> str:
    """Return a line for each body: its name as written, its size, and its placements."""
    shown = bodies.distinct[:MAX_LISTED]
    width = max((len(str(body_path(path, body.name))) for body in shown), default=0)
    lines = [f"  {body_path(path, body.name)!s:<{width}}  {row_text(body)}" for body in shown]
    if len(bodies.distinct) > len(shown):
        lines.append(f"  and {len(bodies.distinct) - len(shown)} more")
    if bodies.open_names:
        names = ", ".join(map(body_name, bodies.open_names[:MAX_LISTED]))
        lines.append(f"  no solid: {names}")
    if bodies.is_in_code_page:
        lines.append(f"  {CODE_PAGE_TEXT}")
    if bodies.missing:
        lines.append(f"  {missing_text(path, bodies)}")
    return "\n".join(lines)


def size_text(size_mm: Iterable[float]) -> str:
    """Return the size of a body in words, from its sides [mm]."""
    return " x ".join(f"{side:.1f}" for side in size_mm) + " mm"


def row_text(body: StepBody) -> str:
    """Return a body's row of a list, behind its name: its size and its placement."""
    return f"{size_text(body.size_mm):<24} {place_text(body)}"


def place_text(body: StepBody) -> str:
    """Return the placement of a body in words: how often, where, and its other names."""
    within = Counter(place.within[-1] for place in body.occurrences if place.within)
    words = ["once" if len(body.occurrences) == 1 else f"{len(body.occurrences)} times"]
    if within:
        words.append("in " + ", ".join(body_name(name) for name in within))
    if body.also:
        words.append(f"(also {', '.join(body.also)})")
    return " ".join(words)


def missing_text(path: Path, bodies: Bodies) -> str:
    """Return a sentence that lists the missing files of an assembly, with advice."""
    names = ", ".join(bodies.missing[:MAX_LISTED])
    folder = path.absolute().parent
    return (
        f"it names files that are not in {folder}: {names}. Put them there, or export the assembly "
        "as one file"
    )
