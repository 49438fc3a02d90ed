"""Curves in a page: predicted with band and stability, measured with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from nicegui import ui

_COLOURS = tuple(f"var(--series-{i + 1})" for i in range(6))
_SYMBOLS = ("circle", "rect", "triangle", "diamond", "roundRect", "pin")
_AXES = {
    "amplitude_drive": "lever amplitude / °",
    "gain": "gain",
    "phase": "phase lag / °",
    "damping": "Lehr's damping D",
}
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
    stretches are dotted. number: which colour; None: by place.
    """

    name: str
    x: Sequence[float]
    y: Sequence[float | None]
    low: Sequence[float | None] = ()
    high: Sequence[float | None] = ()
    is_line: bool = False
    is_stable: Sequence[bool] = ()
    number: int | None = None

    @classmethod
    def of_estimates(cls, name: str, x: Sequence[float], y: Sequence[dict[str, Any]], number: int | None) -> "Curve":
        """Return a row of points with the 90 % intervals of estimates as JSON holds them."""
        low, high = zip(*(one["interval90"] for one in y), strict=True) if y else ((), ())
        return cls(name, x, [one["value"] for one in y], low, high, number=number)


@dataclass
class Curves:
    """A chart in a page. what: gain, phase or damping. marked_hz: a frequency to mark, or None."""

    what: str
    x_name: str = "frequency / Hz"
    marked_hz: float | None = None
    marks: list[tuple[float, float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._chart = ui.echart(options_of(self.what, [], self.x_name), renderer="svg")
        self._chart.props(f'role=img aria-label="{_AXES[self.what]} over {self.x_name}"')

    @property
    def element(self) -> ui.echart:
        """The chart itself."""
        return self._chart

    def draw(self, curves: Sequence[Curve]) -> None:
        """Show these curves instead of those before."""
        self._chart.options.clear()
        self._chart.options.update(options_of(self.what, curves, self.x_name, self.marked_hz, self.marks))
        self._chart.update()

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
        return Curve.of_estimates(name, one["frequency_hz"], one[self.what], one.get("number"))


def options_of(
    what: str,
    curves: Sequence[Curve],
    x_name: str,
    marked: float | None = None,
    marks: Sequence[tuple[float, float, str]] = (),
) -> dict[str, Any]:
    """Return ECharts' options for some curves.

    what: gain, phase, damping or amplitude. marked: place on the x axis of a vertical line. marks: (x, y, label).
    """
    series: list[dict[str, Any]] = []
    for place, curve in enumerate(curves):
        series += _series(curve, place if curve.number is None else curve.number)
    if marked is not None:
        line = {"silent": True, "symbol": "none", "lineStyle": {"color": "var(--ink)", "type": "dashed"}}
        line["label"] = {"formatter": f"wanted {marked:g}", "color": "var(--ink)", "textBorderWidth": 0}
        series.append({"type": "line", "data": [], "markLine": {**line, "data": [{"xAxis": marked}]}})
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
        "aria": {"enabled": True},
        "color": list(_COLOURS),
        "textStyle": {"fontFamily": "system-ui, sans-serif"},
        "grid": {"left": 58, "right": 16, "top": 16, "bottom": 70 if curves else 46},
        "legend": {
            "bottom": 0,
            "type": "scroll",
            "textStyle": {"color": "var(--ink)"},
            "pageTextStyle": {"color": "var(--ink)"},
            "data": [curve.name for curve in curves],
        },
        "tooltip": {"trigger": "item", "confine": True},
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


def _series(curve: Curve, number: int) -> list[dict[str, Any]]:
    colour = _COLOURS[number % len(_COLOURS)]
    points = [[x, y] for x, y in zip(curve.x, curve.y, strict=True)]
    if not curve.is_line:
        whiskers = [
            [x, low, high]
            for x, low, high in zip(curve.x, curve.low, curve.high, strict=True)
            if None not in (low, high)
        ]
        style = {"color": colour}
        symbol = _SYMBOLS[number % len(_SYMBOLS)]
        bars = {"type": "custom", ":renderItem": _WHISKER, "data": whiskers, "encode": {"x": 0, "y": [1, 2]}, "z": 3}
        return [
            {
                "type": "scatter",
                "name": curve.name,
                "data": points,
                "symbol": symbol,
                "symbolSize": 7,
                "itemStyle": style,
            },
            {**bars, "name": curve.name, "itemStyle": style, "silent": True, "clip": True},
        ]
    line = {"type": "line", "name": curve.name, "showSymbol": False, "itemStyle": {"color": colour}, "silent": True}
    made: list[dict[str, Any]] = []
    if curve.low:
        made += _band(curve, colour)
    stable = curve.is_stable or [True] * len(points)
    for wanted, dash in ((True, "solid"), (False, "dotted")):
        if wanted or not all(stable):
            shown = [[x, y if _belongs(stable, i, wanted) else None] for i, (x, y) in enumerate(points)]
            made.append({**line, "data": shown, "lineStyle": {"color": colour, "width": 2, "type": dash}, "z": 2})
    return made


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
        if low is not None and high is not None
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
