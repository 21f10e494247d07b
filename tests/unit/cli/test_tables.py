"""Tables of metrics on the terminal."""

from drcmitsuba.cli.evaluate import metrics_tables

VALUE = {"value": 50.0, "low": 49.0, "high": 51.0}
NUMBERS = {"sDA": VALUE, "ASE": VALUE, "shade_closed": VALUE}
NUMBERS |= dict.fromkeys(("msDA", "MSE", "shade_closed_monthly"), [VALUE] * 12)


def headers(**settings):
    tables = metrics_tables(NUMBERS | ({"settings": settings} if settings else {}), "room")
    whole, months = ([str(column.header) for column in table.columns] for table in tables)
    return whole[0], [str(cell) for cell in tables[0].columns[0].cells], months


def test_a_year_with_a_shade_has_all_rows():
    period, rows, months = headers(period={}, shading={"material": "shade"})
    assert (period, rows[-1], months[-1]) == ("year", "shade closed", "shade closed %")


def test_a_part_of_the_year_is_named_by_its_months():
    period, *_ = headers(period={"months": [3, 4, 5]}, shading={})
    assert period == "Mar–May"


def test_a_case_without_a_shade_has_no_row_for_it():
    _, rows, months = headers(period={})
    assert rows == ["sDA", "ASE"]
    assert months == ["month", "msDA %", "MSE %"]


def test_illuminances_of_unknown_settings_keep_the_shade():
    assert headers()[1][-1] == "shade closed"
