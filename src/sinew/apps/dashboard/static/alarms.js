// Alarms and what happened. An alarm begins where a reading exceeds its limit, and stays until somebody has seen it:
// raised -> (within again) -> acknowledged. It is an alert, a sound and a message of the browser.

import { keep, kept } from "./scope.js";

export const READINGS = [
  { key: "temperature", label: "Temperature", unit: "°C", digits: 0 },
  { key: "tension", label: "Tension", unit: "N", digits: 0 },
  { key: "tilt", label: "Tilt", unit: "°", digits: 2 },
  { key: "missed", label: "Missed cycles", unit: "a minute", digits: 0 },
];
const DEADBAND = 0.03; // of a limit: how far below it a reading must fall to be within again
const BEEP_S = 2, MOST_KEPT = 50;

// The alarms after some readings. alarms: by reading, {key, run, of, value, worst, limit, at, inRun, over, isSeen}; at and
// over in ms since 1970, inRun in s, over null while it lasts. readings: [value, of which part] by reading. limits: null
// where there is none. allowed: what the rig itself allows, by reading. raised: those that began now.
export function judge(alarms, readings, limits, run, at, inRun, allowed = {}) {
  const next = { ...alarms }, raised = [];
  for (const { key } of READINGS) {
    const limit = limits[key], old = alarms[key], [value, of] = readings[key] ?? [null, ""];
    if (value === null) continue;
    const isBeyond = limit !== null && limit !== undefined && value > limit;
    const isWithin = limit === null || limit === undefined || value <= limit * (1 - DEADBAND);
    // Of one that was seen: another part, or the rig's own limit, is another alarm.
    const most = allowed[key] ?? Infinity, seenOf = [...(old?.seenOf ?? []), old?.of];
    const isOther = old?.isSeen && (!seenOf.includes(of) || (value > most && old.worst <= most));
    if (isBeyond && (!old || old.run !== run || isOther)) {
      next[key] = { key, run, of, value, worst: value, limit, at, inRun, over: null, isSeen: false };
      if (isOther && old.run === run) next[key].seenOf = seenOf; // parts that take turns are told once each
      raised.push(next[key]);
    } else if (isBeyond) next[key] = { ...old, over: null, worst: Math.max(old.worst, value) };
    else if (old && isWithin) {
      if (old.isSeen) delete next[key];
      else if (old.over === null) next[key] = { ...old, over: at };
    }
  }
  return { alarms: next, raised };
}

export function acknowledge(alarms, key) {
  const next = { ...alarms };
  if (next[key]?.over !== null) delete next[key]; else next[key] = { ...next[key], isSeen: true };
  return next;
}

// What is known no more: an alarm that was seen is over with the readings, one that was not stays.
export function rest(alarms) {
  return Object.fromEntries(Object.entries(alarms).filter(([, alarm]) => !alarm.isSeen));
}

const $ = (id) => document.getElementById(id);
const put = (id, text) => { const place = $(id); if (place && place.textContent !== text) place.textContent = text; };
const shown = (value, { digits, unit }) => `${value.toFixed(digits)} ${unit}`.replace(" °C", "\u00a0°C").replace(" °", "°");
const clock = (seconds) => window.Sinew.clock(seconds);
const timeOf = (ms) => new Date(ms).toLocaleTimeString([], { hour12: false });

let alarms = kept("sinew-alarms", {}), past = kept("sinew-alarms-past", []), isLoud = kept("sinew-alarm-sound", true);
let mayNotify = kept("sinew-alarm-notify", true), rig = null, limits = {}, audio = null, events = [], stops = [], run = "", printed = "";

const limitsKey = () => `sinew-alarm-limits ${rig.name}`;

