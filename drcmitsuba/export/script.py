"""The shell script that simulates an exported case by Radiance's programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drcmitsuba.schema import LUMINANCE_WEIGHTS

UNBIASED = "-ab 20 -lr -20 -lw 1e-5"
"""Neither a cap on bounces nor a threshold that cuts: light below `-lw` plays Russian roulette."""
EXACT_SUNS = "-dt 0 -dc 1 -dj 1"
"""All suns are tested, and each is a disk with its penumbra."""
EXACT_FILMS = "-ss 0 -st 0"
"""Suns by way of films: values of the file's cells, without jitter across them."""


@dataclass(frozen=True)
class Simulation:
    """Settings of an exported case that its script names."""

    title: str
    """Name of the case, an identifier."""
    state: str
    """State of the shade."""
    sensors: int
    """Number of sensors."""
    times: int
    """Number of time stamps."""
    suns: int
    """Number of suns."""
    subdivision: int
    """Reinhart's factor MF of the sky's patches."""
    has_films: bool
    """Whether there are panes with a measured BSDF."""
    remarks: Sequence[str] = ()
    """Differences to the simulation of the case by this program, a sentence each."""
    notes: Sequence[str] = ()
    """Notes on the weather and the place."""


HEAD = """\
#!/bin/sh
# Illuminance E = C L of the case {title} by Radiance, version 5.4 or later.
#
# Shade: {state}. {sensors} sensors, {times} time stamps, {suns} suns.
#   materials.rad, scene.rad   surfaces of the case [m]: x east, y north, z up
#   sky.rad, suns.rad          sources: sky and ground of radiance 1, suns of radiance 1e6
#   sensors.pts                position and direction of every sensor
#   L_sky.mtx, L_suns.mtx      luminance of every source at every time stamp of times.txt
# Results:
#   C_sky.mtx, C_suns.mtx      coefficients [sr], a row for a sensor; those of suns times 1e6
#   E.txt                      illuminance [lx], a row for a time stamp, a column for a sensor
{remarks}
set -eu
CDPATH= cd -- "$(dirname -- "$0")"
if [ -n "${{RAYPATH:-}}" ]; then  # BSDF and function files lie here
    RAYPATH=".:$RAYPATH"
    export RAYPATH
fi

# Another value may come from the environment: SKY_OPTIONS="{unbiased} -ad 512" sh simulate.sh
: "${{PROCESSES:=1}}"
# Neither a cap on bounces nor a threshold that cuts; a larger -ad has less noise.
: "${{SKY_OPTIONS:={sky}}}"
"""
SUN_OPTIONS = """\
: "${{SUN_OPTIONS:={suns}}}"
"""
RUN_SKY = """
sensors=$(($(wc -l < sensors.pts)))

# Sky: bin 0 is the ground, the others are Reinhart's patches.
oconv materials.rad scene.rad sky.rad > sky.oct
rcontrib -n "$PROCESSES" -I+ -faf -y "$sensors" $SKY_OPTIONS -e MF:{subdivision} -f reinhart.cal \\
    -b rbin -bn Nrbins -m skyglow sky.oct < sensors.pts > C_sky.mtx
dctimestep -of C_sky.mtx L_sky.mtx > E_sky.mtx
"""
RUN_SUNS = """
# Suns: -V+ because coefficients below 1e-6 are dropped; contributions of bright suns are not.
oconv materials.rad scene.rad suns.rad > suns.oct
rcontrib -n "$PROCESSES" -I+ -V+ -faf -y "$sensors" $SUN_OPTIONS -M suns.txt suns.oct \\
    < sensors.pts > C_suns.mtx
dctimestep -of C_suns.mtx L_suns.mtx > E_suns.mtx
"""
LAST = " > E.mtx\ngetinfo - < E.mtx > E.txt\n"


def script(simulation: Simulation) -> str:
    """Write `simulate.sh`; its only words from a case are numbers and identifiers."""
    s = simulation
    remarks = "".join(f"#   {remark}\n" for remark in s.remarks)
    head = HEAD.format(
        title=s.title, state=s.state, sensors=s.sensors, times=s.times, suns=s.suns,
        remarks=f"# Where the two simulations differ:\n{remarks}" if remarks else "",
        unbiased=UNBIASED, sky=f"{UNBIASED} -ad 2048",
    )  # fmt: skip
    weights = " ".join(f"{w:g}" for w in LUMINANCE_WEIGHTS.values())
    sky = RUN_SKY.format(subdivision=s.subdivision)
    total = f"\nrmtxop -fa -t -c {weights} E_sky.mtx"
    if not s.suns:
        return f"{head}{sky}{total}{LAST}"
    films = f" {EXACT_FILMS}" if s.has_films else ""
    rays = 4096 if s.has_films else 256  # a film's lobe is met by few of them
    options = SUN_OPTIONS.format(suns=f"{UNBIASED} -ad {rays} {EXACT_SUNS}{films}")
    suns = f" + \\\n    -t -c {weights} E_suns.mtx"
    return f"{head}{options}{sky}{RUN_SUNS}{total}{suns}{LAST}"
