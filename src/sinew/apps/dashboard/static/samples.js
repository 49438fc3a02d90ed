// The samples of a run that has ended, or of one that is under way, looked at from its begin.

import { Oscilloscope, calm } from "./oscilloscope.js";

const given = JSON.parse(document.getElementById("sinew-samples").textContent);
const $ = (id) => document.getElementById(id);

async function begin() {
  for (let i = 0; i < 200 && !$("sinew-legend"); i++) await new Promise((go) => setTimeout(go, 50));
  const scope = new Oscilloscope(null);
  scope.name(given.name);
  const said = await scope.pieces.begun;
  if (!said) { $("sinew-where").textContent = `The samples cannot be read: ${scope.pieces.trouble}`; return; }
  scope.begin(said.rig, given.name);
  for (const { label, from_s } of said.segments) $("sinew-segment").append(new Option(`${from_s.toFixed(1)} s: ${label}`, String(from_s)));
  // It begins with what swings first; a run that does not swing, with its first seconds.
  const first = said.segments.find(({ label }) => /^(steady|free decay|tracking)/.test(label))?.from_s ?? 0;
  scope.go(first, first + Math.min(5, Math.max(said.end_s - first, 0.1)));
  document.body.dataset.samples = "shown";
  window.SinewScope = scope;
  let last = -1000;
  const draw = (at) => { requestAnimationFrame(draw); if (at - last > (calm.matches ? 200 : 30)) { last = at; scope.render(); } };
  draw(0);
}

begin();
