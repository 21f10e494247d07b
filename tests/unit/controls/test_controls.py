"""Controls on series that can be counted by eye, and against loops in plain Python."""

import math
from functools import partial

import numpy as np
import pytest
import xarray as xr

from drcmitsuba import controls, metrics
from drcmitsuba.case.groups import GroupStates
from drcmitsuba.runtime.errors import InputError

SHADE = GroupStates.of_shade()
TWO = GroupStates(("south", "east"), (("open", "half", "shut"), ("open", "shut")))
FIXED = GroupStates(("south", "(others)"), (("open", "shut"), ("open",)))


def hours(count, start="2015-06-21T08"):
    time = np.datetime64(start, "ns") + np.arange(count) * np.timedelta64(1, "h")
    return xr.DataArray(time, {"time": time}, ("time",))


def illuminance(values, time, **more):
    """E with all groups open, the same at each of two sensors."""
    E = np.repeat(np.asarray(values, float)[:, None], 2, axis=1)
    return xr.Dataset({"total_open": (("time", "sensor"), E), **more}, {"time": time.values})


def weather(time, dni=0.0, dhi=0.0, ghi=0.0, sun=(0.0, -1.0, 0.0)):
    count = len(time)
    arrays = {n: ("time", np.broadcast_to(v, count).astype(float)) for n, v in
              {"dni": dni, "dhi": dhi, "ghi": ghi}.items()}  # fmt: skip
    sun = np.broadcast_to(np.asarray(sun, float), (count, 3))
    sun = sun / np.linalg.norm(sun, axis=1, keepdims=True)
    return xr.Dataset({**arrays, "sun_direction": (("time", "axis"), sun)}, {"time": time.values})


def toward(profile, azimuth=180.0):
    """Direction to a sun of some height [deg] straight before a façade."""
    h, a = np.radians(profile), np.radians(azimuth)
    return [np.cos(h) * np.sin(a), np.cos(h) * np.cos(a), np.sin(h)]


# ---- glare ------------------------------------------------------------------------------------


def dgp_of(time, *by_state):
    """DGP (state, time, view) of two views, of which the second is never dazzled."""
    values = np.stack([np.array(by_state), np.full(np.shape(by_state), 0.2)], axis=-1)
    names = np.array(["open", "half/open", "shut/shut", "applied"], object)[: len(by_state)]
    dims = ("state", "time", "view")
    return xr.DataArray(values, {"state": names, "time": time.values}, dims)


def test_the_first_state_without_glare_is_taken():
    time = hours(5)
    dgp = dgp_of(time, [0.3, 0.41, 0.5, 0.9, 0.40], [0.3, 0.4, 0.45, 0.8, 0.3],
                 [0.3, 0.2, 0.3, 0.7, 0.3], [0.1] * 5)  # fmt: skip
    states = controls.glare(illuminance([0] * 5, time), weather(time), time, groups=TWO, dgp=dgp)
    assert states.values.tolist() == [[0, 0], [1, 0], [2, 1], [2, 1], [0, 0]]
    strict = partial(controls.glare, groups=TWO, dgp=dgp, limit=0.25)
    assert strict(None, None, time[1:2]).values.tolist() == [[2, 1]]


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"limit": 0}, "limit: 0"),
        ({"dgp": "time"}, "no value for 1 time stamps, 2015-06-21T10:00"),
        ({"dgp": "dims"}, "dims time, view"),
        ({"dgp": "nan"}, "NaN"),
        ({"groups": SHADE}, "for 1 groups"),
    ],
)
def test_unfit_glare_is_refused_in_one_line(change, complaint):
    time = hours(3)
    dgp = dgp_of(time, [0.3] * 3, [0.3] * 3)
    unfit = {"time": dgp[:, :2], "dims": dgp[0], "nan": dgp * np.nan}
    keys = {"groups": TWO, "dgp": dgp} | change
    keys["dgp"] = unfit.get(change.get("dgp"), dgp)
    with pytest.raises(InputError, match=complaint):
        controls.glare(None, None, time, **keys)


# ---- hysteresis -------------------------------------------------------------------------------


