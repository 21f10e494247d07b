"""Annual daylight simulation of daylight redirecting components on Mitsuba 3 and Dr.Jit.

load_case, evaluate, evaluate_within, render
    From a case file to a `Result` with metrics, illuminance and coefficients; to pictures [cd/m²].
metrics, controls, standards
    sDA, ASE, msDA, MSE and the rule of the shade, on any DataArray (time, sensor); states of groups
    of panes, electric light; verdicts on standards with their probability.
sky, weather, period, coefficients, accumulate
    Luminances L of the sky and the suns; C = D + G·D; E = C·L.
elements, controlled, lights
    Light by opening and fill, and any façade from it; E of a control; who lights a point.
glare, glare_elements, view_distances
    DGP by view and time stamp, of any façade too; how far points see beyond clear openings.

Other rooms are imported when asked for. Importing the package makes its Mitsuba plugins known.
"""

from typing import TYPE_CHECKING

from drcmitsuba.runtime import lazy, registration

if TYPE_CHECKING:
    from drcmitsuba import metrics as metrics
    from drcmitsuba import schema as schema
    from drcmitsuba import sky as sky
    from drcmitsuba.annual.controlled import controlled as controlled
    from drcmitsuba.annual.elements import elements as elements
    from drcmitsuba.annual.lights import lights as lights
    from drcmitsuba.annual.lights import lights_of_sensors as lights_of_sensors
    from drcmitsuba.annual.result import Result as Result
    from drcmitsuba.annual.result import evaluate as evaluate
    from drcmitsuba.annual.result import evaluate_within as evaluate_within
    from drcmitsuba.case.case import Case as Case
    from drcmitsuba.case.reading import load_case as load_case
    from drcmitsuba.case.shipped import shipped_cases as shipped_cases
    from drcmitsuba.glare_year import GlareYear as GlareYear
    from drcmitsuba.glare_year import glare as glare
    from drcmitsuba.glare_year import glare_elements as glare_elements
    from drcmitsuba.metrics import accumulate as accumulate
    from drcmitsuba.rendering.frames import render as render
    from drcmitsuba.runtime import backend as backend
    from drcmitsuba.runtime.errors import BackendError as BackendError
    from drcmitsuba.runtime.errors import InputError as InputError
    from drcmitsuba.sky import period as period
    from drcmitsuba.sky import weather as weather
    from drcmitsuba.transport import coefficients as coefficients
    from drcmitsuba.transport.windows.view_rays import view_distances as view_distances

    __version__: str

_NAMES = {
    "BackendError": "runtime.errors:BackendError",
    "Case": "case.case:Case",
    "GlareYear": "glare_year:GlareYear",
    "InputError": "runtime.errors:InputError",
    "Result": "annual.result:Result",
    "accumulate": "metrics.accumulate",
    "backend": "runtime.backend",
    "coefficients": "transport.coefficients",
    "controlled": "annual.controlled:controlled",
    "elements": "annual.elements:elements",
    "evaluate": "annual.result:evaluate",
    "evaluate_within": "annual.result:evaluate_within",
    "glare": "glare_year:glare",
    "glare_elements": "glare_year:glare_elements",
    "lights": "annual.lights:lights",
    "lights_of_sensors": "annual.lights:lights_of_sensors",
    "load_case": "case.reading:load_case",
    "period": "sky.period",
    "render": "rendering.frames:render",
    "shipped_cases": "case.shipped:shipped_cases",
    "view_distances": "transport.windows.view_rays:view_distances",
    "weather": "sky.weather",
    "__version__": "runtime.release:RELEASE",
}
_ROOMS = (
    "annual", "blocks", "bsdf", "case", "controls", "design", "export", "glare_year",
    "goniophotometer", "metrics", "model", "picture", "plan", "rendering", "report", "runtime",
    "scene", "schema", "sky", "standards", "transport",
)  # fmt: skip

registration.register_plugins()
__getattr__ = lazy.attributes(__name__, _NAMES)


def __dir__() -> list[str]:
    return sorted([*_NAMES, *_ROOMS, "__doc__"])
