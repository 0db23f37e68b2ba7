"""The commands about a plant: serve its wires, see what is delivered, release its orders."""

from .commands import connect, deliveries, orders

__all__ = ["connect", "deliveries", "orders"]
