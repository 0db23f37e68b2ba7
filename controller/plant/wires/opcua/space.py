"""The address space: OPC 40100-1, Machinery and PackML loaded, and one cell made of their types.

Machine Vision is loaded first, and Machinery Result and Jobs not at all: asyncua keeps the records
of all NodeSets under one name each, and these have some of the same name.
"""

import logging
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import asyncua.server
from asyncua import Node, Server, ua
from asyncua.common.instantiate_util import instantiate

from controller.memory import give_back
from controller.plant.model import PACKML_NUMBERS, CellState

from .states import (
    OPERATIONAL,
    OPERATIONAL_STATES,
    VisionState,
    VisionTransition,
    item_word,
    system_state,
)
from .values import active_configuration, record

FOLDER: Final = Path(__file__).with_name("nodesets")
MACHINE_VISION: Final = "http://opcfoundation.org/UA/MachineVision"
DEVICES: Final = "http://opcfoundation.org/UA/DI/"
MACHINERY: Final = "http://opcfoundation.org/UA/Machinery/"
PACKML: Final = "http://opcfoundation.org/UA/PackML/"
# in this order, see above; Machinery asks for DI and IA
FILES: Final = ("MachineVision", "Di", "IA", "Machinery", "PackML")

# Numbers of the NodeSets
VISION_SYSTEM_TYPE: Final = 1003
VISION_MACHINE_TYPE: Final = 1017
AUTOMATIC_MACHINE_TYPE: Final = 1021
BINARY_ID_TYPE: Final = 3019
# inherit every field of BinaryIdBaseDataType and have no definition of their own
WITHOUT_DEFINITION: Final = (3002, 3008, 3013)
MACHINES_FOLDER: Final = 1001
IDENTIFICATION_TYPE: Final = 1012
ITEM_STATE_TYPE: Final = 1002
PACKML_STATUS_TYPE: Final = 4
PRODUCE: Final = 1  # PackML's ProductionMaintenanceModeEnum
MAINTENANCE: Final = 2

# Optional nodes that are not offered, below the vision system.
NOT_OFFERED: Final = (
    "DiagnosticLevel",
    "SafetyStateManagement",
    "ConfigurationManagement/AddConfiguration",
    "ConfigurationManagement/Configurations",
    "ConfigurationManagement/ConfigurationTransfer",
    "ConfigurationManagement/ReleaseConfigurationHandle",
    "ConfigurationManagement/RemoveConfiguration",
    "RecipeManagement/AddRecipe",
    "RecipeManagement/LinkProduct",
    "RecipeManagement/PrepareProduct",
    "RecipeManagement/Products",
    "RecipeManagement/Recipes",
    "RecipeManagement/RecipeTransfer",
    "RecipeManagement/ReleaseRecipeHandle",
    "RecipeManagement/RemoveRecipe",
    "RecipeManagement/UnlinkProduct",
    "RecipeManagement/UnprepareProduct",
    "ResultManagement/ReleaseResultHandle",
    "ResultManagement/Results",
    "ResultManagement/ResultTransfer",
    "VisionStateMachine/ConfirmAll",
    "VisionStateMachine/SelectModeAutomatic",
    "VisionStateMachine/AutomaticModeStateMachine/SimulationMode",
)
STEP_MODEL: Final = "StepModel"  # of no state is one offered
OPTIONAL_PARTS: Final = {
    "Number": ua.VariantType.UInt32,
    "TransitionTime": ua.VariantType.DateTime,
}

BAD_NO_VALUE: Final = ua.StatusCode(ua.StatusCodes.BadNotSupported)
NOT_ACTIVE: Final = ua.StatusCode(ua.StatusCodes.BadStateNotActive)


@dataclass(frozen=True, slots=True)
class Numbered:
    """A state or transition of a machine's type: its node, and its number."""

    node: ua.NodeId
    number: int


async def load_types(server: Server) -> None:
    """Load OPC UA's own nodes and those of the NodeSets: some 3 s of CPU, once."""
    await server.init()
    _forget_generated()
    importer = logging.getLogger("asyncua.common.xmlimporter")
    level = importer.level
    give_back()
    # It warns of nine nodes of DI that are there for design tools alone and hang on nothing.
    importer.setLevel(logging.CRITICAL)
    try:
        for name in FILES:
            await server.import_xml(str(FOLDER / f"Opc.Ua.{name}.NodeSet2.xml"), strict_mode=False)
            if name == FILES[0]:
                await _define_ids(server)
    finally:
        importer.setLevel(level)
    give_back()


