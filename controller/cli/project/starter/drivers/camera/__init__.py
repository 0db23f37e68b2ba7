"""The ACME camera for cellctl: `driver: acme` of `overhead` or `inspection` in a cell file."""

from .driver import DRIVER, AcmeCamera

__all__ = ["DRIVER", "AcmeCamera"]
