"use strict";
// Finished runs: the report, dividers that move over the landings, runs side by side, sweeps, measured trays.
import { ask, make, pick, state, tell } from "./core.js";
import { edit, openScene, view } from "./page.js";

const open = { run: null, data: null, ends: null, waiting: null, sending: false };
const when = (row) => new Date(1000 * row.made).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
const percent = (one) => one ? one[3] : "–"; // value, low, high, words

export function showStored(found) {
  const chosen = new Set([...document.querySelectorAll("#runs input:checked")].map((box) => box.value));
  pick("runs").replaceChildren(...found.runs.map((row) => make("div", { class: "row" },
    make("input", { type: "checkbox", value: row.name, "aria-label": `choose ${row.name}`, onchange: choose, ...(chosen.has(row.name) ? { checked: true } : {}) }),
    make("div", {}, make("button", { type: "button", title: row.name, onclick: () => openRun(row.name) }, row.title), make("small", {}, when(row), row.differs ? `; ${row.differs}` : "")))));
  if (!found.runs.length) pick("runs").append(make("p", { class: "soft" }, "None yet: run the scene."));
  pick("sweeps").replaceChildren(...found.sweeps.map((row) => make("div", { class: "row" }, make("div", {}, make("button", { type: "button", onclick: () => openSweep(row.name) }, row.name), make("small", {}, when(row))))));
  if (!found.sweeps.length) pick("sweeps").append(make("p", { class: "soft" }, "None yet: choose sweep, map or capacity beside Run."));
  choose();
}
const chosen = () => [...document.querySelectorAll("#runs input:checked")].map((box) => box.value);
function choose() { pick("compare").disabled = chosen().length < 2; }

function clear(name) {
  pick("answer-head").hidden = !name;
  pick("answer-name").textContent = name || "";
  ["answer-more", "verdict", "dividers", "shares", "beside", "points", "differs", "measured"].forEach((id) => pick(id).replaceChildren());
  pick("measured").hidden = true;
  pick("report").hidden = true;
}

export async function openRun(name) {
  const data = await ask("landings", { run: name });
  if (!data) return;
  tell("");
  clear(name);
  const told = (state.stored.runs.find((one) => one.name === name) || { title: name }).title;
  pick("answer-name").textContent = data.calibrated ? `${told}: ${data.calibrated}` : told;
  Object.assign(open, { run: name, data, ends: structuredClone(data.ends) });
  machine();
  place();
  shares(data);
  measured(data);
  beside(name);
  if (data.protocol) pick("answer-more").replaceChildren(make("button", { type: "button", onclick: () => report(`protocol/${name}`) }, "What to weigh"), make("button", { type: "button", onclick: () => report(`run/${name}`) }, "Report"));
  if (data.report) report(`run/${name}`);
  else pick("differs").replaceChildren(make("p", { class: "soft" }, `This run has no report yet; wakeflow report ${data.folder} draws it.`));
}

// The run before it, without being asked for.
async function beside(name) {
  const found = await ask("before", { run: name });
  if (!found || !found.other || open.run !== name || pick("answer-head").hidden) return;
  const rows = found.rows.map(([what, before, now, apart, clear]) => make("tr", {}, make("th", { scope: "row" }, what), make("td", {}, before), make("td", {}, now), make("td", {}, clear ? make("strong", {}, apart) : apart)));
  pick("beside").replaceChildren(make("div", { class: "scroll" }, make("table", {}, make("caption", {}, `${found.differs === "before its calibration" ? "Next to the answer before its calibration" : `Next to the run before, ${found.other.title} of ${when(found.other)}: ${found.differs || "the same scene"}`}. Bold: the interval of the difference leaves zero out.`),
    make("thead", {}, make("tr", {}, make("th", {}, "percent"), ...["before", "now", "difference"].map((head) => make("th", { scope: "col" }, head)))), make("tbody", {}, ...rows))));
}
function report(path) {
  pick("report").src = `${path.split("/").map(encodeURIComponent).join("/")}/`;
  pick("report").hidden = false;
}

