// The oscilloscope: what of a run is seen, how it is moved through, read and computed with.
//
// It follows the newest samples, which the stream brings, or stands still anywhere between the run's first sample and
// its newest, which come in pieces from the server: as many bins as the screen has columns, whatever is looked at.

import { Bins, Scope, Traces, keep, kept, whenItLooksOtherwise } from "./scope.js";

const PIECES = 64, AT_ONCE = 2, AGAIN_MS = 1000, SHORTEST_S = 0.02, PRE = 0.1, TABLE_MS = 300, SPECTRUM_MS = 1000, KEPT = "sinew-scope";
const $ = (id) => document.getElementById(id);
export const calm = matchMedia("(prefers-reduced-motion: reduce)");
const fixed = (value, digits) => value === undefined || value === null || !Number.isFinite(value) ? "–" : value.toFixed(digits);

// What the server answers; it throws what it says is wrong, in words also where the server has none.
async function read(path) {
  const answer = await fetch(path), said = await answer.json().catch(() => ({ sentence: "it could not be read just now" }));
  if (!answer.ok) throw new Error(said.sentence);
  return said;
}

// Pieces of a run, those that were looked at last. news: is called when one has come.
export class Pieces {
  constructor(name, news) {
    Object.assign(this, { name, news, kept: new Map(), wanted: [], underWay: new Set(), about: null, trouble: "" });
    this.begun = this.reach();
  }

  // What there is of the run; asked again while it is under way.
  async reach() {
    try {
      this.about = await read(`/samples/${this.name}/about`);
      this.trouble = "";
    } catch (error) { this.trouble = String(error.message); }
    this.news();
    return this.about;
  }

  level(bin) { return Math.min(this.about.most_level, Math.max(0, Math.floor(Math.log2(bin * this.about.finest_hz)))); }
  long(level) { return this.about.piece_bins * 2 ** level / this.about.finest_hz; }

  // A piece, or null where it is on its way; one that is not whole is asked for again.
  get(level, number) {
    const key = `${level}/${number}`, piece = this.kept.get(key);
    const isOld = !piece || piece.share < 1 || (piece.isOpen && performance.now() - piece.came > AGAIN_MS);
    if (isOld && !this.underWay.has(key) && !this.wanted.includes(key)) this.wanted.push(key);
    if (piece) { this.kept.delete(key); this.kept.set(key, piece); }
    return piece ?? null;
  }

  // What is seen in the meantime: a piece of wider bins that was kept.
  wider(level, number) {
    for (let up = 1; up < 8; up++) {
      const piece = this.kept.get(`${level + up}/${Math.floor(number / 2 ** up)}`);
      if (piece) return piece;
    }
    return null;
  }

  // Value of a trace at a time, by the narrowest bins that were kept of it; NaN where there are none.
  at(row, time) {
    for (let level = 0; this.about && level <= this.about.most_level; level++) {
      const piece = this.kept.get(`${level}/${Math.floor(time / this.long(level))}`), bins = piece && Bins.of(piece);
      if (!bins?.count) continue;
      const near = Math.min(Math.max(time, bins.time[0]), bins.time[bins.count - 1]); // a piece ends with the middle of a bin
      if (Math.abs(near - time) < 2 ** level / this.about.finest_hz) return bins.at(row, near);
    }
    return NaN;
  }

  ask() {
    while (this.wanted.length && this.underWay.size < AT_ONCE) this.fetch(this.wanted.shift());
    this.wanted.length = 0; // what is still wanted is asked for again
  }

  async fetch(key) {
    this.underWay.add(key);
    const [level, number] = key.split("/").map(Number);
    try {
      const said = await read(`/samples/${this.name}/piece?level=${level}&number=${number}`);
      const rows = (table) => table.map((row) => Float32Array.from(row, (v) => v ?? NaN));
      const low = rows(said.low), isOpen = this.about.is_running && (number + 1) * this.long(level) > said.until_s;
      this.kept.set(key, { time: Float64Array.from(said.time), low, high: said.high ? rows(said.high) : low, share: said.share, isOpen, came: performance.now() });
      if (this.kept.size > PIECES) this.kept.delete(this.kept.keys().next().value);
      this.about.end_s = Math.max(this.about.end_s, said.until_s);
      this.trouble = "";
    } catch (error) {
      this.trouble = String(error.message);
      await new Promise((go) => setTimeout(go, AGAIN_MS));
    }
    this.underWay.delete(key);
    this.news();
  }
}

