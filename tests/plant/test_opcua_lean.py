"""Nodes in little room behave as asyncua's own."""

from __future__ import annotations

import pytest
from asyncua import ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.address_space import AddressSpace, NodeManagementService

from controller.plant.wires.opcua.lean import LeanNodes

COUNT = 6


def node(number: int) -> ua.NodeId:
    return ua.NodeId(number + 1, 1)  # 0 is none


def keys(space: AddressSpace) -> list[ua.NodeId]:
    return list(space.keys())


def linked(service: type[NodeManagementService]) -> tuple[AddressSpace, NodeManagementService]:
    """Nodes of which each refers to each other one."""
    space = AddressSpace()
    nodes = service(space)
    for number in range(COUNT):
        item = ua.AddNodesItem(
            RequestedNewNodeId=node(number),
            BrowseName=ua.QualifiedName(f"n{number}", 1),
            NodeClass=ua.NodeClass.Object,
            NodeAttributes=ua.ObjectAttributes(),
        )
        assert not list(nodes.try_add_nodes([item], check=False))
    references = [
        ua.AddReferencesItem(
            SourceNodeId=node(one),
            ReferenceTypeId=ua.NodeId(ua.ObjectIds.Organizes),
            TargetNodeId=node(other),
            TargetNodeClass=ua.NodeClass.Object,
        )
        for one in range(COUNT)
        for other in range(COUNT)
        if one != other
    ]
    for code in nodes.add_references(references):
        code.check()
    return space, nodes


@pytest.mark.parametrize("role", [UserRole.Admin, UserRole.User])
def test_several_nodes_are_deleted_with_all_references_to_them(role: UserRole) -> None:
    found = []
    for service in (NodeManagementService, LeanNodes):
        space, nodes = linked(service)
        asked = [(1, True), (4, True), (5, False), (99, True)]  # the last one is not there
        items = [ua.DeleteNodesItem(node(number), delete) for number, delete in asked]
        codes = nodes.delete_nodes(ua.DeleteNodesParameters(items), User(role=role))
        left = {key: [str(one.NodeId) for one in space[key].references] for key in keys(space)}
        found.append((codes, left))
    assert found[0] == found[1]
    codes, left = found[0]
    is_gone = role == UserRole.Admin
    assert (node(1) in left) is not is_gone
    assert (str(node(1)) in left[node(0)]) is not is_gone
    assert str(node(5)) in left[node(0)]


async def test_what_is_written_to_one_node_changes_no_other() -> None:
    found = []
    for service in (NodeManagementService, LeanNodes):
        space, _ = linked(service)
        renamed = ua.Variant(ua.QualifiedName("renamed", 1))
        told = ua.Variant(ua.LocalizedText("one told"))
        for attribute, value in (
            (ua.AttributeIds.BrowseName, renamed),
            (ua.AttributeIds.DisplayName, told),
        ):
            code = await space.write_attribute_value(node(2), attribute, ua.DataValue(value))
            code.check()
        found.append(
            {
                str(key): (
                    {str(a): repr(one.value.Value) for a, one in space[key].attributes.items()},
                    [repr(one) for one in space[key].references],
                )
                for key in keys(space)
            }
        )
    assert found[0] == found[1]
    names = [attributes["3"] for attributes, _ in found[1].values()]
    assert sum("renamed" in name for name in names) == 1
