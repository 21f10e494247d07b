"""Readers of files under atheris, which finds its way through the code by coverage.

    python -m tests.hard.fuzz_readers READER [-max_total_time=60] [other options of libFuzzer]

READER is one of `readers.READERS`. libFuzzer changes bytes of valid files; the weather files of a
year are given to it as pieces that replace bytes of a whole one. Needs `pip install -e '.[fuzz]'`.
Whatever is no result and no InputError ends it, as does more than 1 GiB or a file that takes more
than a minute; the file that did lies beside the working directory's `crash-…`.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, settings

MEMORY = "4096"
"""The process may take so much [MiB]: atheris itself keeps some 0.3 MiB of every BSDF file that it
tries. What the reader takes for one file is measured, and may be 1 GiB."""


def seeds(name: str, folder: Path) -> None:
    """Write some generated files for libFuzzer to begin with."""
    from tests.hard import generated_cases, generated_files, generated_models

    by_name = {
        "case": generated_cases.cases(),
        "wea": generated_files.weas(),
        "bsdf": generated_files.bsdf_files(),
        "pab_opto": generated_files.measurements(),
        "recipe": generated_files.recipes(),
        "obj": generated_files.meshes(),
        "ply": generated_files.meshes(),
        "time_stamps": generated_files.time_stamps(),
        **generated_models.MODELS,
    }
    if name not in by_name:
        (folder / "none").write_bytes(b"")
        return

    @settings(
        max_examples=50, database=None, deadline=None, derandomize=True, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(by_name[name])
    def write(drawn):
        raw = drawn if isinstance(drawn, bytes) else drawn[1]
        (folder / f"{len(list(folder.iterdir()))}").write_bytes(raw)

    write()


def patched(whole: bytes, data: bytes) -> bytes:
    """Bytes of a whole file with pieces of `data` in it: place, length to replace, text."""
    at = 0
    while len(data) - at >= 6:
        place = int.from_bytes(data[at : at + 3], "little") % (len(whole) + 1)
        drop, count = data[at + 3], data[at + 4] % 32
        new = data[at + 5 : at + 5 + count]
        whole = whole[:place] + new + whole[place + drop % 64 :]
        at += 5 + count
    return whole


def running_time(options: list[str]) -> tuple[float, list[str]]:
    """Seconds of -max_total_time, endless without it, and the other options."""
    key = "-max_total_time="
    times = [float(o.removeprefix(key)) for o in options if o.startswith(key)]
    return (times or [float("inf")])[-1], [o for o in options if not o.startswith(key)]


def main() -> None:
    """Fuzz one reader until libFuzzer stops."""
    import atheris

    with atheris.instrument_imports(include=["drcmitsuba", "drcmitsuba_plugins"]):
        from tests.hard.readers import READERS, outcome
    from tests.hard import generated_cases, generated_files, generated_models
    from tests.hard.command_line import GIB, growth_of

    name, *options = sys.argv[1:]
    reader, suffix = READERS[name]
    folder = Path(tempfile.mkdtemp())
    (folder / "seeds").mkdir()
    generated_cases.furnish(folder)
    generated_models.furnish(folder)
    seeds(name, folder / "seeds")
    years = {suffix: lines for suffix, (lines, _) in generated_files.YEARS.items()}
    whole = "\n".join(years[suffix]()).encode() if name in ("epw", "tmy3", "tmy2") else None
    path = folder / f"made{suffix}"

    counts: Counter[str] = Counter()
    most = [0]
    seconds, options = running_time(options)
    end = time.monotonic() + seconds

    def one(data: bytes) -> None:
        path.write_bytes(data if whole is None else patched(whole, data))
        line, growth = growth_of(lambda: outcome(reader, path))
        if growth > GIB:
            raise MemoryError(f"{growth >> 20} MiB for one file")
        most[0] = max(most[0], growth)
        counts["result" if line == "result" else "refused"] += 1
        if time.monotonic() > end:
            print(f"{name}: {dict(counts)}, {most[0] >> 20} MiB at most for one", flush=True)
            os._exit(0)  # threads of Dr.Jit are running: a plain exit would abort

    limits = [f"-rss_limit_mb={MEMORY}", "-malloc_limit_mb=1024", "-timeout=60"]
    atheris.Setup([sys.argv[0], str(folder / "seeds"), *limits, *options], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