// -- the machine, with where granules landed below its floor, above its top and along its walls
const WIDE = 900, LEFT = 60;  // of a sweep's picture
const STRIP = 80, ROOM = 26;  // points of the picture: height of the landings; room for the places of dividers
const paper = ([x, y]) => [open.data.origin[0] + open.data.scale * x, open.data.origin[1] - open.data.scale * y];
const level = (on) => on === "floor" || on === "top";
const along = (on, at) => level(on) ? paper([at, 0])[0] : paper([0, at])[1];

function machine() {
  const data = open.data, sketch = document.importNode(new DOMParser().parseFromString(data.svg, "image/svg+xml").documentElement, true);
  const [, , wide, tall] = sketch.getAttribute("viewBox").split(" ").map(Number), sides = Object.keys(data.sides);
  const above = sides.includes("top") ? STRIP + ROOM : 0, below = sides.includes("floor") ? STRIP + ROOM : 0;
  Object.entries({ x: 0, y: 0, width: wide, height: tall, role: "img", "aria-label": "The machine to scale" }).forEach(([name, value]) => sketch.setAttribute(name, value));
  // where landings are drawn from (base), which way they grow, and from where to where a divider goes
  const line = (on) => paper(level(on) ? [0, data.walls[on]] : [data.walls[on], 0])[level(on) ? 1 : 0], deep = 0.18 * data.scale * 2 * data.walls.right;
  open.at = { floor: { base: tall + STRIP, grows: -STRIP, from: line("floor"), to: tall + STRIP }, top: { base: -ROOM / 2, grows: -STRIP, from: -ROOM / 2 - STRIP, to: line("top") },
    left: { base: line("left"), grows: deep, from: line("left") - 14, to: line("left") + deep }, right: { base: line("right"), grows: -deep, from: line("right") - deep, to: line("right") + 14 } };
  const drawn = make("svg", { viewBox: `0 ${-above} ${wide} ${above + tall + below}`, style: `max-width: max(20rem, calc(85vh * ${(wide / (above + tall + below)).toFixed(3)}))`, role: "group", "aria-label": "Where each fraction landed, with the dividers" }, sketch, make("g", { id: "air" }), make("g", { id: "tracks" }));
  sides.forEach((on) => { drawn.append(side(on)); dividers(on).forEach((one) => drawn.append(divider(on, one))); });
  const box = (id, word) => make("label", {}, make("input", { type: "checkbox", "data-layer": id, onchange: layers }), ` ${word}`);
  pick("dividers").replaceChildren(make("div", { class: "buttons" }, ...Object.entries(data.colours).map(([name, colour]) => make("span", { class: "named" }, make("i", { style: `background: ${colour}` }), name)), box("tracks", "tracks"), box("air", "air")), make("div", { class: "drawn" }, drawn),
    make("p", { class: "soft" }, `Below the floor${above ? ", above the top" : ""} and along the walls: where each fraction lands, its own highest place full. Drag a divider, or choose it with Tab and move it with the arrow keys; places in mm.`));
}

function side(on) {
  const { span, profile } = open.data.sides[on], { base, grows } = open.at[on], drawn = make("g", { "data-on": on });
  const at = (place, part) => { const [a, b] = [along(on, place), base + 0.92 * grows * part]; return level(on) ? `${a},${b}` : `${b},${a}`; };
  Object.entries(profile).forEach(([name, cells]) => {
    const most = Math.max(...cells, 1e-12), colour = open.data.colours[name];
    const points = cells.map((part, i) => at(span[0] + (i + 0.5) * (span[1] - span[0]) / cells.length, part / most));
    drawn.append(make("polygon", { points: `${at(span[0], 0)} ${points.join(" ")} ${at(span[1], 0)}`, fill: colour, "fill-opacity": 0.22, stroke: colour, "stroke-width": 1.2 }));
  });
  drawn.append(make("polygon", { points: `${at(span[0], 0)} ${at(span[1], 0)}`, stroke: "#1b1f24" }));
  if (level(on)) drawn.append(make("text", { x: 2, y: base - 4 }, `${on}, mm`));
  return drawn;
}

