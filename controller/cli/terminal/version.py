"""Which cellctl this is."""

from importlib.metadata import PackageNotFoundError, version


def installed_version() -> str:
    """Return the version that is installed."""
    try:
        return version("cellctl")
    except PackageNotFoundError:
        return "(not installed)"
