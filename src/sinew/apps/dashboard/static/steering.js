// This is where the browser steers: straight to the steering port, past the pages' server and its event loop.
// What it draws is plain DOM, so it stays when the pages' server is gone.

const config = JSON.parse(document.getElementById("sinew-config").textContent);
const steering = `${location.protocol}//${location.hostname}:${config.steering_port}`;
const DOUBLE_MS = 500, POLL_MS = 1000, ANSWER_MS = 5000;

let ticket = null, number = 0, status = null, reachable = null, lastEscape = -Infinity;

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== null && value !== false) made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children);
  return made;
}

async function ask(path, body, more = {}) {
  const options = { credentials: "include", signal: AbortSignal.timeout(ANSWER_MS), ...more };
  if (body !== undefined) {
    options.method = "POST";
    options.headers = { "content-type": "application/json" };
    options.body = JSON.stringify(body);
  }
  const answer = await fetch(steering + path, options);
  let said = {};
  try { said = await answer.json(); } catch { /* an answer without a body */ }
  return { code: answer.status, said };
}

// A tab keeps its ticket from page to page, so that who is in control stays so.
function keep() { try { sessionStorage.setItem("sinew-ticket", JSON.stringify([ticket, number])); } catch { /* storage is off */ } }
try { [ticket, number] = JSON.parse(sessionStorage.getItem("sinew-ticket")) ?? [null, 0]; } catch { /* nothing was kept */ }

async function takeTicket() {
  const { code, said } = await ask("/ticket", {});
  if (code !== 200) { ticket = null; return code; }
  ticket = said.ticket; number = said.number ?? 0;
  keep();
  claim();
  return code;
}

function numbered(command, more) {
  number += 1;
  keep();
  return { ticket, number, command, ...more };
}

async function send(command, more = {}) {
  if (ticket === null && (await takeTicket()) !== 200) { signIn(`Sign in to ${words(command)}.`); return { ok: false }; }
  let answer = await ask("/command", numbered(command, more), { keepalive: command === "emergency" });
  const isRepeated = answer.code === 409 && answer.said.number !== undefined; // another tab counts with this ticket
  if (answer.code === 401 || answer.said.ticket === false || isRepeated) {
    ticket = null;
    if ((await takeTicket()) !== 200) { signIn(`Sign in to ${words(command)}.`); return { ok: false }; }
    answer = await ask("/command", numbered(command, more));
  }
  return { ok: answer.code < 300, code: answer.code, ...answer.said };
}

function words(command) {
  return { emergency: "stop the bench", take: "take control", give: "hand over" }[command] ?? `${command} a run`;
}

async function command(name, more = {}) {
  try {
    const answer = await send(name, more);
    if (answer.sentence) say(answer.sentence, answer.ok ? "good" : "bad");
    poll();
    return answer;
  } catch (trouble) {
    say(`The bench could not be reached (${trouble.message}). Use the switch of the power supply if it must stop.`, "bad");
    return { ok: false };
  }
}

async function emergency() {
  stopButton.classList.add("pressed");
  const began = performance.now();
  const answer = await command("emergency");
  if (answer.ok) document.body.dataset.emergencyMs = Math.round(performance.now() - began);
  setTimeout(() => stopButton.classList.remove("pressed"), 600);
}

function say(sentence, how = "") {
  const line = element("div", { class: `sinew-said ${how}` }, sentence);
  voice.append(line);
  while (voice.children.length > 4) voice.firstChild.remove();
  setTimeout(() => line.remove(), how === "bad" ? 15000 : 6000);
}

// Signing in: the token comes by hand or in the address's fragment, which no server is ever told.
async function login(token) {
  const answer = await fetch("/login", {
    method: "POST", credentials: "same-origin", headers: { "content-type": "application/json" }, body: JSON.stringify({ token }),
  });
  const said = await answer.json().catch(() => ({}));
  if (answer.ok) { await takeTicket(); poll(); return ""; }
  return said.sentence ?? `The token was not accepted (${answer.status}).`;
}

const tokenField = element("input", { type: "password", id: "sinew-token", autocomplete: "current-password", required: true });
const tokenTrouble = element("p", { class: "bad", role: "alert" });
const tokenWhy = element("p", {});
const dialog = element("dialog", { "aria-labelledby": "sinew-sign-in" },
  element("form", { method: "dialog", onsubmit: async (event) => {
    event.preventDefault();
    tokenTrouble.textContent = await login(tokenField.value.trim());
    if (!tokenTrouble.textContent) { dialog.close(); tokenField.value = ""; if (config.locked) location.reload(); }
  } },
    element("h2", { id: "sinew-sign-in" }, "Sign in"), tokenWhy,
    element("label", { for: "sinew-token" }, "Token, as ", element("code", {}, "sinew serve"), " printed it"), tokenField, tokenTrouble,
    element("div", { class: "sinew-row" },
      element("button", { type: "submit", class: "sinew-button main" }, "Sign in"),
      element("button", { type: "button", class: "sinew-button", onclick: () => dialog.close() }, "Only watch"))));

