"use strict";
// The page: what the server says is shown, what a person does is sent. No library, nothing from outside.
import { ask, ended, make, pick, state, tell } from "./core.js";
import { showMachine, busyWithMachine } from "./machine.js";
import { showStored, openRun, openSweep } from "./results.js";
import { markSearch, searchTyped, showQuantities, showSearches } from "./search.js";

// -- the scene
const plan = { timer: 0, asked: 0 };

export function show(scene) {
  if (!scene || (state.scene && scene.version < state.scene.version)) return;
  const older = !state.scene || scene.version !== state.scene.version;
  state.scene = scene;
  pick("scene-name").textContent = `${scene.file || `${scene.name} (no file yet)`}${scene.changed ? " · not saved" : ""}`;
  document.title = `${scene.changed ? "• " : ""}${scene.name} – wakeflow`;
  pick("save").disabled = !scene.changed;
  pick("undo").disabled = !scene.undo;
  pick("redo").disabled = !scene.redo;
  pick("conflict").hidden = !scene.conflict;
  pick("mistake").replaceChildren(scene.mistake, ...mended(scene));
  pick("mistake").hidden = !scene.mistake;
  document.body.classList.toggle("stale", Boolean(scene.mistake));
  pick("run").disabled = pick("capacity").disabled = Boolean(scene.mistake);
  pick("run-name").placeholder = scene.name;
  if (document.activeElement !== pick("text") || pick("text").dataset.sent === pick("text").value) setText(scene.text);
  showMachine(scene);
  if (older) {
    pick("plan").classList.add("old");
    clearTimeout(plan.timer);
    plan.timer = setTimeout(askPlan, 250);
  }
}

// A line that is no TOML, as the mistake says it should be written, to be taken with a click.
function mended(scene) {
  const found = scene.mistake.match(/not valid TOML: .*at line (\d+), .*; (?:write a decimal point|put quotes round a value with a unit): (.+)$/);
  if (!found) return [];
  const lines = scene.text.split("\n"), rest = (lines[found[1] - 1].match(/\s+#.*$/) || [""])[0];
  lines[found[1] - 1] = found[2] + rest;
  return [make("br"), make("button", { type: "button", class: "cure", onclick: () => edit({ text: lines.join("\n"), before: scene.text }) }, `Write ${found[2]}`)];
}

function setText(text) {
  const box = pick("text");
  if (box.value !== text) {
    const [start, end, top] = [box.selectionStart, box.selectionEnd, box.scrollTop];
    box.value = text;
    box.setSelectionRange(start, end);
    box.scrollTop = top;
  }
  box.dataset.sent = text;
}

export async function edit(what) {
  const scene = await ask("edit", what);
  if (scene) { tell(""); show(scene); }
  else if (state.scene) show(await ask("state"));
  return scene;
}

async function askPlan() {
  const found = await ask("plan");
  if (!found || found.version !== state.scene.version) return;
  pick("plan").classList.remove("old");
  if (!found.lines) { pick("plan").replaceChildren(make("p", {}, found.mistake || "No plan until the scene is right.")); return; }
  showQuantities(found.quantities);
  const rows = found.lines.map(([label, text]) => make("tr", {}, make("th", { scope: "row" }, label), make("td", {}, text)));
  pick("plan").replaceChildren(make("table", {}, make("tbody", {}, ...rows)), falls(found),
    ...Object.entries(found.notes).filter(([, lines]) => lines.length).map(([title, lines]) => make("details", {}, make("summary", {}, `${title}: ${lines.length}`), make("ul", {}, ...lines.map((line) => make("li", {}, line))))));
}

// Each fraction's terminal velocity as a bar beside the speed of the air, and what becomes of it.
function falls(found) {
  const speeds = found.falls.map((one) => one.terminal || 0), most = Math.max(...speeds, found.air || 0, 1e-9);
  const rows = found.falls.flatMap((one) => [make("span", {}, one.name),
    make("div", { class: "air", style: `--air: ${found.air ? 100 * found.air / most : -10}%`, title: "bar: terminal velocity; line: speed of the air" },
      make("div", { class: "bar", style: `width: ${100 * (one.terminal || 0) / most}%` })),
    make("span", {}, `${one.terminal ? `${one.terminal.toPrecision(3)} m/s, ` : ""}${one.told}`)]);
  return make("div", { class: "falls" }, ...rows);
}

let typing = 0;
pick("text").addEventListener("input", () => {
  clearTimeout(typing);
  typing = setTimeout(() => {
    const box = pick("text"), before = box.dataset.sent;
    box.dataset.sent = box.value;
    edit({ text: box.value, before, gesture: `text ${Math.floor(Date.now() / 4000)}` });
  }, 300);
});
pick("text").addEventListener("blur", () => { if (pick("text").dataset.sent === pick("text").value) setText(state.scene.text); });

async function save() {
  const name = state.scene.file ? undefined : prompt("Name of the scene file", `${state.scene.name}.toml`);
  if (name === null) return;
  const scene = await ask("save", name ? { name } : {});
  if (scene) { tell(`${scene.file} saved`); show(scene); list(); }
}
pick("save").addEventListener("click", save);
pick("undo").addEventListener("click", () => edit({ undo: true }));
pick("redo").addEventListener("click", () => edit({ redo: true }));
document.querySelectorAll("[data-keep]").forEach((button) => button.addEventListener("click", async () => show(await ask("settle", { keep: Boolean(button.dataset.keep) }))));
document.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
  const key = event.key.toLowerCase();
  if (key === "s") { event.preventDefault(); if (state.scene.changed) save(); }
  if (key === "enter") { event.preventDefault(); runChosen(); }
  if ((key === "z" || key === "y") && event.target !== pick("text") && event.target.type !== "search") {
    event.preventDefault(); edit(key === "y" || event.shiftKey ? { redo: true } : { undo: true });
  }
});
addEventListener("beforeunload", (event) => { if (state.scene && state.scene.changed && state.scene.undo) event.preventDefault(); });

