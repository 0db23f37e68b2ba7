"""The page in the browser, and its accounts: `cellctl serve`, `cellctl account`."""

from .commands import account, serve

__all__ = ["account", "serve"]
