"""Every picture by its name.

plan, mountain, section
    Values of the sensors: plan of the room in false colours with contours; as a mountain; along a
    line with their intervals.
temporal_map
    Values of the time stamps by day and hour.
sun_path, sky_dome
    Suns of a period with those that close the shade; values of the bins over the sky.
monthly, season
    Metrics of a period and its months; msDA beside its references.
save, save_all, png, html_image
    PNG files and images, from `style`, with the colours and lines that pictures share.
"""

from drcmitsuba.report.metric_charts import monthly, season
from drcmitsuba.report.mountain import mountain
from drcmitsuba.report.plan_view import plan
from drcmitsuba.report.section import section
from drcmitsuba.report.sky_dome import sky_dome
from drcmitsuba.report.style import (
    BLUE,
    GREY,
    INK,
    LINES,
    ORANGE,
    html_image,
    png,
    save,
    save_all,
    tidy,
)
from drcmitsuba.report.sun_path import sun_path
from drcmitsuba.report.temporal_map import temporal_map

__all__ = [
    "BLUE",
    "GREY",
    "INK",
    "LINES",
    "ORANGE",
    "html_image",
    "monthly",
    "mountain",
    "plan",
    "png",
    "save",
    "save_all",
    "season",
    "section",
    "sky_dome",
    "sun_path",
    "temporal_map",
    "tidy",
]
