"""The camera's description in GenICam's XML: what a client reads before anything else."""

from collections.abc import Mapping, Sequence
from typing import Final
from xml.sax.saxutils import quoteattr

from ..protocol import bootstrap as boot
from .table import Feature, Kind, address_of

_SCHEMA: Final = "http://www.genicam.org/GenApi/Version_1_1"
_TEXTS: Final = {
    "DeviceVendorName": (boot.MANUFACTURER_NAME, "RO"),
    "DeviceModelName": (boot.MODEL_NAME, "RO"),
    "DeviceVersion": (boot.DEVICE_VERSION, "RO"),
    "DeviceManufacturerInfo": (boot.MANUFACTURER_INFO, "RO"),
    "DeviceSerialNumber": (boot.SERIAL_NUMBER, "RO"),
    "DeviceID": (boot.SERIAL_NUMBER, "RO"),
    "DeviceUserID": (boot.USER_NAME, "RW"),
}
# name -> address, access, lowest, highest
_WORDS: Final = {
    "GevCurrentIPAddress": (boot.IP_ADDRESS, "RO", 0, 2**32 - 1),
    "GevLinkSpeed": (boot.LINK_SPEED, "RO", 0, 2**32 - 1),
    "GevHeartbeatTimeout": (boot.HEARTBEAT_TIMEOUT, "RW", 500, 60_000),
    "GevPrimaryApplicationSocket": (boot.APPLICATION_PORT, "RO", 0, 65535),
    "GevPrimaryApplicationIPAddress": (boot.APPLICATION_ADDRESS, "RO", 0, 2**32 - 1),
    "GevSCPHostPort": (boot.STREAM_PORT, "RW", 0, 65535),
    "GevSCPD": (boot.STREAM_PACKET_DELAY, "RW", 0, 10_000_000),
    "GevSCDA": (boot.STREAM_ADDRESS, "RW", 0, 2**32 - 1),
    "GevSCSP": (boot.STREAM_SOURCE_PORT, "RO", 0, 65535),
}
_LONG_WORDS: Final = {
    "GevTimestampTickFrequency": boot.TICK_FREQUENCY_HIGH,
    "GevTimestampValue": boot.TIMESTAMP_HIGH,
    "TimestampLatchValue": boot.TIMESTAMP_HIGH,
}
_TIMESTAMP_COMMANDS: Final = {
    "GevTimestampControlLatch": boot.TIMESTAMP_LATCH,
    "TimestampLatch": boot.TIMESTAMP_LATCH,
    "GevTimestampControlReset": boot.TIMESTAMP_RESET,
    "TimestampReset": boot.TIMESTAMP_RESET,
}
_FIRST_OF_TRANSPORT: Final = ("GevSCPSPacketSize", "GevSCPSFireTestPacket", "GevSCPSDoNotFragment")


def describe(features: Sequence[Feature], packet_bytes_range: tuple[int, int], model: str) -> bytes:
    """Return the description of a camera, a multiple of 4 bytes long.

    Parameters
    ----------
    features : in the order of their registers
    packet_bytes_range : least and greatest size of a stream packet
    model : the camera's name
    """
    categories: dict[str, list[str]] = {
        "DeviceControl": [*_TEXTS, *_LONG_WORDS, *_TIMESTAMP_COMMANDS],
    }
    for feature in features:
        categories.setdefault(feature.category, []).append(feature.name)
    categories["TransportLayerControl"] += [*_FIRST_OF_TRANSPORT, *_WORDS, "GevCCP"]
    parts = [
        '<?xml version="1.0" encoding="utf-8"?>\n',
        f'<RegisterDescription ModelName={quoteattr(model)} VendorName="Emulated"',
        ' StandardNameSpace="GEV" SchemaMajorVersion="1" SchemaMinorVersion="1"',
        ' SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"',
        ' ProductGuid="00000000-0000-0000-0000-000000000001"',
        ' VersionGuid="00000000-0000-0000-0000-000000000002"',
        f' ToolTip="Emulated camera" xmlns="{_SCHEMA}">\n',
        _category("Root", list(categories)),
        *(_category(name, inside) for name, inside in categories.items()),
        *(_node(feature, address_of(index)) for index, feature in enumerate(features)),
        *(_text(name, *where) for name, where in _TEXTS.items()),
        *(_word(name, *what) for name, what in _WORDS.items()),
        *(_long_word(name, address) for name, address in _LONG_WORDS.items()),
        _register("TimestampControl", boot.TIMESTAMP_CONTROL, "WO"),
        *(_order(name, "TimestampControl", bit) for name, bit in _TIMESTAMP_COMMANDS.items()),
        *_packet_size(*packet_bytes_range),
        _privilege(),
        '<Port Name="Device" NameSpace="Standard"/>\n',
        "</RegisterDescription>\n",
    ]
    text = "".join(parts).encode()
    return text + b"\n" * (-len(text) % 4)


