// Sort tables by a click on a header, and unfold everything for printing. Needs no network.
"use strict";
const SECONDS = { h: 3600, min: 60, s: 1, ms: 1e-3 };
const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** Return the number at the beginning of a cell; a duration is converted to seconds. Return null for words. */
function valueOf(text) {
  const plain = text.replace(/−/g, "-").replace(/[\u202f\u00a0]/g, "").replace(/^[<>≈~[]\s*/, "").trim();
  const times = [...plain.matchAll(/(\d+(?:\.\d+)?)\s*(h|min|ms|s)\b/g)];
  if (times.length && times[0].index === 0) return times.reduce((sum, t) => sum + Number(t[1]) * SECONDS[t[2]], 0);
  const first = /^(-?\d+(?:\.\d+)?)(?: × 10(⁻?)([⁰¹²³⁴⁵⁶⁷⁸⁹]+))?/.exec(plain);
  if (!first) return null;
  const raised = (first[2] ? -1 : 1) * Number([...(first[3] ?? "")].map((c) => RAISED.indexOf(c)).join(""));
  return Number(first[1]) * 10 ** raised;
}

function sort(table, column, header) {
  const up = header.getAttribute("aria-sort") !== "ascending";
  for (const other of header.parentNode.children) other.setAttribute("aria-sort", "none");
  header.setAttribute("aria-sort", up ? "ascending" : "descending");
  const rows = [...table.tBodies[0].rows].map((row) => {
    const text = row.cells[column].textContent.trim();
    return { row, text, value: valueOf(text) };
  });
  const missing = (cell) => cell.text === "–" || cell.text === "";
  rows.sort((a, b) => {
    if (missing(a) !== missing(b)) return missing(a) ? 1 : -1;
    const order = a.value !== null && b.value !== null ? a.value - b.value
      : a.text.localeCompare(b.text, undefined, { numeric: true });
    return up ? order : -order;
  });
  table.tBodies[0].append(...rows.map((line) => line.row));
}

for (const table of document.querySelectorAll("table")) {
  const rows = table.tBodies[0] ? table.tBodies[0].rows : [];
  if (rows.length < 3) continue;
  [...table.tHead.rows[0].cells].forEach((header, column) => {
    header.setAttribute("aria-sort", "none");
    header.tabIndex = 0;
    header.addEventListener("click", () => sort(table, column, header));
    header.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(table, column, header); });
  });
}

const shut = new Set();
addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details:not([open])")) { shut.add(details); details.open = true; }
});
addEventListener("afterprint", () => { for (const details of shut) details.open = false; shut.clear(); });

/** Unfold the part of the page that contains the target of the current link. */
function reveal() {
  const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let node = target; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
  if (target) target.scrollIntoView();
}
addEventListener("hashchange", reveal);
if (location.hash) reveal();