def _forget_generated() -> None:
    """Forget the code that has made OPC UA's own nodes: 10 MB that run once."""
    for name in [name for name in sys.modules if name.startswith(GENERATED)]:
        del sys.modules[name]
    if hasattr(asyncua.server, GENERATED.rpartition(".")[2]):
        delattr(asyncua.server, GENERATED.rpartition(".")[2])


GENERATED: Final = "asyncua.server.standard_address_space"


async def _define_ids(server: Server) -> None:
    """Give the three types of ids the definition that they inherit.

    asyncua sends none for them, and its clients then know neither them nor ResultDataType, which
    holds them; it would itself send all three as their abstract base.
    """
    index = await server.get_namespace_index(MACHINE_VISION)
    base = server.get_node(ua.NodeId(BINARY_ID_TYPE, index))
    fields = (await base.read_data_type_definition()).Fields
    for number in WITHOUT_DEFINITION:
        node = server.get_node(ua.NodeId(number, index))
        encodings = await node.get_referenced_nodes(ua.ObjectIds.HasEncoding)
        binary = [one for one in encodings if (await one.read_browse_name()).Name == BINARY]
        definition = ua.StructureDefinition(
            DefaultEncodingId=binary[0].nodeid,
            BaseDataType=base.nodeid,
            StructureType=ua.StructureType.StructureWithOptionalFields,
            Fields=list(fields),
        )
        await node.write_attribute(
            ua.AttributeIds.DataTypeDefinition, ua.DataValue(ua.Variant(definition))
        )
        name = (await node.read_browse_name()).Name
        own: Any = dataclass(type(name, (ua.BinaryIdBaseDataType,), {"data_type": node.nodeid}))
        if hasattr(ua, name):  # the base, under another name
            delattr(ua, name)
        ua.register_extension_object(name, binary[0].nodeid, own, node.nodeid)


BINARY: Final = "Default Binary"