// The readings of a state that the server told. isNow: whether they are of now.
export function take(state, isNow, drawn) {
  const live = state.live;
  if (drawn !== rig) choose(drawn);
  if (live?.name !== run) { run = live?.name ?? ""; events = []; stops = []; }
  if (live?.events) events = live.events;
  noteStop(state.steward);
  const readings = live?.readings ?? {};
  for (const reading of READINGS) {
    const [value, of] = readings[reading.key] ?? [null, ""];
    put(`sinew-reading-${reading.key}`, value === null || !live ? "–" : reading.key === "missed" ? value.toFixed(0) : `${shown(value, reading)}, ${of}`);
  }
  if (isNow) {
    const at = Date.now(), [began] = events.filter((event) => event[3] !== null).map((event) => event[3] - event[4]).slice(-1);
    const found = judge(alarms, readings, limits, live.name, at, began === undefined ? null : at / 1000 - began, allowed());
    for (const alarm of found.raised) raise(alarm);
    store(found.alarms);
  } else store(rest(alarms));
  list();
}

// An emergency stop is told as soon as it is under way: the run's own record of it comes later, or never.
function noteStop(steward) {
  const its = [steward?.run, steward?.last].find((one) => one && one.name === run), stop = steward?.emergency;
  const row = (text, at) => { stops = [{ severity: "stop", text, at, inRun: null }]; };
  if (stop?.was_emergency && its && stop.at >= its.started) row(`Emergency stop: ${stop.sentence}`, stop.at);
  else if (steward?.stopping && steward.run?.name === run && !stops.length) row("Emergency stop", steward.time_s);
}

const isNews = (stop) => !events.some(([, severity, , at]) => severity === "stop" && at > stop.at - 2);

const allowed = () => Object.fromEntries(READINGS.map(({ key }) => [key, rig.alarms[key].rig]));

// The limits of a rig's alarms with those that somebody set in their place, none beyond what the rig allows.
export function limitsOf(alarmsOfRig, own) {
  return Object.fromEntries(READINGS.map(({ key }) => {
    const value = key in own ? own[key] : alarmsOfRig[key].limit, most = alarmsOfRig[key].rig;
    return [key, value === null || most === null ? value : Math.min(value, most)];
  }));
}

// What is typed into a field: a limit, null for none, or undefined where it is no limit. A field of numbers says of
// what it cannot read that it is empty.
export function typed(field) {
  const text = field.value.trim(), value = text === "" ? null : Number(text);
  return field.validity.badInput || (value !== null && !(value >= 0)) ? undefined : value;
}

// Why a limit is another than was typed, in words; empty where it is that one. typed, limit: as above.
function whyOther(key, text, value, limit) {
  const { unit } = READINGS.find((one) => one.key === key), stays = `the limit stays ${limit === null ? "off" : `${limit} ${unit}`}.`;
  if (value === undefined) return `${text === "" ? "That" : text} is ${text < 0 ? "below 0" : "no number"}: ${stays}`;
  return value === limit ? "" : `The rig itself stops at ${limit} ${unit}, so that is the limit.`;
}

function fill(key) {
  const field = $(`sinew-limit-${key}`);
  if (field) { field.value = limits[key] ?? ""; field.placeholder = "off"; }
}

function choose(drawn) {
  rig = drawn;
  limits = limitsOf(rig.alarms, kept(limitsKey(), {}));
  for (const { key, unit } of READINGS) {
    fill(key);
    put(`sinew-limit-said-${key}`, "");
    const most = rig.alarms[key].rig;
    put(`sinew-most-${key}`, most === null ? "–" : `${most} ${unit}`.replace(" °", "°").replace("°C", " °C"));
  }
}

function store(next) {
  const text = JSON.stringify(next);
  if (text !== JSON.stringify(alarms)) { alarms = next; keep("sinew-alarms", alarms); }
  show();
}

const named = (alarm) => { // what, where it is, in words
  const reading = READINGS.find(({ key }) => key === alarm.key);
  const where = alarm.key === "missed" ? "" : ` of ${alarm.of.replace(/^(drive|head plate)/, "the $1")}`;
  return { reading, what: `${reading.label}${where}: ${shown(alarm.value, reading)}`, limit: `the limit is ${shown(alarm.limit, reading)}` };
};

