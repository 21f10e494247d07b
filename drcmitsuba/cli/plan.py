"""The command `drcmitsuba plan`."""

from __future__ import annotations

import json
from typing import Any

from rich import box
from rich.markup import escape
from rich.table import Table

from drcmitsuba.cli.options import AsJson, CaseName, OptionalOutput, Weather, load
from drcmitsuba.cli.terminal import show, show_notes, stages


def plan(
    case: CaseName, output: OptionalOutput = None, weather: Weather = None, as_json: AsJson = False
) -> None:
    """Show which effects a case calls for, why, and what they will cost."""
    from drcmitsuba.plan import notes
    from drcmitsuba.plan import plan as decide
    from drcmitsuba.plan.forecast import forecast
    from drcmitsuba.runtime import backend, storage
    from drcmitsuba.scene.prepared_case import prepared
    from drcmitsuba.sky.daylight import daylight_and_year

    loaded = load(case, weather)
    backend.select()
    with stages() as stage, stage("plan") as done:
        prepared(loaded).check()
        remarks = notes(loaded)
        light = daylight_and_year(loaded)
        decided = decide(loaded, light)
        done(0.3)
        expected = forecast(decided)
        decided = decided.summed() if expected.summed_states else decided
    entries = expected.beside(decided.to_dict())
    if output is not None:
        storage.save_json(entries, output / "plan.json")
    if as_json:
        print(json.dumps(entries, indent=2, ensure_ascii=False, default=str))
        return
    print_plan(loaded.name, entries)
    accuracy = loaded.accuracy
    print(f"forecast: {expected}{accuracy.rounds_toward(accuracy.sensor_goal)}")
    show_notes([*light.notes, *remarks, *decided.notes()])
    if output is not None:
        print(f"the plan is in {output / 'plan.json'}")


def print_plan(title: str, entries: dict[str, dict[str, Any]]) -> None:
    """Print the effects of a plan as a table."""
    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE, pad_edge=False)
    table.add_column("effect", no_wrap=True)
    table.add_column("on", no_wrap=True)
    table.add_column("share", justify="right", no_wrap=True)
    table.add_column("reason")
    for name, effect in entries.items():
        if name == "cost":
            continue
        share = f"{100 * effect['share']:.0f} %" if effect["share"] >= 0.005 else ""
        mark = "missing" if effect.get("missing") else ("yes" if effect["on"] else "–")
        table.add_row(name, mark, share, escape(effect["reason"]))
    table.add_row("rest", "", f"{100 * entries['cost']['share']:.0f} %", "sky, metrics, files")
    show(table)
