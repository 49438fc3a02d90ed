// The oscilloscope: three panels over one time axis, least and largest value of each column.

const CAPACITY = 12000;
const colours = new Map();
setInterval(() => colours.clear(), 500); // the theme may change; asking the style sheet for every line is slow

export function css(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.body).getPropertyValue(name).trim());
  return colours.get(name);
}

// Bins of one run, in typed arrays that are made once.
export class Traces {
  constructor() { this.reset([]); }

  reset(traces) {
    this.traces = traces;
    this.time = new Float64Array(CAPACITY);
    this.low = traces.map(() => new Float32Array(CAPACITY));
    this.high = traces.map(() => new Float32Array(CAPACITY));
    this.count = 0;
  }

  put(frame) {
    const { time, low } = frame, high = frame.high ?? low;
    for (let i = 0; i < time.length; i++) {
      const joins = this.count > 0 && time[i] <= this.time[(this.count - 1) % CAPACITY];
      const at = (joins ? this.count - 1 : this.count) % CAPACITY;
      this.time[at] = joins ? this.time[at] : time[i];
      for (let c = 0; c < this.traces.length; c++) {
        const a = low[c][i] ?? NaN, b = high[c][i] ?? NaN;
        this.low[c][at] = joins ? Math.min(this.low[c][at], a) : a;
        this.high[c][at] = joins ? Math.max(this.high[c][at], b) : b;
      }
      if (!joins) this.count++;
    }
  }

  get newest() { return this.count ? this.time[(this.count - 1) % CAPACITY] : 0; }

  // Number of the first bin at or after a time.
  from(time) {
    let low = Math.max(0, this.count - CAPACITY), high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time[middle % CAPACITY] < time) low = middle + 1; else high = middle;
    }
    return low;
  }
}

export function sized(canvas, height) {
  const ratio = Math.min(2, devicePixelRatio || 1), width = canvas.clientWidth || 300;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
    canvas.style.height = `${height}px`;
  }
  const draw = canvas.getContext("2d");
  draw.setTransform(ratio, 0, 0, ratio, 0, 0);
  draw.clearRect(0, 0, width, height);
  draw.font = "12px system-ui, sans-serif";
  return { draw, width, height };
}

