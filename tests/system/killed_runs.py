"""A process that evaluates a case again and again and kills itself's children at random moments.

Run as `python -m tests.system.killed_runs CASE FOLDER KILLS`: it forks a child for every run, so
that imports are paid once, and prints JSON.
"""

import importlib
import json
import os
import random
import signal
import sys
import time
from pathlib import Path

SENSORS = 4
"""Number of sensors in a block."""


def prepared():
    from drcmitsuba.cli.startup import FOR_FILES, FOR_METRICS

    for name in ("drcmitsuba.annual.result", "drcmitsuba.cli.evaluate", *FOR_FILES, *FOR_METRICS):
        importlib.import_module(name)


def run(case, folder):
    """The command, in a child; the number of blocks that it stored is written beside."""
    from drcmitsuba.blocks import block_folder
    from drcmitsuba.cli import evaluate
    from drcmitsuba.transport.interreflection import interior

    interior.SENSORS = SENSORS
    write_block, computed = block_folder.write_block, []
    block_folder.write_block = lambda *args: computed.append(write_block(*args))
    evaluate.evaluate(str(case), folder)
    (folder / "computed").write_text(str(len(computed)))


def child(case, folder, seconds=None):
    """Fork a run, kill it after some seconds, and return how it ended and how long it took."""
    start, pid = time.perf_counter(), os.fork()
    if pid == 0:
        code = 1
        try:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            run(case, folder)
            code = 0
        finally:
            os._exit(code)
    if seconds is not None:
        time.sleep(seconds)
        os.kill(pid, signal.SIGKILL)
    status = os.waitpid(pid, 0)[1]
    return os.waitstatus_to_exitcode(status), time.perf_counter() - start


def main(case, folder, kills):
    prepared()
    rng, folder = random.Random(20), Path(folder)
    code, whole = child(case, folder / "undisturbed")
    ends = [code]
    killed, unfinished = 0, 0

    def blocks():
        """Number of blocks that wait for the next run."""
        return len([*(folder / "killed").glob("unfinished/*/*.zip")])

    while killed < kills:
        code, seconds = child(case, folder / "killed", rng.uniform(0, whole))
        ends.append(code)
        killed += code == -signal.SIGKILL
        unfinished += blocks() > 0
        if code == 0:  # a run that goes on takes less time
            whole = min(whole, seconds)
    waiting = blocks()
    (folder / "killed" / "computed").unlink(missing_ok=True)
    ends.append(child(case, folder / "killed")[0])
    names = ("undisturbed", "killed")
    computed = {name: int((folder / name / "computed").read_text()) for name in names}
    print(json.dumps({
        "ends": ends, "unfinished": unfinished, "blocks": waiting,
        "computed": computed,
    }))  # fmt: skip


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
