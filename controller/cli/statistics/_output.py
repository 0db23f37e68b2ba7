"""The common base of the statistics commands: the check of their page."""

from pathlib import Path

from controller.config import ConfigError

from ..inputs.checks import check_writable_folder


def check_page(report: Path | None) -> None:
    """Check the path of a page to write.

    Raises
    ------
    ConfigError : it cannot have that name, or be written there
    """
    if report is not None:
        if report.suffix.lower() != ".html" or report.is_dir():
            raise ConfigError(f"--report {report}: name a file that ends in .html")
        check_writable_folder(report.parent, "--report in")
