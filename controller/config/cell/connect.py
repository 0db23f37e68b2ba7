"""The section `connect` of a cell file: how `cellctl connect` ties the cell to a plant system.

Nothing of it is read by a run. Passwords and keys stand in files of their own, never here.
"""

from pathlib import Path
from string import Formatter
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from ..object_address import object_address
from ..yaml_models import Section
from .mqtt import MqttSection
from .plc import PlcSection
from .values import Listen


def _web_address(url: str) -> str:
    if not url.startswith(("https://", "http://")) or not url.isprintable() or " " in url:
        raise ValueError("must be an address that begins with https:// or http://")
    return url


class WebhookSection(Section):
    """A server that gets each result and alarm by POST.

    Attributes
    ----------
    url : its address
    secret_file : file with the secret that signs each message
    ca_file : certificate of the authority that vouches for the server (default: the system's)
    """

    url: Annotated[str, Field(max_length=500), AfterValidator(_web_address)]
    secret_file: Path
    ca_file: Path | None = None


class RestSection(Section):
    """A server that answers questions for results and state, and takes orders.

    Attributes
    ----------
    listen : address and port
    tls_cert, tls_key : certificate and key (PEM); needed for any address but this machine's own
    """

    listen: Listen = "127.0.0.1:8471"
    tls_cert: Path | None = None
    tls_key: Path | None = None

    @model_validator(mode="after")
    def _certificate_has_key(self) -> "RestSection":
        if (self.tls_cert is None) != (self.tls_key is None):
            raise ValueError("`tls_cert` and `tls_key` require each other")
        return self


class FolderSection(Section):
    """A folder that gets a file of each result, as soon as it is whole.

    Attributes
    ----------
    path : the folder; it must exist
    formats : kinds of files
    name : name of the files without their ending, from {order}, {recipe}, {serial}, {lot}, {run},
        {part} and {revision}
    """

    path: Path
    formats: Annotated[
        tuple[Literal["json", "csv", "qif", "dfq"], ...], Field(min_length=1, max_length=4)
    ] = ("json",)
    name: Annotated[str, Field(min_length=1, max_length=200)] = "{order}_{serial}_{run}_{part}"

    @model_validator(mode="after")
    def _name_has_known_blanks(self) -> "FolderSection":
        known = ", ".join(f"{{{name}}}" for name in FOLDER_BLANKS)
        try:
            pieces = [*Formatter().parse(self.name)]
        except ValueError as error:
            raise ValueError(f"`name` may have the blanks {known}") from error
        for _, blank, form, conversion in pieces:
            if blank is not None and (blank not in FOLDER_BLANKS or form or conversion):
                raise ValueError(f"`name` may have the blanks {known}")
        filled = self.name.format_map(dict.fromkeys(FOLDER_BLANKS, "x"))
        if "/" in filled or "\\" in filled or filled.startswith("."):
            raise ValueError("`name` names a file in the folder: no slash, no dot at its beginning")
        return self


class OpcuaSection(Section):
    """An OPC UA server, built to OPC 40100-1 (Machine Vision).

    Attributes
    ----------
    listen : address and port
    names : further names and addresses by which clients reach it, for its certificate
    folder : certificates of the server and its clients
    """

    listen: Listen = "127.0.0.1:4840"
    names: Annotated[
        tuple[Annotated[str, Field(pattern=r"^[A-Za-z0-9.:-]{1,253}$")], ...], Field(max_length=10)
    ] = ()
    folder: Path = Path("connect/opcua")


FOLDER_BLANKS = ("order", "recipe", "serial", "lot", "run", "part", "revision")


class PicturesSection(Section):
    """Copies of the runs' pictures in a store of objects, and how long pictures stay here.

    Attributes
    ----------
    copy_to : address of the store, as `s3://plant/cell-3` or `file:///mnt/share/cell-3`; with one,
        no picture is deleted here before its copy was read back
    keep_local_days : age from which pictures of a run are deleted here (default: never)
    """

    copy_to: Annotated[str, Field(max_length=500), AfterValidator(object_address)] = ""
    keep_local_days: float | None = Field(None, ge=0)


class ConnectSection(Section):
    """Wires to a plant system.

    Attributes
    ----------
    may_start : whether an order of a plant starts a run: `never`, `asked` once a person at the cell
        has released it, `yes` whenever the cell is free
    webhook : servers that get each result
    rest : answers questions and takes orders over HTTP
    folder : folders that get a file of each result
    mqtt : a broker that gets each result and the state, and takes orders
    plc : registers for a PLC, over Modbus TCP
    pictures : copies of the runs' pictures, and how long they stay here
    opcua : an OPC UA server
    """

    may_start: Literal["never", "asked", "yes"] = "never"
    webhook: tuple[WebhookSection, ...] = Field((), max_length=10)
    rest: RestSection | None = None
    folder: tuple[FolderSection, ...] = Field((), max_length=10)
    mqtt: MqttSection | None = None
    plc: PlcSection | None = None
    pictures: PicturesSection | None = None
    opcua: OpcuaSection | None = None
