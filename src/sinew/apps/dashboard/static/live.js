// The live page: frames from the web socket, each drawn once, some 30 a second, and grey with their age when they are old.

import { Lissajous, Traces } from "./scope.js";
import { Oscilloscope, calm } from "./oscilloscope.js";
import { JointView } from "./joint.js";
import * as alarms from "./alarms.js";

const FRAME_MS = () => calm.matches ? 500 : 1000 / 34, RETRY_MS = 1500, FRESH_S = 2;
const given = JSON.parse(document.getElementById("sinew-live").textContent);
const $ = (id) => document.getElementById(id);
const traces = new Traces();
let scope, lissajous, joint, rig, now = [], tensions = [], state = null, told = 0, socket = null;
let drawn = 0, drawnSince = performance.now();

function ready() { return ["sinew-scope", "sinew-lissajous", "sinew-legend", "sinew-log", "sinew-severity"].every($); }

async function begin() {
  for (let i = 0; i < 200 && !ready(); i++) await new Promise((go) => setTimeout(go, 50));
  lissajous = new Lissajous($("sinew-lissajous"));
  scope = new Oscilloscope(traces, tell);
  window.SinewScope = scope;
  setInterval(age, 250);
  alarms.begin();
  await show(given.rig);
  connect();
  draw(0);
  for (let i = 0; i < 200 && !window.getElement?.(given.scene)?.renderer; i++) await new Promise((go) => setTimeout(go, 50));
  const scene = window.getElement?.(given.scene);
  if (scene?.renderer) { joint = new JointView(scene, traces, given.eye); await joint.show(rig); }
}

// A run may be of another rig than the one that is offered first.
async function show(drawn) {
  rig = drawn;
  scope.begin(rig, state?.live?.name);
  put("sinew-tension-limit", String(rig.tension_limit_n));
  await joint?.show(rig);
}

function tell() {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ base_s: scope.base, pixels: scope.scope.pixels }));
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
  if (frame.reset) { scope.forget(); traces.reset(frame.traces); lissajous.reset(); now = []; if (JSON.stringify(frame.rig) !== JSON.stringify(rig)) show(frame.rig); }
  traces.put(frame);
  lissajous.put(frame.points);
  if (frame.now.length) now = frame.now;
  tensions = frame.tension_n;
  document.body.dataset.samples = traces.count;
}

// A frame that comes late is drawn when it comes, and the next one at its time: none is left out to keep in step.
function draw(at) {
  requestAnimationFrame(draw);
  const late = at - (draw.due ?? 0), isDue = late > -4, isDrawn = isDue && scope.render(), isNews = isDue && lissajous.isFresh;
  if (isDrawn) drawn++;
  if (isNews) lissajous.render();
  if (isDrawn || isNews || late > FRAME_MS()) { joint?.move(now, at); draw.due = Math.max(at, (draw.due ?? 0) + FRAME_MS()); }
  joint?.paint(at, isDue);
  if (at - drawnSince > 1000) {
    const rate = 1000 * drawn / (at - drawnSince);
    document.body.dataset.fps = rate.toFixed(1);
    if (drawn && !calm.matches) joint?.yieldTo(rate);
    drawn = 0; drawnSince = at;
    numbers();
  }
}

const fixed = (value, digits, unit) => value === null || value === undefined || Number.isNaN(value) ? "–" : `${value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1")}${unit}`;

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

// Whether all samples of the run that is seen have come. Its traces are what it measured then, and keep their colours.
function isOver() {
  const { live, steward } = state ?? {}, run = steward?.run;
  return Boolean(live && steward && (!run || run.name !== live.name || run.state === "finishing") && socket?.readyState === WebSocket.OPEN);
}

