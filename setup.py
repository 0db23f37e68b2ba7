"""What pyproject.toml cannot say: wheels and sdists are stamped with the commit they are built of.

`cellctl --version` and every report name it (controller/setup/software.py).
"""

import runpy
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

SOFTWARE = Path(__file__).with_name("controller") / "setup" / "software.py"


def stamp(tree: str) -> None:
    """Write the commit beside the module that reads it, in a tree that is packed."""
    software = runpy.run_path(str(SOFTWARE))
    file = Path(tree, "controller", "setup", software["STAMP"])
    file.write_text(software["commit"]() + "\n", encoding="ascii")


class StampedBuild(build_py):
    """Copies modules to the tree of a wheel; an editable install has no such tree."""

    def run(self) -> None:
        """Copy, then stamp."""
        super().run()
        if not self.editable_mode:
            stamp(self.build_lib)


class StampedSource(sdist):
    """Copies files to the tree of an sdist."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Copy, then stamp."""
        super().make_release_tree(base_dir, files)
        stamp(base_dir)


setup(cmdclass={"build_py": StampedBuild, "sdist": StampedSource})