// Steps of 1, 2 or 5 times a power of ten, about so many in a range.
export function ticks(low, high, about) {
  const raw = (high - low) / about, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((x) => x * power).find((x) => x >= raw);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Ranges follow what is shown: out at once, in slowly, so that the axis does not flicker.
class Range {
  constructor(least) { this.least = least; this.high = least; this.low = 0; }
  follow(low, high) {
    if (!Number.isFinite(low)) return;
    const span = Math.max(high - low, this.least), middle = (high + low) / 2;
    const wantLow = middle - 0.58 * span, wantHigh = middle + 0.58 * span;
    this.low = wantLow < this.low ? wantLow : this.low + 0.03 * (wantLow - this.low);
    this.high = wantHigh > this.high ? wantHigh : this.high + 0.03 * (wantHigh - this.high);
  }
}

const LEFT = 46, RIGHT = 8, GAP = 12, BOTTOM = 22;

export class Scope {
  // panels: [{unit, least, share, lines: [{key, colour, dash}]}]
  constructor(canvas, panels) {
    this.canvas = canvas; this.panels = panels.map((panel) => ({ ...panel, range: new Range(panel.least) }));
    this.hidden = new Set();
  }

  get pixels() { return Math.max(50, Math.round((this.canvas.clientWidth || 300) - LEFT - RIGHT)); }

  render(traces, base, end) {
    const height = innerWidth < 900 ? 300 : 380;
    const { draw, width } = sized(this.canvas, height);
    const start = end - base, x = (time) => LEFT + (time - start) / base * (width - LEFT - RIGHT);
    const ink = css("--soft"), grid = css("--grid");
    const shares = this.panels.reduce((sum, panel) => sum + panel.share, 0);
    let top = 4;
    const room = height - BOTTOM - GAP * (this.panels.length - 1) - 4;
    const first = traces.from(start - base / this.pixels);
    for (const panel of this.panels) {
      const tall = room * panel.share / shares;
      this.panel(draw, traces, panel, first, { x, top, tall, width, ink, grid });
      top += tall + GAP;
    }
    draw.fillStyle = ink; draw.textAlign = "center"; draw.textBaseline = "top";
    const { found, digits } = ticks(start, end, Math.max(3, width / 110));
    for (const time of found) if (time >= 0) draw.fillText(`${time.toFixed(digits)} s`, x(time), height - BOTTOM + 6);
  }

  panel(draw, traces, panel, first, { x, top, tall, width, ink, grid }) {
    const shown = panel.lines.map((line) => ({ ...line, at: traces.traces.findIndex((t) => t.key === line.key) }))
      .filter((line) => line.at >= 0 && !this.hidden.has(line.key));
    let low = Infinity, high = -Infinity;
    for (const { at } of shown) for (let k = first; k < traces.count; k++) {
      const a = traces.low[at][k % CAPACITY], b = traces.high[at][k % CAPACITY];
      if (a < low) low = a;
      if (b > high) high = b;
    }
    panel.range.follow(low, high);
    const range = panel.range, y = (value) => top + tall - (value - range.low) / (range.high - range.low) * tall;
    draw.strokeStyle = grid; draw.fillStyle = ink; draw.lineWidth = 1; draw.setLineDash([]);
    draw.textAlign = "right"; draw.textBaseline = "middle";
    const { found, digits } = ticks(range.low, range.high, Math.max(2, tall / 38));
    for (const value of found) {
      draw.beginPath(); draw.moveTo(LEFT, y(value)); draw.lineTo(width - RIGHT, y(value)); draw.stroke();
      draw.fillText(value.toFixed(digits), LEFT - 6, y(value));
    }
    draw.save(); draw.beginPath(); draw.rect(LEFT, top - 2, width - LEFT - RIGHT, tall + 4); draw.clip();
    for (const { at, colour, dash } of shown) {
      draw.strokeStyle = css(colour); draw.lineWidth = 1.6; draw.setLineDash(dash ?? []);
      draw.beginPath();
      let open = false;
      for (let k = first; k < traces.count; k++) {
        const i = k % CAPACITY, a = traces.low[at][i], b = traces.high[at][i];
        if (Number.isNaN(a)) { open = false; continue; }
        const across = x(traces.time[i]);
        if (open) draw.lineTo(across, y(a)); else draw.moveTo(across, y(a));
        if (b !== a) draw.lineTo(across, y(b));
        open = true;
      }
      draw.stroke();
    }
    draw.restore();
    draw.setLineDash([]); draw.fillStyle = ink; draw.textAlign = "left"; draw.textBaseline = "top";
    draw.fillText(panel.unit, LEFT + 4, top + 1);
  }
}

export class Lissajous {
  constructor(canvas) { this.canvas = canvas; this.points = []; this.across = new Range(4); this.up = new Range(4); }

  reset() { this.points = []; }

  put([drive, torsion]) {
    for (let i = 0; i < drive.length; i++) if (drive[i] !== null && torsion[i] !== null) this.points.push([drive[i], torsion[i]]);
    if (this.points.length > 400) this.points.splice(0, this.points.length - 400);
  }

  render() {
    const { draw, width, height } = sized(this.canvas, 250);
    for (const [range, at] of [[this.across, 0], [this.up, 1]]) {
      const most = this.points.reduce((found, point) => Math.max(found, Math.abs(point[at])), 0);
      range.follow(-most, most);
    }
    const left = 44, top = 16, wide = width - left - 8, tall = height - top - 38;
    const x = (v) => left + (v - this.across.low) / (this.across.high - this.across.low) * wide;
    const y = (v) => top + (this.up.high - v) / (this.up.high - this.up.low) * tall;
    draw.strokeStyle = css("--grid"); draw.fillStyle = css("--soft"); draw.lineWidth = 1;
    const columns = ticks(this.across.low, this.across.high, 4), rows = ticks(this.up.low, this.up.high, 5);
    draw.textAlign = "center"; draw.textBaseline = "top";
    for (const v of columns.found) {
      draw.beginPath(); draw.moveTo(x(v), top); draw.lineTo(x(v), top + tall); draw.stroke();
      draw.fillText(v.toFixed(columns.digits), x(v), top + tall + 4);
    }
    draw.textAlign = "right"; draw.textBaseline = "middle";
    for (const v of rows.found) {
      draw.beginPath(); draw.moveTo(left, y(v)); draw.lineTo(left + wide, y(v)); draw.stroke();
      draw.fillText(v.toFixed(rows.digits), left - 5, y(v));
    }
    draw.textAlign = "center"; draw.textBaseline = "top"; draw.fillText("lever θ / °", left + wide / 2, top + tall + 20);
    draw.textAlign = "left"; draw.fillText("torsion φ / °", left, 0);
    draw.strokeStyle = css("--torsion"); draw.lineWidth = 1.6;
    const count = this.points.length;
    for (let part = 0; part < 4; part++) { // what is older is fainter
      draw.globalAlpha = 0.25 + 0.25 * part;
      draw.beginPath();
      for (let i = Math.floor(part * count / 4); i < Math.min(count, Math.floor((part + 1) * count / 4) + 1); i++) {
        draw.lineTo(x(this.points[i][0]), y(this.points[i][1]));
      }
      draw.stroke();
    }
    draw.globalAlpha = 1;
    if (count) {
      draw.fillStyle = css("--torsion");
      draw.beginPath(); draw.arc(x(this.points[count - 1][0]), y(this.points[count - 1][1]), 4, 0, 7); draw.fill();
    }
  }
}