async function layers() {
  const on = (id) => pick("dividers").querySelector(`[data-layer=${id}]`).checked, run = open.run;
  if (!open.data.inside && (on("tracks") || on("air"))) {
    const found = await ask("inside", { run });
    if (!found || open.run !== run) return;
    open.data.inside = found;
  }
  const { tracks, air } = open.data.inside || { tracks: {}, air: [] };
  const fast = Math.max(1e-9, ...air.map(([, , u, v]) => Math.hypot(u, v))), long = air.length ? 0.9 * open.data.scale * 2 * open.data.walls.right / 24 : 0;
  pick("tracks").replaceChildren(...(on("tracks") ? Object.entries(tracks).flatMap(([name, own]) => own.map((places) => make("path", { d: `M${places.map(paper).map((at) => at.map((one) => one.toFixed(1)).join(" ")).join("L")}`, fill: "none", stroke: open.data.colours[name], "stroke-width": 0.7, "stroke-opacity": 0.7 }))) : []));
  pick("air").replaceChildren(...(on("air") ? air.map(([x, y, u, v]) => {
    const [a, b] = paper([x, y]), [p, q] = [long * u / fast, -long * v / fast], tip = [a + p / 2, b + q / 2];
    return make("path", { d: `M${a - p / 2} ${b - q / 2}L${tip}M${tip[0] - 0.3 * p + 0.15 * q} ${tip[1] - 0.3 * q - 0.15 * p}L${tip}L${tip[0] - 0.3 * p - 0.15 * q} ${tip[1] - 0.3 * q + 0.15 * p}`, fill: "none", stroke: "#0b7285", "stroke-width": 0.6 });
  }) : []));
}

// The ends of bins on a side, those that touch together.
function dividers(on) {
  const found = new Map();
  Object.entries(open.data.ends).filter(([name]) => open.data.on[name] === on).forEach(([name, pair]) => pair.forEach((place, end) => {
    const key = place.toFixed(7);
    found.set(key, [...(found.get(key) || []), [name, end]]);
  }));
  return [...found.values()];
}

function divider(on, ends) {
  const [name, end] = ends[0], span = open.data.sides[on].span;
  const node = make("g", { class: "divider", tabindex: 0, role: "slider", "data-ends": JSON.stringify(ends), "aria-label": `divider ${ends.map(([bin]) => bin).join(" | ")}`, "aria-valuemin": 1000 * span[0], "aria-valuemax": 1000 * span[1] },
    ...["reach", ""].map((kind) => make("line", { class: kind, ...(level(on) ? { y1: open.at[on].from, y2: open.at[on].to } : { x1: open.at[on].from, x2: open.at[on].to }) })),
    make("text", level(on) ? { y: on === "floor" ? open.at[on].to + 12 : open.at[on].from - 3, "text-anchor": "middle" } : { x: on === "left" ? open.at[on].to + 3 : open.at[on].from - 3, y: -3, "text-anchor": on === "left" ? "start" : "end" }));
  if (!level(on)) node.classList.add("upright");
  let held = false;
  const to = (place) => {
    const step = open.data.step;
    place = Math.min(span[1], Math.max(span[0], step * Math.round(place / step)));
    ends.forEach(([bin, which]) => { open.ends[bin][which] = place; });
    position(node); follow();
  };
  node.addEventListener("pointerdown", (event) => { held = true; node.setPointerCapture(event.pointerId); event.preventDefault(); node.focus({ preventScroll: true }); });
  node.addEventListener("pointermove", (event) => {
    if (!held) return;
    const box = node.ownerSVGElement.getBoundingClientRect(), view = node.ownerSVGElement.viewBox.baseVal, dots = view.width / box.width;
    to(level(on) ? ((event.clientX - box.left) * dots - open.data.origin[0]) / open.data.scale : (open.data.origin[1] - view.y - (event.clientY - box.top) * dots) / open.data.scale);
  });
  ["pointerup", "pointercancel"].forEach((kind) => node.addEventListener(kind, () => { held = false; }));
  node.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
    if (way) { event.preventDefault(); to(open.ends[name][end] + way * open.data.step * (event.shiftKey ? 10 : 1)); }
  });
  return node;
}
function position(node) {
  const [[name, end]] = JSON.parse(node.dataset.ends), on = open.data.on[name], place = open.ends[name][end];
  const at = along(on, place);
  node.setAttribute("transform", level(on) ? `translate(${at} 0)` : `translate(0 ${at})`);
  node.setAttribute("aria-valuenow", 1000 * place);
  node.setAttribute("aria-valuetext", `${Number((1000 * place).toPrecision(6))} mm`);
  node.querySelector("text").textContent = Number((1000 * place).toPrecision(6));
}
function place() { document.querySelectorAll("#dividers .divider").forEach(position); }

