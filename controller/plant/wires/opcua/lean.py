"""OPC UA's 8,000 nodes in little room: equal values are one object, attributes have no spare parts.

Of 97,000 attributes most are the likes of False, and 30,000 references name the same 8,000 nodes.
asyncua puts another object in the place of a value and never changes one, so that equal values may
be one and the same. With a dictionary for each attribute's listeners and one for its fields, the
nodes take some 60 MB, so 20.
"""

from typing import Any, Final

from asyncua import ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.address_space import AddressSpace, NodeData, NodeManagementService

ADMIN: Final = User(role=UserRole.Admin)
PLAIN: Final = (bool, int, float, str, type(None))
GOOD: Final = ua.StatusCode()
NAMED: Final = ("ReferenceTypeId", "NodeId", "TypeDefinition")  # of a reference, by a NodeId each


class _Attribute:
    """An attribute as asyncua has it, but for the room of what few ever have."""

    __slots__ = ("_callbacks", "value", "value_callback", "value_setter")

    def __init__(self, value: Any) -> None:
        self.value = value
        self.value_callback: Any = None
        self.value_setter: Any = None
        self._callbacks: dict[int, Any] | None = None

    @property
    def datachange_callbacks(self) -> dict[int, Any]:
        """Those who are told of a change."""
        if self._callbacks is None:
            self._callbacks = {}
        return self._callbacks


class LeanNodes(NodeManagementService):
    """Adds nodes to an address space.

    Parameters
    ----------
    space : the address space
    """

    def __init__(self, space: AddressSpace) -> None:
        super().__init__(space)
        self._known: dict[Any, Any] = {}

    def _add_node_attributes(
        self, nodedata: NodeData, item: ua.AddNodesItem, add_timestamps: bool
    ) -> None:
        super()._add_node_attributes(nodedata, item, add_timestamps)
        for key, attribute in nodedata.attributes.items():
            held = attribute.value
            if held is not None and held.StatusCode == GOOD:
                held.StatusCode = GOOD
            if held is not None and key != ua.AttributeIds.Value:
                held = self._shared(held)
            nodedata.attributes[key] = _Attribute(held)

    def delete_nodes(
        self, deletenodeitems: ua.DeleteNodesParameters, user: User = ADMIN
    ) -> list[ua.StatusCode]:
        """Delete nodes; references to them go in one pass, where asyncua makes one for each node.

        Parameters
        ----------
        deletenodeitems : the nodes
        user : who asks; nodes stay for all but an administrator

        Returns
        -------
        result : of each node, in their order
        """
        items = deletenodeitems.NodesToDelete
        gone = {item.NodeId for item in items if item.DeleteTargetReferences}
        gone = {node for node in gone if node in self._aspace}
        if gone and user.role == UserRole.Admin:
            nodes = self._aspace.keys()
            for node in nodes:
                references = self._aspace[node].references
                if any(one.NodeId in gone for one in references):
                    references[:] = [one for one in references if one.NodeId not in gone]
        left = [ua.DeleteNodesItem(item.NodeId, DeleteTargetReferences=False) for item in items]
        return super().delete_nodes(ua.DeleteNodesParameters(left), user)

    def _add_unique_reference(
        self, nodedata: NodeData, desc: ua.ReferenceDescription
    ) -> ua.StatusCode:
        for name in NAMED:
            node = getattr(desc, name)
            setattr(desc, name, self._known.setdefault(_key_of(node), node))
        return super()._add_unique_reference(nodedata, desc)

    def _shared(self, held: ua.DataValue) -> ua.DataValue:
        """Return a value of an attribute other than Value, whose time nobody asks for."""
        inner = held.Value
        key = None if inner is None else _key_of(inner.Value)
        if inner is None or key is None:
            return held
        same = (inner.VariantType, inner.is_array, key, held.StatusCode.value)
        found = self._known.get(same)
        if found is None:
            found = self._known[same] = ua.DataValue(inner, StatusCode=held.StatusCode)
        return found


def _key_of(value: Any) -> tuple[Any, ...] | None:
    """Return what equal values alone have in common, None for a record."""
    fields: tuple[Any, ...] | None = None
    if isinstance(value, PLAIN):
        fields = (value,)
    elif isinstance(value, ua.LocalizedText):
        fields = (value.Locale, value.Text)
    elif isinstance(value, ua.QualifiedName):
        fields = (value.NamespaceIndex, value.Name)
    elif isinstance(value, ua.ExpandedNodeId):
        where = (value.NamespaceUri, value.ServerIndex)
        fields = (value.NamespaceIndex, value.NodeIdType, value.Identifier, *where)
    elif isinstance(value, ua.NodeId):
        fields = (value.NamespaceIndex, value.NodeIdType, value.Identifier)
    elif isinstance(value, list) and all(isinstance(one, int) for one in value):
        fields = tuple(value)
    return None if fields is None else (type(value), *fields)
