"""`cellctl learn`: what good parts look like, learned from pictures of accepted ones."""

from .commands import learn

__all__ = ["learn"]
