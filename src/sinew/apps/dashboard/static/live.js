// The live page: frames from the web socket, drawn 25 to 30 times a second, and grey with their age when they are old.

import { Scope, Lissajous, Traces } from "./scope.js";
import { Joint } from "./joint.js";
import * as alarms from "./alarms.js";

const FRAME_MS = 1000 / 30, RETRY_MS = 1500, FRESH_S = 2;
const given = JSON.parse(document.getElementById("sinew-live").textContent);
const $ = (id) => document.getElementById(id);
const traces = new Traces();
let scope, lissajous, joint, scene, rig, base = 5, paused = false, shownEnd = 0, now = [], tensions = [], state = null, told = 0, socket = null;
let drawn = 0, drawnSince = performance.now();

const PANELS = ({ shape: { tendons }, sensors, pose }) => [
  { unit: "angle / °", least: 4, share: 3, lines: [
    { key: "drive_command", colour: "--command", dash: [5, 4] }, { key: "drive", colour: "--drive" }, { key: "torsion", colour: "--torsion" }] },
  ...(pose ? [{ unit: "tilt / °", least: 0.5, share: 1.6, lines: [
    { key: "out_of_plane", colour: "--torsion" }, { key: "in_plane", colour: "--other", dash: [6, 3] }] }] : []),
  { unit: "drive current / A", least: 0.2, share: 1.3, lines: [{ key: "drive_current", colour: "--current" }] },
  { unit: "tendon currents / A", least: 0.1, share: 1.3, lines: Array.from({ length: tendons }, (_, i) =>
    ({ key: `tendon_${i + 1}_current`, colour: ["--torsion", "--other", "--drive", "--current"][i % 4], dash: [null, [6, 3], [2, 3], [8, 3, 2, 3]][i % 4] })) },
  ...sensors.map(({ key, label }) => ({ unit: label, least: 0.2, share: 1.3, lines: [{ key, colour: "--other" }] })),
];

function ready() { return ["sinew-scope", "sinew-lissajous", "sinew-legend", "sinew-log", "sinew-severity"].every($); }

async function begin() {
  for (let i = 0; i < 200 && !ready(); i++) await new Promise((go) => setTimeout(go, 50));
  lissajous = new Lissajous($("sinew-lissajous"));
  $("sinew-base").addEventListener("change", (event) => { base = Number(event.target.value); tell(); });
  setInterval(age, 250);
  alarms.begin();
  $("sinew-freeze").addEventListener("click", (event) => {
    paused = !paused; shownEnd = traces.newest;
    event.target.textContent = paused ? "Go on" : "Freeze";
    event.target.setAttribute("aria-pressed", String(paused));
  });
  await show(given.rig);
  connect();
  draw(0);
  for (let i = 0; i < 200 && !window.getElement?.(given.scene)?.renderer; i++) await new Promise((go) => setTimeout(go, 50));
  scene = window.getElement?.(given.scene);
  await build();
}

// A run may be of another rig than the one that is offered first.
async function show(drawn) {
  rig = drawn;
  scope = new Scope($("sinew-scope"), PANELS(rig));
  put("sinew-tension-limit", String(rig.tension_limit_n));
  $("sinew-legend").replaceChildren();
  legend();
  await build();
}

async function build() {
  if (!scene?.renderer) return;
  joint?.remove();
  joint = await Joint.build(scene, rig.shape);
}

function legend() {
  for (const panel of scope.panels) for (const line of panel.lines) {
    const box = document.createElement("input");
    box.type = "checkbox"; box.checked = true;
    box.addEventListener("change", () => { box.checked ? scope.hidden.delete(line.key) : scope.hidden.add(line.key); });
    const swatch = document.createElement("span");
    swatch.className = "sinew-swatch";
    swatch.style.borderTopColor = `var(${line.colour})`;
    if (line.dash) swatch.style.borderTopStyle = line.dash[0] < 4 ? "dotted" : "dashed";
    const value = document.createElement("span");
    value.id = `sinew-now-${line.key}`;
    const label = document.createElement("label");
    label.append(box, swatch, rig.labels[line.key], value);
    $("sinew-legend").append(label);
  }
}

