"""The arms that can be emulated, each as a chain of links made from its lengths."""

from .made import MadeShape
from .umi import UmiShape
from .ur import BODIES, UrShape

__all__ = ["BODIES", "MadeShape", "UmiShape", "UrShape"]
