// Rows of the table of runs by keyboard: arrows go from row to row, space chooses, Enter opens, / goes to the search.

const REFOCUS_MS = 50;
const rows = () => [...document.querySelectorAll("#sinew-runs tbody tr")].filter((row) => row.querySelector("[role=checkbox]"));

function ready() {
  const all = rows();
  if (!all.length) return;
  const here = all.find((row) => row.tabIndex === 0) ?? all[0];
  for (const row of all) if (row.tabIndex !== (row === here ? 0 : -1)) row.tabIndex = row === here ? 0 : -1;
  // One stop of the tabulator for the whole table: its boxes are reached with the space of their row.
  for (const box of document.querySelectorAll("#sinew-runs tbody [role=checkbox]")) if (box.tabIndex !== -1) box.tabIndex = -1;
}

function go(row) {
  for (const one of rows()) one.tabIndex = one === row ? 0 : -1;
  row.focus();
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const isTyping = event.target.closest?.("input, textarea, select, [contenteditable]");
  if (event.key === "/" && !isTyping) {
    const field = document.getElementById("sinew-search");
    if (field) { event.preventDefault(); field.focus(); }
    return;
  }
  const row = event.target.closest?.("#sinew-runs tbody tr");
  if (!row || event.target !== row) return;
  const all = rows(), at = all.indexOf(row);
  const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: all.length - 1 }[event.key];
  if (to !== undefined) { event.preventDefault(); if (all[to]) go(all[to]); }
  else if (event.key === " ") {
    event.preventDefault();
    row.querySelector("[role=checkbox]").click();
    setTimeout(() => { const now = rows()[at]; if (now) go(now); }, REFOCUS_MS); // the box takes the focus to a part that goes away
  }
  else if (event.key === "Enter") { event.preventDefault(); row.querySelector("td:not(:first-child)").click(); }
});

ready();
new MutationObserver(ready).observe(document.querySelector("main, body"), { childList: true, subtree: true, attributes: true, attributeFilter: ["tabindex"] });