pick("open").addEventListener("change", async (event) => {
  const [what, name] = event.target.value.split(/:(.*)/);
  event.target.selectedIndex = 0;
  await openScene({ [what]: name });
});
export async function openScene(what) {
  const unsaved = state.scene.changed && state.scene.undo;
  if (unsaved && !confirm(`${state.scene.name} is not saved. Open the other one all the same?`)) return;
  const scene = await ask("open", { ...what, drop: true });
  if (scene) { tell(""); show(scene); view("machine"); }
}

// -- runs
async function run(kind, typed) {
  const found = await ask("run", { name: pick("run-name").value.trim(), quick: pick("quick").checked, kind, typed });
  if (found) { tell(""); showQueue(found.queue); }
  if (kind === "search") markSearch(found ? "" : pick("told").textContent);
}
const runChosen = () => run(pick("kind").value, pick("kind").value === "search" ? searchTyped() : pick("typed").value);
pick("run").addEventListener("click", runChosen);
pick("capacity").addEventListener("click", () => run("capacity", ""));

// What is typed for each kind of task, as the command line takes it.
const TYPED = { sweep: "air.speed=4,5,6 m/s; feed.width='20 mm:40 mm:5'", map: "empty, or air.speed=3:7:5 m/s; feed.rate=200:800:4 kg/hour", capacity: "empty, or feed.rate=200:800:4 kg/hour", protocol: "empty, or FRACTION or FRACTION.BIN" };
pick("kind").addEventListener("change", () => {
  const kind = pick("kind").value;
  Object.assign(pick("typed"), { hidden: !TYPED[kind], placeholder: TYPED[kind] || "", title: TYPED[kind] || "", value: "" });
  pick("search-form").hidden = kind !== "search";
});

