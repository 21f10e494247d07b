"""Weather files: EPW, TMY3, TMY2 and Radiance's WEA.

text
    Text of strangers: bounded, decoded, rows counted.
record
    `Weather`: a site and its irradiances, from rows of numbers.
formats
    `read` for any of these files, `default` for the year that pvlib ships.
"""

from drcmitsuba.sky.weather.formats import default, read
from drcmitsuba.sky.weather.record import NOMINAL_YEAR, Site, Weather
from drcmitsuba.sky.weather.text import read_text

__all__ = ["NOMINAL_YEAR", "Site", "Weather", "default", "read", "read_text"]
