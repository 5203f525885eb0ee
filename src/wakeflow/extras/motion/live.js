"use strict";
// The page's own script: plain, no library, no request. Without it, and on paper, the page says the same in tables.
(function () {
  const data = JSON.parse(document.getElementById("live-data").textContent);
  const canvas = document.getElementById("machine"), pen = canvas.getContext("2d"), told = document.getElementById("told");
  const pick = (id) => document.getElementById(id);
  const [left, right, low, high] = data.window, wide = right - left, tall = high - low;
  const ROOM = 0.05 * Math.max(wide, tall);  // round the channel, mm
  const view = { x: (left + right) / 2, y: (low + high) / 2, zoom: 1 };
  const state = { phase: 0, playing: false, chosen: -1, last: 0 };
  const images = data.frames.map((source) => { const image = new Image(); image.onload = draw; image.src = source; return image; });
  const shown = new Map(data.fractions.map((one) => [one.name, true]));
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function scale() {
    return view.zoom * Math.min(canvas.width / (wide + 2 * ROOM), canvas.height / (tall + 2 * ROOM));
  }
  function place(x, y) {
    const s = scale();
    return [canvas.width / 2 + s * (x - view.x), canvas.height / 2 - s * (y - view.y)];
  }
  function line(flat) {
    pen.beginPath();
    for (let i = 0; i < flat.length; i += 2) pen[i ? "lineTo" : "moveTo"](...place(flat[i], flat[i + 1]));
  }
  function loop() { return data.loop || longest(); }
  function longest() {
    const spans = data.fractions.flatMap((one) => one.tracks.map((track) => track.step * (track.at.length / 2 - 1)));
    return Math.max(0.01, ...spans);
  }
  // How many of a fraction's tracks are shown: by mass the heaviest fraction has all of them, and none has less than one.
  function count(one) {
    if (!pick("by-mass").checked) return one.tracks.length;
    const most = Math.max(...data.fractions.map((other) => other.feed));
    return Math.max(1, Math.round(one.tracks.length * one.feed / most));
  }
  function some(one) {
    const n = Math.min(count(one), one.tracks.length), step = one.tracks.length / Math.max(n, 1);
    return Array.from({ length: n }, (_, i) => one.tracks[Math.floor(i * step)]);
  }
  function draw() {
    const s = scale(), ink = style("--ink");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.fillStyle = style("--page");
    pen.fillRect(0, 0, canvas.width, canvas.height);
    const frame = images[Math.floor(state.phase * images.length) % Math.max(images.length, 1)];
    if (frame && frame.complete && pick("show-air").checked)
      pen.drawImage(frame, ...place(left, high), s * wide, s * tall);
    if (pick("show-tracks").checked) tracks();
    if (pick("show-granules").checked) granules();
    data.bodies.forEach((body) => {
      line(body); pen.closePath();
      pen.fillStyle = "#8a8a8a"; pen.fill(); pen.strokeStyle = ink; pen.lineWidth = 1; pen.stroke();
    });
    pen.strokeStyle = ink; pen.lineWidth = 2;
    [[left, low, left, high], [right, low, right, high]].forEach((wall) => { line(wall); pen.stroke(); });
    data.bins.forEach((bin, i) => {
      line(bin.line);
      pen.lineWidth = i === state.chosen ? 12 : 7;
      pen.strokeStyle = i === state.chosen ? style("--accent") : i % 2 ? "#8d8d8d" : ink;
      pen.stroke();
    });
  }
  function tracks() {
    data.fractions.filter((one) => shown.get(one.name)).forEach((one) => {
      pen.strokeStyle = one.colour; pen.globalAlpha = 0.5; pen.lineWidth = 1.1;
      some(one).forEach((track) => { line(track.at.map((x) => x / 10)); pen.stroke(); });
    });
    pen.globalAlpha = 1;
  }
  // Every granule whose own clock is at this phase of the loop, whole loops apart: it met this very frame.
  function granules() {
    const period = loop(), now = (data.loop ? data.start || 0 : 0) + state.phase * period;
    data.fractions.filter((one) => shown.get(one.name)).forEach((one) => {
      pen.fillStyle = one.colour; pen.strokeStyle = style("--ink"); pen.lineWidth = 0.6;
      some(one).forEach((track) => {
        const n = track.at.length / 2, span = track.step * (n - 1), begin = data.loop ? track.from : 0;
        let late = (now - begin) % period;
        if (late < 0) late += period;
        for (; late <= span; late += period) {
          const i = Math.min(n - 2, Math.floor(late / track.step)), part = late / track.step - i;
          const at = (k) => (track.at[2 * i + k] * (1 - part) + track.at[2 * i + 2 + k] * part) / 10;
          pen.beginPath(); pen.arc(...place(at(0), at(1)), 4, 0, 7); pen.fill(); pen.stroke();
        }
      });
    });
  }
  function tell(i) {
    state.chosen = i;
    const bin = data.bins[i];
    if (!bin) { told.textContent = "Point at a bin, or choose one, to read what lands in it."; }
    else {
      const parts = Object.entries(bin.shares).map(([name, share]) => name + " " + share);
      const pure = Object.entries(bin.purity).filter(([, share]) => !share.startsWith("0.0")).map(([name, share]) => name + " " + share);
      told.textContent = bin.name + ": of all " + parts.join("; of all ") + ". "
        + (bin.flow ? bin.flow.toPrecision(3) + " kg/h; made of " + pure.join(", ") + "." : "It stays empty.");
    }
    draw();
  }
  function nearest(event) {
    const box = canvas.getBoundingClientRect(), s = canvas.width / box.width;
    const at = [(event.clientX - box.left) * s, (event.clientY - box.top) * s];
    let best = -1, least = 24;
    data.bins.forEach((bin, i) => {
      for (let k = 0; k + 3 < bin.line.length; k += 2) {
        const a = place(bin.line[k], bin.line[k + 1]), b = place(bin.line[k + 2], bin.line[k + 3]);
        const along = [b[0] - a[0], b[1] - a[1]], size = along[0] ** 2 + along[1] ** 2 || 1;
        const part = Math.min(1, Math.max(0, ((at[0] - a[0]) * along[0] + (at[1] - a[1]) * along[1]) / size));
        const gap = Math.hypot(at[0] - a[0] - part * along[0], at[1] - a[1] - part * along[1]);
        if (gap < least) { least = gap; best = i; }
      }
    });
    return best;
  }
  function zoom(factor) {
    view.zoom = Math.min(12, Math.max(1, view.zoom * factor));
    if (view.zoom === 1) { view.x = (left + right) / 2; view.y = (low + high) / 2; }
    draw();
  }
  function phase(value) {
    state.phase = ((value % 1) + 1) % 1;
    pick("phase").value = String(Math.round(1000 * state.phase));
    const seconds = state.phase * loop();
    pick("phase-told").textContent = (1000 * seconds).toFixed(0) + " ms of " + (1000 * loop()).toFixed(0) + " ms";
    draw();
  }
  function play(now) {
    if (!state.playing) return;
    if (state.last) phase(state.phase + (now - state.last) / 1000 * data.played / loop());
    state.last = now;
    requestAnimationFrame(play);
  }

  // -- shares by wake: a group of bars a bin, the answer's interval as a line in each
  function bars() {
    const wake = pick("wake") ? pick("wake").value : "answer";
    const values = wake === "answer" ? data.wakes.answer : data.wakes.others[wake] || {};
    document.querySelectorAll("#bars [data-fraction]").forEach((bar) => {
      const name = bar.dataset.fraction, value = (values[name] || {})[bar.dataset.bin];
      bar.hidden = !shown.get(name);
      bar.style.setProperty("--value", String(value === undefined ? 0 : value));
      bar.querySelector(".value span").textContent = value === undefined ? "" : value.toFixed(value < 10 ? 1 : 0);
      bar.title = name + " in " + bar.dataset.bin + ": " + (value === undefined ? "not flown" : value.toFixed(1) + " %");
    });
  }

  document.querySelectorAll("[data-show]").forEach((box) => box.addEventListener("change", () => {
    shown.set(box.dataset.show, box.checked); bars(); draw();
  }));
  ["by-mass", "show-air", "show-tracks", "show-granules"].forEach((id) => pick(id).addEventListener("change", draw));
  if (pick("wake")) pick("wake").addEventListener("change", bars);
  pick("phase").addEventListener("input", (event) => phase(Number(event.target.value) / 1000));
  pick("play").addEventListener("click", () => {
    state.playing = !state.playing; state.last = 0;
    pick("play").textContent = state.playing ? "Pause" : "Play";
    pick("play").setAttribute("aria-pressed", String(state.playing));
    if (state.playing) requestAnimationFrame(play);
  });
  pick("zoom-in").addEventListener("click", () => zoom(1.5));
  pick("zoom-out").addEventListener("click", () => zoom(1 / 1.5));
  pick("zoom-all").addEventListener("click", () => zoom(1e-9));
  pick("bin").addEventListener("change", (event) => tell(event.target.selectedIndex - 1));
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons === 1) {
      const s = scale() * canvas.getBoundingClientRect().width / canvas.width;
      view.x -= event.movementX / s; view.y += event.movementY / s; draw();
    } else {
      const i = nearest(event);
      if (i !== state.chosen) { tell(i); pick("bin").selectedIndex = i + 1; }
    }
  });
  canvas.addEventListener("keydown", (event) => {
    const step = 0.1 * Math.max(wide, tall) / view.zoom;
    const keys = { "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), "0": () => zoom(1e-9),
      ArrowLeft: () => { view.x -= step; draw(); }, ArrowRight: () => { view.x += step; draw(); },
      ArrowUp: () => { view.y += step; draw(); }, ArrowDown: () => { view.y -= step; draw(); },
      " ": () => pick("play").click() };
    if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  tell(-1); phase(0); bars();
})();