// What is not of now must not look as if it were.
function age() {
  const live = state?.live, run = state?.steward?.run, old = ageOfValues(), isNow = isOfNow();
  const isStale = Boolean(live) && !isNow, text = !isStale ? "" : old === null ? "from before" : `${clock(old)} ago`;
  // Of a run that is over the bench has left what it showed last: after a release there is no tension any more.
  const { last, emergency } = state?.steward ?? {}, ends = [last?.sentence, emergency?.at >= last?.started ? emergency.sentence : ""];
  const kind = !isStale || run ? "" : /let down|torque off/.test(ends.join()) ? "last sample, before the release" : "last sample";
  document.body.dataset.stale = String(isStale);
  scope.over(isOver());
  for (const card of document.querySelectorAll(".sinew-live")) {
    card.classList.toggle("stale", isStale);
    card.classList.toggle("over", isStale && isOver());
    for (const [part, said] of [[".sinew-age", text], [".sinew-last", kind]]) {
      const place = card.querySelector(part);
      if (place && place.textContent !== said) place.textContent = said;
    }
  }
  // Only what the pages' server says of now counts: where it says nothing, its silence is not the bench's.
  const isHeard = socket?.readyState === WebSocket.OPEN && performance.now() - told < 1000 * FRESH_S;
  const isQuiet = isHeard && run && run.name === live?.name && live.silent_s > FRESH_S && ["running", "paused", "pausing"].includes(run.state);
  notice("quiet", isQuiet ? "bad" : null, { title: "No samples come from the bench", lines: ["What is shown is old. The run may hang: see to the bench, and end the run."] });
}

const DOING = { settle: "settling", steady: "recording", "ring-down": "free decay", idle: "at rest", pause: "pausing", tracking: "tracking" };

function describe() {
  const live = state.live, run = state.steward?.run, health = live?.health ?? {}, segment = live?.segment;
  notice("trouble", state.trouble ? "bad" : null, { title: "The run cannot be followed", lines: [state.trouble] });
  notice("steward", state.steward === null ? "bad" : null, { title: "The steward does not answer", lines: ["What is shown may be old."] });
  notice("doubts", live?.doubts?.length ? "warn" : null, { title: "The measurement contradicts itself", lines: live?.doubts ?? [] });
  scope.name(live?.name);
  const source = live?.source ?? (state.steward?.bench?.kind === "emulator" ? "emulator" : "the bench");
  put("sinew-source", !live ? "–" : source === "emulator" ? "the emulated bench, not a real joint" : source);
  const begins = run && run.name !== live?.name;
  $("sinew-nothing")?.toggleAttribute("hidden", Boolean(live) && !begins);
  if (begins) put("sinew-nothing-yet", `What ${run.name} measures appears here as it comes.`);
  $("sinew-steps")?.toggleAttribute("hidden", Boolean(begins));
  put("sinew-run", begins ? run.name : live ? live.name : "–");
  put("sinew-doing", begins ? "its plan is tried on the twin" : !live ? "–" : !run ? "ended" : run.state === "finishing" ? "the recording is written" : run.state === "paused" ? "paused" : health.state && health.state !== "running" ? health.state
    : segment?.state === "running" ? DOING[segment.kind] ?? segment.kind : "between segments");
  put("sinew-at", !segment || begins ? "–" : [fixed(segment.pretension_mm, 1, " mm"), segment.frequency_hz === null ? null : fixed(segment.frequency_hz, 2, " Hz"),
    segment.amplitude_deg === null ? null : fixed(segment.amplitude_deg, 1, "°"), rig.pose].filter(Boolean).join(", "));
  const bar = $("sinew-progress");
  if (bar && begins) {
    bar.value = 0;
    put("sinew-progress-text", `for ${clock(state.steward.time_s - run.started)} so far; nothing moves yet`);
  } else if (bar && live) {
    const bySeconds = run && health.total_s; // what was begun and not ended is not recorded
    bar.max = Math.max(1, bySeconds ? health.total_s : live.groups); bar.value = bySeconds ? health.done_s : live.groups_done;
    put("sinew-progress-text", `${live.groups_done} of ${live.groups} groups`
      + (run && health.total_s ? `, about ${clock(health.total_s - health.done_s)} of swinging left` : ""));
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
