// Light and dark: chosen by whoever looks, remembered in the browser.
const key = "sinew-theme", system = matchMedia("(prefers-color-scheme: dark)");
let kept = "auto";
try { kept = localStorage.getItem(key) ?? "auto"; } catch { /* storage is off */ }

function apply() {
  const dark = kept === "dark" || (kept === "auto" && system.matches);
  document.body.classList.toggle("body--dark", dark);
  document.body.classList.toggle("body--light", !dark);
  document.documentElement.style.colorScheme = dark ? "dark" : "light";
}

for (const choice of document.querySelectorAll("#sinew-theme input")) {
  choice.checked = choice.value === kept;
  choice.addEventListener("change", () => {
    kept = choice.value;
    try { localStorage.setItem(key, kept); } catch { /* storage is off */ }
    apply();
  });
}

// What the library of the pages makes, and screen readers and keyboards need more of.
function mend() {
  for (const list of document.querySelectorAll(".q-menu .q-virtual-scroll__content:not([role])")) list.setAttribute("role", "group");
  for (const portal of document.querySelectorAll("[id^=q-portal]:not([role])")) {
    portal.setAttribute("role", "region");
    portal.setAttribute("aria-label", "Choice");
  }
  for (const table of document.querySelectorAll(".q-table__middle:not([tabindex])")) table.tabIndex = 0;
}

system.addEventListener("change", apply);
new MutationObserver(mend).observe(document.documentElement, { childList: true, subtree: true });
new MutationObserver(() => { // whoever sets the class afterwards does not know the choice
  const dark = kept === "dark" || (kept === "auto" && system.matches);
  if (document.body.classList.contains("body--dark") !== dark) apply();
}).observe(document.body, { attributes: true, attributeFilter: ["class"] });
apply();
mend();
