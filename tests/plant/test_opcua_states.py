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
    ClientRequest,
    SystemState,
    VisionState,
    item_word,
    system_state,
    transition_of,
    transitions_between,
    vision_state_of,
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


def number_of(vision_state: VisionState) -> int:
    return STATES[vision_state.value]


def test_each_transition_is_that_of_the_nodeset_from_and_to_the_states_of_its_number() -> None:
    numbers = numbers_of_the_nodeset()
    assert {name: numbers[name] for name in STATES} == STATES
    methods = [transition for transitions in BY_METHOD.values() for transition in transitions]
    for transition in (*BY_ITSELF, *methods):
        first, second = divmod(numbers[transition.name] // 10, 10)
        inner = {number_of(transition.before), number_of(transition.after)}
        assert first in (STATES[transition.before.outer], number_of(transition.before)), transition
        assert second in (STATES[transition.after.outer], number_of(transition.after)), transition
        assert len(inner) == 2
    for cause, transitions in BY_METHOD.items():
        assert {numbers[transition.name] for transition in transitions} == BY_METHOD_NUMBERS[cause]
    assert all(numbers[transition.name] % 10 == 0 for transition in BY_ITSELF)


@pytest.mark.parametrize("at", VisionState)
@pytest.mark.parametrize("to", VisionState)
def test_every_state_is_reached_from_every_other_by_transitions_that_follow_each_other(
    at: VisionState, to: VisionState
) -> None:
    transitions = transitions_between(at, to)
    vision_states = [at, *(transition.after for transition in transitions)]
    assert [transition.before for transition in transitions] == vision_states[:-1]
    assert vision_states[-1] is to
    assert len(set(vision_states)) == len(vision_states)


def test_a_method_makes_no_transition_where_the_table_has_none() -> None:
    assert transition_of("StartSingleJob", VisionState.INITIALIZED) is None
    assert transition_of("Halt", VisionState.HALTED) is None
    assert transition_of("Stop", VisionState.READY) is None


PREPARED = ClientRequest(is_prepared=True)
RUNNING: dict[str, Any] = {"run": "r", "order": "PO-1", "done": {"holder": (0, 1)}}


@pytest.mark.parametrize(
    ("cell", "client_request", "vision_state", "item", "system"),
    [
        ({}, ClientRequest(), VisionState.INITIALIZED, "NotExecuting", "SBY_2"),
        ({}, PREPARED, VisionState.READY, "NotExecuting", "SBY_2"),
        ({}, ClientRequest(is_halted=True), VisionState.HALTED, "NotExecuting", "SDT_4"),
        ({"state": "unknown"}, PREPARED, VisionState.PREOPERATIONAL, "NotAvailable", "NST_6"),
        ({"state": "left"}, PREPARED, VisionState.ERROR, "OutOfService", "UDT_5"),
        (
            {"state": "left"},
            ClientRequest(is_halted=True),
            VisionState.HALTED,
            "OutOfService",
            "SDT_4",
        ),
        ({"state": "taken"}, PREPARED, VisionState.HALTED, "OutOfService", "ENG_3"),
        ({"state": "resetting", **RUNNING}, PREPARED, VisionState.SINGLE, "Executing", "PRD_1"),
        (
            {"state": "execute_placing", **RUNNING},
            PREPARED,
            VisionState.SINGLE,
            "Executing",
            "PRD_1",
        ),
        ({"state": "completing", **RUNNING}, PREPARED, VisionState.SINGLE, "Executing", "PRD_1"),
        (
            {"state": "execute_placing", **RUNNING, "done": {"a": (1, 1), "b": (0, 2)}},
            ClientRequest(),
            VisionState.CONTINUOUS,
            "Executing",
            "PRD_1",
        ),
        (
            {"state": "suspended_placing", **RUNNING},
            PREPARED,
            VisionState.SINGLE,
            "NotExecuting",
            "SBY_2",
        ),
        ({"state": "held", **RUNNING}, PREPARED, VisionState.SINGLE, "NotExecuting", "UDT_5"),
        ({"state": "stopping", **RUNNING}, PREPARED, VisionState.READY, "NotExecuting", "SBY_2"),
        ({"state": "stopped", **RUNNING}, PREPARED, VisionState.READY, "NotExecuting", "SBY_2"),
        ({"state": "complete", **RUNNING}, PREPARED, VisionState.READY, "NotExecuting", "SBY_2"),
        ({"state": "aborting", **RUNNING}, PREPARED, VisionState.ERROR, "OutOfService", "UDT_5"),
        ({"state": "aborted", **RUNNING}, PREPARED, VisionState.ERROR, "OutOfService", "UDT_5"),
        ({"state": "clearing", **RUNNING}, PREPARED, VisionState.ERROR, "OutOfService", "UDT_5"),
    ],
)
def test_a_state_of_the_cell_is_shown_as_the_table_of_the_manual_has_it(
    cell: dict[str, Any],
    client_request: ClientRequest,
    vision_state: VisionState,
    item: str,
    system: str,
) -> None:
    state = idle_state(**cell, packml=packml_of(str(cell.get("state", "free"))))
    found = vision_state_of(state, client_request, VisionState.READY)
    assert found is vision_state
    assert item_word(state) == item
    word, why = system_state(state, found)
    assert word == system
    assert why
    assert word in set(SystemState)


@pytest.mark.parametrize("state", STATES_OF_THE_CELL)
@pytest.mark.parametrize("now", VisionState)
def test_every_state_of_a_run_has_a_vision_state(state: str, now: VisionState) -> None:
    cell = idle_state(state=state, packml=packml_of(state), **RUNNING)
    found = vision_state_of(cell, PREPARED, now)
    assert found in (VisionState.READY, VisionState.ERROR, *EXECUTING)
    assert vision_state_of(cell, PREPARED, found) is found, "it would go to and fro"


def test_a_job_that_was_accepted_executes_before_its_run_is_there_and_no_more_behind_it() -> None:
    job = ClientRequest(is_prepared=True, order="PO-1", kind="single", has_begun=True)
    free, starting = idle_state(), idle_state(state="starting", packml="Starting")
    assert vision_state_of(free, job, VisionState.READY) is VisionState.SINGLE
    assert vision_state_of(starting, job, VisionState.SINGLE) is VisionState.SINGLE
    complete = idle_state(state="complete", packml="Complete", **RUNNING)
    gone = replace(job, has_begun=False)
    assert vision_state_of(complete, gone, VisionState.SINGLE) is VisionState.READY
    assert vision_state_of(free, gone, VisionState.READY) is VisionState.READY


def test_a_run_that_begins_stopped_is_not_taken_for_one_that_was_stopped() -> None:
    begins = idle_state(state="stopped", **RUNNING)
    assert vision_state_of(begins, PREPARED, VisionState.SINGLE) is VisionState.SINGLE
    assert (
        vision_state_of(begins.model_copy(update={"part": 1}), PREPARED, VisionState.SINGLE)
        is VisionState.READY
    )
    assert vision_state_of(begins, PREPARED, VisionState.READY) is VisionState.READY, (
        "stopped while it homed"
    )


def test_a_run_of_somebody_else_is_not_taken_for_the_job() -> None:
    waiting = ClientRequest(is_prepared=True, order="PO-1", kind="single")
    other = idle_state(state="execute_acquiring", packml="Execute", run="r", done={"plate": (0, 9)})
    assert vision_state_of(other, waiting, VisionState.READY) is VisionState.CONTINUOUS


def test_how_many_parts_a_run_is_for_is_waited_for() -> None:
    early = idle_state(state="resetting", packml="Resetting", run="r")
    assert (
        vision_state_of(early, ClientRequest(), VisionState.INITIALIZED) is VisionState.INITIALIZED
    )
    assert vision_state_of(early, ClientRequest(), VisionState.PREOPERATIONAL) is VisionState.READY
