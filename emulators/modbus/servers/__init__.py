"""The owners of a wire: Modbus TCP, RTU over TCP, and RTU on a pseudo-terminal, in world time."""

from ._pty import RtuPtyServer
from ._tcp import RtuOverTcpServer, TcpGateway, TcpServer

__all__ = ["RtuOverTcpServer", "RtuPtyServer", "TcpGateway", "TcpServer"]