class CellSpace:
    """The nodes of one cell; made by `made`.

    Attributes
    ----------
    vision : the vision system
    namespace : index of Machine Vision's names
    """

    def __init__(self, server: Server, vision: Node, namespace: int) -> None:
        self.server = server
        self.vision = vision
        self.namespace = namespace
        self._types: dict[str, dict[str, Numbered]] = {}
        self._nodes: dict[str, Node] = {}

    @classmethod
    async def made(cls, server: Server, cell: str, software: str, file_sha256: str) -> "CellSpace":
        """Return the nodes of a cell, made in a server whose types are loaded.

        Parameters
        ----------
        server : its types are loaded
        cell : name of the cell
        software : version of cellctl
        file_sha256 : of its cell file
        """
        index = await server.get_namespace_index(MACHINE_VISION)
        made = await instantiate(
            server.nodes.objects,
            server.get_node(ua.NodeId(VISION_SYSTEM_TYPE, index)),
            nodeid=ua.NodeId("VisionSystem", 1),
            bname=ua.QualifiedName(cell, 1),
            dname=ua.LocalizedText(cell),
            idx=1,
        )
        space = cls(server, made[0], index)
        await space._leave_out()
        for machine, number in (("outer", VISION_MACHINE_TYPE), ("inner", AUTOMATIC_MACHINE_TYPE)):
            space._types[machine] = await space._numbered(ua.NodeId(number, index))
        await space._make_machine(cell, software)
        await space._make_packml()
        await space._find()
        await space.write("active_configuration", active_configuration(cell, file_sha256))
        await space._close(space.vision)
        return space

    async def child(self, path: str) -> Node:
        """Return a node below the vision system, by the names on the way to it."""
        return await _below(self.vision, path)

    def transition(self, name: str) -> Numbered:
        """Return a transition by its browse name."""
        return self._types["outer"].get(name) or self._types["inner"][name]

    def state(self, vision_state: VisionState) -> Numbered:
        """Return the innermost state, as the machine numbers it."""
        return self._types["inner" if vision_state in OPERATIONAL_STATES else "outer"][
            vision_state.value
        ]

    async def write(self, name: str, value: Any, status: ua.StatusCode | None = None) -> None:
        """Write a variable of the cell.

        Parameters
        ----------
        name : as `_find` names it
        value : None for none
        status : why there is none; None for good
        """
        node = self._nodes[name]
        variant = value if isinstance(value, ua.Variant) else ua.Variant(value)
        await self.server.write_attribute_value(
            node.nodeid,
            ua.DataValue(
                variant,
                StatusCode=status or ua.StatusCode(),
                SourceTimestamp=datetime.now(UTC),
            ),
        )

    async def show_transition(self, transition: VisionTransition) -> None:
        """Show that the machine has made a transition."""
        now = datetime.now(UTC)
        moved = self.transition(transition.name)
        machine = "outer" if transition.name in self._types["outer"] else "inner"
        await self.show_state(transition.after)
        await self.write(f"{machine}/LastTransition", ua.LocalizedText(transition.name))
        await self.write(f"{machine}/LastTransition/Id", moved.node)
        await self.write(f"{machine}/LastTransition/Number", _uint32(moved.number))
        await self.write(f"{machine}/LastTransition/TransitionTime", now)

    async def show_state(self, vision_state: VisionState) -> None:
        """Show the state of both machines; the inner one has none outside Operational."""
        outer = self._types["outer"][vision_state.outer]
        await self.write("outer/CurrentState", ua.LocalizedText(vision_state.outer))
        await self.write("outer/CurrentState/Id", outer.node)
        await self.write("outer/CurrentState/Number", _uint32(outer.number))
        if vision_state.outer != OPERATIONAL:
            for name in ("", "/Id", "/Number"):
                await self.write(f"inner/CurrentState{name}", None, NOT_ACTIVE)
            return
        inner = self._types["inner"][vision_state.value]
        await self.write("inner/CurrentState", ua.LocalizedText(vision_state.value))
        await self.write("inner/CurrentState/Id", inner.node)
        await self.write("inner/CurrentState/Number", _uint32(inner.number))

    async def show_cell(self, cell: CellState, vision_state: VisionState) -> None:
        """Show the state of the cell in the words of SEMI E10, Machinery and PackML."""
        word, why = system_state(cell, vision_state)
        await self.write(
            "system_state",
            record(
                "SystemStateDescriptionDataType",
                State=getattr(ua.SystemStateDataType, word.value),
                StateDescription=why,
            ),
        )
        item = self._types["item"][item_word(cell)]
        await self.write("item/CurrentState", ua.LocalizedText(item_word(cell)))
        await self.write("item/CurrentState/Id", item.node)
        await self.write("item/CurrentState/Number", _uint32(item.number))
        number = PACKML_NUMBERS[cell.packml]
        await self.write("packml/StateCurrent", ua.Variant(number, ua.VariantType.Int32))
        await self.write("packml/StateCurrentName", cell.packml)
        mode = MAINTENANCE if cell.state == "taken" else PRODUCE
        await self.write("packml/UnitModeCurrent", ua.Variant(mode, ua.VariantType.Int32))

    async def _leave_out(self) -> None:
        """Remove the optional nodes that are not offered."""
        unwanted = [await _found(self.vision, path) for path in NOT_OFFERED]
        outer = await self.child("VisionStateMachine")
        inner = await self.child("VisionStateMachine/AutomaticModeStateMachine")
        for machine in (outer, inner):
            unwanted += [
                child
                for child in await machine.get_children()
                if (await child.read_browse_name()).Name.endswith(STEP_MODEL)
            ]
        await self.server.delete_nodes([node for node in unwanted if node], recursive=True)

    async def _numbered(self, machine_type: ua.NodeId) -> dict[str, Numbered]:
        """Return states and transitions of a machine's type, by browse name."""
        found = {}
        for child in await self.server.get_node(machine_type).get_children():
            for name in ("StateNumber", "TransitionNumber"):
                number = await _found(child, name)
                if number is not None:
                    key = (await child.read_browse_name()).Name
                    found[key] = Numbered(child.nodeid, int(await number.read_value()))
        return found

    async def _make_machine(self, cell: str, software: str) -> None:
        """Make the cell a machine by OPC 40001-1: identification, and the state of the item."""
        machinery = await self.server.get_namespace_index(MACHINERY)
        devices = await self.server.get_namespace_index(DEVICES)
        machines = self.server.get_node(ua.NodeId(MACHINES_FOLDER, machinery))
        await machines.add_reference(self.vision, ua.ObjectIds.Organizes)
        identification = (
            await instantiate(
                self.vision,
                self.server.get_node(ua.NodeId(IDENTIFICATION_TYPE, machinery)),
                nodeid=ua.NodeId("VisionSystem.Identification", 1),
                bname=ua.QualifiedName("Identification", devices),
                instantiate_optional=False,
                idx=1,
            )
        )[0]
        known: Mapping[str, Any] = {
            "Manufacturer": ua.LocalizedText("cellctl"),
            "ProductInstanceUri": instance_uri(cell),
            "SerialNumber": cell,
        }
        for name, value in known.items():
            await (await _below(identification, name)).write_value(value)
        revision = await identification.add_property(
            ua.NodeId("VisionSystem.Identification.SoftwareRevision", 1),
            ua.QualifiedName("SoftwareRevision", devices),
            software,
        )
        await revision.set_read_only()
        blocks = await self.vision.add_object(
            ua.NodeId("VisionSystem.MachineryBuildingBlocks", 1),
            ua.QualifiedName("MachineryBuildingBlocks", machinery),
            objecttype=ua.ObjectIds.FolderType,
        )
        await blocks.add_reference(identification, ua.ObjectIds.HasAddIn)
        item_type = ua.NodeId(ITEM_STATE_TYPE, machinery)
        item = (
            await instantiate(
                blocks,
                self.server.get_node(item_type),
                nodeid=ua.NodeId("VisionSystem.MachineryItemState", 1),
                bname=ua.QualifiedName("MachineryItemState", machinery),
                instantiate_optional=False,
                idx=1,
            )
        )[0]
        self._types["item"] = await self._numbered(item_type)
        current = await _below(item, "CurrentState")
        self._nodes["item/CurrentState"] = current
        self._nodes["item/CurrentState/Id"] = await _below(current, "Id")
        self._nodes["item/CurrentState/Number"] = await _part(current, "Number")

    async def _make_packml(self) -> None:
        """Make the status object of OPC 30050; commands are not offered."""
        packml = await self.server.get_namespace_index(PACKML)
        status = (
            await instantiate(
                self.vision,
                self.server.get_node(ua.NodeId(PACKML_STATUS_TYPE, packml)),
                nodeid=ua.NodeId("VisionSystem.PackMLStatus", 1),
                bname=ua.QualifiedName("PackMLStatus", 1),
                instantiate_optional=False,
                idx=1,
            )
        )[0]
        for name, value in (("StateCurrent", 0), ("StateCurrentName", "")):
            self._nodes[f"packml/{name}"] = await status.add_variable(
                ua.NodeId(f"VisionSystem.PackMLStatus.{name}", 1),
                ua.QualifiedName(name, 1),
                value,
                varianttype=ua.VariantType.String
                if name.endswith("Name")
                else ua.VariantType.Int32,
            )
        self._nodes["packml/UnitModeCurrent"] = await _below(status, "UnitModeCurrent")
        # no speed is set or measured, and no neighbour in the line is known
        for name in ("CurMachSpeed", "MachSpeed", "EquipmentBlocked", "EquipmentStarved"):
            self._nodes[name] = await _below(status, name)
            await self.write(name, None, BAD_NO_VALUE)

    async def _find(self) -> None:
        """Find the variables that are written later."""
        machines = {
            "outer": "VisionStateMachine",
            "inner": "VisionStateMachine/AutomaticModeStateMachine",
        }
        for name, path in machines.items():
            machine = await self.child(path)
            last = await instantiate(
                machine,
                self.server.get_node(ua.NodeId(ua.ObjectIds.FiniteTransitionVariableType)),
                nodeid=ua.NodeId(f"{machine.nodeid.Identifier}.LastTransition", 1),
                bname=ua.QualifiedName("LastTransition", 0),
                instantiate_optional=False,
            )
            for variable, node, parts in (
                ("CurrentState", await _below(machine, "CurrentState"), ("Id", "Number")),
                ("LastTransition", last[0], ("Id", "Number", "TransitionTime")),
            ):
                self._nodes[f"{name}/{variable}"] = node
                for part in parts:
                    self._nodes[f"{name}/{variable}/{part}"] = await _part(node, part)
        self._nodes["system_state"] = await self.child("SystemState")
        self._nodes["active_configuration"] = await self.child(
            "ConfigurationManagement/ActiveConfiguration"
        )

    async def _close(self, node: Node) -> None:
        """Make every variable below a node one that clients only read."""
        for child in await node.get_children():
            if await child.read_node_class() is ua.NodeClass.Variable:
                await child.set_read_only()
            await self._close(child)


def instance_uri(cell: str) -> str:
    """Return the URI of a cell: of its server, its certificate and its identification."""
    return f"urn:cellctl:{cell}"


def _uint32(number: int) -> ua.Variant:
    return ua.Variant(number, ua.VariantType.UInt32)


async def _found(node: Node, path: str) -> Node | None:
    """Return a node by the names on the way to it, of whichever namespace; None without."""
    for name in path.split("/"):
        for child in await node.get_children():
            if (await child.read_browse_name()).Name == name:
                node = child
                break
        else:
            return None
    return node


async def _below(node: Node, path: str) -> Node:
    found = await _found(node, path)
    if found is None:
        raise LookupError(f"the NodeSet has no {path}")
    return found


async def _part(node: Node, name: str) -> Node:
    """Return a part of a state or transition; those that are optional are made."""
    found = await _found(node, name)
    if found is not None:
        return found
    return await node.add_property(
        ua.NodeId(f"{node.nodeid.Identifier}.{name}", 1),
        ua.QualifiedName(name, 0),
        ua.get_default_value(OPTIONAL_PARTS[name]),
        varianttype=OPTIONAL_PARTS[name],
    )
