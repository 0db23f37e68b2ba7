"""`cellctl recover`: the grippers' possible parts; opens one while the operator holds the part."""

import asyncio
import sys
from pathlib import Path

from controller.cell.batch import find_proposal
from controller.cell.compute import Job
from controller.cell.compute.answers import homing_swept, proven_back
from controller.cell.custody import GripperName, known_words
from controller.cell.custody.openings import Occupancy
from controller.cell.custody.releasing import GripperStanding, ReleaseVisit
from controller.cell.devices.clocks import find_clock
from controller.cell.lock import hold_cell
from controller.cell.recovery import Beside, HomingBounds, Interrupted, Proposal
from controller.config import Cell, ConfigError, load_cell
from controller.planning.motion import ProvenMove, Swept
from controller.setup.drivers import require_drivers
from controller.setup.layout import build_layout

from ..terminal.output import emit, print_line, warn
from .accepting import recipe_of

OPTION = {GripperName.ARM: "arm", GripperName.FIXED: "fixed"}


def recover_cell(
    cell_path: Path,
    runs_dir: Path,
    gripper: GripperName | None,
    *,
    is_confirmed: bool,
    as_json: bool,
) -> int:
    """Report what the grippers may hold, open one on request; return 1 if a part may still be held.

    Parameters
    ----------
    cell_path : cell file
    runs_dir : folder of all runs, whose journals say what was held last
    gripper : the one to open, None to report only
    is_confirmed : the operator has stated on the command line that they hold the part
    as_json : print one JSON object instead of sentences

    Raises
    ------
    ConfigError : each run emulates this cell's grippers, so there is nothing to recover; or a
        confirmation is required and standard input is no terminal
    """
    cell = load_cell(cell_path)
    require_drivers(cell_path, cell)
    if {"arm", "gripper", "io"} & set(cell.emulated_devices):
        raise ConfigError(
            f"{cell_path}: its grippers are emulated by each run and end with it. Nothing is left "
            "to recover. Give the cell file with the addresses of `cellctl emulate`"
        )
    if gripper is not None and not is_confirmed and not sys.stdin.isatty():
        raise ConfigError(
            "--open requires a terminal for your answer; --yes states that you hold the part"
        )

    async def visit() -> int:
        clock = find_clock(cell, {})
        opens = gripper is not None
        async with ReleaseVisit(cell, clock, runs_dir, opens=opens) as recovery:
            standing = await recovery.look()
            found = await _proposal(recovery, standing, cell, cell_path, runs_dir)
            if not as_json:
                _report(standing, found)
            custody = None
            if gripper is not None:
                if not is_confirmed and not await asyncio.to_thread(_is_held_by_hand, gripper):
                    warn("cellctl: nothing was opened")
                    return 1
                custody = await recovery.open(gripper, standing.known)
                if not as_json:
                    print_line(f"The {gripper.value} is open. The part is {custody.value}.")
            if as_json:
                emit(_json(standing, found, None if custody is None else custody.key))
        if custody is not None:
            return 0
        return 1 if _may_hold(standing) else 0

    with hold_cell(runs_dir, cell, "recover"):
        return asyncio.run(visit())


async def _proposal(
    visit: ReleaseVisit, standing: GripperStanding, cell: Cell, cell_path: Path, runs_dir: Path
) -> Proposal | str | None:
    """Return the proposal for the part, the reason for none, or None if no part is held."""
    if not standing.known:
        return None
    if visit.journal is None:
        return "the journal that knew of it is lost"

    async def sweep(left: Interrupted, bounds: HomingBounds) -> Swept:
        job = Job(recipe_of(left, runs_dir / left.run), cell_path)
        return await asyncio.to_thread(homing_swept, job, *bounds.arguments)

    async def back(left: Interrupted, beside: Beside) -> ProvenMove:
        job = Job(recipe_of(left, runs_dir / left.run), cell_path)
        return await asyncio.to_thread(proven_back, job, *beside.arguments)

    return await find_proposal(
        visit.devices,
        visit.journal,
        standing.known,
        visit.began,
        build_layout(cell),
        sweep,
        back,
        has_recipe=False,
    )


