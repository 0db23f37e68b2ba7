"""Ask the history of a cell a question in SQL: the newest parts, first those that did not pass.

    python examples/history_sql.py [RUNS]

`cellctl history` fills `history.sqlite` in the folder of runs from the journals; it can be made
anew at any time. Read it, write nothing: the journals are the evidence.
"""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

QUESTION = """
SELECT runs.run_id, parts.number, parts.serial, parts.recipe, parts.verdict, parts.tray,
       round(parts.wall_s) AS seconds, parts.reason
FROM parts JOIN runs USING (run_no)
WHERE parts.is_counted AND parts.start >= datetime('now', '-30 days')
ORDER BY parts.verdict = 'pass', parts.start DESC
LIMIT 20
"""

runs = Path(sys.argv[1] if len(sys.argv) > 1 else "runs")
fill = [sys.executable, "-m", "controller.cli", "history", "--runs", str(runs), "--json"]
subprocess.run(fill, check=True, stdout=subprocess.DEVNULL)
with closing(sqlite3.connect(f"file:{runs / 'history.sqlite'}?mode=ro", uri=True)) as store:
    store.row_factory = sqlite3.Row
    for part in store.execute(QUESTION):
        print(
            f"{part['run_id']} part {part['number']} {part['serial']}: {part['verdict']}, "
            f"{part['tray'] or 'no tray'}, {part['seconds']:.0f} s, {part['reason']}"
        )
