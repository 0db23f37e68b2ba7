"""The machine of OPC 40100-1: its table is that of the specification, and it goes where it must."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from fake_plant import idle_state

from controller.cell.machine.table import STATES as STATES_OF_THE_CELL
from controller.plant.standing import packml_of
from controller.plant.wires.opcua.states import (
    BY_ITSELF,
    BY_METHOD,
    EXECUTING,
    Intent,
    Place,
    SystemState,
    item_word,
    place_of,
    step_of,
    system_state,
    way,
)

NODESETS = Path(__file__).parents[2] / "controller/plant/wires/opcua/nodesets"
XML = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
# OPC 40100-1, 8.2.4 and 8.3.4; transitions are numbered from, to, cause (0 by itself)
STATES = {
    "Preoperational": 1, "Halted": 2, "Error": 3, "Operational": 4, "Initialized": 5, "Ready": 6,
    "SingleExecution": 7, "ContinuousExecution": 8,
}  # fmt: skip
BY_METHOD_NUMBERS = {
    "Halt": {121, 321, 421},
    "Reset": {211, 311, 411},
    "PrepareRecipe": {561},
    "UnprepareRecipe": {651},
    "StartSingleJob": {671},
    "StartContinuous": {681},
    "Stop": {761, 861},
    "Abort": {762, 862},
}


def numbers_of_the_nodeset() -> dict[str, int]:
    """Return the numbers of states and transitions, read without the library."""
    tree = ElementTree.parse(NODESETS / "Opc.Ua.MachineVision.NodeSet2.xml").getroot()
    names = {
        one.get("NodeId"): one.get("BrowseName", "").partition(":")[2]
        for one in tree.iter(f"{XML}UAObject")
    }
    found: dict[str, int] = {}
    for one in tree.iter(f"{XML}UAVariable"):
        if one.get("BrowseName") in ("StateNumber", "TransitionNumber"):
            name = names.get(one.get("ParentNodeId"), "")
            value = one.find(f"{XML}Value")
            if name and value is not None:
                found.setdefault(name, int("".join(value.itertext()).strip()))
    return found


def number_of(place: Place) -> int:
    return STATES[place.value]


def test_each_transition_is_that_of_the_nodeset_from_and_to_the_states_of_its_number() -> None:
    numbers = numbers_of_the_nodeset()
    assert {name: numbers[name] for name in STATES} == STATES
    methods = [step for steps in BY_METHOD.values() for step in steps]
    for step in (*BY_ITSELF, *methods):
        first, second = divmod(numbers[step.transition] // 10, 10)
        inner = {number_of(step.before), number_of(step.after)}
        assert first in (STATES[step.before.outer], number_of(step.before)), step
        assert second in (STATES[step.after.outer], number_of(step.after)), step
        assert len(inner) == 2
    for cause, steps in BY_METHOD.items():
        assert {numbers[step.transition] for step in steps} == BY_METHOD_NUMBERS[cause]
    assert all(numbers[step.transition] % 10 == 0 for step in BY_ITSELF)


@pytest.mark.parametrize("at", Place)
@pytest.mark.parametrize("to", Place)
def test_every_state_is_reached_from_every_other_by_steps_that_follow_each_other(
    at: Place, to: Place
) -> None:
    steps = way(at, to)
    places = [at, *(step.after for step in steps)]
    assert [step.before for step in steps] == places[:-1]
    assert places[-1] is to
    assert len(set(places)) == len(places)


def test_a_method_makes_no_transition_where_the_table_has_none() -> None:
    assert step_of("StartSingleJob", Place.INITIALIZED) is None
    assert step_of("Halt", Place.HALTED) is None
    assert step_of("Stop", Place.READY) is None


PREPARED = Intent(is_prepared=True)
RUNNING: dict[str, Any] = {"run": "r", "order": "PO-1", "done": {"holder": (0, 1)}}


@pytest.mark.parametrize(
    ("cell", "intent", "place", "item", "system"),
    [
        ({}, Intent(), Place.INITIALIZED, "NotExecuting", "SBY_2"),
        ({}, PREPARED, Place.READY, "NotExecuting", "SBY_2"),
        ({}, Intent(is_halted=True), Place.HALTED, "NotExecuting", "SDT_4"),
        ({"state": "unknown"}, PREPARED, Place.PREOPERATIONAL, "NotAvailable", "NST_6"),
        ({"state": "left"}, PREPARED, Place.ERROR, "OutOfService", "UDT_5"),
        ({"state": "left"}, Intent(is_halted=True), Place.HALTED, "OutOfService", "SDT_4"),
        ({"state": "taken"}, PREPARED, Place.HALTED, "OutOfService", "ENG_3"),
        ({"state": "resetting", **RUNNING}, PREPARED, Place.SINGLE, "Executing", "PRD_1"),
        ({"state": "execute_placing", **RUNNING}, PREPARED, Place.SINGLE, "Executing", "PRD_1"),
        ({"state": "completing", **RUNNING}, PREPARED, Place.SINGLE, "Executing", "PRD_1"),
        (
            {"state": "execute_placing", **RUNNING, "done": {"a": (1, 1), "b": (0, 2)}},
            Intent(),
            Place.CONTINUOUS,
            "Executing",
            "PRD_1",
        ),
        (
            {"state": "suspended_placing", **RUNNING},
            PREPARED,
            Place.SINGLE,
            "NotExecuting",
            "SBY_2",
        ),
        ({"state": "held", **RUNNING}, PREPARED, Place.SINGLE, "NotExecuting", "UDT_5"),
        ({"state": "stopping", **RUNNING}, PREPARED, Place.READY, "NotExecuting", "SBY_2"),
        ({"state": "stopped", **RUNNING}, PREPARED, Place.READY, "NotExecuting", "SBY_2"),
        ({"state": "complete", **RUNNING}, PREPARED, Place.READY, "NotExecuting", "SBY_2"),
        ({"state": "aborting", **RUNNING}, PREPARED, Place.ERROR, "OutOfService", "UDT_5"),
        ({"state": "aborted", **RUNNING}, PREPARED, Place.ERROR, "OutOfService", "UDT_5"),
        ({"state": "clearing", **RUNNING}, PREPARED, Place.ERROR, "OutOfService", "UDT_5"),
    ],
)
def test_a_state_of_the_cell_is_shown_as_the_table_of_the_manual_has_it(
    cell: dict[str, Any], intent: Intent, place: Place, item: str, system: str
) -> None:
    state = idle_state(**cell, packml=packml_of(str(cell.get("state", "free"))))
    found = place_of(state, intent, Place.READY)
    assert found is place
    assert item_word(state) == item
    word, why = system_state(state, found)
    assert word == system
    assert why
    assert word in set(SystemState)


@pytest.mark.parametrize("state", STATES_OF_THE_CELL)
@pytest.mark.parametrize("now", Place)
def test_every_state_of_a_run_has_a_place(state: str, now: Place) -> None:
    cell = idle_state(state=state, packml=packml_of(state), **RUNNING)
    found = place_of(cell, PREPARED, now)
    assert found in (Place.READY, Place.ERROR, *EXECUTING)
    assert place_of(cell, PREPARED, found) is found, "it would go to and fro"


def test_a_job_that_was_accepted_executes_before_its_run_is_there_and_no_more_behind_it() -> None:
    job = Intent(is_prepared=True, order="PO-1", kind="single", has_begun=True)
    free, starting = idle_state(), idle_state(state="starting", packml="Starting")
    assert place_of(free, job, Place.READY) is Place.SINGLE
    assert place_of(starting, job, Place.SINGLE) is Place.SINGLE
    complete = idle_state(state="complete", packml="Complete", **RUNNING)
    gone = replace(job, has_begun=False)
    assert place_of(complete, gone, Place.SINGLE) is Place.READY
    assert place_of(free, gone, Place.READY) is Place.READY


def test_a_run_that_begins_stopped_is_not_taken_for_one_that_was_stopped() -> None:
    begins = idle_state(state="stopped", **RUNNING)
    assert place_of(begins, PREPARED, Place.SINGLE) is Place.SINGLE
    assert place_of(begins.model_copy(update={"part": 1}), PREPARED, Place.SINGLE) is Place.READY
    assert place_of(begins, PREPARED, Place.READY) is Place.READY, "stopped while it homed"


def test_a_run_of_somebody_else_is_not_taken_for_the_job() -> None:
    waiting = Intent(is_prepared=True, order="PO-1", kind="single")
    other = idle_state(state="execute_acquiring", packml="Execute", run="r", done={"plate": (0, 9)})
    assert place_of(other, waiting, Place.READY) is Place.CONTINUOUS


def test_how_many_parts_a_run_is_for_is_waited_for() -> None:
    early = idle_state(state="resetting", packml="Resetting", run="r")
    assert place_of(early, Intent(), Place.INITIALIZED) is Place.INITIALIZED
    assert place_of(early, Intent(), Place.PREOPERATIONAL) is Place.READY
