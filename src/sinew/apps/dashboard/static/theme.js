// This is where light and dark are chosen, and remembered in the browser.
const key = "sinew-theme", system = matchMedia("(prefers-color-scheme: dark)");
let kept = "auto";
try { kept = localStorage.getItem(key) ?? "auto"; } catch { /* storage is off */ }

function apply() {
  const dark = kept === "dark" || (kept === "auto" && system.matches);
  document.body.classList.toggle("body--dark", dark);
  document.body.classList.toggle("body--light", !dark);
  document.documentElement.style.colorScheme = dark ? "dark" : "light";
}

function wire() {
  // What scrolls must be reachable by keyboard.
  for (const table of document.querySelectorAll(".q-table__middle:not([tabindex])")) table.tabIndex = 0;
  const choice = document.getElementById("sinew-theme");
  if (!choice || choice.dataset.wired) return;
  choice.dataset.wired = "yes";
  choice.value = kept;
  choice.addEventListener("change", () => {
    kept = choice.value;
    try { localStorage.setItem(key, kept); } catch { /* storage is off */ }
    apply();
  });
}

system.addEventListener("change", apply);
new MutationObserver(wire).observe(document.documentElement, { childList: true, subtree: true });
new MutationObserver(() => { // whoever sets the class afterwards does not know the choice
  const dark = kept === "dark" || (kept === "auto" && system.matches);
  if (document.body.classList.contains("body--dark") !== dark) apply();
}).observe(document.body, { attributes: true, attributeFilter: ["class"] });
apply();
wire();
