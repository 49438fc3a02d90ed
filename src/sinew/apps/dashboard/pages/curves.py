"""Curves in a page: predicted with band and stability, measured with intervals."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
from nicegui import ui

from sinew.apps.dashboard.pages.frame import part
from sinew.apps.dashboard.work.results import Verdict
from sinew.measure.estimate import interval, number, span, typeset

# Of six curves dash alone and marker alone tell them apart, of thirty-six colour with dash.
_COLOURS = tuple(f"var(--series-{i + 1})" for i in range(6))
_DASHES: tuple[str | list[int], ...] = ("solid", [9, 4], [3, 3], [12, 4, 3, 4], [16, 4], [8, 3, 2, 3, 2, 3])
_SYMBOLS = (  # outlines keep their shape in a legend, where names of shapes are stretched
    "circle",
    "path://M0,0L9,0L9,9L0,9Z",  # a square
    "path://M5,0L10,9L0,9Z",  # a triangle
    "path://M5,0L10,5L5,10L0,5Z",  # a diamond
    "path://M0,0L10,0L5,9Z",  # a triangle on its tip
    "path://M3.5,0L6.5,0L6.5,3.5L10,3.5L10,6.5L6.5,6.5L6.5,10L3.5,10L3.5,6.5L0,6.5L0,3.5L3.5,3.5Z",  # a plus
    "path://M5,0L6.2,3.4L9.8,3.5L6.9,5.7L8,9.1L5,7.1L2,9.1L3.1,5.7L0.2,3.5L3.8,3.4Z",  # a star
)
_UNSTABLE: str | list[int] = [1, 4]
_MISS = "path://M0,2L2,0L5,3L8,0L10,2L7,5L10,8L8,10L5,7L2,10L0,8L3,5Z"  # a cross, which marks no curve
_ROWS_OF_LINE = 21
_AXES = {
    "amplitude_drive": "lever amplitude / °",
    "gain": "gain",
    "phase": "phase lag / °",
    "damping": "Lehr's damping D",
}
_UNITS = {"amplitude_drive": "°", "gain": "", "phase": "°", "damping": ""}
# A whisker from the lower to the upper end of an interval, with caps.
_WHISKER = """(params, api) => {
  const x = api.value(0), low = api.coord([x, api.value(1)]), high = api.coord([x, api.value(2)]), w = 4;
  const style = {stroke: api.visual('color'), lineWidth: 1.5};
  const line = (x1, y1, x2, y2) => ({type: 'line', shape: {x1, y1, x2, y2}, style});
  return {type: 'group', children: [line(low[0], low[1], high[0], high[1]),
    line(low[0] - w, low[1], low[0] + w, low[1]), line(high[0] - w, high[1], high[0] + w, high[1])]};
}"""


@dataclass(frozen=True)
class Curve:
    """One line or row of points.

    name: as the legend has it. x, y: of its points; None leaves a gap. low, high: ends of the intervals or of the band,
    or empty. is_line: a line, else points with whiskers. is_stable: by point, or empty where all are; unstable
    stretches are dotted. number: which colour, dash and marker; None: by place. verdicts: what a prediction says of
    each point, or empty; one that misses it is a red cross. Where x, y, low or high have no number, as in a damaged
    file, that point is NaN or None: a key that begins with ":" in a chart's options is run as a script.
    """

    name: str
    x: Sequence[float]
    y: Sequence[float | None]
    low: Sequence[float | None] = ()
    high: Sequence[float | None] = ()
    is_line: bool = False
    is_stable: Sequence[bool] = ()
    number: int | None = None
    verdicts: Sequence[Verdict | None] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", str(self.name))
        object.__setattr__(self, "x", [math.nan if at is None else at for at in map(_number_or_none, self.x)])
        for name in ("y", "low", "high"):
            object.__setattr__(self, name, [*map(_number_or_none, getattr(self, name))])

    @classmethod
    def of_estimates(
        cls,
        name: str,
        x: Sequence[float],
        y: Sequence[dict[str, Any]],
        number: int | None,
        verdicts: Sequence[Verdict | None] = (),
    ) -> "Curve":
        """Return a row of points with the 90 % intervals of estimates as JSON holds them."""
        low, high = zip(*(one["interval90"] or (None, None) for one in y), strict=True) if y else ((), ())
        return cls(name, x, [one["value"] for one in y], low, high, number=number, verdicts=verdicts)

    @property
    def misses(self) -> list[int]:
        """Which points miss their prediction."""
        return [i for i, verdict in enumerate(self.verdicts) if verdict is not None and verdict.misses]


def _number_or_none(found: Any) -> float | None:
    """Return a finite number as a float, and None for anything else that a file may hold."""
    return float(found) if isinstance(found, int | float | np.number) and math.isfinite(found) else None


@dataclass
class Curves:
    """A chart in a page, with its summary in words and, where somebody opens it, its numbers as a table.

    what: gain, phase, damping or amplitude_drive. marks: points that are named, (x, y, label).
    """

    what: str
    x_name: str = "frequency / Hz"
    marks: list[tuple[float, float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._curves: Sequence[Curve] = ()
        self._chart = ui.echart(options_of(self.what, [], self.x_name), renderer="svg")
        with ui.element("details").classes("sinew-table") as details:
            with ui.element("summary"):
                ui.label(f"{begun(_AXES[self.what].partition(' / ')[0])} as a table")
            self._table = ui.html(sanitize=False)
        self._is_open = False
        details.on("toggle", self._toggled, js_handler="(event) => emit(event.target.open)")

    @property
    def element(self) -> ui.echart:
        """The chart itself."""
        return self._chart

    def draw(self, curves: Sequence[Curve]) -> None:
        """Show these curves instead of those before."""
        self._curves = curves
        self._chart.options.clear()
        self._chart.options.update(options_of(self.what, curves, self.x_name, self.marks))
        self._chart.update()
        self._fill()

    def _toggled(self, event: Any) -> None:
        self._is_open = bool(event.args)
        self._fill()

    def _fill(self) -> None:
        if self._is_open:
            self._table.set_content(table_of(self.what, self._curves, self.x_name))

    def show(self, predicted: Sequence[dict[str, Any]], measured: Sequence[dict[str, Any]]) -> None:
        """Show predictions and measurements, as `sinew.apps.dashboard.hub.Results` has them."""
        self.draw([*map(self._predicted, predicted), *map(self._measured, measured)])

    def _predicted(self, one: dict[str, Any]) -> Curve:
        low, high = one.get(f"{self.what}_low") or (), one.get(f"{self.what}_high") or ()
        name = f"{one['pretension_mm']:g} mm, predicted"
        return Curve(
            name, one["frequency_hz"], one[self.what], low, high, True, one.get("stable") or (), one.get("number")
        )

    def _measured(self, one: dict[str, Any]) -> Curve:
        name = one.get("name") or f"{one['pretension_mm']:g} mm, measured"
        verdicts = one.get(f"{self.what}_verdict") or ()
        return Curve.of_estimates(name, one["frequency_hz"], one[self.what], one.get("number"), verdicts)


def begun(text: str) -> str:
    """Return text as a sentence begins; the rest keeps its letters: Hz and D stay what they are."""
    return text[:1].upper() + text[1:]


def options_of(
    what: str,
    curves: Sequence[Curve],
    x_name: str,
    marks: Sequence[tuple[float, float, str]] = (),
) -> dict[str, Any]:
    """Return ECharts' options for some curves.

    what: gain, phase, damping or amplitude. marks: (x, y, label).
    """
    series: list[dict[str, Any]] = []
    points = sum(not curve.is_line for curve in curves)
    for index, curve in enumerate(curves):
        # Of points at one place the first are the largest, so that none hides another.
        size = 8 + 2 * min(2, max(0, points - 1 - index))
        series += _series(curve, index if curve.number is None else curve.number, size)
    if marks:
        label = {
            "show": True,
            "position": "top",
            "color": "var(--ink)",
            "textBorderWidth": 0,
            ":formatter": "p => p.data.name",
        }
        data = [{"value": [x, y], "name": name} for x, y, name in marks]
        series.append({"type": "scatter", "symbol": "diamond", "symbolSize": 10, "data": data, "label": label})
        series[-1]["itemStyle"] = {"color": "var(--ink)"}
    axis = {
        "type": "value",
        "scale": True,
        "axisLabel": {"color": "var(--soft)"},
        "axisLine": {"show": True, "lineStyle": {"color": "var(--line)"}},
        "splitLine": {"lineStyle": {"color": "var(--grid)"}},
        "nameTextStyle": {"color": "var(--soft)"},
        "nameLocation": "middle",
    }
    nothing = {
        "type": "text",
        "left": "center",
        "top": "35%",
        "style": {"text": "nothing to show yet", "fill": "var(--soft)"},
    }
    return {
        "graphic": [] if curves else [nothing],
        "animation": False,
        "aria": {"enabled": True, "label": {"description": summary_of(what, curves, x_name)}},
        "color": list(_COLOURS),
        "textStyle": {"fontFamily": "system-ui, sans-serif"},
        "grid": {"left": 58, "right": 16, "top": 16, "bottom": 70 if curves else 46},
        "legend": {
            "bottom": 0,
            "type": "scroll",
            "itemWidth": 38,
            "textStyle": {"color": "var(--ink)"},
            "pageTextStyle": {"color": "var(--ink)"},
            "data": [
                {"name": curve.name, "itemStyle": {"opacity": 0} if curve.is_line else {}} for curve in curves
            ],  # a line has no markers
        },
        "tooltip": {
            "trigger": "item",
            "confine": True,
            "backgroundColor": "var(--card)",
            "textStyle": {"color": "var(--ink)"},
        },
        "xAxis": {**axis, **_ends(curves), "name": x_name, "nameGap": 26},
        "yAxis": {**axis, "name": _AXES[what], "nameGap": 42},
        "series": series,
    }


def _ends(curves: Sequence[Curve]) -> dict[str, Any]:
    """Return where an x axis ends: at the ends of lines, a little beyond points, so that none lies on the frame."""
    if all(curve.is_line for curve in curves):
        return {"min": "dataMin", "max": "dataMax"} if curves else {}
    # A single place on the axis has no width to take a share of.
    margin = "(0.04 * (v.max - v.min) || 0.5)"
    hidden = {"color": "var(--soft)", "showMinLabel": False, "showMaxLabel": False}
    return {":min": f"v => v.min - {margin}", ":max": f"v => v.max + {margin}", "axisLabel": hidden}


def style_of(number: int) -> tuple[str, str | list[int], str]:
    """Return (colour, dash, marker) of a curve; no two of 36 have the same colour and dash."""
    turned = number + number // len(_DASHES)  # so that colour and dash do not come again together
    return _COLOURS[turned % len(_COLOURS)], _DASHES[number % len(_DASHES)], _SYMBOLS[number % len(_SYMBOLS)]


def _series(curve: Curve, number: int, size: int) -> list[dict[str, Any]]:
    colour, dash, symbol = style_of(number)
    points = [[x, y] for x, y in zip(curve.x, curve.y, strict=True)]
    style = {"color": colour}
    if not curve.is_line:
        whiskers = [
            [x, low, high]
            for x, low, high in zip(curve.x, curve.low, curve.high, strict=True)
            if None not in (low, high)
        ]
        bars = {"type": "custom", ":renderItem": _WHISKER, "data": whiskers, "encode": {"x": 0, "y": [1, 2]}, "z": 3}
        scatter = {
            "type": "scatter",
            "name": curve.name,
            "symbol": symbol,
            "symbolSize": size,
            "itemStyle": style,
            "z": 4,
        }
        missed: dict[str, Any] = {"symbol": _MISS, "symbolSize": 13}
        missed["itemStyle"] = {"color": "var(--bad)", "borderColor": colour, "borderWidth": 1.5}
        data = [
            {"value": point, "said": _said(curve, i), **(missed if i in curve.misses else {})}
            for i, point in enumerate(points)
        ]
        tooltip = {":formatter": "p => p.data.said"}
        return [
            {**scatter, "data": data, "tooltip": tooltip},
            {**bars, "name": curve.name, "itemStyle": style, "silent": True, "clip": True},
        ]
    line = {"type": "line", "name": curve.name, "showSymbol": False, "itemStyle": style, "silent": True, "z": 2}
    made: list[dict[str, Any]] = []
    stable = curve.is_stable or [True] * len(points)
    for wanted, pattern in ((True, dash), (False, _UNSTABLE)):
        if wanted or not all(stable):
            shown = [[x, y if _belongs(stable, i, wanted) else None] for i, (x, y) in enumerate(points)]
            made.append({**line, "data": shown, "lineStyle": {"color": colour, "width": 2, "type": pattern}})
    if curve.low:
        made += _band(curve, colour)
    return made


def _said(curve: Curve, i: int) -> str:
    """Return what the tooltip of a point says, as HTML."""
    x, verdict = curve.x[i], curve.verdicts[i] if curve.verdicts else None
    low, high = (curve.low[i], curve.high[i]) if curve.low else (None, None)
    lines = [escape(curve.name), typeset(f"at {x:g}: {interval(curve.y[i], low, high)}")]
    if verdict is not None:
        predicted = number(verdict.predicted, 3) + (
            "" if verdict.low is None else f" ({span(verdict.low, verdict.high)})"
        )
        lines.append(typeset(f"predicted {predicted}"))
        lines.append(f"<b>misses by {verdict.sentence}</b>" if verdict.misses else f"within: {verdict.sentence}")
    return "<br>".join(lines)


# The same in words and as a table, for whoever does not see the chart, or wants its numbers.


def summary_of(what: str, curves: Sequence[Curve], x_name: str) -> str:
    """Return what a chart shows, in words: of every curve where it goes and its largest value, and what misses."""
    title = f"{_AXES[what]} over {x_name}"
    return typeset(". ".join([title, *map(_summarised, curves)])) + "." if curves else f"{title}: nothing to show yet."


def _summarised(curve: Curve) -> str:
    known = [(y, x) for x, y in zip(curve.x, curve.y, strict=True) if y is not None]
    if not known:
        return f"{curve.name}: nothing known"
    most, at = max(known)
    form = "line" if curve.is_line else f"{len(known)} point{'s' * (len(known) != 1)}"
    low, high = min(x for _, x in known), max(x for _, x in known)
    where = f"from {number(low, 3)} to {number(high, 3)}, largest {number(most, 3)} at {number(at, 3)}"
    missed = [f"{curve.x[i]:g} by {curve.verdicts[i].sentence}" for i in curve.misses]  # type: ignore[union-attr]
    return f"{curve.name}: {form} {where}" + (f"; missed the prediction at {'; at '.join(missed)}" if missed else "")


def table_of(what: str, curves: Sequence[Curve], x_name: str) -> str:
    """Return curves as the HTML of a table: all points, and some places of every line."""
    heads = ("curve", x_name, _AXES[what], "90 %", "against the prediction")
    return part("curves", "table", _AXES[what], heads, [row for curve in curves for row in _rows(what, curve)])


def _rows(what: str, curve: Curve) -> Iterator[tuple[str, ...]]:
    count = len(curve.x)
    places = range(count)
    if curve.is_line and count > _ROWS_OF_LINE:
        places = [round(i * (count - 1) / (_ROWS_OF_LINE - 1)) for i in range(_ROWS_OF_LINE)]  # type: ignore[assignment]
    unit = _UNITS[what]
    for i in places:
        low, high = (curve.low[i], curve.high[i]) if curve.low else (None, None)
        verdict = curve.verdicts[i] if curve.verdicts else None
        said = "" if verdict is None else f"misses by {verdict.sentence}" if verdict.misses else "within"
        if curve.is_stable and not curve.is_stable[i]:
            said = "unstable"
        value = interval(curve.y[i], low, high, unit).partition(" (")[0]
        yield curve.name, number(curve.x[i]), typeset(value), typeset(span(low, high, unit)), said


def _belongs(stable: Sequence[bool], i: int, wanted: bool) -> bool:
    """Return whether a point is drawn with those of its kind; neighbours join, so that a line has no gap."""
    return stable[i] == wanted or (
        wanted is False and any(stable[j] == wanted for j in (i - 1, i + 1) if 0 <= j < len(stable))
    )


def _band(curve: Curve, colour: str) -> list[dict[str, Any]]:
    """Return a filled band as one polygon, which needs no stacking and takes gaps."""
    pairs = [
        (x, low, high)
        for x, low, high in zip(curve.x, curve.low, curve.high, strict=True)
        if low is not None and high is not None and math.isfinite(x)
    ]
    render = """(params, api) => {
      if (params.context.done) return; params.context.done = true;
      const points = DATA.map(([x, y]) => api.coord([x, y]));
      return {type: 'polygon', shape: {points}, style: {fill: 'COLOUR', opacity: 0.18}};
    }"""
    outline = [[x, low] for x, low, _ in pairs] + [[x, high] for x, _, high in reversed(pairs)]
    render = render.replace("DATA", repr(outline)).replace("COLOUR", colour)
    return [
        {"type": "custom", ":renderItem": render, "data": [[x, low] for x, low, _ in pairs], "silent": True, "z": 1}
    ]
