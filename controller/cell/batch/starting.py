"""The decision on a start: both grippers are empty, or the part in one can go on.

Without evidence that both are empty nothing moves until somebody decides: the operator, or the
order if the next motion is proven safe.
"""

from collections.abc import Sequence
from pathlib import Path

from controller.config import split_cad
from controller.planning.model import CellLayout
from messages import key, say

from ..custody import CellIdentity, Custody, GripperName, Held, where_it_is
from ..custody.openings import Occupancy, Opening, presses_on_something, read_openings
from ..custody.start_check import PartMayBeHeldError, openings_row, require_empty_grippers
from ..devices import Devices
from ..journal import Journal, read_rows, read_rows_of_kinds, rows
from ..machine import Event
from ..operator import Choice, Operator, Question
from ..recovery import (
    Back,
    Interrupted,
    Proposal,
    Sweep,
    beside_path,
    classify,
    fold_interrupted,
    listed,
    lost_bounds,
    propose,
    read_world,
    same_cell,
)
from .dispatcher import BatchEnd
from .order import RunOrder

GO_ON, REFUSE = "go_on", "refuse"
BY_OPTION = "--auto-recover"
BY_START = key("the start")


async def start(
    order: RunOrder,
    devices: Devices,
    journal: Journal,
    known: Sequence[Held],
    began: rows.RunBegan,
    layout: CellLayout,
    operator: Operator,
    sweep: Sweep,
    back: Back,
) -> BatchEnd | Proposal | None:
    """Return None for empty grippers, else the proposal to begin with or the outcome of a refusal.

    Parameters
    ----------
    order : says who decides
    devices : connected, and halted
    journal : journal of the cell; gets evidence and decision
    known : grippers that may hold a part, by the journals of all runs
    began : the first row of this run
    layout : layout for the preview of the first motion
    operator : person who decides, if the order requires it
    sweep : proves the space that homing with the part would sweep
    back : proves the move back to its path of an arm beside it

    Raises
    ------
    DeviceError : a device does not answer
    """
    why = ""
    if known and order.recovery != "refuse" and not order.is_part_removed:
        found = await find_proposal(devices, journal, known, began, layout, sweep, back)
        if isinstance(found, Proposal):
            row = await _decided(order, operator, found)
            await journal.write_secured(row)
            if row.decision == "accepted":
                journal.write(openings_row(await read_openings(devices)))
                return found
            why = _why_refused(order, found)
        else:
            why = found
    openings = await read_openings(devices)
    if not known and not _may_hold(openings):
        alone = await _arm_alone(devices, journal, began, layout)
        if alone is not None:
            # no gripper holds anything, and a start may move the arm: it would home it otherwise
            await journal.write_secured(_row(alone, "accepted", BY_START, key("proven safe")))
            journal.write(openings_row(openings))
            return alone
    try:
        await require_empty_grippers(
            known,
            openings,
            journal,
            lambda: presses_on_something(devices),
            is_part_removed=order.is_part_removed,
            why=why,
        )
    except PartMayBeHeldError as error:
        where = where_it_is(error.custody)
        return refuse(journal, str(error), "part_may_be_held", where, error.custody)
    return None


def _may_hold(openings: Sequence[Opening]) -> bool:
    held = (Occupancy.HOLDS, Occupancy.MAY_HOLD)
    return any(one.occupancy in held for one in openings)


async def _arm_alone(
    devices: Devices, journal: Journal, began: rows.RunBegan, layout: CellLayout
) -> Proposal | None:
    """Return the arm's way out after a killed run with no part in a gripper; None: it homes.

    Homing sweeps the whole workspace from the arm's present position, past everything in it.
    """
    run = _last_to_move(journal)
    if run is None:
        return None
    found = list(read_rows(journal.path, run))
    # joint paths count: the run may have been killed on its way to the first grasp
    part = next((row.part for row in reversed(found) if row.kind == "intent" and row.part), None)
    left = None if part is None else fold_interrupted(found, run, part)
    if left is None or left.custody not in (Custody.ON_TABLE, Custody.PLACED):
        return None
    here = CellIdentity.of(began)
    if left.intent is not None or not here.shares(GripperName.ARM, CellIdentity.of(left.began)):
        return None
    if not same_cell(left.began.cell, began.cell):
        return None
    proposal = propose(left, await read_world(devices, left), layout)
    return proposal if proposal.is_proven else None


def _last_to_move(journal: Journal) -> str | None:
    """Return the last other run that may have moved the arm, homing included, if it was killed."""
    ends = (rows.RunEnded.row_name, rows.RunBrokeOff.row_name)
    run, has_ended = None, False
    # nothing moves before a reset
    for row in read_rows_of_kinds(journal.path, (), (Event.RESET.value, *ends)):
        if row.run == journal.run:
            continue
        if row.name == Event.RESET.value:
            run, has_ended = row.run, False
        elif row.run == run:
            has_ended = True
    return None if has_ended else run