// Times at which a trace crosses zero upwards, in order, between bins; it must have been below a twentieth of its
// largest value before, so that noise about zero is one crossing.
export function risingZeros(bins, row, first = 0, last = bins.count) {
  const low = bins.low[row], high = bins.high[row], found = [];
  let most = 0, isArmed = false;
  for (let k = first; k < last; k++) most = Math.max(most, Math.abs(low[k] + high[k]) / 2 || 0);
  for (let k = first; k < last; k++) {
    const value = (low[k] + high[k]) / 2;
    if (value < -0.05 * most) isArmed = true;
    if (isArmed && k > first && value >= 0) {
      const before = (low[k - 1] + high[k - 1]) / 2;
      found.push(before < 0 ? bins.time[k - 1] + before / (before - value) * (bins.time[k] - bins.time[k - 1]) : bins.time[k]);
      isArmed = false;
    }
  }
  return found;
}

// Peak to peak of a trace over the time that went before, as long as given: into a row of its own.
function running(bins, row, span) {
  const out = new Float32Array(bins.count), tops = [], floors = [];
  for (let k = 0, first = 0; k < bins.count; k++) {
    while (tops.length && !(bins.high[row][tops.at(-1)] > bins.high[row][k])) tops.pop();
    while (floors.length && !(bins.low[row][floors.at(-1)] < bins.low[row][k])) floors.pop();
    tops.push(k); floors.push(k);
    while (bins.time[k] - bins.time[first] > span) first++;
    while (tops[0] < first) tops.shift();
    while (floors[0] < first) floors.shift();
    out[k] = first > 0 ? bins.high[row][tops[0]] - bins.low[row][floors[0]] : NaN;
  }
  return out;
}

export const MATHS = [
  { key: "gain", label: "gain: torsion over lever, running amplitudes" },
  { key: "x-y", label: "x − y" },
  { key: "x/y", label: "x / y" },
];

// Fills the rows of what is computed. Amplitudes are exact in bins, too; differences and quotients are those of the
// bins' middles.
export function compute(bins, { gain, operation, x, y }) {
  const put = (key, value) => { const row = bins.row(key); for (let k = 0; k < bins.count; k++) bins.low[row][k] = bins.high[row][k] = value(k); };
  const drive = bins.row("drive"), torsion = bins.row("torsion");
  if (gain && drive >= 0 && torsion >= 0 && bins.count > 4) {
    const zeros = risingZeros(bins, drive), steps = zeros.slice(1).map((time, i) => time - zeros[i]).sort((x, y) => x - y);
    const bin = (bins.time[bins.count - 1] - bins.time[0]) / bins.count, period = steps[steps.length >> 1] ?? 0;
    const span = Math.max(period, 4 * bin), over = running(bins, torsion, span), under = running(bins, drive, span);
    let most = 0;
    for (const value of under) if (value > most) most = value;
    put("gain", (k) => under[k] > 0.05 * most && under[k] > 0.5 ? over[k] / under[k] : NaN); // the lever must move
  }
  const rows = [bins.row(x), bins.row(y)];
  if (!operation || rows.includes(-1)) return;
  const middle = (row, k) => (bins.low[row][k] + bins.high[row][k]) / 2;
  if (operation === "x-y") put("x-y", (k) => middle(rows[0], k) - middle(rows[1], k));
  let most = 0;
  for (let k = 0; k < bins.count; k++) most = Math.max(most, Math.abs(middle(rows[1], k)) || 0);
  if (operation === "x/y") put("x/y", (k) => Math.abs(middle(rows[1], k)) > 0.05 * most ? middle(rows[0], k) / middle(rows[1], k) : NaN);
}

