"""Do intervals of single sensors and eyes hold in rooms of many kinds, also in the darkest quarter?

    python -m tests.validation.calibration [--rooms empty,film] [--seeds 30]

from the repository's root, with the test extras installed; writes the table of coverage to
`docs/validation/calibration.md`.

Rationale: sums may be right where single places are not, and an interval can be wrong where nothing
else is. Light that is blurred between a dark place and its bright neighbour shows in the dark one.

Method: rooms with a grid of sensors and two places of eyes, with the default samples of a case.
Three kinds of light: interreflected light of the sky of 145 patches (its sum), that of thirty suns
of March, June and December, and DGP in eight directions from every eye at twelve hours of a year.
All seeds are compared with the plain path tracer `coefficient`, which shares neither cells nor
replicates nor photons with the program. DGP takes E_v from it; its glare sources are the mean of
all seeds, so that DGP tests the errors of E_v and of luminances, not the list of sources.

Sensors are sorted into quarters by brightness, eyes and hours by DGP. An interval is the mean of
six replicates and 2.57 of their standard error to either side; the path tracer's own error is added
to it. Suns that give a sensor less than a thousandth of what the brightest pair gets are left out.
Suns are 0.533° wide; where they are seen in mirrors, which plain paths find by chance, 10°.
"""
