"""Standards: verdicts with their probability, from E, C and L of an evaluation.

standard
    `Standard`: thresholds, hours and levels as tables, with the source of every number; the tables
    are the `.toml` files of this room.
evidence
    `Evidence`: E of an evaluation with its C and L, from a folder or a result.
coverage
    Whether an evaluation covers a standard's hours, and its points lie close enough.
year, quantities
    E at a standard's hours, and its quantities in E and in every draw.
deciding
    Points and hours that decide a level.
verdict
    `Verdict`: level, margin, probability.
view
    `ViewOut`, `view_out`: levels of the view out of EN 17037.
judgement
    `verdict` on one standard, `each` of several, `verdicts` on all.
terms
    `terms`: cases with the hours and points that standards ask for, in place of a user's own.
"""

from drcmitsuba.standards.evidence import Evidence
from drcmitsuba.standards.judgement import Refusal, each, on_terms, verdict, verdicts
from drcmitsuba.standards.standard import Standard, names, read
from drcmitsuba.standards.terms import Terms, terms
from drcmitsuba.standards.verdict import Verdict
from drcmitsuba.standards.view import ViewOut, view_out

__all__ = [
    "Evidence",
    "Refusal",
    "Standard",
    "Terms",
    "Verdict",
    "ViewOut",
    "each",
    "names",
    "on_terms",
    "read",
    "terms",
    "verdict",
    "verdicts",
    "view_out",
]
