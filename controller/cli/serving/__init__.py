"""The page in the browser, and who may log in to it: `cellctl serve`, `cellctl account`."""

from .commands import account, serve

__all__ = ["account", "serve"]