async function follow() {
  open.waiting = structuredClone(open.ends);
  if (open.sending) return;
  open.sending = true;
  while (open.waiting) {
    const ends = open.waiting, from = performance.now();
    open.waiting = null;
    const found = await ask("dividers", { run: open.run, ends });
    if (found) { tell(""); shares(found); }
    pick("shares").dataset.took = String(Math.round(performance.now() - from));
  }
  open.sending = false;
}

function shares(found) {
  const names = Object.keys(found.shares), bins = Object.keys(found.shares[names[0]]);
  const cell = (bin, name) => make("td", { class: `share${open.data.targets[name].includes(bin) ? " wanted" : ""}`, style: `--share: ${100 * found.shares[name][bin][0]}` }, percent(found.shares[name][bin]));
  const purest = (bin) => Object.entries(found.purity[bin] || {}).sort((a, b) => b[1][0] - a[1][0])[0];
  const rows = bins.map((bin) => make("tr", {}, make("th", { scope: "row" }, bin), ...names.map((name) => cell(bin, name)),
    make("td", { class: "text" }, purest(bin) ? `${purest(bin)[0]} ${percent(purest(bin)[1])}` : "–"), make("td", {}, percent(found.dirt[bin]))));
  const below = (title, told) => make("tr", {}, make("th", { scope: "row" }, title), ...names.map((name) => make("td", {}, told(name))), make("td"), make("td"));
  const last = [below("recovery", (name) => percent(found.recovery[name])), below("loss", (name) => percent(found.loss[name])), below("loss, kg/h", (name) => found.lost[name].replace(" kg/h", ""))];
  last[0].className = "first";
  pick("verdict").replaceChildren(...found.limits.map((line) => make("p", { class: `note ${line.includes(": not met, ") ? "void" : ""}` }, line)));
  const moved = JSON.stringify(open.ends) !== JSON.stringify(open.data.ends);
  pick("own-dividers").disabled = pick("use-dividers").disabled = !moved;
  pick("shares").replaceChildren(make("div", { class: "scroll" }, make("table", {}, make("caption", {}, moved ? "Percent of each fraction's mass with the dividers as they are here, in brackets the 95 % interval." : `Percent of each fraction's mass, in brackets the 95 % interval: ${open.data.calibrated ? "the answer of the calibrated machine" : "the run's own answer"}.`),
    make("thead", {}, make("tr", {}, make("th", {}, "bin"), ...names.map((name) => make("th", { scope: "col" }, name)), make("th", { class: "text" }, "purity"), make("th", { scope: "col" }, "dirt"))), make("tbody", {}, ...rows, ...last))));
}

