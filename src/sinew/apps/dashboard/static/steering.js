// Steering from the browser: straight to the steering port, past the pages' server and its event loop. What it works on
// is the plain HTML of the frame, so all of it stays when the pages' server is gone.

const config = JSON.parse(document.getElementById("sinew-config").textContent);
const steering = `${location.protocol}//${location.hostname}:${config.steering_port}`;
const DOUBLE_MS = 500, POLL_MS = 1000, ANSWER_MS = 5000, LOST_MS = 2000, HEARD_MS = 2500;
const $ = (id) => document.getElementById(id);

let status = null, reachable = null, lastEscape = -Infinity, stopped = null;

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
  const text = await answer.text(); // one that breaks off is no answer, and is not taken for an empty one
  let said = {};
  try { said = JSON.parse(text); } catch { /* an answer without a body, or by whatever stands between */ }
  return { code: answer.status, said };
}

async function send(command, more = {}) {
  const isEmergency = command === "emergency"; // it goes out though this page is left
  const answer = await ask("/command", { command, ...more }, isEmergency ? { keepalive: true } : {});
  if (answer.code === 401) signIn(isEmergency ? "Sign in to stop the bench from here, or stop it on the computer that serves." : `Sign in to ${words(command)}.`);
  return { ok: answer.code < 300, code: answer.code, ...answer.said };
}