// Lines of a rig; each has its colour and its dash, and no two the same.
export const panelsOf = ({ shape: { tendons }, sensors, pose }) => [
  { unit: "angle / °", least: 4, share: 3, lines: [
    { key: "drive_command", colour: "--command", dash: [3, 3] }, { key: "drive", colour: "--drive", dash: [9, 3] }, { key: "torsion", colour: "--torsion", wide: 2 }] },
  { unit: "tilt / °", least: 0.5, share: 1.6, lines: [
    ...(pose ? [{ key: "out_of_plane", colour: "--torsion", dash: [12, 3] }, { key: "in_plane", colour: "--other", dash: [6, 3] }] : []),
    { key: "tilt", colour: "--other", hidden: true }] },
  { unit: "drive current / A", least: 0.2, share: 1.3, lines: [{ key: "drive_current", colour: "--current" }] },
  { unit: "tendon currents / A", least: 0.1, share: 1.3, lines: Array.from({ length: tendons }, (_, i) =>
    ({ key: `tendon_${i + 1}_current`, colour: `--series-${i % 4 + 3}`, dash: [[6, 3], [2, 3], [8, 3, 2, 3], [14, 4]][i % 4] })) },
  ...sensors.map(({ key, label }, i) => ({ unit: label, least: 0.2, share: 1.3, lines: [{ key, colour: "--other", dash: [4, 2, 1 + i, 2] }] })),
  { unit: "gain", least: 0.5, share: 1.3, lines: [{ key: "gain", colour: "--series-2", dash: [12, 3, 3, 3] }] },
  { unit: "x − y", least: 0.2, share: 1.3, lines: [{ key: "x-y", colour: "--series-6", dash: [5, 2] }] },
  { unit: "x / y", least: 0.2, share: 1.3, lines: [{ key: "x/y", colour: "--series-4", dash: [5, 2, 2, 2] }] },
];

export class Oscilloscope {
  // rig: as the server draws it. traces: of the stream, or null where a run has ended. said: is told the time base.
  constructor(traces, told = () => {}) {
    Object.assign(this, { traces, told, base: 5, chosen: 5, isOver: false, follows: traces !== null, isTriggered: false, cursors: null, pieces: null,
      shown: { start: 0, end: 5 }, isFresh: true, maths: { gain: false, operation: "", x: "torsion", y: "drive" }, mark: null, spectrum: null });
    this.pointers = new Map();
    this.recall();
    this.listen();
  }

  // What was chosen on a page before; of what it cannot be, nothing.
  recall() {
    const { base, isTriggered, isRead, isSpectrum, maths, lines } = kept(KEPT, {}), button = (id) => $(id)?.setAttribute("aria-pressed", "true");
    const radio = [...document.querySelectorAll("#sinew-base input")].find((one) => Number(one.value) === base);
    if (radio) { radio.checked = true; this.base = this.chosen = base; this.shown.end = base; }
    if (isTriggered && this.traces) { this.isTriggered = true; button("sinew-trigger"); }
    if (isRead) { this.cursors = [1 / 3, 2 / 3]; button("sinew-cursors"); this.place(); }
    if (isSpectrum) { this.spectrum = { due: 0 }; button("sinew-spectrum"); $("sinew-spectrum-box").hidden = false; }
    const operations = [...$("sinew-operation").options].map((one) => one.value);
    if (maths && operations.includes(maths.operation)) {
      this.maths = { gain: maths.gain === true, operation: maths.operation, x: String(maths.x), y: String(maths.y) };
      $("sinew-gain").checked = this.maths.gain; $("sinew-operation").value = this.maths.operation;
    }
    this.lines = lines && typeof lines === "object" ? lines : {}; // by key, whether it is shown, where somebody said so
  }

  remember() {
    const base = this.chosen;
    const isTriggered = this.traces ? this.isTriggered : kept(KEPT, {}).isTriggered; // a run that has ended has no trigger
    keep(KEPT, { base, isTriggered, isRead: this.cursors !== null, isSpectrum: this.spectrum !== null, maths: this.maths, lines: this.lines });
  }

  // A rig begins: its lines, its legend, its choices.
  begin(rig, name) {
    const keys = rig.traces.map((trace) => trace.key);
    this.rig = rig; this.units = new Map(rig.traces.map((trace) => [trace.key, trace.unit]));
    this.panels = panelsOf(rig);
    this.scope = new Scope($("sinew-scope"), this.panels);
    for (const [key, is] of Object.entries(this.lines)) this.scope.hidden[is ? "delete" : "add"](key);
    this.rows = keys.length;
    if (this.spectrum) this.spectrum = { due: 0 }; // the last one is of other traces
    this.bins = new Bins([...keys, ...MATHS.map((one) => one.key)]);
    this.name(name);
    this.legend();
    this.choices();
    this.see();
  }

