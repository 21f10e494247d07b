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

from drcmitsuba.runtime import backend  # first: it imports Dr.Jit without its complaints on stderr

# isort: split
import drcmitsuba_plugins as _plugins  # noqa: F401  registers the plugins

from drcmitsuba import metrics, schema, sky
from drcmitsuba.annual.result import Result, evaluate
from drcmitsuba.case.case import Case, load_case
from drcmitsuba.case.shipped import shipped_cases
from drcmitsuba.metrics import accumulate
from drcmitsuba.runtime.errors import BackendError, InputError
from drcmitsuba.sky import period, weather
from drcmitsuba.transport import coefficients

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
