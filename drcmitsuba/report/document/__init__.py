"""The report that a client reads: one page of HTML, Markdown or CSV, from finished evaluations.

report
    `Report`: façades side by side, and their formats.
facade
    `EvaluatedFacade`: one evaluation, from a folder or a result in memory.
tables, spaces, verdicts, record
    Tables: what was asked, metrics, months; spaces; verdicts on standards; plan and versions.
charts
    The months as shapes of SVG.
light_of_sensors
    Who lights every point of a plan.
stored_lights, stored_pictures
    What other commands add to a folder: who lights its points; glare and pictures.
plans, hours
    Points, counts and hourly illuminances for the page's script.
packing
    Arrays as text that browsers decompress.
table, labels
    Tables of any content; the words of the report, to translate.
"""

from drcmitsuba.report.document.facade import EvaluatedFacade
from drcmitsuba.report.document.report import Report

__all__ = ["EvaluatedFacade", "Report"]