pick("own-dividers").addEventListener("click", () => { open.ends = structuredClone(open.data.ends); place(); follow(); });
pick("use-dividers").addEventListener("click", async () => {
  const set = {};
  Object.entries(open.ends).forEach(([bin, pair]) => pair.forEach((end, i) => {
    if (end !== open.data.ends[bin][i]) set[`bin.${bin}.${i ? "to" : "from"}`] = `"${Number((1000 * end).toPrecision(6))} mm"`;
  }));
  if (await edit({ set })) view("machine");
});
pick("edit-run").addEventListener("click", () => openScene({ run: open.run }));

// -- measured trays
function measured(data) {
  const names = Object.keys(data.shares), bins = Object.keys(data.shares[names[0]]);
  const box = (bin, name) => make("input", { size: 6, placeholder: "26.5", inputmode: "decimal", "data-bin": bin, "data-fraction": name, "aria-label": `${name} in ${bin}, percent of the ${name} that was fed` });
  const table = make("table", {}, make("caption", {}, "Percent of each fraction's mass that lay in each tray; leave empty what was not weighed."), make("thead", {}, make("tr", {}, make("th", {}, "measured, %"), ...names.map((name) => make("th", { scope: "col" }, name)))),
    make("tbody", {}, ...bins.map((bin) => make("tr", {}, make("th", { scope: "row" }, bin), ...names.map((name) => make("td", {}, box(bin, name)))))));
  const error = make("input", { size: 4, value: "2", "data-error": "1", "aria-label": "uncertainty of each, points" }), told = make("p", { class: "soft", role: "status" }, "Agreement and calibrated numbers appear in the list of runs.");
  const whole = make("details", {}, make("summary", {}, "Measured trays"), make("div", { class: "scroll" }, table), make("div", { class: "buttons" }, make("label", {}, "± points ", error),
    make("button", { type: "button", onclick: async () => {
      const boxes = [...table.querySelectorAll("input")].filter((one) => one.value.trim());
      const found = await ask("measured", { run: open.run, rows: boxes.map((one) => [one.dataset.fraction, one.dataset.bin, one.value]), error: error.value });
      if (!found) return;
      const wrong = found.wrong || {};
      boxes.forEach((one) => one.classList.toggle("wrong", `${one.dataset.fraction} in ${one.dataset.bin}` in wrong));
      error.classList.toggle("wrong", "±" in wrong);
      told.textContent = Object.entries(wrong).map(([where, what]) => `${where}: ${what}`).join("; ");
      if (!told.textContent) { tell(""); view("machine"); }
      else { const first = whole.querySelector("input.wrong") || table.querySelector("input"); first.focus(); }
    } }, "Compare and calibrate")), told);
  pick("measured").replaceChildren(whole);
  pick("measured").hidden = false;
}

// -- runs side by side
pick("compare").addEventListener("click", async () => {
  const runs = chosen(), found = await ask("compare", { runs });
  if (!found) return;
  tell("");
  clear("");
  const rows = Object.entries(found.differs).map(([key, values]) => make("tr", {}, make("th", { scope: "row" }, key), ...values.map((value) => make("td", {}, value))));
  pick("differs").replaceChildren(make("h2", {}, runs.join(", ")), make("div", { class: "scroll" }, make("table", {}, make("caption", {}, "What differs in their scenes (SI)"),
    make("thead", {}, make("tr", {}, make("th", {}, "key"), ...runs.map((name) => make("th", {}, name)))), make("tbody", {}, ...rows))));
  report(`compared/${found.page}`);
});

