"""Every picture by its name.

plan
    Plan of the room with one value for each sensor, from `plan_view`.
monthly, season
    Metrics of a period and its months; msDA beside its references, from `months`.
save, png, html_image
    PNG files and images, from `style`, with the colours and lines that pictures share.
"""

from drcmitsuba.report.metric_charts import monthly, season
from drcmitsuba.report.plan_view import plan
from drcmitsuba.report.style import BLUE, GREY, INK, LINES, ORANGE, html_image, png, save, tidy

__all__ = [
    "BLUE",
    "GREY",
    "INK",
    "LINES",
    "ORANGE",
    "html_image",
    "monthly",
    "plan",
    "png",
    "save",
    "season",
    "tidy",
]