function signIn(why = "") { tokenWhy.textContent = why; tokenTrouble.textContent = ""; if (!dialog.open) dialog.showModal(); tokenField.focus(); }

// What is always there.
const voice = element("div", { id: "sinew-voice", role: "status", "aria-live": "polite" });
const stopButton = element("button", { id: "sinew-emergency", type: "button", onclick: emergency,
  title: "Stops the bench at once: key F9, or Escape twice", "aria-keyshortcuts": "F9" },
  element("b", {}, "EMERGENCY STOP"), element("span", {}, "F9 · Esc Esc"));

function button(name, label, title) {
  return element("button", { type: "button", class: "sinew-button", id: `sinew-${name}`, title, onclick: () => command(name) }, label);
}
const buttons = {
  pause: button("pause", "Pause", "Rest after the segment under way; the tension stays"),
  resume: button("resume", "Resume", "Go on with the next segment"),
  stop: button("stop", "End run", "End the run now, in the state that the rig declares safe"),
  hold: button("hold", "Hold", "End the run; every motor stands still with limited output"),
  release: button("release", "Release", "End the run; the tension is let down and the torque taken off"),
};
const who = element("span", { id: "sinew-who" });
const take = element("button", { type: "button", class: "sinew-button", id: "sinew-take", onclick: () => {
  if (!status?.signed_in && ticket === null) { signIn("Sign in to take control."); return; }
  command(status?.operator?.mine ? "give" : "take");
} }, "Take control");
const chip = element("span", { id: "sinew-state", class: "sinew-chip" }, "…");
const bar = element("section", { id: "sinew-bar", "aria-label": "Steering" }, chip, who, take, ...Object.values(buttons));

function show() {
  const run = status?.run, state = run?.state ?? "", mine = Boolean(status?.operator?.mine);
  const bench = status?.bench?.kind;
  let text, how;
  if (reachable === false) { text = "Steering is not reachable: use the power switch"; how = "bad"; }
  else if (status === null) { text = "Connecting"; how = ""; }
  else if (run) { text = `${run.name}: ${state || "running"}`; how = state === "silent" ? "bad" : ["paused", "pausing"].includes(state) ? "warn" : "good"; }
  else if (!bench) { text = "No bench"; how = ""; }
  else { text = bench === "emulator" ? "Emulated bench, at rest" : "Bench, at rest"; how = ""; }
  chip.textContent = text; chip.className = `sinew-chip ${how}`;
  const operator = status?.operator;
  who.textContent = !operator ? "Nobody is in control" : mine ? "You are in control" : "Somebody else is in control";
  take.textContent = mine ? "Hand over" : operator ? "Take over" : "Take control";
  const may = mine && Boolean(run);
  buttons.pause.disabled = !may || state === "paused" || state === "pausing";
  buttons.resume.disabled = !may || !(state === "paused" || state === "pausing");
  for (const name of ["stop"]) buttons[name].disabled = !may;
  for (const name of ["hold", "release"]) buttons[name].disabled = !mine || !bench;
  const isOut = status !== null && !status.signed_in;
  stopButton.classList.toggle("unreachable", reachable === false || isOut);
  stopButton.lastChild.textContent = isOut ? "sign in first" : "F9 · Esc Esc";
}

async function poll() {
  try {
    const { code, said } = await ask("/status", undefined, ticket ? { headers: { "x-sinew-ticket": ticket } } : {});
    reachable = code < 500; status = code === 200 ? said : null;
    if (code === 401) signIn("This page is for those who have its token.");
  } catch { reachable = false; }
  show();
}

addEventListener("keydown", (event) => {
  if (event.repeat) return;
  if (event.key === "F9") { event.preventDefault(); emergency(); }
  if (event.key === "Escape") {
    if (document.querySelector("dialog[open], .q-menu, .q-dialog")) return; // it closes what is open
    if (event.timeStamp - lastEscape < DOUBLE_MS) emergency();
    lastEscape = event.timeStamp;
  }
}, true);

window.Sinew = {
  config, command, emergency, signIn, say,
  start: (plan, rig, name) => command("start", { plan, rig, name }),
  status: () => status,
};

document.body.append(stopButton, voice, dialog);
const place = () => { const host = document.getElementById("sinew-controls"); if (host && !host.contains(bar)) host.append(bar); };
new MutationObserver(place).observe(document.body, { childList: true, subtree: true });
place();

// A tab that was duplicated has the ticket of the other: only one of them may keep it.
async function claim() {
  if (ticket === null || !navigator.locks) return;
  const held = ticket;
  await new Promise((go) => navigator.locks.request(`sinew ${held}`, { ifAvailable: true }, (lock) => {
    if (!lock) { ticket = null; number = 0; go(); return undefined; }
    go();
    return new Promise(() => {});
  }).catch(go));
}
await claim();

const given = new URLSearchParams(location.hash.slice(1)).get("token");
if (given) {
  history.replaceState(null, "", location.pathname + location.search);
  const trouble = await login(given);
  if (trouble) signIn(trouble); else if (config.locked) location.reload();
} else if (ticket === null) await takeTicket().catch(() => null);
await poll();
setInterval(poll, POLL_MS);