// -- a sweep's points
export async function openSweep(name) {
  const found = await ask("sweep", { sweep: name });
  if (!found) return;
  tell("");
  clear("");
  const list = (id, label, names) => make("select", { id, "aria-label": label, onchange: () => draw(name, found) }, ...names.map((one) => make("option", {}, one)));
  const first = found.numbers.filter((one) => one.startsWith("recovery."));
  pick("points").replaceChildren(make("h2", {}, name), make("div", { class: "buttons" }, list("along", "over", found.inputs), list("of", "quantity", [...first, ...found.numbers.filter((one) => !first.includes(one))])), make("div", { id: "cloud" }),
    ...found.figures.map((file) => make("img", { src: `figure/${[...name.split("/"), "figures", file].map(encodeURIComponent).join("/")}`, alt: `${name}: ${file}`, loading: "lazy" })));
  draw(name, found);
}
function draw(name, found) {
  const over = pick("along").value, of = pick("of").value;
  const rows = found.rows.filter((row) => row[of] !== "" && row[over] !== undefined), numeric = rows.every((row) => row[over] !== "" && !isNaN(row[over]));
  const words = [...new Set(rows.map((row) => row[over]))], x = (row) => numeric ? Number(row[over]) : words.indexOf(row[over]);
  const part = /^(without_collisions\.)?(share|purity|recovery|loss|dirt)\./.test(of), number = (text) => (part ? 100 : 1) * Number(text);
  const ends = rows.flatMap((row) => [row[of], row[`${of}.low`] || row[of], row[`${of}.high`] || row[of]].map(number));
  const range = (values) => { const [low, high] = [Math.min(...values), Math.max(...values)], room = 0.06 * (high - low) || 0.5; return [low - room, high + room]; };
  const [xs, ys] = [range(rows.map(x)), range(ends)], tall = 320;
  const px = (value) => LEFT + (WIDE - LEFT - 20) * (value - xs[0]) / (xs[1] - xs[0]), py = (value) => tall - (tall - 16) * (value - ys[0]) / (ys[1] - ys[0]);
  const drawn = make("svg", { viewBox: `0 0 ${WIDE} ${tall + 40}`, role: "group", "aria-label": `${of} over ${over}` });
  drawn.append(make("line", { x1: LEFT, x2: WIDE - 20, y1: tall, y2: tall, stroke: "#1b1f24" }), make("line", { x1: LEFT, x2: LEFT, y1: 0, y2: tall, stroke: "#1b1f24" }), make("text", { x: WIDE / 2, y: tall + 34, "text-anchor": "middle" }, over), make("text", { x: LEFT + 6, y: 12 }, part ? `${of}, %` : of));
  const power = 10 ** Math.floor(Math.log10((ys[1] - ys[0]) / 3)), step = [5, 2, 1].map((one) => one * power).find((one) => 3 * one <= ys[1] - ys[0]) || power;
  for (let value = Math.ceil(ys[0] / step) * step; value <= ys[1]; value += step) drawn.append(make("text", { x: LEFT - 5, y: py(value) + 4, "text-anchor": "end" }, Number(value.toPrecision(6))));
  new Map(rows.map((row) => [row[over], x(row)])).forEach((value, word) => drawn.append(make("text", { x: px(value), y: tall + 16, "text-anchor": "middle" }, word)));
  rows.forEach((row) => {
    const told = `${row.scene}: ${of} = ${row[of]}`;
    const node = make("g", { class: "point", tabindex: 0, role: "link", "aria-label": told, "data-scene": row.scene }, make("line", { x1: px(x(row)), x2: px(x(row)), y1: py(number(row[`${of}.low`] || row[of])), y2: py(number(row[`${of}.high`] || row[of])), stroke: "#56606a", "stroke-width": 1.5 }),
      make("circle", { cx: px(x(row)), cy: py(number(row[of])), r: 6, fill: "#0b7285" }));
    const go = () => row.run ? openRun(`${name === "." ? "" : `${name}/`}${row.scene}`) : tell(`${row.scene} has no result: ${row.reason || row.state}`);
    node.addEventListener("click", go);
    node.addEventListener("keydown", (event) => { if (event.key === "Enter") go(); });
    drawn.append(node);
  });
  pick("cloud").replaceChildren(drawn);
}