def test_a_group_closes_at_one_threshold_and_opens_below_the_other():
    time = hours(8)
    E = illuminance([100, 2000, 1600, 1500, 1499, 1999, 2500, 1500], time)
    states = controls.work_plane(E, weather(time), time, groups=SHADE, close=2000, reopen=1500)
    assert states.dims == ("time", "group")
    assert states.values[:, 0].tolist() == [0, 1, 1, 1, 0, 0, 1, 1]
    without = controls.work_plane(E, weather(time), time, groups=SHADE, close=2000)
    assert without.values[:, 0].tolist() == [0, 1, 0, 0, 0, 0, 1, 0]


def test_every_day_begins_open():
    time = xr.concat([hours(2), hours(2, "2015-06-22T08")], "time")
    E = illuminance([2500, 1800, 1800, 1800], time)
    states = controls.work_plane(E, weather(time), time, groups=SHADE, close=2000, reopen=1500)
    assert states.values[:, 0].tolist() == [1, 1, 0, 0]


def test_hysteresis_is_that_of_a_plain_loop():
    rng = np.random.default_rng(3)
    time = hours(600)
    signal = rng.uniform(0, 400, (600, 3))
    states = controls.closed_by(signal, time, 300.0, 120.0)
    days = time.dt.dayofyear.values
    for g in range(3):
        closed = False
        for t in range(600):
            if t == 0 or days[t] != days[t - 1]:
                closed = False
            if signal[t, g] >= 300:
                closed = True
            elif signal[t, g] < 120:
                closed = False
            assert states[t, g] == closed
    assert 0.2 < states.mean() < 0.8


def test_groups_take_the_state_that_is_named_and_fixed_ones_stay():
    time = hours(2)
    E = illuminance([0, 5000], time)
    last = controls.work_plane(E, weather(time), time, groups=TWO)
    assert last.values.tolist() == [[0, 0], [2, 1]]
    half = controls.work_plane(E, weather(time), time, groups=TWO, state=1)
    assert half.values.tolist() == [[0, 0], [1, 1]]
    fixed = controls.work_plane(E, weather(time), time, groups=FIXED)
    assert fixed.values.tolist() == [[0, 0], [1, 0]]
    assert fixed.group.values.tolist() == ["south", "(others)"]


def test_the_irradiance_of_a_facade_is_direct_diffuse_and_from_the_ground():
    """South: 500 · cos 60° + 100/2 + 0.2 · 200/2 = 320; the east has 70, without direct sun."""
    time = hours(1)
    sun = weather(time, dni=500.0, dhi=100.0, ghi=200.0, sun=toward(60))
    rule = partial(controls.facade_irradiance, groups=TWO, azimuths=(180, 90))
    for close, expected in ((319.9, [2, 0]), (320.1, [0, 0]), (69.9, [2, 1]), (70.1, [2, 0])):
        assert rule(illuminance([0], time), sun, time, close=close).values[0].tolist() == expected
    below = weather(time, dni=500.0, dhi=100.0, ghi=200.0, sun=toward(-10))
    assert rule(illuminance([0], time), below, time, close=71).values[0].tolist() == [0, 0]


def test_the_brightest_eye_closes():
    time = hours(3)
    eyes = xr.DataArray([[100, 900], [2000, 0], [1999, 1999]], dims=("time", "sensor"))
    states = controls.vertical_illuminance(
        illuminance([0, 0, 0], time), weather(time), time, groups=SHADE, eyes=eyes
    )
    assert states.values[:, 0].tolist() == [0, 1, 0]


# ---- slats ------------------------------------------------------------------------------------


def test_the_cut_off_angle_by_geometry():
    """Slats as wide as their distance: at 45° flat ones are enough; at 0° they have to stand."""
    tilt = controls.cut_off_angle(np.array([0.0, 20.0, 45.0, 60.0, np.nan]), 1.0, 1.0)
    np.testing.assert_allclose(tilt, [90, 50, 0, 0, np.nan], atol=1e-9)
    np.testing.assert_array_equal(controls.cut_off_angle(np.array([10.0]), 2.0, 1.0), [np.inf])


