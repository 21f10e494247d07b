"""Annual daylight simulation of daylight redirecting components on Mitsuba 3 and Dr.Jit.

load_case, evaluate
    From a case file to a `Result` with metrics, illuminance and coefficients.
metrics
    sDA, ASE, msDA, MSE and the rule of the shade, on any DataArray (time, sensor).
sky, weather, period
    Luminances of the sky and the suns.
coefficients, accumulate
    C = D + G·D and E = C·L.

Importing the package makes its Mitsuba plugins known to every JIT variant; it sets none.
"""

from drcmitsuba import backend  # first: it imports Dr.Jit without its complaints on stderr

# isort: split
import drcmitsuba_plugins as _plugins  # noqa: F401  registers the plugins

from drcmitsuba import accumulate, coefficients, metrics, period, schema, sky, weather
from drcmitsuba.case import Case, load_case
from drcmitsuba.errors import BackendError, InputError
from drcmitsuba.result import Result, evaluate
from drcmitsuba.shipped import shipped_cases

__version__ = "0.1.0"

__all__ = [
    "BackendError",
    "Case",
    "InputError",
    "Result",
    "accumulate",
    "backend",
    "coefficients",
    "evaluate",
    "load_case",
    "metrics",
    "period",
    "schema",
    "shipped_cases",
    "sky",
    "weather",
]
