"use strict";
// The machine is the form: the report's own sketch with points to drag over it, and every key beside it.
import { make, pick, state, tell } from "./core.js";
import { edit } from "./page.js";

const held = { name: null, one: null, gesture: null, waiting: null, sending: false, timer: 0 };
const emptied = new Map();  // fields by key that were emptied here: they stay, to be filled anew
const absent = (one) => one.value === null && !emptied.has(one.key);
export const busyWithMachine = () => held.name !== null;

export function showMachine(scene) {
  if (scene.svg && scene.svg !== showMachine.svg) {
    showMachine.svg = scene.svg;
    const drawing = new DOMParser().parseFromString(scene.svg, "image/svg+xml").documentElement;
    drawing.setAttribute("role", "img");
    drawing.setAttribute("aria-label", "The machine to scale, with its measures");
    pick("paper").replaceChildren(document.importNode(drawing, true));
    pick("over").setAttribute("viewBox", drawing.getAttribute("viewBox"));
  }
  if (scene.handles) handles(scene);
  form(scene);
}

// -- points to drag
const onPaper = (scene, [x, y]) => [scene.origin[0] + scene.scale * x, scene.origin[1] - scene.scale * y];
const mm = (metres) => `${Number((1000 * metres).toPrecision(6))} mm`;
const said = (one) => `${one.label}, ${one.ways === "x" ? `x = ${mm(one.at[0])}` : one.ways === "y" ? `y = ${mm(one.at[1])}` : `x = ${mm(one.at[0])}, y = ${mm(one.at[1])}`}`;

function handles(scene) {
  const over = pick("over"), focus = document.activeElement && document.activeElement.dataset.handle;
  const known = new Map([...over.children].map((node) => [node.dataset.handle, node]));
  scene.handles.forEach((one) => {
    const node = known.get(one.name) || handle(one);
    known.delete(one.name);
    const [x, y] = onPaper(scene, one.at);
    if (held.name !== one.name || !node.parentNode) node.setAttribute("transform", `translate(${x} ${y})`);
    node.setAttribute("aria-label", said(one));
    node.querySelector("text").textContent = said(one);
    if (!node.parentNode) over.append(node);
  });
  known.forEach((node, name) => { if (name !== held.name) node.remove(); });
  if (focus) { const again = [...over.children].find((node) => node.dataset.handle === focus); if (again && again !== document.activeElement) again.focus(); }
}

function handle(one) {
  const node = make("g", { class: "handle", tabindex: 0, role: "button", "data-handle": one.name },
    make("circle", { class: "reach", r: 11 }), one.name.startsWith("channel ") ? make("rect", { x: -6, y: -3, width: 12, height: 6 }) : make("circle", { r: 4 }), make("text", { y: -8, "text-anchor": "middle" }));
  node.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    node.setPointerCapture(event.pointerId);
    node.classList.add("held");
    node.focus({ preventScroll: true });
    Object.assign(held, { name: one.name, one: find(one.name), gesture: `drag ${Date.now()}` });
    event.preventDefault();
  });
  node.addEventListener("pointermove", (event) => {
    if (held.name !== one.name) return;
    const [x, y] = place(event), now = find(one.name);
    const to = [now.ways.includes("x") ? x : now.at[0], now.ways.includes("y") ? y : now.at[1]];
    const shown = onPaper(state.scene, to);
    node.setAttribute("transform", `translate(${shown[0]} ${shown[1]})`);
    send({ drag: one.name, x: to[0], y: to[1], gesture: held.gesture });
  });
  const drop = () => { held.name = null; node.classList.remove("held"); if (!held.sending) showMachine(state.scene); };
  node.addEventListener("pointerup", drop);
  node.addEventListener("pointercancel", drop);
  node.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (event.key === "Enter") { show_field(find(one.name).key); return; }
    if (!way) return;
    event.preventDefault();
    const gesture = `keys ${one.name}`, step = state.scene.step * (event.shiftKey ? 10 : 1);
    const from = held.sending && held.last.gesture === gesture ? [held.last.x, held.last.y] : find(one.name).at;  // a key held down
    send({ drag: one.name, x: from[0] + way[0] * step, y: from[1] + way[1] * step, gesture });
  });
  node.addEventListener("dblclick", () => show_field(find(one.name).key));
  return node;
}
const find = (name) => state.scene.handles.find((one) => one.name === name) || held.one;

function place(event) {
  const over = pick("over"), box = over.getBoundingClientRect(), wide = over.viewBox.baseVal.width, tall = over.viewBox.baseVal.height;
  const [x, y] = [(event.clientX - box.left) * wide / box.width, (event.clientY - box.top) * tall / box.height];
  return [(x - state.scene.origin[0]) / state.scene.scale, (state.scene.origin[1] - y) / state.scene.scale];
}

// One request is on its way at a time; of what comes meanwhile only the last counts.
async function send(what) {
  held.waiting = held.last = what;
  if (held.sending) return;
  held.sending = true;
  while (held.waiting) {
    const next = held.waiting;
    held.waiting = null;
    await edit(next);
  }
  held.sending = false;
  if (!held.name) showMachine(state.scene);
}

// -- the form
function show_field(key) {
  const input = document.querySelector(`#form [data-key="${CSS.escape(key)}"]`);
  if (!input) return;
  input.closest("details").open = true;
  input.closest(".field").classList.add("found");
  input.scrollIntoView({ block: "center" });
  input.focus();
  input.select();
}

