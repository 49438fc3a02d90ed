// The editor of a plan: it has a name for screen readers, the colours of the page, and is left by the tabulator key, as
// every other field.
const THEMES = { dark: "githubDark", light: "xcodeLight" };
let editor = null;

function colour() {
  editor?.setTheme(THEMES[document.body.classList.contains("body--dark") ? "dark" : "light"]);
}

function find() {
  const place = document.getElementById("sinew-plan-text"), text = place?.querySelector(".cm-content");
  if (!text) return;
  looking.disconnect();
  text.setAttribute("aria-label", "Plan as TOML");
  text.setAttribute("aria-describedby", "sinew-plan-state");
  text.tabIndex = 0;
  place.addEventListener("keydown", (event) => { if (event.key === "Tab") event.stopPropagation(); }, true);
  editor = window.getElement(Number(place.firstElementChild.id.slice(1)));
  colour();
  new MutationObserver(colour).observe(document.body, { attributes: true, attributeFilter: ["class"] });
}

const looking = new MutationObserver(find);
looking.observe(document.body, { childList: true, subtree: true });
find();
