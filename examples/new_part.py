"""From a drawing's numbers to a verdict: write a part and its recipe, check them, run them.

    python examples/new_part.py [FOLDER]

A CAD file (STL, STEP, OBJ, ...) takes the place of the part's text. The emulated cell needs no
device; the report it names is one HTML file.
"""

import subprocess
import sys
from pathlib import Path

PART = """\
unit: mm
density_g_cm3: 2.7
part:
  difference:
    - block: {size: [60, 40, 12]}
    - cylinder: {diameter: 12, height: 30}
      move: [-15, 0, -5]
    - cylinder: {diameter: 8, height: 30}
      move: [18, 5, -5]
"""
RECIPE = """\
name: plate
part: plate.csg.yaml
inspection:
  required: stated
"""


def cellctl(*words: str) -> int:
    """Run a command of cellctl in the folder; return its exit code."""
    return subprocess.run([sys.executable, "-m", "controller.cli", *words], cwd=folder).returncode


folder = Path(sys.argv[1] if len(sys.argv) > 1 else "plate")
folder.mkdir(parents=True, exist_ok=True)
(folder / "plate.csg.yaml").write_text(PART)
(folder / "recipe.yaml").write_text(RECIPE)
# 2: a file is wrong; nothing was started
if cellctl("check", "recipe.yaml") == 2:
    sys.exit(2)
sys.exit(cellctl("run", "recipe.yaml", "--speed", "10", "--seed", "7"))