async def find_proposal(
    devices: Devices,
    journal: Journal,
    known: Sequence[Held],
    began: rows.RunBegan,
    layout: CellLayout,
    sweep: Sweep,
    back: Back,
    *,
    has_recipe: bool = True,
) -> Proposal | str:
    """Return the proposal for the part, or the reason why there is none; nothing moves.

    Parameters
    ----------
    devices : connected, and halted
    journal : journal of the cell
    known : grippers that may hold a part, by the journals of all runs
    began : the first row of this run
    layout : layout for the preview of the first motion
    sweep : proves the space that homing with the part would sweep
    back : proves the move back to its path of an arm beside it
    has_recipe : this run has a recipe, which must be that of the part

    Raises
    ------
    DeviceError : a device does not answer
    """
    whose = {(one.run, one.part) for one in known}
    if len(whose) != 1:
        return key("two runs have each left a part")
    ((run, part),) = whose
    if not part:
        return say("run {run} had no part of its own", run=run)
    left = fold_interrupted(read_rows(journal.path, run), run, part)
    if left is None:
        return say(
            "run {run} is in the journal of another folder of runs; start with that one", run=run
        )
    if why := _why_not_here(left, began, has_recipe=has_recipe):
        return why
    world = await read_world(devices, left)
    case = classify(left, world)
    swept = proven = None
    if case.homes:
        swept = await sweep(left, lost_bounds(left, world, layout))
    elif (beside := beside_path(left, world, case)) is not None:
        proven = await back(left, beside)
    return propose(left, world, layout, swept, proven)


def _why_not_here(left: Interrupted, began: rows.RunBegan, *, has_recipe: bool) -> str:
    """Return the reason why a part cannot go on in this run; empty if it can."""
    if not same_cell(left.began.cell, began.cell):
        return key(
            "the cell file has changed since then: the paths and grasps of that run are no "
            "longer valid"
        )
    if has_recipe and recipe_for(left, began) is None:
        name = left.recipe.recipe.get("name", "")
        return say("it is the part of recipe {name}: start with that recipe", name=name)
    return ""


def recipe_for(left: Interrupted, began: rows.RunBegan) -> int | None:
    """Return the index of the recipe that fits the part another run left; None if none does.

    Parameters
    ----------
    left : the part
    began : the first row of the run that is to go on with it
    """
    wanted = _part(left.recipe, left.began)
    parts = [_part(one, began) for one in began.ordered]
    return parts.index(wanted) if wanted in parts else None


def _part(ordered: rows.RecipeOrdered, began: rows.RunBegan) -> tuple[str, str | None]:
    """Return the name of a recipe's part, and the SHA-256 of its file."""
    part = split_cad(Path(str(ordered.recipe.get("part", ""))))
    return part.part_name, began.files.get(str(part.file))


async def _decided(
    order: RunOrder, operator: Operator, proposal: Proposal
) -> rows.RecoveryProposed:
    """Return the proposal as a row, with the decision, who made it and the reason."""
    decision, who, why, shown = "refused", "", proposal.person, ""
    if not proposal.person and order.recovery == "auto":
        who = BY_OPTION
        decision = "accepted" if proposal.is_proven else "refused"
        why = key("proven safe") if proposal.is_proven else _why_not_alone(proposal)
    elif not proposal.person:
        answer = await operator.decide(_question(proposal))
        if answer is None:
            why = key("nobody was there to decide")
        else:
            decision = "accepted" if answer.key == GO_ON else "refused"
            who, why = answer.who, answer.why
            shown = proposal.look  # it is in the question that they answered
    return _row(proposal, decision, who, why, shown)


def _why_not_alone(proposal: Proposal) -> str:
    if proposal.homing is not None:
        return key(
            "the arm has to home with the part in a gripper, and a person has to confirm "
            "that it still stands where that run left it"
        )
    if proposal.case.activates_fixed:
        return key(
            "the fixed gripper lost its power and has to be activated, and a person has to "
            "confirm that nothing is between its jaws"
        )
    return key("the path out is not proven to end free")


def _row(
    proposal: Proposal, decision: str, who: str, why: str, shown: str = ""
) -> rows.RecoveryProposed:
    return rows.RecoveryProposed(
        run=proposal.left.run,
        custody=proposal.case.now.key,
        evidence=proposal.evidence,
        intents=proposal.intents,
        steps=proposal.steps,
        first_motion=proposal.first_motion,
        is_proven=proposal.is_proven,
        person=proposal.person,
        decision=decision,
        who=who,
        why=why,
        shown=shown,
    )


def _question(proposal: Proposal) -> Question:
    return Question(
        code="part_left",
        text=(
            say(
                "Run {run} has left a part. Evidence:\n{evidence}\nThe cell would:\n{steps}",
                run=proposal.left.run,
                evidence=listed(proposal.evidence),
                steps=listed(proposal.steps),
            )
            + (say("\n{look}", look=proposal.look) if proposal.look else "")
        ),
        choices=(
            Choice(GO_ON, key("continue with the part as listed")),
            Choice(REFUSE, key("move nothing; I take the part out")),
        ),
        preview=((GO_ON, proposal.preview),),
    )


def _why_refused(order: RunOrder, proposal: Proposal) -> str:
    if proposal.person:
        return proposal.person
    if order.recovery == "auto":
        if proposal.homing is not None or proposal.case.activates_fixed:
            return say(
                "{why_not_alone}; decide with `cellctl recover --accept`",
                why_not_alone=_why_not_alone(proposal),
            )
        return key("the next motion of the cell is not proven safe")
    return key("continuing with it was not accepted")


def refuse(
    journal: Journal, message: str, code: str, where: str, custody: Custody | None = None
) -> BatchEnd:
    """Journal that a start is refused; return the outcome.

    Parameters
    ----------
    journal : journal of the cell
    message, code : reason, and its code
    where : the part is, or what has not moved, as a sentence
    custody : gripper that may have a part; None if nobody has looked
    """
    holder = "" if custody is None else custody.key.upper()
    journal.write(
        rows.AtRest(state="refused", message=message, code=code, custody=holder, where=where)
    )
    return BatchEnd("refused", message, code, where)
