"""How many citations there are, by place, and how many lead nowhere.

python benchmarks/count_citations.py [--json] [CHECKOUT]

Counted are sections and rows of pages, § with a number, ADRs, tables of the paper, standards. An
older checkout is judged by its own pages; what its code wrote in forms that no test could read, a
bare "(2.3)" for instance, leads nowhere.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests")]

from citations import Checkout  # noqa: E402  (path set above)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", nargs="?", type=Path, default=ROOT)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    checkout = Checkout(args.checkout)
    cited: Counter[str] = Counter()
    dangling = Counter(problem.path.parts[0] for problem in checkout.problems)
    for path in checkout.texts:
        cited[path.parts[0]] += checkout.count_in(path)
    if args.json:
        print(json.dumps({"citations": dict(cited), "dangling": dict(dangling)}))
        return
    print(f"{'place':16} {'citations':>9} {'dangling':>9}")
    for place in sorted(cited | dangling):
        print(f"{place:16} {cited[place]:9d} {dangling[place]:9d}")
    print(f"{'all':16} {cited.total():9d} {dangling.total():9d}")


if __name__ == "__main__":
    main()
