"""Answers about views: where the part is, what a view shows, and the judged part."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

from controller import inspection as inspecting
from controller.arrays import FloatArray, Grey
from controller.config.view_set import load_view_set, parse_view_set
from controller.stored import judge_ahead as stored_ahead
from controller.stored import judge_views, judging_of, read_pictures

from .. import held_search
from ..job import Context, Job, context
from ..tasks import held_task, table_task

Holder = tuple[inspecting.WorldBox, ...]
MAX_LOCATED_COUNT: Final = 8
# Views of the part at hand that left its turn open, by what is guessed of it.
_open: dict[tuple[object, ...], list[inspecting.PicturedView]] = {}
# What `locate` found last, for `inspect` to go on from; ten megabytes each.
_located: dict[tuple[object, ...], inspecting.CheckedView | inspecting.NotEvaluated] = {}


@dataclass(frozen=True, eq=False, slots=True)
class Located:
    """The pose of the part in the arm gripper by one view, for the arm to go on with.

    Attributes
    ----------
    evaluated : the view shows it where it may be; otherwise `reason` says why not
    T_world_part : (4, 4) measured; the expected one where it is not evaluated
    is_turn_known : False where the view leaves a free turn open; the pose is then at the turn
        expected
    """

    evaluated: bool
    reason: str
    T_world_part: FloatArray
    is_turn_known: bool = True


def locate(
    job: Job,
    view_id: str,
    T_world_part: FloatArray,
    holder: Holder,
    backlit: Grey,
    lit: Mapping[str, Grey],
    is_hold_measured: bool,
    facts: inspecting.PartFacts = inspecting.NO_FACTS,
) -> Located:
    """Return the pose of the part in the arm gripper, as located in one view.

    It is the quick half of `inspect`, which continues from it.

    Parameters
    ----------
    job : recipe and cell
    view_id : id of the view
    T_world_part : (4, 4) expected pose of the part
    holder : objects of the cell that may be in the picture
    backlit, lit : pictures in front of the backlight panel, and by lamp
    is_hold_measured : an earlier view has confirmed how the part is held
    facts : known of this part besides its CAD model
    """
    task = held_task(
        context(job), view_id, T_world_part, holder, tuple(lit),
        is_hold_measured=is_hold_measured, facts=facts,
    )  # fmt: skip
    pictures = inspecting.ViewPictures(backlit=backlit, lit=lit)
    before = _open_before(job, facts)
    found = inspecting.locate_view(context(job).posed, task, pictures, before)
    _located[_view_key(job, view_id, T_world_part, backlit)] = found
    if len(_located) > MAX_LOCATED_COUNT:
        _located.pop(next(iter(_located)))
    if isinstance(found, inspecting.NotEvaluated):
        if found.T_world_part is not None:
            before.append(found.view)
            return Located(True, "", found.T_world_part, is_turn_known=False)
        return Located(False, found.reason, T_world_part)
    return Located(True, "", found.fit.T_world_part)


def _open_before(job: Job, facts: inspecting.PartFacts) -> list[inspecting.PicturedView]:
    """Return the views so far that left this turn open; those of another one are forgotten.

    So are they once a view has shown it: they were expected at the guess before that.
    """
    free = facts.free_turn if facts.is_turn_open else None
    guess = () if free is None else (job, free.axis.tobytes(), free.through_mm.tobytes())
    if guess not in _open:
        _open.clear()
    return _open.setdefault(guess, [])


def _view_key(
    job: Job, view_id: str, T_world_part: FloatArray, backlit: Grey
) -> tuple[object, ...]:
    return job, view_id, T_world_part.tobytes(), hashlib.sha256(backlit.tobytes()).digest()


def inspect(
    job: Job,
    view_id: str,
    T_world_part: FloatArray,
    holder: Holder,
    backlit: Grey,
    lit: Mapping[str, Grey],
    is_hold_measured: bool,
    facts: inspecting.PartFacts = inspecting.NO_FACTS,
) -> inspecting.ViewResult:
    """Return the result of one view of the part in the arm gripper.

    Parameters
    ----------
    job : recipe and cell
    view_id : id of the view
    T_world_part : (4, 4) expected pose of the part
    holder : objects of the cell that may be in the picture
    backlit, lit : pictures in front of the backlight panel, and by lamp
    is_hold_measured : an earlier view has confirmed how the part is held
    facts : known of this part besides its CAD model
    """
    task = held_task(
        context(job), view_id, T_world_part, holder, tuple(lit),
        is_hold_measured=is_hold_measured, facts=facts,
    )  # fmt: skip
    located = _located.pop(_view_key(job, view_id, T_world_part, backlit), None)
    return _inspected(context(job), task, backlit, lit, located)


def inspect_on_table(
    job: Job,
    view_id: str,
    T_world_part: FloatArray,
    backlit: Grey,
    lit: Mapping[str, Grey],
    facts: inspecting.PartFacts = inspecting.NO_FACTS,
) -> inspecting.ViewResult:
    """Return the table pictures' result as a view; nothing hides the part there.

    Parameters
    ----------
    job : recipe and cell
    view_id : id of the view
    T_world_part : (4, 4) pose of the part
    backlit, lit : pictures of the light table, and by lamp
    facts : known of this part besides its CAD model
    """
    c = context(job)
    return _inspected(c, table_task(c, view_id, T_world_part, tuple(lit), facts), backlit, lit)


def _inspected(
    c: Context,
    task: inspecting.ViewTask,
    backlit: Grey,
    lit: Mapping[str, Grey],
    located: inspecting.CheckedView | inspecting.NotEvaluated | None = None,
) -> inspecting.ViewResult:
    pictures = inspecting.ViewPictures(backlit=backlit, lit=lit)
    return _with_faces(c, inspecting.inspect_view(c.posed, c.samples, task, pictures, located))


def _with_faces(c: Context, result: inspecting.ViewResult) -> inspecting.ViewResult:
    """Return the result of a view, with the CAD face of each sample."""
    return replace(result, face_ids=c.samples.face_ids)


def find_hold(
    job: Job,
    T_world_part: FloatArray,
    T_part_tcp: FloatArray,
    holder: Holder,
    backlit: Grey,
) -> FloatArray | None:
    """Return T_world_part (4, 4) of a held part away from its expected pose; None if not found.

    Parameters
    ----------
    job : recipe and cell
    T_world_part : (4, 4) expected pose of the part
    T_part_tcp : (4, 4) intended grasp
    holder : objects of the cell that may be in the picture
    backlit : picture in front of the backlight panel
    """
    c = context(job)
    task = held_task(c, "hold", T_world_part, holder, (), is_hold_measured=False)
    return held_search.find_hold(c.posed, c.samples, task, T_part_tcp, backlit)


def judge_ahead(job: Job, set_path: Path, text: str, view_count: int) -> bool:
    """Do a piece of `judge`'s work in advance; return whether there may be more.

    Parameters
    ----------
    job : recipe and cell
    set_path : the file of the part's views, to be written
    text : state of the inspection so far, over all grasps that are over
    view_count : number of views planned

    Raises
    ------
    ConfigError : a picture that was stored cannot be read again
    """
    kept = _kept(set_path)
    before = kept.count
    # what was worked out before takes no time, and is no piece
    return any(kept.count > before for _ in _work_at_hand(job, set_path, text, view_count))


def judge(job: Job, set_path: Path) -> inspecting.PartInspection:
    """Return the inspection of a part from all its views.

    Parameters
    ----------
    job : recipe and cell
    set_path : the file of its views

    Raises
    ------
    ConfigError : a picture that was stored cannot be read again
    """
    file, kept = load_view_set(set_path), _kept(set_path)
    _kept.cache_clear()
    _work_at_hand.cache_clear()
    pictures = read_pictures(set_path, file, kept)
    judging = judging_of(set_path, file, None)
    found = judge_views(file, context(job).part, pictures, judging, kept)
    return replace(found, views=tuple(_with_faces(context(job), one) for one in found.views))


@lru_cache(maxsize=1)
def _kept(set_path: Path) -> inspecting.Kept:
    """Return the intermediate results kept for one part; those of the part before are dropped."""
    return inspecting.Kept()


@lru_cache(maxsize=1)
def _work_at_hand(job: Job, set_path: Path, text: str, view_count: int) -> Iterator[None]:
    """Return the work on some views; it goes on where its last piece ended.

    A view's pictures at its pose are large, and live from its first comparison to its last.
    """
    file = parse_view_set(set_path, text)
    judging = judging_of(set_path, file, None)
    return stored_ahead(file, context(job).part, judging, _kept(set_path), view_count)
