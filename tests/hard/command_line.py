"""The command line in a process of its own that stays: what it answers, and what it took.

A process that dies, hangs or takes more memory than it may is seen from outside; one that stays
compiles each kernel once. Run as a script this module is that process.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import select
import subprocess
import sys
import traceback
from dataclasses import dataclass
from pathlib import Path

SELF = Path("/proc/self")
GIB = 1 << 30
SPARE = 8 * GIB
"""Address space beyond what the process starts with: LLVM reserves more than it touches."""


def _memory(name: str) -> int:
    """Memory of this process [bytes]: VmRSS held now, VmHWM held at most, VmSize reserved."""
    match = re.search(rf"^{name}:\s*(\d+) kB$", (SELF / "status").read_text(), re.MULTILINE)
    assert match is not None
    return 1024 * int(match[1])


def growth_of(call):
    """Result of a call, and by how much the memory held at most grew beyond what was held [bytes].

    Writing 5 to clear_refs makes the kernel forget the largest value so far.
    """
    (SELF / "clear_refs").write_text("5")
    before = _memory("VmRSS")
    result = call()
    return result, _memory("VmHWM") - before


@contextlib.contextmanager
def no_more_than(extra: int):
    """Refuse address space beyond what is reserved now and `extra` bytes: MemoryError."""
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_memory("VmSize") + extra, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@dataclass(frozen=True)
class Answer:
    """A command ends with an exit code, its output and its use of memory.

    Parameters
    ----------
    code : int
        Exit code.
    out, err : str
    fault : str
        Traceback, how the process died, or that it did not end; "" for none.
    growth : int
        Memory that the command took at most [bytes].
    """

    code: int
    out: str
    err: str
    fault: str
    growth: int

    @property
    def line(self) -> str:
        """The line that says what is wrong; "" where there is a result.

        Asserts all that was promised of any input.
        """
        assert not self.fault, self.fault
        assert self.growth <= GIB, f"{self.growth / GIB:.2f} GiB"
        if self.code == 0:
            assert self.err == "", self.err  # silence means that nothing is wrong
            return ""
        assert self.code == 2, (self.code, self.err)
        assert self.err.startswith("drcmitsuba: ")
        assert self.err.endswith("\n")
        line = self.err.removeprefix("drcmitsuba: ").rstrip("\n")
        assert line.isprintable(), line
        assert len(line) <= 1300, line
        assert re.search(r".: .+: .+; .", line), line  # where, what came, what to do
        return line


class CommandLine:
    """A process that runs commands one after another, and is started anew when it dies.

    Parameters
    ----------
    seconds : float
        After which a command counts as hung.
    """

    def __init__(self, seconds: float = 300.0):
        from tests import skips  # not where the module is run

        skips.PROC.skip_if_so()
        self.seconds = seconds
        self.process: subprocess.Popen[bytes] | None = None

    def __call__(self, *arguments: object, folder: Path) -> Answer:
        """Run `drcmitsuba ARGUMENTS` in a folder."""
        return self._asked({"arguments": [str(a) for a in arguments]}, folder)

    def python(self, text: str, folder: Path) -> Answer:
        """Run Python code in a folder, as a script whose names nothing else sees."""
        return self._asked({"python": text}, folder)

    def _asked(self, request: dict[str, object], folder: Path) -> Answer:
        if self.process is None:
            program = [sys.executable, __file__]
            with (folder / "stderr").open("wb") as err:
                self.process = subprocess.Popen(
                    program, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=err, cwd=folder,
                )  # fmt: skip
        process = self.process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps(request | {"folder": str(folder)}).encode() + b"\n")
        process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], self.seconds)
        answer = process.stdout.readline() if ready else b""
        if answer:
            return Answer(**json.loads(answer))
        self.close()
        how = f"ended with {process.returncode}" if ready else f"hung for {self.seconds} s"
        return Answer(1, "", "", f"the process {how}: {request}", 0)

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()  # closes the pipes
            self.process = None


def _run(request: dict) -> None:
    """Run what is asked for: a command, or Python code."""
    if "python" in request:
        from drcmitsuba.runtime import backend

        backend.select()
        exec(compile(request["python"], "script", "exec"), {"__name__": "__main__"})
        return
    from drcmitsuba.cli import main

    sys.argv = ["drcmitsuba", *request["arguments"]]
    main.main()


def _answer(request: dict) -> Answer:
    """Run what is asked for in this process."""
    out, err, code, fault = io.StringIO(), io.StringIO(), 0, ""

    def run():
        nonlocal code, fault
        try:
            _run(request)
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
        except BaseException:
            code, fault = 1, traceback.format_exc()

    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        _, growth = growth_of(run)
    return Answer(code, out.getvalue(), err.getvalue(), fault, growth)


def main() -> None:
    """Answer one line of JSON with another until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the program prints by itself is no answer
    import resource

    import drcmitsuba
    from drcmitsuba.runtime import backend

    backend.select()
    assert drcmitsuba
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_memory("VmSize") + SPARE, hard))
    for line in sys.stdin:
        asked = json.loads(line)
        os.chdir(asked["folder"])
        answers.write(json.dumps(_answer(asked).__dict__) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
