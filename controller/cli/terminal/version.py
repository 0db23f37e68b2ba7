"""The installed version of cellctl."""

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """Return the installed version; cellctl may run without being installed."""
    try:
        return version("cellctl")
    except PackageNotFoundError:
        return "(not installed)"