function form(scene) {
  if (!scene.form) return;
  const groups = new Map([...pick("form").children].map((node) => [node.dataset.table, node]));
  scene.form.forEach((group, i) => {
    const node = groups.get(group.table) || make("details", { "data-table": group.table, open: group.fields.some((one) => one.value !== null) });
    groups.delete(group.table);
    const before = new Map([...node.querySelectorAll("input")].map((input, at) => [input.dataset.key, at]));
    const gone = [...emptied.values()].filter((one) => one.table === group.table && group.fields.every((other) => other.key !== one.key));
    group.fields = [...group.fields, ...gone].sort((a, b) => (before.get(a.key) ?? before.size) - (before.get(b.key) ?? before.size));
    node.classList.toggle("absent", group.fields.every(absent));
    fields(node, group, scene);
    if (pick("form").children[i] !== node) pick("form").insertBefore(node, pick("form").children[i] || null);
  });
  groups.forEach((node) => node.remove());
  const kinds = scene.addable.map((one) => one.table).join();
  if (kinds !== form.kinds) {
    form.kinds = kinds;
    pick("add-kind").replaceChildren(...scene.addable.map((one) => make("option", { value: one.table, title: one.about, "data-named": one.named ? "1" : "" }, one.table)));
    named();
  }
  look_for();
}

function fields(node, group, scene) {
  const shape = JSON.stringify(group.fields.map((one) => [one.key, one.choices]));
  if (node.dataset.shape !== shape) {
    node.dataset.shape = shape;
    const drop = make("button", { type: "button", class: "drop", onclick: (event) => { event.preventDefault(); edit({ set: { [group.table]: null } }); } }, "Remove");
    node.replaceChildren(make("summary", { title: group.about }, group.table || "the whole scene", ...(group.removable ? [drop] : [])), ...group.fields.map((one) => field(one, group.table)));
  }
  group.fields.forEach((one, i) => {
    const row = node.children[i + 1], input = row.querySelector("input");
    row.classList.toggle("absent", absent(one));
    if (document.activeElement !== input || input.dataset.typed === input.value) input.dataset.typed = input.value = one.value === null ? "" : one.value;
    const wrong = [`: ${one.key} = `, `: ${one.key}: `, `: ${one.key}[`];
    const told = scene.mistake.split("\n").filter((line) => wrong.some((start) => line.includes(start))).map((line) => line.slice(line.indexOf(one.key))).join("; ");
    row.classList.toggle("wrong", Boolean(told));
    row.querySelector("small").replaceChildren(told, ...cures(told, one));
  });
}

// What a mistake says that may be meant, each to be taken with a click: of a decimal comma the number with a point.
function cures(told, one) {
  if (told.includes("unknown key") || one.value === null) return [];
  const given = (told.match(/ = '([^']*)': /) || [])[1] || one.value;
  const named = (told.match(/(?:without a mark: |did you mean )('[^']+'(?:,? (?:or )?'[^']+')*)/) || ["", ""])[1].match(/'[^']+'/g) || [];
  const found = named.length ? named.map((word) => word.slice(1, -1)) : /^[^,]*\d,\d+(?!\d)[^,]*$/.test(given) && told ? [given.replace(",", ".")] : [];
  return found.map((word) => make("button", { type: "button", class: "cure", onclick: () => edit({ set: { [one.key]: one.value.replace(given, word) }, gesture: `type ${one.key}` }) }, `Write ${word}`));
}

function field(one, table) {
  const id = `key ${one.key}`, list = `choices ${one.key}`;
  const input = make("input", { id, "data-key": one.key, placeholder: one.hint, autocomplete: "off", spellcheck: "false", list: one.choices.length ? list : null });
  const typed = () => {
    clearTimeout(held.timer);
    if (input.value === input.dataset.typed) return;
    input.dataset.typed = input.value;
    if (input.value.trim() === "") emptied.set(one.key, { ...one, table, value: null });
    edit({ set: { [one.key]: input.value.trim() === "" ? null : input.value }, gesture: `type ${one.key}` });
  };
  input.addEventListener("input", () => { clearTimeout(held.timer); held.timer = setTimeout(typed, 400); });
  input.addEventListener("change", typed);
  input.addEventListener("keydown", (event) => { if (event.key === "Enter") typed(); });
  return make("div", { class: "field", title: one.about }, make("label", { for: id }, one.label), input, make("small"),
    ...(one.choices.length ? [make("datalist", { id: list }, ...one.choices.map((choice) => make("option", { value: choice })))] : []));
}

function look_for() {
  const wanted = pick("find").value.trim().toLowerCase();
  pick("form").classList.toggle("all", pick("show-all").checked);
  document.querySelectorAll("#form .field").forEach((row) => {
    const found = wanted && `${row.querySelector("input").dataset.key} ${row.title}`.toLowerCase().includes(wanted);
    row.hidden = Boolean(wanted) && !found;
    row.classList.toggle("found", Boolean(found));
  });
  if (wanted || look_for.before) document.querySelectorAll("#form details").forEach((node) => {
    node.classList.toggle("found", Boolean(node.querySelector(".found")));
    node.open = wanted ? node.classList.contains("found") : !node.classList.contains("absent");
  });
  look_for.before = wanted;
}
pick("find").addEventListener("input", look_for);
pick("show-all").addEventListener("change", look_for);

const named = () => { pick("add-name").hidden = !(pick("add-kind").selectedOptions[0] || { dataset: {} }).dataset.named; };
pick("add-kind").addEventListener("change", named);
pick("add").addEventListener("click", async () => {
  const kind = pick("add-kind").value, name = pick("add-name").value.trim();
  if (!pick("add-name").hidden && !name) { tell(`give the new ${kind} a name`); return; }
  if (await edit({ add: pick("add-name").hidden ? kind : `${kind}.${name}` })) pick("add-name").value = "";
});