@pytest.mark.parametrize("profile", [5.0, 20.0, 35.0, 50.0, 75.0])
@pytest.mark.parametrize("ratio", [0.6, 0.8, 1.0])
def test_at_the_cut_off_angle_no_ray_passes_and_just_below_some_do(profile, ratio):
    """Rays are followed through two neighbouring slats; positions in widths."""
    d = math.radians(profile)

    def passes(tilt):
        b = math.radians(tilt)
        # Slats from their inner ends (0, 0), (0, ratio) to their outer ends, which are lower.
        for start in np.linspace(0, 1, 400, endpoint=False):
            # A ray ends at (0, y): where does it cross the lines of both slats?
            y = start * ratio
            blocked = False
            for foot in (0.0, ratio):
                # (u cos d, y + u sin d) = (v cos b, foot − v sin b)
                v = (y - foot) * math.cos(d) / -math.sin(d + b) if math.sin(d + b) else math.inf
                blocked |= 0 < v <= 1 and v * math.cos(b) > 0
            if not blocked:
                return True
        return False

    tilt = float(controls.cut_off_angle(np.array([profile]), ratio, 1.0)[0])
    assert not passes(tilt + 0.2)
    assert tilt == 0 or passes(tilt - 0.5)


def test_the_flattest_slats_that_keep_the_sun_out_are_taken():
    time = hours(6)
    groups = GroupStates(("south",), (("open", "flat", "30", "60", "shut"),))
    suns = [toward(50), toward(40), toward(16), toward(1), toward(50, 0), toward(-5)]
    w = xr.concat([weather(time[[i]], 500, sun=s) for i, s in enumerate(suns)], "time")
    rule = partial(
        controls.cut_off, groups=groups, azimuths=[180], tilts=[[0, 30, 60, 80]], spacing=1, width=1
    )
    # They want tilts of 0, 10, 58 and 88°; the last two suns are behind the façade and down.
    E = illuminance(np.zeros(6), time)
    assert rule(E, w, time).values[:, 0].tolist() == [1, 2, 3, 4, 0, 0]
    cloudy = w.assign(dni=0 * w["dni"])
    assert not rule(E, cloudy, time).values.any()


def test_the_profile_angle_grows_beside_the_facade():
    sun = np.array([toward(30), toward(30, 120), toward(30, 90), toward(30, 0)])
    normal = np.array([0.0, -1.0, 0.0])
    beside = np.degrees(np.arctan(np.tan(np.radians(30)) / np.cos(np.radians(60))))
    angles = controls.profile_angle(sun, normal)
    np.testing.assert_allclose(angles[:2], [30, beside])
    assert np.isnan(angles[3])


# ---- rules ------------------------------------------------------------------------------------


def test_lm83_is_the_rule_of_the_metrics():
    rng = np.random.default_rng(5)
    time = hours(200)
    D = rng.uniform(0, 1040, (200, 60))
    E = illuminance(np.zeros(200), time).drop_vars("total_open")
    E = E.assign(direct_sun=(("time", "sensor"), D))
    states = controls.lm83(E, weather(time), time, groups=SHADE, area=0.05)
    closed = metrics.shade_closed(E["direct_sun"], area=0.05)
    np.testing.assert_array_equal(states.values[:, 0], closed.values)
    assert 0 < closed.sum() < 200


def test_lm83_closes_the_group_that_lets_the_sun_in():
    time = hours(3)
    D = np.zeros((3, 50))
    D[1, :3], D[2, :] = 1000, 2000
    group = np.zeros((3, 50))
    group[:, :25] = 1
    E = xr.Dataset(
        {"direct_sun": (("time", "sensor"), D), "sun_group": (("time", "sensor"), group)},
        {"time": time.values},
    )
    states = controls.lm83(E, weather(time), time, groups=TWO)
    assert states.values.tolist() == [[0, 0], [0, 1], [2, 1]]


def test_a_schedule_gives_the_state_of_the_hour():
    time = hours(3, "2015-01-01T01")
    of_year = np.zeros(8760, int)
    of_year[[2, 3]] = [2, 1]
    scheduled = partial(controls.scheduled, illuminance(np.zeros(3), time), weather(time), time)
    states = scheduled(groups=TWO, of_group={"south": of_year})
    assert states.values.tolist() == [[0, 0], [2, 0], [1, 0]]
    with pytest.raises(InputError, match="no group 'west'"):
        scheduled(groups=TWO, of_group={"west": of_year})
    with pytest.raises(InputError, match="give 8760 states"):
        scheduled(groups=TWO, of_group={"south": of_year[:-1]})
    with pytest.raises(InputError, match="2 for group 'east'"):
        scheduled(groups=TWO, of_group={"east": of_year})
    with pytest.raises(InputError, match="65536 for group 'east'"):
        scheduled(groups=TWO, of_group={"east": of_year + 65536})
    with pytest.raises(InputError, match="the type float64 for group 'south'"):
        scheduled(groups=TWO, of_group={"south": of_year / 2})
    labelled = xr.DataArray(of_year, {"time": hours(8760, "2015-01-01T00").values}, ("time",))
    assert scheduled(groups=TWO, of_group={"south": labelled[::-1]}).equals(states)