function tell() {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ base_s: base, pixels: scope.pixels }));
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream`);
  socket.onopen = () => { document.body.dataset.stream = "open"; tell(); };
  socket.onmessage = (event) => {
    const frame = JSON.parse(event.data);
    if (frame.kind === "samples") take(frame); else { state = frame; told = performance.now(); describe(); age(); alarms.take(state, isOfNow(), rig); }
  };
  socket.onclose = () => {
    document.body.dataset.stream = "closed";
    for (const key of ["trouble", "steward", "quiet"]) notice(key); // of what it told there is nothing newer
    setTimeout(connect, RETRY_MS);
  };
}

function take(frame) {
  if (frame.reset) { traces.reset(frame.traces); lissajous.reset(); shownEnd = 0; if (JSON.stringify(frame.rig) !== JSON.stringify(rig)) show(frame.rig); }
  traces.put(frame);
  lissajous.put(frame.points);
  if (frame.now.length) now = frame.now;
  tensions = frame.tension_n;
  document.body.dataset.samples = traces.count;
}

function draw(at) {
  requestAnimationFrame(draw);
  if (at - (draw.last ?? -FRAME_MS) < FRAME_MS - 2) return;
  draw.last = at;
  if (!paused) shownEnd = traces.newest;
  scope.render(traces, base, Math.max(base, shownEnd));
  lissajous.render();
  const value = (key) => now[traces.traces.findIndex((t) => t.key === key)] ?? 0;
  const most = Math.max(rig.tension_limit_n, 1), radians = (key) => value(key) * Math.PI / 180;
  joint?.pose(radians("torsion"), radians("drive"), tensions.map((t) => (t ?? 0) / most), [radians("pitch"), radians("roll")],
    value("shortening") / rig.length_mm);
  drawn++;
  if (at - drawnSince > 1000) {
    document.body.dataset.fps = (1000 * drawn / (at - drawnSince)).toFixed(1);
    drawn = 0; drawnSince = at;
    numbers();
  }
}

const fixed = (value, digits, unit) => value === null || value === undefined || Number.isNaN(value) ? "–" : `${value.toFixed(digits)}${unit}`;

function numbers() {
  traces.traces.forEach((trace, i) => {
    const place = $(`sinew-now-${trace.key}`);
    if (place) place.textContent = fixed(now[i], trace.unit === "A" ? 3 : 1, ` ${trace.unit}`);
  });
}

function put(id, text) { const place = $(id); if (place && place.textContent !== text) place.textContent = text; }
const clock = (seconds) => window.Sinew.clock(seconds);
const notice = (...all) => window.Sinew?.notice(...all);

// How old the newest sample is [s]; null where that is not known. Between two frames it goes on by this page's clock.
function ageOfValues() {
  const age = state?.live?.age_s;
  return age === null || age === undefined ? null : age + (performance.now() - told) / 1000;
}

function isOfNow() {
  const live = state?.live, run = state?.steward?.run, old = ageOfValues();
  return Boolean(live && run && run.name === live.name && old !== null && old < FRESH_S && socket?.readyState === WebSocket.OPEN);
}

// What is not of now must not look as if it were.
function age() {
  const live = state?.live, run = state?.steward?.run, old = ageOfValues(), isNow = isOfNow();
  const isStale = Boolean(live) && !isNow, text = !isStale ? "" : old === null ? "from before" : `${clock(old)} ago`;
  document.body.dataset.stale = String(isStale);
  for (const card of document.querySelectorAll(".sinew-live")) {
    card.classList.toggle("stale", isStale);
    const place = card.querySelector(".sinew-age");
    if (place && place.textContent !== text) place.textContent = text;
  }
  const isQuiet = isStale && socket?.readyState === WebSocket.OPEN && run && run.name === live.name && old !== null && ["running", "paused", "pausing"].includes(run.state);
  notice("quiet", isQuiet ? "bad" : null, { title: "No samples come from the bench", lines: ["What is shown is old. The run may hang: see to the bench, and end the run."] });
}

const DOING = { settle: "settling", steady: "recording", "ring-down": "free decay", idle: "at rest", pause: "pausing", tracking: "tracking" };

function describe() {
  const live = state.live, run = state.steward?.run, health = live?.health ?? {}, segment = live?.segment;
  notice("trouble", state.trouble ? "bad" : null, { title: "The run cannot be followed", lines: [state.trouble] });
  notice("steward", state.steward === null ? "bad" : null, { title: "The steward does not answer", lines: ["What is shown may be old."] });
  notice("doubts", live?.doubts?.length ? "warn" : null, { title: "The measurement contradicts itself", lines: live?.doubts ?? [] });
  put("sinew-source", !live ? "–" : live.source ?? (state.steward?.bench?.kind === "emulator" ? "the emulated bench, not a real joint" : "the bench"));
  const begins = run && run.name !== live?.name;
  $("sinew-nothing")?.toggleAttribute("hidden", Boolean(live) && !begins);
  if (begins) put("sinew-nothing-yet", `What ${run.name} measures appears here as it comes.`);
  put("sinew-run", live ? live.name : "–");
  put("sinew-doing", !live ? "–" : !run ? "ended" : run.state === "finishing" ? "the recording is written" : run.state === "paused" ? "paused" : health.state && health.state !== "running" ? health.state
    : segment?.state === "running" ? DOING[segment.kind] ?? segment.kind : "between segments");
  put("sinew-at", !segment ? "–" : [fixed(segment.pretension_mm, 1, " mm"), segment.frequency_hz === null ? null : fixed(segment.frequency_hz, 2, " Hz"),
    segment.amplitude_deg === null ? null : fixed(segment.amplitude_deg, 1, "°"), rig.pose].filter(Boolean).join(", "));
  const bar = $("sinew-progress");
  if (bar && live) {
    const bySeconds = run && health.total_s; // what was begun and not ended is not recorded
    bar.max = Math.max(1, bySeconds ? health.total_s : live.groups); bar.value = bySeconds ? health.done_s : live.groups_done;
    put("sinew-progress-text", `${live.groups_done} of ${live.groups} segments`
      + (run && health.total_s ? `, about ${clock(health.total_s - health.done_s)} left` : ""));
  }
  put("sinew-tilt", fixed(now[traces.traces.findIndex((t) => t.key === "tilt")], 2, "°"));
  put("sinew-tension", tensions.length ? tensions.map((t) => fixed(t, 0, "")).join(" / ") + " N" : "–");
  const temperatures = Object.entries(health.temperature_c ?? {});
  put("sinew-temperature", temperatures.length ? temperatures.map(([name, t]) => `${name.replace("tendon ", "T")} ${fixed(t, 0, "")}`).join(", ") + " °C" : "–");
  put("sinew-supply", fixed(health.supply_v, 1, " V"));
  put("sinew-cycles", health.cycles === undefined ? "–" : `${health.cycles}, ${health.missed} missed, ${health.incomplete} incomplete`);
  put("sinew-late", fixed(health.worst_late_ms, 1, " ms"));
  const bus = health.bus ?? {};
  const told = ["transactions", "retries", "silent", "damaged", "crc_errors", "alerts"].filter((name) => name in bus);
  put("sinew-bus", told.map((name) => `${bus[name]} ${name.replaceAll("_", " ")}`).join(", ") || "–");
}

begin();