// Of a search the designs at its finest level.
const finest = (folder) => state.stored.sweeps.map((one) => one.name).filter((name) => name.startsWith(`${folder}/level-`)).sort().pop() || folder;
const time = (seconds) => seconds < 100 ? `${Math.round(seconds)} s` : seconds < 5400 ? `${Math.round(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`;
function showQueue(queue) {
  const focus = document.activeElement && document.activeElement.dataset.act;
  const finished = queue.filter((one) => one.state === "done").length;
  pick("queue").replaceChildren(...queue.map((one) => {
    const act = (word, name) => make("button", { type: "button", "data-act": `${name} ${one.number}`, onclick: async () => { const found = await ask("job", { number: one.number, act: name }); if (found) showQueue(found.queue); } }, word);
    const acts = { waits: [act("Stop", "stop")], "is computed": [act("Stop", "stop")], stopped: [act("Go on", "go_on"), act("Drop", "drop")], failed: [act("Try again", "go_on"), act("Drop", "drop")] }[one.state]
      || [make("button", { type: "button", onclick: () => { view("results"); (["run", "protocol"].includes(one.kind) ? openRun : openSweep)(one.kind === "search" ? finest(one.folder) : one.folder); } }, "Results"), act("Drop", "drop")];
    const left = one.state === "is computed" && one.seconds_left !== undefined && one.seconds_left !== null ? `, about ${time(one.seconds_left)} left` : "";
    const stage = one.state === "is computed" && one.stage ? `${one.stage}: ${one.text}${one.of ? `; stage ${one.at} of ${one.of}` : ""}${left}` : one.told;
    const [, behind, all] = (one.text || "").match(/(\d+) of (\d+) stages/) || [0, 0, 1];
    return make("div", { class: "job" }, make("div", { class: "buttons" }, make("strong", {}, one.name), make("span", { class: "state" }, one.state), ...acts),
      ...(one.state === "is computed" ? [make("progress", { max: 1, value: one.part || behind / all, "aria-label": `${one.name}: part of the expected time` })] : []),
      make("div", { class: "soft" }, stage || ""));
  }));
  if (focus) { const again = document.querySelector(`[data-act="${focus}"]`); if (again) again.focus(); }
  if (finished !== showQueue.finished) { showQueue.finished = finished; list(); }
}

// -- what there is on the disk
export async function list() {
  const found = await ask("list");
  if (!found) return;
  state.stored = found;
  showQueue.finished = found.queue.filter((one) => one.state === "done").length;
  showQueue(found.queue);
  const group = (label, what, names) => make("optgroup", { label }, ...names.map((name) => make("option", { value: `${what}:${name}` }, name)));
  pick("open").replaceChildren(make("option", {}, "Open …"), group("scene files", "file", found.scenes.map((one) => one.name)), group("a new one from", "kind", found.kinds));
  if (!pick("kind").options.length) pick("kind").replaceChildren(...["run", ...found.tasks].map((kind) => make("option", {}, kind)));
  showSearches(found.searches);
  showStored(found);
}

export function view(which) {
  ["machine", "results"].forEach((name) => {
    pick(`${name}-view`).hidden = name !== which;
    pick(`show-${name}`).setAttribute("aria-pressed", String(name === which));
  });
}
["machine", "results"].forEach((name) => pick(`show-${name}`).addEventListener("click", () => view(name)));

// -- what the server says
const hears = {
  scene: (scene) => { if (!busyWithMachine()) show(scene); },
  queue: (found) => showQueue(found.queue),
  end: () => { listen.over = true; ended(); },
};
function listen(again) {
  const news = new WebSocket(new URL("events", location.href.replace(/^http/, "ws")));
  news.addEventListener("message", (event) => { const told = JSON.parse(event.data); hears[told.kind](told.data); });
  news.addEventListener("open", async () => { if (state.scene) show(await ask("state")); if (again === true) list(); });
  news.addEventListener("close", () => { if (!listen.over) setTimeout(listen, 1000, true); });  // the machine slept, say
}

show(await ask("state"));
await list();
if (state.stored.shown) { view("results"); openRun(state.stored.shown); }
listen();