function raise(alarm) {
  const { what, limit } = named(alarm);
  past = [...past, { run: alarm.run, at: alarm.at / 1000, inRun: alarm.inRun, text: `${what}, ${limit}` }].slice(-MOST_KEPT);
  keep("sinew-alarms-past", past);
  if (mayNotify && window.Notification?.permission === "granted") {
    try {
      const note = new Notification(`Sinew: ${what}`, { body: `${limit}; run ${alarm.run}`, tag: `sinew ${alarm.key}`, requireInteraction: true });
      note.onclick = () => { window.focus(); note.close(); };
      document.body.dataset.notified = String(Number(document.body.dataset.notified ?? 0) + 1);
    } catch { /* some browsers of telephones have none */ }
  }
  beep();
}

// Its text changes only where something happened to it: whoever hears the page hears each once.
function show() {
  for (const reading of READINGS) {
    const { key } = reading, alarm = alarms[key], row = $(`sinew-alarm-${key}`);
    if (row) {
      row.className = !alarm ? "" : alarm.isSeen ? "warn" : "bad";
      put(`sinew-alarm-state-${key}`, !alarm ? "quiet" : alarm.isSeen ? "▲ beyond, seen" : alarm.over === null ? "◆ ALARM" : "◆ was beyond");
    }
    if (!alarm || alarm.isSeen) { window.Sinew?.notice(`alarm-${key}`); continue; }
    const { what, limit } = named(alarm), since = alarm.inRun === null ? "" : `, ${clock(alarm.inRun)} into the run ${alarm.run}`;
    const lines = [`At ${timeOf(alarm.at)}${since}; ${limit}.`];
    if (alarm.over !== null) lines.push(`Within it again since ${timeOf(alarm.over)}; the most was ${shown(alarm.worst, reading)}.`);
    window.Sinew?.notice(`alarm-${key}`, "bad", { title: `Alarm: ${what}`, lines,
      actions: [[`sinew-acknowledge-${key}`, "Acknowledge", () => { store(acknowledge(alarms, key)); list(); }]] });
  }
  const count = Object.values(alarms).filter((alarm) => !alarm.isSeen).length, plain = document.title.replace(/^◆ \d+ · /, "");
  const title = count ? `◆ ${count} · ${plain}` : plain;
  if (document.title !== title) document.title = title;
  document.body.dataset.alarms = String(count);
}

// Sound: two short tones, again while an alarm waits to be seen. A browser gives sound only after the first click or key.
function wake() {
  if (!isLoud || audio || !window.AudioContext) return;
  audio = new AudioContext();
  audio.suspend(); // between its tones it costs nothing
  sound();
}

async function beep() {
  if (!isLoud || !audio) return;
  await audio.resume();
  const begin = audio.currentTime + 0.02;
  for (const [i, pitch] of [880, 660].entries()) {
    const tone = audio.createOscillator(), loudness = audio.createGain(), at = begin + 0.18 * i;
    tone.frequency.value = pitch;
    loudness.gain.setValueAtTime(0, at);
    loudness.gain.linearRampToValueAtTime(0.25, at + 0.01);
    loudness.gain.setValueAtTime(0.25, at + 0.13);
    loudness.gain.linearRampToValueAtTime(0, at + 0.16);
    tone.connect(loudness).connect(audio.destination);
    tone.start(at); tone.stop(at + 0.17);
  }
  document.body.dataset.beeps = String(Number(document.body.dataset.beeps ?? 0) + 1);
  setTimeout(() => audio.suspend(), 700);
}

function sound() {
  const button = $("sinew-sound");
  if (!button) return;
  button.setAttribute("aria-pressed", String(isLoud));
  put("sinew-sound", isLoud ? "Sound is on" : "Sound is off");
  put("sinew-sound-waits", isLoud && !audio ? "The browser gives sound after the first click or key." : "");
}

function notify() {
  const button = $("sinew-notify"), may = window.Notification?.permission ?? "none";
  if (!button) return;
  button.disabled = may === "denied" || may === "none";
  button.title = may === "none" ? "This browser notifies only from pages by https or of this computer" : may === "denied" ? "Notifications of this page are blocked in the browser" : "";
  if (may === "granted") button.setAttribute("aria-pressed", String(mayNotify)); else button.removeAttribute("aria-pressed");
  put("sinew-notify", may === "granted" ? (mayNotify ? "Notifications are on" : "Notifications are off") : button.disabled ? "No notifications" : "Notify me");
}

