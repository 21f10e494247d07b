"""Bench: seconds of this program and of Radiance at equal error, on one machine in one run.

room
    `BenchRoom`: the classroom with open windows, its sensors and suns, and our coefficients.
reference
    Converged coefficients by the unbiased integrator `coefficient`; errors of an estimate.
radiance
    Seconds and coefficients of the fastest known commands of Radiance.
run
    `bench`: the least seconds in which ours has no larger error, and the `Bench` as Markdown.
"""

from __future__ import annotations

from drcmitsuba.annual.bench.run import Bench, bench

__all__ = ["Bench", "bench"]