  // Of which run the pieces are.
  name(name) {
    if (!name || this.pieces?.name === name) return;
    this.pieces = new Pieces(name, () => { this.isFresh = true; });
  }

  // The stream begins anew, perhaps with another run, or with another clock.
  forget() { this.pieces = null; this.isFresh = true; }

  label(key) { return this.rig.traces.find((trace) => trace.key === key)?.label ?? MATHS.find((one) => one.key === key)?.label ?? key; }
  unit(key) { return this.units.get(key) ?? (key === "x-y" ? this.units.get(this.maths.x) : ""); }
  get end() { return Math.max(this.traces?.newest ?? 0, this.pieces?.about?.end_s ?? 0); }

  legend() {
    $("sinew-legend").replaceChildren();
    for (const line of this.panels.flatMap((panel) => panel.lines)) {
      if (MATHS.some((one) => one.key === line.key)) continue;
      const box = document.createElement("input");
      box.type = "checkbox"; box.checked = !this.scope.hidden.has(line.key);
      box.addEventListener("change", () => { this.scope.hidden[box.checked ? "delete" : "add"](line.key); this.lines[line.key] = box.checked; this.remember(); this.isFresh = true; this.redrawSpectrum(); });
      const value = document.createElement("span"), label = document.createElement("label");
      value.id = `sinew-now-${line.key}`;
      label.append(box, swatch(line), this.label(line.key), value);
      $("sinew-legend").append(label);
    }
  }

  choices() {
    for (const one of ["x", "y"]) {
      const select = $(`sinew-maths-${one}`);
      select.replaceChildren(...this.panels.flatMap((panel) => panel.lines).filter((line) => !MATHS.some((m) => m.key === line.key))
        .map((line) => new Option(this.label(line.key), line.key, false, line.key === this.maths[one])));
      this.maths[one] = select.value;
    }
  }

