"""What fuzzing has kept is fed again: every target takes its corpus, whole and damaged."""

import subprocess
import sys
from pathlib import Path

FUZZ = Path(__file__).parent
ROOT = FUZZ.parents[1]
CORPUS_BYTES_MAX = 400_000  # of the whole corpus
REPLAY = """
import os, random, sys
sys.path[:0] = [{root!r}, {fuzz!r}]
from pathlib import Path
import fuzz_targets
rng, fed = random.Random(13), 0
for name, target in fuzz_targets.TARGETS.items():
    for path in sorted((Path({fuzz!r}) / "corpus" / name).iterdir()):
        data = path.read_bytes()
        damaged = bytearray(data)
        damaged[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        for one in (data, bytes(damaged), data[: rng.randrange(len(data))]):
            try:
                target(one)
            except Exception:
                print(name, path.name, one, file=sys.stderr)
                raise
            fed += 1
print(fed)
sys.stdout.flush()
os._exit(0)  # a camera's peer still listens
"""


def test_every_target_takes_its_corpus() -> None:
    script = REPLAY.format(root=str(ROOT), fuzz=str(FUZZ))
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr[-3000:]
    files = [path for path in (FUZZ / "corpus").rglob("*") if path.is_file()]
    assert int(done.stdout.split()[-1]) == 3 * len(files) > 100


def test_the_corpus_is_small_and_every_target_has_one() -> None:
    source = (FUZZ / "fuzz_targets.py").read_text()
    table = source[source.index("TARGETS: dict") :]
    names = {line.split('"')[1] for line in table.splitlines() if line.startswith('    "')}
    folders = {folder.name for folder in (FUZZ / "corpus").iterdir()}
    assert folders == names
    sizes = [path.stat().st_size for path in (FUZZ / "corpus").rglob("*") if path.is_file()]
    assert sum(sizes) < CORPUS_BYTES_MAX
