"""The key `plc` of the cell file's section `connect`: who may order by registers, and what."""

from ipaddress import ip_address
from typing import Annotated, Any, Final

from pydantic import BeforeValidator, Field, IPvAnyAddress, model_validator

from ..yaml_models import Section
from .values import Listen, host_and_port

MAX_VALUES: Final = 20  # registers 26 to 65 of the map hold as many
MAX_RECIPES: Final = 1000


class PlcRecipeSection(Section):
    """A recipe that has a number.

    Attributes
    ----------
    recipe : its name, as an order has it
    values : ids of the characteristics whose measured values stand in the registers, in this order
    """

    recipe: str = Field(min_length=1, max_length=300)
    values: tuple[str, ...] = Field(default=(), max_length=MAX_VALUES)


def _recipe(value: Any) -> Any:  # noqa: ANN401 - pydantic's signature
    return {"recipe": value} if isinstance(value, str) else value


Number = Annotated[int, Field(ge=1, le=65535)]
Recipe = Annotated[PlcRecipeSection, BeforeValidator(_recipe)]


class PlcSection(Section):
    """A server of Modbus TCP for a PLC: orders and results by registers.

    Attributes
    ----------
    listen : address and port; Modbus' own port 502 needs a right that a user does not have
    clients : addresses that may connect; needed where others than this machine can
    recipes : recipe of each number that the PLC writes, with what it wants to know of it
    """

    listen: Listen = "127.0.0.1:1502"
    clients: tuple[IPvAnyAddress, ...] = Field(default=(), max_length=20)
    recipes: dict[Number, Recipe] = Field(min_length=1, max_length=MAX_RECIPES)

    @model_validator(mode="after")
    def _knows_its_clients(self) -> "PlcSection":
        host, port = self.address
        if not 1 <= port <= 65535:
            raise ValueError(f"listen: a port is 1 to 65535, not {port}")
        try:
            is_here = ip_address(host).is_loopback
        except ValueError:
            is_here = host == "localhost"
        if not (is_here or self.clients):
            raise ValueError(
                "Modbus asks nobody who he is: with `listen` on the network, name the PLC's address"
                " in `clients`"
            )
        return self

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return host_and_port(self.listen)
