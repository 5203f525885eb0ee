"use strict";
// A search: what should be most and least, which keys may change, what has to be kept, and how long it may take.
import { make, pick, state } from "./core.js";

const names = (text) => text.split(/[;,]/).map((one) => one.trim()).filter(Boolean);
const box = (name, size, more = {}) => make("input", { "data-search": name, size, autocomplete: "off", spellcheck: "false", "aria-label": name, ...more });
const lists = ["quantities", "keys", "searches"].map((id) => make("datalist", { id }));

// A key to change, from where to where; the value that the scene has is shown in both boxes.
function axis() {
  const [low, high] = [box("from", 8), box("to", 8)];
  const key = box("key to change", 22, { list: "keys", placeholder: "air.speed", onchange: (event) => {
    const own = fields().find((one) => one.key === event.target.value.trim());
    [low, high].forEach((one) => { one.placeholder = own ? `now ${own.value}` : ""; });
  } });
  return make("div", { class: "buttons", "data-row": "within" }, key, "from", low, "to", high);
}
function limit() {
  return make("div", { class: "buttons", "data-row": "where" }, box("number to keep", 22, { list: "quantities", placeholder: "purity.BIN.FRACTION" }),
    make("select", { "aria-label": "at least or at most" }, make("option", { value: "least" }, "at least"), make("option", { value: "most" }, "at most")), box("limit", 7, { placeholder: "98 %" }));
}
const fields = () => ((state.scene && state.scene.form) || []).flatMap((group) => group.fields).filter((one) => one.value !== null && /^[-+.\d]/.test(one.value));
const more = (word, made) => make("button", { type: "button", onclick: (event) => event.target.before(made()) }, word);

pick("search-form").append(...lists,
  make("div", { class: "buttons" }, make("label", {}, "most ", box("most", 26, { list: "quantities", placeholder: "recovery.FRACTION" })), make("label", {}, "least ", box("least", 26, { list: "quantities", placeholder: "airflow.fan_power" }))),
  axis(), axis(), more("Another key", axis), limit(), more("Another limit", limit),
  make("div", { class: "buttons" }, make("label", {}, "in at most ", box("time", 8, { value: "30 min" }), " of one core"), make("label", {}, "or from a file ", box("file", 18, { list: "searches", placeholder: "search.toml" }))),
  make("p", { class: "soft" }, "Several numbers with ; between them. Limits of the scene hold too. First designs are quick answers; the best are computed as the scene says."));

export function showQuantities(found) { lists[0].replaceChildren(...(found || []).map((value) => make("option", { value }))); lists[1].replaceChildren(...fields().map((one) => make("option", { value: one.key }, one.value))); }
export function showSearches(found) { lists[2].replaceChildren(...found.map((one) => make("option", { value: one.name }))); }

const value = (name) => pick("search-form").querySelector(`[data-search="${name}"]`).value.trim();
const rows = (kind) => [...pick("search-form").querySelectorAll(`[data-row=${kind}]`)].map((row) => [...row.querySelectorAll("input, select")].map((one) => one.value.trim())).filter(([first, ...rest]) => first || rest.some((one, i) => one && (kind === "within" || i === 1)));

// What the server reads: the name of a file, or the form.
export function searchTyped() {
  if (value("file")) return value("file");
  const where = {};
  rows("where").forEach(([name, end, typed]) => { where[name] = { ...where[name], [end]: typed }; });
  return JSON.stringify({ maximise: names(value("most")), minimise: names(value("least")), budget: value("time"), where,
    within: Object.fromEntries(rows("within").map(([key, from, to]) => [key, { from, to }])) });
}

// The boxes that a refusal names.
export function markSearch(told) {
  pick("search-form").querySelectorAll("input").forEach((one) => {
    const row = one.closest("[data-row]"), own = names(row ? row.querySelector("input").value : one.value);
    const about = { time: "search.budget", most: "search.maximise", least: "search.minimise" }[one.dataset.search];
    one.classList.toggle("wrong", Boolean(told) && (own.some((name) => told.includes(name)) || (about !== undefined && told.includes(about))));
  });
}
