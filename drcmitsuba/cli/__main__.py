"""Entry point of the command `drcmitsuba` and of `python -m drcmitsuba.cli`."""

from __future__ import annotations

import contextlib
import os
import sys

from drcmitsuba.runtime import interruption


def main() -> None:
    """Run the command line and end the process with its exit code.

    The process ends without Python's own clean-up: there libraries would flush files that a full
    disk has cut off, and crash.
    """
    interruption.exit_at_once()
    from drcmitsuba.cli import main as command_line

    code = 1
    try:
        command_line.main()
        code = 0
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):  # a closed pipe, or a full disk that has been reported
            stream.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