function words(command) {
  return { continue: "go on with a run", store: "save" }[command] ?? `${command} a run`;
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

// What the stop says stands on its button at once, and what the bench says of it as soon as that is known.
async function emergency() {
  const button = $("sinew-emergency"), began = performance.now();
  const told = (how, title, line) => {
    button.dataset.stop = how;
    stopped = { title, line };
    label();
  };
  told("asked", "STOPPING", "the bench is asked");
  const answer = await command("emergency");
  const took = Math.round(performance.now() - began);
  if (answer.ok) document.body.dataset.emergencyMs = took;
  told(answer.ok ? "done" : "failed", answer.ok ? "STOPPED" : "NOT CONFIRMED", answer.ok ? `confirmed here in ${took} ms` : "switch the supply off");
  const mine = stopped;
  setTimeout(() => { if (stopped === mine) { stopped = null; delete button.dataset.stop; label(); } }, answer.ok ? 4000 : 20000);
}

function label() {
  const button = $("sinew-emergency"), isOut = status !== null && !status.signed_in && !status.may_stop;
  put(button.querySelector("b"), stopped?.title ?? "EMERGENCY STOP");
  put(button.querySelector("span"), stopped?.line ?? (isOut ? "sign in first" : "F9 · Esc Esc"));
  button.classList.toggle("told", Boolean(stopped || isOut)); // its keys are no news, and none on a device without them
  button.classList.toggle("unreachable", !stopped && (reachable === false || isOut));
}

const put = (place, text) => { if (place && place.textContent !== text) place.textContent = text; };

// What went well takes away the refusals that stand yet.
function say(sentence, how = "") {
  if (how === "good") for (const line of voice.querySelectorAll(".bad")) line.remove();
  const line = element("div", { class: `sinew-said ${how}` }, sentence);
  voice.append(line);
  while (voice.children.length > 3) voice.firstChild.remove();
  setTimeout(() => line.remove(), how === "bad" ? 15000 : 6000);
}

// Notices stand below the head until what they say is over. parts: {title, lines, actions: [[id, label, act, may, why]]}
const shown = new Map();
function notice(key, how = null, parts = {}) {
  const { title = "", lines = [], actions = [] } = parts;
  const print = JSON.stringify([how, title, lines, actions.map(([id, text, , may, why]) => [id, text, may, why])]);
  const old = shown.get(key);
  if (old?.print === print) return;
  if (how === null) { old?.place.remove(); shown.delete(key); return; }
  const row = actions.map(([id, text, act, may = true, why = ""]) => typeof act === "string"
    ? element("a", { class: "sinew-button", id, href: act }, text)
    : element("button", { type: "button", class: "sinew-button", id, disabled: !may, title: why, onclick: act }, text));
  const made = element("div", { class: `sinew-notice ${how}`, id: `sinew-notice-${key}`, role: how === "bad" ? "alert" : "status" },
    element("div", {}, element("strong", {}, title), ...lines.map((line) => element("p", {}, line))));
  if (row.length) made.append(element("div", { class: "sinew-row" }, ...row));
  if (old) old.place.replaceWith(made); else $("sinew-notices").append(made);
  shown.set(key, { print, place: made });
}

// Signing in: the token comes by hand or in the address's fragment, which no server is ever told.
async function login(token) {
  const answer = await fetch("/login", {
    method: "POST", credentials: "same-origin", headers: { "content-type": "application/json" }, body: JSON.stringify({ token }),
  });
  const said = await answer.json().catch(() => ({}));
  if (answer.ok) { poll(); return ""; }
  return said.sentence ?? `The token was not accepted (${answer.status}).`;
}

const tokenField = element("input", { type: "password", id: "sinew-token", autocomplete: "current-password", required: true });
const tokenTrouble = element("p", { class: "bad", role: "alert" });
const tokenWhy = element("p", {});
// Not shown as a modal one, which would put the stop out of reach; what it covers is made inert by hand.
const dialog = element("dialog", { "aria-labelledby": "sinew-sign-in", "aria-modal": "true" },
  element("form", { method: "dialog", onsubmit: async (event) => {
    event.preventDefault();
    tokenTrouble.textContent = await login(tokenField.value.trim());
    if (!tokenTrouble.textContent) { closeDialog(); tokenField.value = ""; goOn(); }
  } },
    element("h2", { id: "sinew-sign-in" }, "Sign in"), tokenWhy,
    element("label", { for: "sinew-token" }, "Token, as ", element("code", {}, "sinew serve"), " printed it"), tokenField, tokenTrouble,
    element("div", { class: "sinew-row" },
      element("button", { type: "submit", class: "sinew-button main" }, "Sign in"),
      ...(config.locked ? [] : [element("button", { type: "button", class: "sinew-button", onclick: () => closeDialog() }, "Only watch")]))));
const veil = element("div", { id: "sinew-veil", hidden: true });
const covered = () => [$("app"), document.querySelector(".sinew-header"), $("sinew-notices"), document.querySelector("main.nicegui-content")].filter(Boolean);
let before = null;

function signIn(why = "") {
  tokenWhy.textContent = why; tokenTrouble.textContent = "";
  if (!dialog.open) { before = document.activeElement; dialog.show(); veil.hidden = false; covered().forEach((part) => { part.inert = true; }); }
  tokenField.focus();
}
// A page that took the token is there now.
function goOn() {
  if (location.pathname === "/login") location.replace("/");
  else if (config.locked) location.reload();
}
function closeDialog() {
  dialog.close(); veil.hidden = true; covered().forEach((part) => { part.inert = false; });
  before?.focus?.();
}

const voice = element("div", { id: "sinew-voice", role: "status", "aria-live": "polite" });

$("sinew-emergency").addEventListener("click", emergency);
for (const name of ["pause", "resume", "stop", "hold", "release"]) $(`sinew-${name}`).addEventListener("click", () => command(name));
$("sinew-in").addEventListener("click", () => signIn("Sign in to steer the bench."));
$("sinew-out").addEventListener("click", async () => {
  await ask("/logout", {}).catch(() => null);
  location.reload();
});

function clock(seconds) {
  const s = Math.max(0, Math.round(seconds));
  return s >= 86400 ? `${Math.floor(s / 86400)} d ${Math.floor(s % 86400 / 3600)} h`
    : s >= 3600 ? `${Math.floor(s / 3600)} h ${Math.floor(s % 3600 / 60)} min` : s >= 60 ? `${Math.floor(s / 60)} min ${s % 60} s` : `${s} s`;
}
const at = (seconds) => new Date(1000 * seconds).toLocaleTimeString([], { hour12: false });
const sentence = (text) => `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;

const DOING = { starting: "begins", preparing: "begins", finishing: "writes its recording", silent: "does not answer" };
const BEGINS = ["starting", "preparing"];
const isEarly = (last) => !last.complete || (last.exit !== null && last.exit !== 0);

function mayStart() {
  if (reachable === false) return "Steering does not answer.";
  if (!status?.bench?.kind) return "There is no bench to start on: sinew serve --emulate plays one.";
  if (!status.signed_in) return "Sign in to start.";
  if (status.run ?? status.elsewhere) return `The run ${status.run?.name ?? status.elsewhere} is under way.`;
  if (status.stopping) return "The bench is being brought to rest.";
  return "";
}

function show() {
  const run = status?.run, state = run?.state ?? "", last = status?.last;
  const bench = status?.bench?.kind;
  let text, how = "";
  if (reachable === false) { text = "Steering does not answer"; how = "bad"; }
  else if (status === null) text = "Connecting";
  else if (run) {
    text = `${DOING[state] ?? state ?? "running"}: ${run.name}`; // the name may be cut off, what it does is not
    how = state === "silent" ? "bad" : ["paused", "pausing", "stopping"].includes(state) ? "warn" : "good";
  } else if (!bench) text = "No bench";
  else if (status.stopping) { text = "is brought to rest"; how = "warn"; }
  else if (status.elsewhere) { text = `${status.elsewhere} runs in a terminal`; how = "warn"; }
  else if (last && isEarly(last)) { text = `ended early: ${last.name}`; how = "bad"; }
  else text = "at rest";
  const chip = $("sinew-state");
  put(chip, bench && reachable !== false && status ? `${bench === "emulator" ? "Emulated bench" : "Bench"} · ${text}` : text);
  chip.className = `sinew-chip ${how}`; chip.title = chip.textContent;
  const isIn = Boolean(status?.signed_in);
  put($("sinew-who"), status !== null && !isIn ? "You only watch" : "");
  $("sinew-in").hidden = isIn || status === null;
  $("sinew-out").hidden = !isIn;
  const steers = isIn && reachable !== false, may = steers && Boolean(run);
  $("sinew-pause").disabled = !may || state !== "running";
  $("sinew-resume").disabled = !may || !["paused", "pausing"].includes(state);
  $("sinew-stop").disabled = !may || state === "finishing";
  $("sinew-hold").disabled = !may || state === "finishing"; // at rest there is nothing to hold
  $("sinew-release").disabled = !steers || !bench || state === "finishing";
  label();
  gate();
  tellLost();
  tell(run, state, last);
}

const mayKeep = () => reachable === false ? "Steering does not answer." : !status?.signed_in ? "Sign in first." : "";

// The buttons that start a run, save and delete are the page's; whether this tab may is known here.
function gate() {
  for (const button of document.querySelectorAll("button[data-steers]")) {
    const why = mayKeep();
    button.disabled = button.dataset.steers !== "ready" || Boolean(why);
    button.title = why;
  }
  for (const place of document.querySelectorAll(".sinew-why-not")) put(place, mayKeep());
  const start = $("sinew-start");
  if (!start) return;
  const why = mayStart();
  start.disabled = start.dataset.ready !== "yes" || Boolean(why);
  put($("sinew-start-why"), why || (start.dataset.ready === "yes" ? "" : start.dataset.why || "The plan is looked at."));
}

let seenStop = null; // the emergency stop whose notice was closed in this tab
try { seenStop = JSON.parse(sessionStorage.getItem("sinew-seen-stop")); } catch { /* nothing was kept */ }
function seeStop(when) {
  seenStop = when;
  try { sessionStorage.setItem("sinew-seen-stop", JSON.stringify(when)); } catch { /* storage is off */ }
}

function tell(run, state, last) {
  notice("unreachable", reachable === false ? "bad" : null, { title: "The bench cannot be steered from here",
    lines: ["sinew serve does not answer. The stop does not reach the bench: use the switch of the power supply if it must stop."] });
  if (status === null) return;
  const stop = status.emergency, isNew = stop?.was_emergency && !run; // the steward forgets it when a run begins
  if (status.stopping) notice("emergency", "bad", { title: "The bench is being brought to rest" });
  else if (isNew) {
    const next = "The stop needs no reset: when the bench is well, go on from here or start again on the page Plan.";
    if (stop.at === seenStop) notice("emergency");
    else notice("emergency", "bad", { title: `Emergency stop at ${at(stop.at)}`,
      lines: stop.is_safe ? [sentence(stop.sentence), next] : [`NOT CONFIRMED: ${stop.sentence}.`],
      actions: stop.is_safe ? [["sinew-stop-seen", "Close", () => { seeStop(stop.at); notice("emergency"); }]] : [] });
  } else notice("emergency");
  notice("begins", config.here === "/" && BEGINS.includes(state) ? "good" : null,
    { title: `The run ${run?.name} begins`, lines: ["Its plan is tried on the twin before anything moves, unless Plan did so: some seconds."] });
  notice("silent", state === "silent" && reachable !== false ? "bad" : null, { title: `The run ${run?.name} does not answer`,
    lines: ["Whether it still moves the bench is not known here. The emergency stop ends it by force."] });
  if (config.here !== "/" || run || !last) { notice("ended"); }
  else {
    const done = last.groups === null || last.groups === undefined ? "" : `${last.groups_done} of ${last.groups} groups are recorded.`;
    const asked = /^(?!emergency).* by the operator/i.test(last.sentence);
    const open = last.groups_done ? [["sinew-open-last", "Open its results", `/runs/${encodeURIComponent(last.name)}`]] : [];
    const when = `at ${at(last.ended)}`;
    if (!isEarly(last)) notice("ended", "good", { title: `The run ${last.name} is complete, ${when}`, lines: [sentence(last.sentence)], actions: open });
    else {
      const why = mayStart();
      const resume = [["sinew-go-on", "Go on with this run", () => command("continue", { name: last.name }), !why, why]];
      notice("ended", "bad", { title: last.complete ? `The run ${last.name} is complete, but ended in trouble, ${when}` : `The run ${last.name} ended early, ${when}`,
        lines: [sentence(last.sentence), last.can_resume ? `${done}${asked ? "" : " See that the bench is well."} Go on with the first group that is missing, or leave it at that.`
          : last.complete ? done : "Nothing was recorded. Mend what it says, and start it again from the page Plan."],
        actions: [...(last.can_resume ? resume : []), ...open] });
    }
  }
}

// On a slow line answers overtake each other: one that was asked for before the newest that came is of the past.
let asked = 0, newest = 0, heard = -Infinity;
async function poll() {
  const turn = asked += 1;
  let code = null, said = null;
  try {
    ({ code, said } = await ask("/status"));
  } catch { /* nothing came */ }
  if (turn < newest) return;
  newest = turn;
  reachable = code !== null && code < 500;
  if (reachable) heard = performance.now();
  if (code !== null) status = code === 200 ? said : null;
  if (code === 401 && !dialog.open) signIn("This page is for those who have its token.");
  show();
}

// In the capture phase of the window, so before whatever is open gets it: Escape closes that, and twice stops all the same.
addEventListener("keydown", (event) => {
  if (event.repeat) return;
  if (event.key === "F9") { event.preventDefault(); emergency(); }
  if (event.key === "Escape") {
    if (dialog.open) closeDialog();
    if (event.timeStamp - lastEscape < DOUBLE_MS) { lastEscape = -Infinity; emergency(); } else lastEscape = event.timeStamp;
  }
}, true);

// The box of the pages' library would lie over the stop; what it has to say is said among the notices.
const box = $("popup");
let lost = null;
function watchBox() {
  const isLost = box.getAttribute("aria-hidden") === "false";
  if (isLost && lost === null) lost = setTimeout(() => { document.body.dataset.pages = "lost"; tellLost(); }, LOST_MS);
  if (!isLost && lost !== null) { clearTimeout(lost); lost = null; delete document.body.dataset.pages; tellLost(); }
}
// Where steering does not answer either, its notice is the only one: of the stop there is one answer.
function tellLost() {
  const isLost = document.body.dataset.pages === "lost" && reachable !== false, works = performance.now() - heard < HEARD_MS;
  notice("lost", isLost ? "bad" : null, { title: "The pages' server does not answer",
    lines: [`What is shown is old. ${works ? "The bench goes on as it was, and the emergency stop works. " : ""}Trying again.`] });
}
if (box) new MutationObserver(watchBox).observe(box, { attributes: true, attributeFilter: ["aria-hidden"] });

window.Sinew = {
  config, command, emergency, signIn, say, notice, clock,
  start: (plan, rig, name) => command("start", { plan, rig, name }),
  status: () => status,
};

document.body.append(voice, veil, dialog);
new MutationObserver(gate).observe(document.body, { childList: true, subtree: true, attributes: true, attributeFilter: ["data-ready", "data-steers"] });

// Signs in by the token of the address, where it has one. The address may come into a tab that shows a page already.
async function enter() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!given) return;
  history.replaceState(null, "", location.pathname + location.search);
  const trouble = await login(given).catch((lost) => `The bench could not be reached (${lost.message}).`);
  if (trouble) { signIn(trouble); return; }
  if (dialog.open) closeDialog();
  goOn();
}
addEventListener("hashchange", enter);
await enter();
await poll();
if (location.pathname === "/login" && !status?.signed_in) signIn();
setInterval(() => { poll(); tellLost(); }, POLL_MS);
