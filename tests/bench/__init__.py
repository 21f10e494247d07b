"""Time and error of ours and of Radiance: `python -m tests.bench --help`."""
