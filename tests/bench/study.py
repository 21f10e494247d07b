"""Cost of a study beside as many single runs, each as a user starts it.

`python -m tests.bench.study [FOLDER]`: fifty rows of the paper's classroom that differ in the
film's place and the glass, in the clear window's place and glass, and in a threshold; a single run
is the median of three. Kernels are warm.
"""

import itertools
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

BOTTOMS, TOPS, GLASS = (1.6, 1.8, 2.0, 2.2, 2.4), (2.6, 2.7, 2.8, 2.9, 3.0), (0.55, 0.65)
SILLS, HEADS = (0.9, 1.0, 1.1, 1.2, 1.3), (2.8, 3.0, 3.2, 3.4, 3.6)
STRIP, THRESHOLDS = "facade.south.strips.", range(300, 800, 10)
FILM = {
    f"{STRIP}0.top": 0, f"{STRIP}1.bottom": 0, f"{STRIP}1.top": 1,
    "materials.glass.transmittance": 2,
}  # fmt: skip
CLEAR = {f"{STRIP}0.bottom": 0, f"{STRIP}0.top": 1, "materials.glass.transmittance": 2}
STUDIES = {
    "film and glass": ("o3", FILM, [*itertools.product(BOTTOMS, TOPS, GLASS)]),
    "clear window": ("existing", CLEAR, [*itertools.product(SILLS, HEADS, GLASS)]),
    "threshold": ("existing", {"metrics.sda_threshold": 0}, [(value,) for value in THRESHOLDS]),
}
"""Case, place of each key's value in a row, rows."""


def seconds(*arguments):
    """Time a command of the program."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "drcmitsuba.cli", *map(str, arguments)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def written(folder, case, keys, rows):
    """Write a study and its rows."""
    table = "\n".join(",".join(str(row[i]) for i in keys.values()) for row in rows)
    (folder / "rows.csv").write_text(f"{','.join(keys)}\n{table}\n")
    study = folder / "study.toml"
    study.write_text(f'case = "{case}"\nrows = "rows.csv"\n')
    return study


def main():
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary)
        print("| rows differ in | rows | study: s | one run: s | study / single runs |")
        print("| --- | --- | --- | --- | --- |")
        for name, (case, keys, rows) in STUDIES.items():
            shipped = f"classroom/reference/{case}"
            study = written(folder, shipped, keys, rows)
            single = [seconds("evaluate", shipped, "-o", folder / "one") for _ in range(4)][1:]
            whole = seconds("study", study, "-o", folder / "out")
            one = statistics.median(single)
            ratio = whole / (len(rows) * one)
            print(f"| {name} | {len(rows)} | {whole:.0f} | {one:.1f} | {ratio:.2f} |", flush=True)
            shutil.rmtree(folder / "out")


if __name__ == "__main__":
    main()
