"""The key `mqtt` of the cell file's section `connect`: the broker, and how to get in."""

import re
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from ..yaml_models import Section

MAX_TOPIC: Final = 200  # signs; MQTT allows 65,535 bytes
_LEVEL: Final = re.compile(r"[^/+#\x00-\x1f\x7f]+")


def _topic(text: str) -> str:
    levels = text.split("/")
    if text.startswith("$") or not all(_LEVEL.fullmatch(level) for level in levels):
        raise ValueError(
            "must be levels with / between, without + and #, as in plant/line-2/cell-3"
        )
    return text


def _level(text: str) -> str:
    if not _LEVEL.fullmatch(text):
        raise ValueError("must be one level of a topic: without /, + and #")
    return text


Topic = Annotated[str, Field(min_length=1, max_length=MAX_TOPIC), AfterValidator(_topic)]
Level = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_level)]


class MqttTlsSection(Section):
    """Files of certificates, beside the cell file.

    Attributes
    ----------
    ca : certificate of who signed the broker's; without it, the system's list counts
    certificate, key : of this cell, where the broker asks for one
    """

    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None

    @model_validator(mode="after")
    def _certificate_has_a_key(self) -> "MqttTlsSection":
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key belong together: give both, or neither")
        return self


class SparkplugSection(Section):
    """The cell as an edge node of Sparkplug B 3.0.

    Attributes
    ----------
    group, node, device : its names; the node defaults to the name of the cell
    primary_host : host application without which nothing is sent
    """

    group: Level
    node: Level | None = None
    device: Level = "vision"
    primary_host: Level | None = None


class MqttSection(Section):
    """A broker of MQTT.

    Attributes
    ----------
    broker : its host
    port : default 8883 with `tls`, 1883 without
    user : the cell's name at the broker
    password_file : file with the password alone, mode 600
    is_clear_text : allows a password on a network without TLS
    version : of the protocol; with 3.1.1 a broker tells no refusal of a message
    prefix : topics begin with it; default cellctl/v1/CELL
    reply_to : further topics below which an order may ask for its answer
    tls : encrypts, with certificates; `{}` with the system's list of authorities
    keep_alive_s : a broker tells after 1.5 times as long that the cell is gone [s]
    sparkplug : the cell as an edge node, beside plain JSON
    """

    broker: str = Field(min_length=1, max_length=253)
    port: int | None = Field(default=None, ge=1, le=65535)
    user: str | None = Field(default=None, min_length=1, max_length=200)
    password_file: Path | None = None
    is_clear_text: bool = Field(default=False, alias="clear_text")
    tls: MqttTlsSection | None = None
    version: Literal[5, "3.1.1"] = 5
    prefix: Topic | None = None
    reply_to: tuple[Topic, ...] = Field(default=(), max_length=20)
    keep_alive_s: int = Field(default=20, ge=5, le=600)
    sparkplug: SparkplugSection | None = None

    @model_validator(mode="after")
    def _password_is_not_sent_in_clear(self) -> "MqttSection":
        if self.password_file is not None and self.user is None:
            raise ValueError("password_file needs `user`")
        if self.user and not (self.tls or self.is_clear_text or self._is_here):
            raise ValueError(
                f"the password would be readable on the way to {self.broker}: give `tls: {{}}`,"
                " or `clear_text: true` on a network that nobody else can listen to"
            )
        return self

    @property
    def _is_here(self) -> bool:
        try:
            return ip_address(self.broker).is_loopback
        except ValueError:
            return self.broker == "localhost"

    @property
    def is_known(self) -> bool:
        """Whether the broker asks who this cell is."""
        return self.user is not None or bool(self.tls and self.tls.certificate)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return self.broker, self.port or (8883 if self.tls else 1883)