def _category(name: str, inside: list[str]) -> str:
    links = "".join(f"<pFeature>{one}</pFeature>" for one in inside)
    return f'<Category Name="{name}" NameSpace="Standard">{links}</Category>\n'


def _node(feature: Feature, address: int) -> str:
    """Return the node of a feature and its register."""
    register = f"{feature.name}Reg"
    links = f"<pValue>{register}</pValue>"
    match feature.kind:
        case Kind.INTEGER:
            links += f"<Min>{feature.low:.0f}</Min><Max>{feature.high:.0f}</Max>"
            links += f"<Inc>{feature.step}</Inc>"
        case Kind.FLOAT:
            links += f"<Min>{feature.low:g}</Min><Max>{feature.high:g}</Max>"
        case Kind.BOOLEAN:
            links += "<OnValue>1</OnValue><OffValue>0</OffValue>"
        case Kind.COMMAND:
            links += "<CommandValue>1</CommandValue>"
        case Kind.ENUMERATION:
            links = _entries(feature.entries) + links
    if feature.is_locked:
        links = f"<pIsLocked>TLParamsLocked</pIsLocked>{links}"
    if feature.unit:
        links += f"<Unit>{feature.unit}</Unit>"
    kind = feature.kind.value
    node = f'<{kind} Name="{feature.name}" NameSpace="Standard">{links}</{kind}>\n'
    if feature.kind is Kind.FLOAT:
        return node + _register(register, address, feature.access, "FloatReg")
    return node + _register(register, address, feature.access)


def _register(
    name: str, address: int, access: str, kind: str = "IntReg", length: int = 4, more: str = ""
) -> str:
    sign = "" if kind == "FloatReg" else "<Sign>Unsigned</Sign>"
    return (
        f'<{kind} Name="{name}"><Address>{address:#x}</Address><Length>{length}</Length>'
        f"<AccessMode>{access}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>"
        f"{more}{sign}<Endianess>BigEndian</Endianess></{kind}>\n"
    )


def _text(name: str, address: int, access: str) -> str:
    return (
        f'<StringReg Name="{name}" NameSpace="Standard"><Address>{address:#x}</Address>'
        f"<Length>{boot.TEXT_BYTES[address]}</Length><AccessMode>{access}</AccessMode>"
        "<pPort>Device</pPort></StringReg>\n"
    )


def _word(name: str, address: int, access: str, low: int, high: int) -> str:
    return (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Reg</pValue>'
        f"<Min>{low}</Min><Max>{high}</Max></Integer>\n" + _register(f"{name}Reg", address, access)
    )


def _long_word(name: str, address: int) -> str:
    return (
        f'<Integer Name="{name}" NameSpace="Standard"><pValue>{name}Reg</pValue></Integer>\n'
        + _register(f"{name}Reg", address, "RO", length=8)
    )


def _order(name: str, register: str, value: int) -> str:
    return (
        f'<Command Name="{name}" NameSpace="Standard"><pValue>{register}</pValue>'
        f"<CommandValue>{value}</CommandValue></Command>\n"
    )


def _packet_size(low: int, high: int) -> list[str]:
    """Return the nodes of the register that has a size and two bits; its bit 0 is the highest."""

    def masked(name: str, first: int, last: int) -> str:
        bits = f"<LSB>{last}</LSB><MSB>{first}</MSB>"
        return _register(name, boot.STREAM_PACKET_SIZE, "RW", "MaskedIntReg", more=bits)

    return [
        '<Integer Name="GevSCPSPacketSize" NameSpace="Standard"><pValue>PacketSizeReg</pValue>'
        f"<Min>{low}</Min><Max>{high}</Max><Inc>4</Inc><Unit>B</Unit></Integer>\n",
        masked("PacketSizeReg", 16, 31),
        _order("GevSCPSFireTestPacket", "FireTestPacketReg", 1),
        masked("FireTestPacketReg", 0, 0),
        '<Boolean Name="GevSCPSDoNotFragment" NameSpace="Standard">'
        "<pValue>DoNotFragmentReg</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>\n",
        masked("DoNotFragmentReg", 1, 1),
    ]


def _entries(entries: Mapping[str, int]) -> str:
    return "".join(
        f'<EnumEntry Name="{name}" NameSpace="Standard"><Value>{value}</Value></EnumEntry>'
        for name, value in entries.items()
    )


def _privilege() -> str:
    inside = _entries({"OpenAccess": 0, "ExclusiveAccess": 1, "ControlAccess": 2})
    return (
        f'<Enumeration Name="GevCCP" NameSpace="Standard">{inside}<pValue>GevCCPReg</pValue>'
        "</Enumeration>\n" + _register("GevCCPReg", boot.PRIVILEGE, "RW")
    )
