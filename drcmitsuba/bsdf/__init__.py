"""BSDF files of films and panes: read, check, show, and make from measurements.

reader, writer
    `read` and `save`: LBNL's XML with tensor trees or Klems matrices.
lobes, balance
    Lobes of the light from one direction; energy and reciprocity.
check, check_report, advice, pictures
    Check of a file, in numbers, words and pictures.
pab_opto, measured, incidence, displacement, merge
    From goniophotometer measurements to a tensor tree of variable resolution.
"""

from drcmitsuba.bsdf import check
from drcmitsuba.bsdf.reader import read

__all__ = ["check", "read"]