  listen() {
    const canvas = $("sinew-scope"), on = (id, what, then) => $(id)?.addEventListener(what, (event) => { then(event); this.remember(); });
    on("sinew-base", "change", (event) => { const end = this.shown.end; this.base = this.chosen = Number(event.target.value); this.follows ? this.told() : this.go(end - this.base, end); this.isFresh = true; });
    on("sinew-freeze", "click", () => this.follows ? this.stand() : this.live());
    on("sinew-live", "click", () => this.live());
    on("sinew-first", "click", () => this.go(0, this.base));
    on("sinew-back", "click", () => this.move(-0.5));
    on("sinew-forth", "click", () => this.move(0.5));
    on("sinew-closer", "click", () => this.zoom(0.5));
    on("sinew-wider", "click", () => this.zoom(2));
    on("sinew-whole", "click", () => this.go(0, Math.max(this.end, SHORTEST_S)));
    on("sinew-position", "input", (event) => this.go(Number(event.target.value) - this.base, Number(event.target.value)));
    on("sinew-segment", "change", (event) => { if (event.target.value) this.go(Number(event.target.value), Number(event.target.value) + this.base); });
    on("sinew-trigger", "click", (event) => { this.isTriggered = press(event.target); this.mark = null; if (this.isTriggered && this.traces && !this.follows) this.live(); this.isFresh = true; });
    on("sinew-cursors", "click", (event) => { this.cursors = press(event.target) ? [1 / 3, 2 / 3] : null; this.place(); });
    on("sinew-gain", "change", (event) => { this.maths.gain = event.target.checked; this.see(); });
    on("sinew-operation", "change", (event) => { this.maths.operation = event.target.value; this.see(); });
    for (const one of ["x", "y"]) on(`sinew-maths-${one}`, "change", (event) => { this.maths[one] = event.target.value; this.see(); });
    on("sinew-spectrum", "click", (event) => { this.spectrum = press(event.target) ? { due: 0 } : null; $("sinew-spectrum-box").hidden = !this.spectrum; this.isFresh = true; });
    on("sinew-spectrum-most", "change", () => this.redrawSpectrum());
    on("sinew-cursors-here", "click", () => this.fetchCursors());
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return; // the page scrolls
      event.preventDefault();
      this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.scope.time(event.offsetX));
    }, { passive: false });
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => this.point(event));
    canvas.addEventListener("dblclick", () => this.traces ? this.live() : this.go(0, this.end));
    for (const one of ["a", "b"]) on(`sinew-cursor-${one}`, "input", (event) => { this.cursors[one === "a" ? 0 : 1] = Number(event.target.value); this.place(); });
    whenItLooksOtherwise(canvas, () => { this.isFresh = true; });
    whenItLooksOtherwise($("sinew-spectrum-canvas"), () => this.redrawSpectrum());
  }

  // What is computed is seen where it is asked for.
  see() {
    for (const { key } of MATHS) this.scope.hidden[(key === "gain" ? this.maths.gain : this.maths.operation === key) ? "delete" : "add"](key);
    $("sinew-maths-pair").hidden = !this.maths.operation;
    this.isFresh = true;
  }

  // It stands still where it is.
  stand() { this.go(this.shown.start, this.shown.end); }

  live() {
    this.follows = this.traces !== null; this.base = Math.min(this.base, 60); this.mark = null;
    this.fetchCursors(); // what follows has no time of theirs to come back to
    this.told(); this.tell();
  }

  // Whether the run is over: there is nothing to freeze then.
  over(isOver) { if (isOver !== this.isOver) { this.isOver = isOver; this.tell(); } }

  // It stands still where it is sent to, within the run.
  go(start, end) {
    const most = Math.max(this.end, SHORTEST_S), long = Math.min(Math.max(end - start, SHORTEST_S), Math.max(most, 60));
    const from = Math.max(0, Math.min(start, most - Math.min(long, most)));
    if (this.follows) this.pieces?.reach(); // how far the run has come
    const before = this.shown;
    this.follows = false; this.base = long; this.mark = null;
    this.shown = { start: from, end: from + long };
    this.keep(before);
    this.tell();
  }

  move(share) { const { start, end } = this.shown; this.go(start + share * (end - start), end + share * (end - start)); }

  // about: the time that stays where it is.
  zoom(factor, about = (this.shown.start + this.shown.end) / 2) {
    const { start, end } = this.shown;
    this.go(about - factor * (about - start), about + factor * (end - about));
  }

  tell() {
    const freeze = $("sinew-freeze"), isHeld = !this.follows && !this.isOver;
    if (freeze) {
      freeze.textContent = isHeld ? "Go on" : "Freeze"; freeze.setAttribute("aria-pressed", String(isHeld));
      freeze.disabled = this.isOver; freeze.title = this.isOver ? "The run is over: nothing moves" : "";
    }
    for (const one of document.querySelectorAll("#sinew-base input")) one.checked = Math.abs(Number(one.value) - this.base) < 1e-6;
    this.isFresh = true;
  }

  key(event) {
    const step = event.shiftKey ? 1 : 0.1, steps = { ArrowLeft: () => this.move(-step), ArrowRight: () => this.move(step), "+": () => this.zoom(0.8), "=": () => this.zoom(0.8),
      "-": () => this.zoom(1.25), Home: () => this.go(0, this.base), End: () => this.traces ? this.live() : this.go(this.end - this.base, this.end),
      PageUp: () => this.move(-1), PageDown: () => this.move(1), " ": () => this.isOver ? null : this.follows ? this.stand() : this.live(), c: () => this.fetchCursors() };
    const act = event.ctrlKey || event.altKey || event.metaKey ? null : steps[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (act) { event.preventDefault(); act(); }
  }

  point(event) {
    const canvas = $("sinew-scope"), reach = event.pointerType === "touch" ? 24 : 9;
    if (event.type === "pointerdown") {
      canvas.setPointerCapture(event.pointerId);
      const near = this.cursors?.map((share, i) => [Math.abs(this.scope.x(this.cursorTime(share)) - event.offsetX), i]).sort((p, q) => p[0] - q[0])[0];
      this.held = near && near[0] < reach ? near[1] : null;
      this.pointers.set(event.pointerId, event.offsetX);
    } else if (event.type === "pointermove" && this.pointers.has(event.pointerId)) {
      const before = this.pointers.get(event.pointerId), others = [...this.pointers].filter(([id]) => id !== event.pointerId);
      const share = (this.scope.time(event.offsetX) - this.shown.start) / (this.shown.end - this.shown.start);
      if (others.length) { // two fingers
        const other = others[0][1], was = Math.abs(before - other), is = Math.abs(event.offsetX - other);
        if (was > 8 && is > 8) this.zoom(was / is, this.scope.time(other));
      } else if (this.held !== null) { this.cursors[this.held] = Math.min(1, Math.max(0, share)); this.place(); }
      else if (Math.abs(event.offsetX - before) > (this.follows ? 5 : 0)) {
        const shift = this.scope.time(before) - this.scope.time(event.offsetX);
        this.go(this.shown.start + shift, this.shown.end + shift);
        this.scope.start = this.shown.start; this.scope.end = this.shown.end;
      } else return;
      this.pointers.set(event.pointerId, event.offsetX);
    } else if (event.type !== "pointermove") { this.pointers.delete(event.pointerId); this.held = null; }
  }

  // Cursors keep their place on the screen while it follows, and their time while it stands: both are a share of it.
  cursorTime(share) { return this.shown.start + share * (this.shown.end - this.shown.start); }

  place() {
    $("sinew-cursor-row").hidden = !this.cursors;
    if (this.cursors) $("sinew-values").open = true;
    for (const [i, one] of ["a", "b"].entries()) if (this.cursors) $(`sinew-cursor-${one}`).value = String(this.cursors[i]);
    $("sinew-cursors-here").disabled = !this.isAway;
    this.isFresh = true;
  }

  get isAway() { return Boolean(this.cursors?.some((share) => share < 0 || share > 1)); }

  // Cursors that were left behind come to where the picture is.
  fetchCursors() { if (this.isAway) { this.cursors = [1 / 3, 2 / 3]; this.place(); this.remember(); } }

  // Value of a trace at a time: of what is seen, else of what is kept of the run; what is computed is so of what is seen.
  valueAt(row, time) {
    const { bins, pieces } = this, isSeen = bins.count && bins.time[0] <= time && time <= bins.time[bins.count - 1];
    return isSeen ? bins.at(row, time) : row < this.rows ? pieces?.at(row, time) ?? NaN : NaN;
  }

  // Where the picture is: at the newest sample, or at the last crossing of the lever's zero after which it is filled.
  window() {
    if (!this.follows) return this.shown;
    const end = Math.max(this.base, this.traces.newest);
    this.mark = null;
    if (!this.isTriggered) return { start: end - this.base, end };
    const seen = this.filled(end - 2.2 * this.base, end, true), row = seen.row("drive");
    const zeros = row < 0 ? [] : risingZeros(seen, row), last = zeros.findLast((time) => time <= end - (1 - PRE) * this.base);
    if (last === undefined) return { start: end - this.base, end }; // no crossing: it runs freely
    this.mark = last;
    return { start: last - PRE * this.base, end: last + (1 - PRE) * this.base };
  }

  // Bins of a stretch of time: from the stream's, or from pieces, and what is missing of them.
  filled(start, end, isLive) {
    const { bins, traces, rows } = this, ring = (from, to) => {
      if (traces) for (let k = traces.from(from); k < traces.count; k++) {
        const i = k % traces.time.length;
        if (traces.time[i] > to) break;
        bins.add(traces.time[i], traces.low, traces.high, i, rows);
      }
    };
    bins.clear();
    this.missing = [];
    if (isLive) { ring(start, end); return bins; }
    if (!this.pieces?.about) { ring(start, end); return bins; }
    const level = this.pieces.level((end - start) / this.scope.pixels), long = this.pieces.long(level);
    const last = Math.floor(Math.min(end, Math.max(this.end, 0)) / long);
    for (let number = Math.max(0, Math.floor(start / long)); number <= last; number++) {
      const from = number * long, to = from + long, piece = this.pieces.get(level, number) ?? null, other = piece ?? this.pieces.wider(level, number);
      if (other) for (let k = 0; k < other.time.length; k++) { if (other.time[k] >= from && other.time[k] < to) bins.add(other.time[k], other.low, other.high, k, rows); }
      else ring(from, to - 1e-9);
      if (!piece || piece.share < 1) this.missing.push([piece ? Math.max(from, piece.time.at(-1) ?? from) : from, Math.min(to, this.end)]);
    }
    for (const share of this.isAway ? this.cursors : []) { // they are read where they are
      const time = this.cursorTime(share);
      if (time >= 0 && time < this.end) this.pieces.get(level, Math.floor(time / long));
    }
    this.pieces.ask();
    return bins;
  }

  // Draws what is new; says whether anything was.
  render() {
    const isOpen = !this.follows && (this.traces?.count ?? 0) !== this.drawnCount && this.shown.end > this.end - 1;
    if (!this.isFresh && !isOpen && !(this.follows && this.traces.count !== this.drawnCount) && !this.missing?.length) return false;
    this.isFresh = false;
    this.drawnCount = this.traces?.count ?? 0;
    this.shown = this.window();
    const { start, end } = this.shown, more = this.maths.gain ? Math.min(2, end - start) : 0;
    const bins = this.filled(start - more, end, this.follows);
    if (this.maths.gain || this.maths.operation) compute(bins, this.maths);
    const cursors = (this.cursors ?? []).map((share, i) => ({ time: this.cursorTime(share), name: "AB"[i] }));
    this.scope.render(bins, start, end, { cursors, missing: this.missing, still: !this.follows || this.isOver, mark: this.mark });
    this.read(cursors);
    return true;
  }

  // What is read off it, in words and as a table, a few times a second.
  read(cursors) {
    const now = performance.now();
    if (now - (this.toldAt ?? -TABLE_MS) < TABLE_MS) { this.late ??= setTimeout(() => { this.late = null; this.isFresh = true; }, TABLE_MS); return; }
    this.toldAt = now;
    const { start, end } = this.shown, { bins } = this, lines = this.scope.lines(bins), slider = $("sinew-position");
    const most = Math.max(this.end, this.base);
    Object.assign(slider, { min: String(Math.min(this.base, most)), max: String(most), step: String(this.base / 20), value: String(end) });
    slider.setAttribute("aria-valuetext", `${fixed(start, 2)} to ${fixed(end, 2)} s of ${fixed(this.end, 0)} s`);
    const loading = this.missing.length ? ", older samples are being read" : "";
    put("sinew-where", `${fixed(start, 2)} to ${fixed(end, 2)} s of ${fixed(this.end, 1)} s${loading}${this.pieces?.trouble ? `: ${this.pieces.trouble}` : ""}`
      + (this.isTriggered && this.follows ? this.mark === null ? "; no crossing of the lever's zero, it runs freely" : "; triggered" : ""));
    if (cursors.length) {
      const [a, b] = cursors.map(({ time }) => time), apart = b - a;
      put("sinew-apart", `A ${fixed(a, 4)} s, B ${fixed(b, 4)} s, Δt ${fixed(apart, 4)} s, 1/Δt ${apart ? fixed(1 / Math.abs(apart), 3) : "–"} Hz`);
      for (const [i, one] of ["a", "b"].entries()) {
        $(`sinew-cursor-${one}`).setAttribute("aria-valuetext", `${fixed(cursors[i].time, 4)} s`);
      }
    }
    const rows = lines.map((line) => {
      const row = bins.row(line.key), unit = this.unit(line.key), digits = unit === "A" ? 3 : 2, [low, high] = bins.range(row, start, end);
      const values = cursors.map(({ time }) => this.valueAt(row, time));
      return { line, unit, cells: [bins.newest(row, start, end), low, high, ...values, ...(values.length ? [values[1] - values[0]] : [])].map((v) => fixed(v, digits)) };
    });
    $("sinew-scope").setAttribute("aria-label", `Oscilloscope, ${fixed(start, 1)} to ${fixed(end, 1)} s. `
      + rows.map(({ line, unit, cells }) => `${this.label(line.key)}: ${cells[0]} ${unit}, from ${cells[1]} to ${cells[2]}`).join("; "));
    if ($("sinew-values").open) this.table(rows, cursors.length);
    this.analyse();
  }

  table(rows, isRead) {
    const heads = ["", this.follows && !this.isOver ? "now" : "at the end", "least", "largest", ...(isRead ? ["at A", "at B", "B − A"] : [])];
    const cells = (kind, texts) => { const tr = document.createElement("tr"); tr.append(...texts.map((text, i) => { const cell = document.createElement(i === 0 && kind === "td" ? "th" : kind); if (cell.tagName === "TH") cell.scope = kind === "th" ? "col" : "row"; cell.append(text); return cell; })); return tr; };
    const name = ({ line, unit }) => { const span = document.createElement("span"); span.append(swatch(line), ` ${this.label(line.key)}${unit ? ` / ${unit}` : ""}`); return span; };
    $("sinew-values").querySelector("thead").replaceChildren(cells("th", heads));
    $("sinew-values").querySelector("tbody").replaceChildren(...rows.map((row) => cells("td", [name(row), ...row.cells])));
  }

  // The amplitudes in what is seen, by frequency; the server computes them from all samples.
  async analyse() {
    const { start, end } = this.shown, of = `${start} ${end}`, asked = this.spectrum;
    if (!asked || asked.isAsking || asked.of === of || performance.now() < asked.due || !this.pieces?.about) return;
    asked.isAsking = true; asked.due = performance.now() + SPECTRUM_MS;
    try {
      const answer = await fetch(`/samples/${this.pieces.name}/spectrum?begin=${Math.max(0, start)}&end=${end}`), said = await answer.json();
      if (!answer.ok) throw new Error(said.sentence);
      Object.assign(asked, { of, said });
      this.redrawSpectrum();
    } catch (error) { put("sinew-peaks", String(error.message)); }
    asked.isAsking = false;
    this.isFresh = true;
  }

  redrawSpectrum() { if (this.spectrum?.said) this.drawSpectrum(this.spectrum.said); }

  drawSpectrum({ frequency_hz: frequency, amplitude, resolution_hz, from_s, to_s }) {
    const bins = new Bins(this.bins.keys, frequency.length), none = new Float32Array(frequency.length).fill(NaN);
    const rows = this.bins.keys.map((_, c) => amplitude[c] ?? none);
    frequency.forEach((hz, i) => bins.add(hz, rows, rows, i, rows.length));
    const panels = this.panels.filter((panel) => panel.lines.some((line) => amplitude[bins.row(line.key)]));
    const scope = new Scope($("sinew-spectrum-canvas"), panels, { unit: "Hz", log: true });
    scope.hidden = this.scope.hidden;
    scope.render(bins, 0, Math.min(frequency.at(-1), Number($("sinew-spectrum-most").value)), { still: true, tall: 300 });
    const peaks = scope.lines(bins).filter((line) => amplitude[bins.row(line.key)]).map((line) => {
      const row = amplitude[bins.row(line.key)];
      let best = 1;
      for (let i = 1; i < row.length; i++) if (row[i] > row[best]) best = i;
      return `${this.label(line.key)} ${fixed(row[best], this.unit(line.key) === "A" ? 3 : 2)} ${this.unit(line.key)} at ${fixed(frequency[best], 2)} Hz`;
    });
    put("sinew-peaks", `Largest amplitudes, ${fixed(from_s, 1)} to ${fixed(to_s, 1)} s, lines ${fixed(resolution_hz, 3)} Hz apart: ${peaks.join("; ")}.`);
    $("sinew-spectrum-canvas").setAttribute("aria-label", `Spectrum. ${$("sinew-peaks").textContent}`);
  }

  // Cursors stay where they are in time when what is seen moves.
  keep(before) {
    this.cursors = this.cursors && this.cursors.map((share) => {
      const time = before.start + share * (before.end - before.start);
      return (time - this.shown.start) / (this.shown.end - this.shown.start);
    });
    if (this.cursors) this.place();
  }
}

function press(button) {
  const isPressed = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", String(isPressed));
  return isPressed;
}

function put(id, text) { const place = $(id); if (place && place.textContent !== text) place.textContent = text; }

// A line's colour and dash beside its name.
export function swatch({ colour, dash }) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), line = document.createElementNS(svg.namespaceURI, "line");
  svg.setAttribute("class", "sinew-swatch"); svg.setAttribute("aria-hidden", "true"); svg.setAttribute("viewBox", "0 0 30 6");
  for (const [name, value] of Object.entries({ x1: 0, x2: 30, y1: 3, y2: 3, "stroke-width": 2.5, stroke: `var(${colour})`, "stroke-dasharray": (dash ?? []).join(" ") })) line.setAttribute(name, value);
  svg.append(line);
  return svg;
}