def test_winter_takes_the_blind_out():
    time = xr.concat([hours(1, f"2015-{m:02}-15T12") for m in (1, 6, 12)], "time")
    E = illuminance([9000] * 3, time)
    control = partial(controls.work_plane, groups=TWO)
    out = controls.seasonal(
        E, weather(time), time, groups=TWO, control=control, months=[12, 1], state=0
    )
    assert out.values.tolist() == [[0, 0], [2, 1], [0, 0]]
    film = controls.seasonal(
        E, weather(time), time, groups=TWO, control=control, months=[6], state=1
    )
    assert film.values.tolist() == [[2, 1], [1, 1], [2, 1]]
    with pytest.raises(InputError, match="numbers from 1 to 12"):
        controls.seasonal(E, weather(time), time, groups=TWO, control=control, months=[0])
    with pytest.raises(InputError, match='state: "-1"; give'):
        controls.seasonal(E, weather(time), time, groups=TWO, control=control, months=[], state=-1)


def test_the_best_state_of_every_hour():
    time = hours(3)

    def of(values):
        return xr.DataArray(np.array(values, float)[:, None], {"time": time.values}, ("time", "s"))

    by_state = {"open": of([100, 900, 700]), "half/shut": of([90, 600, 700]),
                "shut/open": of([10, 490, 200])}  # fmt: skip
    near_500 = controls.best_state(by_state, lambda E: -abs(E.mean("s") - 500), TWO)
    assert near_500.values.tolist() == [[0, 0], [2, 0], [0, 0]]  # a tie takes the first
    with pytest.raises(InputError, match="finite values"):
        controls.best_state(by_state, lambda E: E, TWO)
    with pytest.raises(InputError, match="no state"):
        controls.best_state({}, lambda E: E, TWO)
    with pytest.raises(InputError, match="did you mean"):
        controls.best_state({"halff/shut": by_state["open"]}, lambda E: E.mean("s"), TWO)


# ---- a function of the user's ------------------------------------------------------------------


def test_any_function_is_a_control():
    time = hours(3)
    E, w = illuminance([0, 600, 0], time), weather(time)

    def bright(E, weather, time):
        return (E["total_open"].mean("sensor") > 500).values[:, None] * np.array([1, 1])

    states = controls.called(bright, E, w, time, TWO)
    assert states.values.tolist() == [[0, 0], [1, 1], [0, 0]]


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        (np.zeros((2, 3), int), "mine: states: the shape .2, 3.; give .3, 2.: time stamps"),
        (np.zeros((3, 2)), "the type float64; give the index"),
        (np.full((3, 2), 2), "2 for group 'east'; give an index from 0 to 1"),
        (np.full((3, 2), -1), "-1 for group 'south'"),
        (None, "the shape"),
    ],
)
def test_a_function_that_returns_anything_else_is_refused(answer, complaint):
    time = hours(3)

    def mine(E, weather, time):
        return answer

    with pytest.raises(InputError, match=complaint):
        controls.called(mine, illuminance([0] * 3, time), weather(time), time, TWO)


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda E, w, t: controls.work_plane(E, w, t, groups=SHADE, close=1, reopen=2), "reopen"),
        (lambda E, w, t: controls.work_plane(E * np.nan, w, t, groups=SHADE), "NaN"),
        (lambda E, w, t: controls.facade_irradiance(E, w, t, groups=TWO, azimuths=[1]), "1 for 2"),
        (lambda E, w, t: controls.work_plane(E, w, t, groups=SHADE, state=2), '"2"; .* to 1'),
        (lambda E, w, t: controls.work_plane(E, w, t, groups=SHADE, state="x"), 'state: "x"; give'),
        (
            lambda E, w, t: controls.cut_off(
                E, w, t, groups=TWO, azimuths=[0, 0], tilts=[[0], [0]], spacing=1, width=1
            ),
            r"give \[2, 1\]",
        ),
        (lambda E, w, t: controls.cut_off_angle(np.zeros(1), 0, 1), "lengths above 0"),
    ],
)
def test_unfit_arguments_are_refused(call, complaint):
    time = hours(2)
    with pytest.raises(InputError, match=complaint):
        call(illuminance([0, 0], time), weather(time), time)