// What happened, newest first.
const SEVERITIES = {
  note: { mark: "●", word: "Note", how: "", rank: 0 }, warning: { mark: "▲", word: "Warning", how: "warn", rank: 1 },
  stop: { mark: "■", word: "Stop", how: "bad", rank: 2 }, alarm: { mark: "◆", word: "Alarm", how: "bad", rank: 2 },
};
const LEAST = { all: 0, warning: 1, bad: 2 };
let least = "all";

function list() {
  const log = $("sinew-log");
  if (!log) return;
  const rows = [...events.map(([, severity, text, at, inRun]) => ({ severity, text, at, inRun })), ...stops.filter(isNews),
    ...past.filter((one) => one.run === run).map((one) => ({ ...one, severity: "alarm" }))]
    .filter((row) => (SEVERITIES[row.severity] ?? SEVERITIES.note).rank >= LEAST[least])
    .sort((a, b) => (a.at ?? 0) - (b.at ?? 0)).reverse();
  const print = JSON.stringify([run, least, rows]);
  if (print === printed) return;
  printed = print;
  put("sinew-log-empty", rows.length ? "" : least === "all" ? "Nothing yet." : "Nothing of this kind.");
  const element = (name, className, ...children) => { const made = document.createElement(name); made.className = className; made.append(...children); return made; };
  log.replaceChildren(...rows.map(({ severity, text, at, inRun }) => {
    const { mark, word, how } = SEVERITIES[severity] ?? SEVERITIES.note, icon = element("span", "", mark);
    icon.setAttribute("aria-hidden", "true");
    const when = element("span", "sinew-when");
    if (at !== null && at !== undefined) {
      const time = element("time", "", timeOf(1000 * at));
      time.dateTime = new Date(1000 * at).toISOString();
      when.append(time, inRun === null || inRun < 0 ? "" : ` · ${clock(inRun)}`);
    }
    return element("li", how, element("span", "sinew-severity", icon, ` ${word}`), when, element("span", "sinew-told", text));
  }));
}

export function begin() {
  for (const { key } of READINGS) $(`sinew-limit-${key}`).addEventListener("change", (event) => {
    const value = typed(event.target), text = event.target.value.trim();
    if (!rig) return;
    if (value !== undefined) {
      const own = { ...kept(limitsKey(), {}), [key]: value };
      limits = limitsOf(rig.alarms, own);
      keep(limitsKey(), { ...own, [key]: limits[key] });
    }
    event.target.value = ""; // what cannot be read stays in the field otherwise
    fill(key);
    put(`sinew-limit-said-${key}`, whyOther(key, text, value, limits[key]));
  });
  $("sinew-limits-back").addEventListener("click", () => {
    try { localStorage.removeItem(limitsKey()); } catch { /* storage is off */ }
    choose(rig);
  });
  $("sinew-sound").addEventListener("click", () => { isLoud = !isLoud; keep("sinew-alarm-sound", isLoud); wake(); sound(); });
  $("sinew-notify").addEventListener("click", async () => {
    if (Notification.permission === "default") await Notification.requestPermission();
    else { mayNotify = !mayNotify; keep("sinew-alarm-notify", mayNotify); }
    notify();
  });
  $("sinew-severity").addEventListener("change", (event) => { least = event.target.value; list(); });
  for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, wake, true);
  addEventListener("storage", (event) => { // another tab of this browser
    if (event.key === "sinew-alarms") { alarms = kept("sinew-alarms", {}); show(); }
    if (event.key === "sinew-alarms-past") { past = kept("sinew-alarms-past", []); list(); }
    if (rig && event.key === limitsKey()) choose(rig);
  });
  setInterval(() => { if (Object.values(alarms).some((alarm) => !alarm.isSeen)) beep(); }, 1000 * BEEP_S);
  sound(); notify(); show(); list();
}