def _may_hold(standing: GripperStanding) -> set[GripperName]:
    holding = (Occupancy.HOLDS, Occupancy.MAY_HOLD)
    return (
        {one.gripper for one in standing.known}
        | {one.gripper for one in standing.openings if one.occupancy in holding}
        | standing.unknown
    )


def _report(standing: GripperStanding, found: Proposal | str | None) -> None:
    if standing.notice:
        warn(standing.notice)
    for one in standing.known:
        print_line(f"journal: the {one.gripper.value} may hold a part: {known_words(one)}")
    if not standing.known and not standing.unknown:
        print_line("journal: no gripper holds a part")
    for gripper in GripperName:
        if gripper in standing.unknown:
            print_line(
                f"journal: what the {gripper.value} holds is unknown: no run of this cell has "
                "recorded it. Look at its jaws"
            )
    for lease in standing.leases:
        print_line(f"lease: {lease.words}")
    for opening in standing.openings:
        print_line(f"{opening.gripper.value}: {opening.occupancy.value}; {opening.reason}")
    names = sorted(OPTION[gripper] for gripper in _may_hold(standing))
    if not names:
        print_line(_none_held(standing))
        return
    _report_proposal(found)
    for name in names:
        print_line(
            f"To open the {name} gripper while you hold the part: cellctl recover --open {name}"
        )
    print_line("To go on after the part is out: cellctl run RECIPE --part-removed")


def _none_held(standing: GripperStanding) -> str:
    """Return the advice if neither the journal nor a gripper has a part."""
    unread = [
        one.gripper.value for one in standing.openings if one.occupancy is Occupancy.UNREADABLE
    ]
    if not unread:
        return "Nothing is held: `cellctl run` may start."
    return (
        f"According to the journal nothing is held, but the {' and the '.join(unread)} "
        "cannot be read. Look at its jaws: `cellctl run` may start, and opens them."
    )


def _report_proposal(found: Proposal | str | None) -> None:
    if found is None:
        return
    if isinstance(found, str):
        print_line(f"The cell cannot go on with the part: {found}.")
        return
    for sentence in found.evidence:
        print_line(f"evidence: {sentence}")
    for sentence in found.intents:
        print_line(f"cut off: {sentence}")
    if found.person:
        print_line(f"The cell cannot go on with the part: {found.person}.")
        return
    sure = "proven safe" if found.is_proven else "not proven safe: your decision"
    print_line(f"The cell would go on with the part ({sure}):")
    for number, step in enumerate(found.steps, 1):
        print_line(f"  {number}. {step}")
    if found.look:
        print_line(found.look)
    alone = ", or cellctl run RECIPE --auto-recover" if found.is_proven else ""
    print_line(f"To go on: cellctl recover --accept{alone}")


def _is_held_by_hand(gripper: GripperName) -> bool:
    warn(
        f"The {gripper.value} will open by about 20 mm; the arm stays where it is. Hold the part. "
        "Type `open` when you hold it:"
    )
    return sys.stdin.readline().strip() == "open"


def _proposal_json(found: Proposal | str | None) -> dict[str, object] | None:
    if found is None:
        return None
    if isinstance(found, str):
        return {"person": found}
    return {
        "run": found.left.run,
        "part": found.left.part,
        "custody": found.case.now.key,
        "evidence": list(found.evidence),
        "intents": list(found.intents),
        "steps": list(found.steps),
        "first_motion": found.first_motion,
        "is_proven": found.is_proven,
        "look": found.look,
        "person": found.person,
    }


def _json(
    standing: GripperStanding, found: Proposal | str | None, custody: str | None
) -> dict[str, object]:
    return {
        "event": "recover",
        "known": [
            {
                "gripper": one.gripper.value,
                "custody": one.custody.key,
                "run": one.run,
                "part": one.part,
                "since": one.since,
                "detail": one.detail,
            }
            for one in standing.known
        ],
        "openings": [
            {"gripper": one.gripper.value, "finding": one.occupancy.value, "reason": one.reason}
            for one in standing.openings
        ],
        "leases": [
            {"resources": list(one.resources), "by": one.by, "run": one.run, "since": one.since}
            for one in standing.leases
        ],
        "unknown": [one.value for one in GripperName if one in standing.unknown],
        "notice": standing.notice,
        "proposal": _proposal_json(found),
        "custody": custody,
    }
