"""Every picture by its name.

plan
    Plan of the room with one value for each sensor, from `plan_view`.
monthly, season
    Metrics of a period and its months; msDA beside its references, from `months`.
write, save
    PNG files, from `style`, with the colours and lines that pictures share.
"""

from drcmitsuba.report.metric_charts import monthly, season
from drcmitsuba.report.plan_view import plan
from drcmitsuba.report.style import BLUE, GREY, INK, LINES, ORANGE, save, write

__all__ = [
    "BLUE",
    "GREY",
    "INK",
    "LINES",
    "ORANGE",
    "monthly",
    "plan",
    "save",
    "season",
    "write",
]
