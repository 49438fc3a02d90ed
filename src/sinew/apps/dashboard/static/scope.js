// What is drawn over time: panels over one axis, least and largest value of each column; and one trace over another.

const CAPACITY = 12000;
const colours = new Map();
setInterval(() => colours.clear(), 500); // the theme may change; asking the style sheet for every line is slow

export function css(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.body).getPropertyValue(name).trim());
  return colours.get(name);
}

// What this browser remembers from page to page.
export function kept(name, otherwise) { try { return JSON.parse(localStorage.getItem(name)) ?? otherwise; } catch { return otherwise; } }
export function keep(name, value) { try { localStorage.setItem(name, JSON.stringify(value)); } catch { /* storage is off */ } }

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

// Widths of canvases as they were laid out last: to ask the page for one lays it out anew, and costs as much as all lines.
const widths = new WeakMap();
const laidOut = new ResizeObserver((all) => { for (const { target } of all) widths.set(target, target.clientWidth); });

function widthOf(canvas) {
  if (!widths.has(canvas)) { widths.set(canvas, canvas.clientWidth); laidOut.observe(canvas); }
  return widths.get(canvas) || 300;
}

export function sized(canvas, height) {
  const ratio = Math.min(2, devicePixelRatio || 1), width = widthOf(canvas);
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

// Calls what draws a canvas where that has another width, or the theme other colours: some that stand still are drawn
// for nothing else.
export function whenItLooksOtherwise(canvas, then) {
  new ResizeObserver(then).observe(canvas);
  new MutationObserver(() => setTimeout(then, 600)).observe(document.body, { attributes: true, attributeFilter: ["class"] });
}

// Draws a path as wide as asked by hairlines beside one another: without a graphics card eight wide lines of 1200 points
// take 13 ms, plain or dashed; hairlines take 1 and 2 ms.
function stroke(draw, path, wide) {
  const ratio = draw.getTransform().a, times = Math.max(1, Math.ceil(wide));
  draw.lineWidth = 1 / ratio;
  for (let k = 0; k < times; k++) {
    const up = times > 1 ? (k / (times - 1) - 0.5) * (wide - 1) : 0;
    draw.translate(0, up); draw.stroke(path); draw.translate(0, -up);
  }
}

// Steps of 1, 2 or 5 times a power of ten, about so many in a range, and two at least: from one tick no size is read.
export function ticks(low, high, about) {
  const raw = (high - low) / about, power = 10 ** Math.floor(Math.log10(raw));
  const steps = [0.2, 0.5, 1, 2, 5, 10].map((x) => x * power);
  let found = [], k = steps.findIndex((x) => x >= raw);
  for (; k >= 0 && found.length < 2; k--) {
    found = [];
    for (let i = Math.ceil(low / steps[k] - 1e-9); i * steps[k] <= high + 1e-9 * steps[k]; i++) found.push(i * steps[k]);
  }
  return { found, digits: Math.max(0, -Math.floor(Math.log10(steps[k + 1]) + 1e-9)) };
}

// The same of decades: 1, 2 and 5 of each where there is but one power of ten.
function decades(low, high, about) {
  const whole = ticks(low, high, about).found.filter((at) => at % 1 === 0);
  if (whole.length > 1) return whole;
  const found = [];
  for (let power = Math.floor(low); power <= high; power++) found.push(...[1, 2, 5].map((x) => power + Math.log10(x)));
  return found.filter((at) => at >= low && at <= high);
}

// Ranges follow what is shown: out at once, in slowly, so that the axis does not flicker; at once where it stands still.
class Range {
  constructor(least) { this.least = least; this.high = 0.58 * least; this.low = -this.high; }
  follow(low, high, atOnce = false) {
    if (!Number.isFinite(low)) return;
    const span = Math.max(high - low, this.least), middle = (high + low) / 2;
    const wantLow = middle - 0.58 * span, wantHigh = middle + 0.58 * span;
    this.low = atOnce || wantLow < this.low ? wantLow : this.low + 0.03 * (wantLow - this.low);
    this.high = atOnce || wantHigh > this.high ? wantHigh : this.high + 0.03 * (wantHigh - this.high);
  }
}

const LEFT = 50, RIGHT = 8, GAP = 12, BOTTOM = 22, FLOOR = 1e-5, FLAT = 0.7, LINE = 11;

// What is seen of a run at once: least and largest value of each trace in bins that follow one another. Rows beyond
// those of the run are computed here.
export class Bins {
  constructor(keys, capacity = 8192) {
    this.keys = keys; this.capacity = capacity; this.count = 0;
    this.time = new Float64Array(capacity);
    this.low = keys.map(() => new Float32Array(capacity));
    this.high = keys.map(() => new Float32Array(capacity));
  }

  static of({ time, low, high }) { return Object.assign(new Bins([], 0), { time, low, high, count: time.length }); }

  clear() { this.count = 0; }

  add(time, low, high, i, rows) {
    if (this.count === this.capacity) return;
    this.time[this.count] = time;
    for (let c = 0; c < rows; c++) { this.low[c][this.count] = low[c][i]; this.high[c][this.count] = high[c][i]; }
    this.count++;
  }

  row(key) { return this.keys.indexOf(key); }

  // Number of the first bin at or after a time.
  from(time) {
    let low = 0, high = this.count;
    while (low < high) { const middle = (low + high) >> 1; if (this.time[middle] < time) low = middle + 1; else high = middle; }
    return low;
  }

  // Value of a trace at a time, between the middles of two bins; NaN outside and where there is none.
  at(row, time) {
    const k = this.from(time), middle = (i) => (this.low[row][i] + this.high[row][i]) / 2;
    if (k < this.count && this.time[k] === time) return middle(k);
    if (k === 0 || k === this.count) return NaN;
    const share = (time - this.time[k - 1]) / (this.time[k] - this.time[k - 1]);
    return middle(k - 1) + share * (middle(k) - middle(k - 1));
  }

  // Newest value of a trace between two times; NaN where there is none.
  newest(row, start, end) {
    let k = Math.min(this.count - 1, this.from(end));
    if (k >= 0 && this.time[k] > end) k--;
    return k >= 0 && this.time[k] >= start ? (this.low[row][k] + this.high[row][k]) / 2 : NaN;
  }

  // Least and largest value of a trace between two times.
  range(row, start, end) {
    let low = Infinity, high = -Infinity;
    for (let k = this.from(start); k < this.count && this.time[k] <= end; k++) {
      if (this.low[row][k] < low) low = this.low[row][k];
      if (this.high[row][k] > high) high = this.high[row][k];
    }
    return [low, high];
  }
}

export class Scope {
  // panels: [{unit, least, share, lines: [{key, colour, dash}]}]. log: whether values are drawn by their decades.
  constructor(canvas, panels, { unit = "s", log = false } = {}) {
    this.canvas = canvas; this.unit = unit; this.log = log;
    this.panels = panels.map((panel) => ({ ...panel, range: new Range(log ? 1 : panel.least) }));
    this.hidden = new Set(panels.flatMap((panel) => panel.lines).filter((line) => line.hidden).map((line) => line.key));
  }

  get width() { return widthOf(this.canvas) - LEFT - RIGHT; }
  get pixels() { return Math.max(50, Math.round(this.width)); }
  x(time) { return LEFT + (time - this.start) / (this.end - this.start) * this.width; }
  time(x) { return this.start + (x - LEFT) / this.width * (this.end - this.start); }

  // Lines that are shown, of the traces that there are.
  lines(bins) {
    return this.panels.flatMap((panel) => panel.lines).filter((line) => !this.hidden.has(line.key) && bins.row(line.key) >= 0);
  }

  // cursors: [{time, name}]; missing: [[from, to]], which is on its way; still: whether the picture stands; mark: a time.
  render(bins, start, end, { cursors = [], missing = [], still = false, mark = null, tall = innerWidth < 900 ? 300 : 400 } = {}) {
    const { draw, width, height } = sized(this.canvas, tall);
    Object.assign(this, { start, end });
    const panels = this.panels.map((panel) => ({ panel, shown: panel.lines.filter((line) => !this.hidden.has(line.key) && bins.row(line.key) >= 0) }))
      .filter(({ shown }) => shown.length);
    const shares = panels.reduce((sum, { panel }) => sum + panel.share, 0), ink = css("--soft");
    const room = height - BOTTOM - GAP * Math.max(0, panels.length - 1) - 4, axis = ticks(start, end, Math.max(3, width / 110));
    let top = 4;
    draw.fillStyle = css("--grid");
    for (const [from, to] of missing) {
      const left = Math.max(LEFT, this.x(from)), right = Math.min(width - RIGHT, this.x(to));
      if (right > left) draw.fillRect(left, top, right - left, height - BOTTOM - top);
    }
    for (const { panel, shown } of panels) {
      const high = room * panel.share / shares;
      this.panel(draw, bins, panel, shown, { top, tall: high, width, ink, axis, still });
      top += high + GAP;
    }
    draw.fillStyle = ink; draw.textAlign = "center"; draw.textBaseline = "top";
    for (const time of axis.found) if (time >= -1e-9) {
      const across = Math.min(width - 24, Math.max(LEFT - 20, this.x(time)));
      draw.fillText(`${time.toFixed(axis.digits)} ${this.unit}`, across, height - BOTTOM + 6);
    }
    if (mark !== null) { // where the trigger is
      draw.fillStyle = css("--drive");
      draw.beginPath(); draw.moveTo(this.x(mark) - 5, height - BOTTOM + 5); draw.lineTo(this.x(mark) + 5, height - BOTTOM + 5);
      draw.lineTo(this.x(mark), height - BOTTOM - 4); draw.fill();
    }
    for (const { time, name } of cursors) {
      const across = this.x(time);
      if (across < LEFT || across > width - RIGHT) continue;
      draw.strokeStyle = draw.fillStyle = css("--accent"); draw.lineWidth = 1.5; draw.setLineDash(name === "A" ? [] : [6, 4]);
      draw.beginPath(); draw.moveTo(across, 2); draw.lineTo(across, height - BOTTOM); draw.stroke(); draw.setLineDash([]);
      draw.fillRect(across - 8, 0, 16, 15);
      draw.fillStyle = css("--card"); draw.textAlign = "center"; draw.textBaseline = "top"; draw.fillText(name, across, 2);
    }
  }

  panel(draw, bins, panel, shown, { top, tall, width, ink, axis, still }) {
    const value = this.log ? (v) => Math.log10(Math.max(v, FLOOR)) : (v) => v;
    const first = Math.max(0, bins.from(this.start) - 1), last = Math.min(bins.count, bins.from(this.end) + 1);
    let low = Infinity, high = -Infinity;
    for (const { key } of shown) {
      const [a, b] = bins.range(bins.row(key), this.start, this.end);
      low = Math.min(low, a); high = Math.max(high, b);
    }
    if (this.log && high > 0) { high = value(high); low = Math.max(value(low), high - 4); }
    panel.range.follow(low, high, still);
    const range = panel.range, scale = tall / (range.high - range.low), y = (v) => top + tall - (value(v) - range.low) * scale;
    draw.strokeStyle = css("--grid"); draw.fillStyle = ink; draw.lineWidth = 1; draw.setLineDash([]);
    draw.textAlign = "right"; draw.textBaseline = "middle";
    const about = Math.max(2, tall / 38), { found, digits } = this.log ? { found: decades(range.low, range.high, about) } : ticks(range.low, range.high, about);
    const inWords = (at) => !this.log ? at.toFixed(digits) : at < -2 ? (10 ** at).toExponential(0) : String(Number((10 ** at).toPrecision(1)));
    draw.beginPath();
    let written = Infinity;
    for (const at of found) {
      const up = top + tall - (at - range.low) * scale;
      draw.moveTo(LEFT, up); draw.lineTo(width - RIGHT, up);
      if (written - up < LINE) continue; // it would be written over the one below
      written = up;
      draw.fillText(inWords(at), LEFT - 6, up);
    }
    for (const time of axis.found) { draw.moveTo(this.x(time), top); draw.lineTo(this.x(time), top + tall); }
    draw.stroke();
    draw.save(); draw.beginPath(); draw.rect(LEFT, top - 2, width - LEFT - RIGHT, tall + 4); draw.clip();
    const hole = this.log ? Infinity : Math.max(0.06, 4 * (this.end - this.start) / this.pixels), across = this.width / (this.end - this.start);
    for (const { key, colour, dash, wide } of shown) {
      const lows = bins.low[bins.row(key)], highs = bins.high[bins.row(key)];
      const path = new Path2D();
      draw.strokeStyle = css(colour); draw.setLineDash(dash ?? []);
      let open = false, before = -Infinity, up = 0;
      for (let k = first; k < last; k++) {
        const a = lows[k], b = highs[k], time = bins.time[k];
        if (Number.isNaN(a) || Number.isNaN(b)) { open = false; continue; }
        const at = LEFT + (time - this.start) * across, joins = open && time - before < hole;
        let near = y(a), far = y(b);
        if (near - far < FLAT) near = far = (near + far) / 2;
        else if (joins && Math.abs(far - up) < Math.abs(near - up)) [near, far] = [far, near]; // no way back
        if (joins) path.lineTo(at, near); else path.moveTo(at, near);
        if (far !== near) path.lineTo(at, far);
        open = true; before = time; up = far;
      }
      stroke(draw, path, wide ?? 1.6);
    }
    draw.restore();
    draw.setLineDash([]); draw.textAlign = "left"; draw.textBaseline = "top";
    const wide = draw.measureText(panel.unit).width;
    draw.fillStyle = css("--card"); draw.globalAlpha = 0.75; draw.fillRect(LEFT + 2, top, wide + 5, 14); draw.globalAlpha = 1;
    draw.fillStyle = ink; draw.fillText(panel.unit, LEFT + 4, top + 1);
  }
}

export class Lissajous {
  constructor(canvas) {
    Object.assign(this, { canvas, points: [], across: new Range(4), up: new Range(4), isFresh: true });
    whenItLooksOtherwise(canvas, () => { this.isFresh = true; });
  }

  reset() { this.points = []; this.isFresh = true; }

  put([drive, torsion]) {
    for (let i = 0; i < drive.length; i++) if (drive[i] !== null && torsion[i] !== null) this.points.push([drive[i], torsion[i]]);
    if (this.points.length > 400) this.points.splice(0, this.points.length - 400);
    this.isFresh = true;
  }

  render() {
    this.isFresh = false;
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
    draw.strokeStyle = css("--torsion");
    const count = this.points.length;
    for (let part = 0; part < 4; part++) { // what is older is fainter
      draw.globalAlpha = 0.25 + 0.25 * part;
      const path = new Path2D();
      for (let i = Math.floor(part * count / 4); i < Math.min(count, Math.floor((part + 1) * count / 4) + 1); i++) {
        path.lineTo(x(this.points[i][0]), y(this.points[i][1]));
      }
      stroke(draw, path, 1.6);
    }
    draw.globalAlpha = 1;
    if (count) {
      draw.fillStyle = css("--torsion");
      draw.beginPath(); draw.arc(x(this.points[count - 1][0]), y(this.points[count - 1][1]), 4, 0, 7); draw.fill();
    }
  }
}
