"""Entry point of `python -m drcmitsuba`, for where the command is on no path."""

from __future__ import annotations

from drcmitsuba.cli.__main__ import main

if __name__ == "__main__":
    main()
