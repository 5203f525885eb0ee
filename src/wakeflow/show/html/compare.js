"use strict";
// Without it, and on paper, the page shows all fractions, runs, pictures and quantities.
(function () {
  const all = (what) => document.querySelectorAll(what), pick = (id) => document.getElementById(id);
  function bars() {
    const off = (kind) => new Set([...all(`[data-${kind}]`)].filter((box) => !box.checked).map((box) => box.getAttribute(`data-${kind}`)));
    const fractions = off("show"), runs = off("show-run");
    all("#bars [data-fraction]").forEach((bar) => { bar.hidden = fractions.has(bar.dataset.fraction) || runs.has(bar.dataset.run); });
  }
  function pictures() {
    const over = pick("lay-over").checked, shown = pick("picture").value;
    pick("see-through").disabled = !over;
    all("[data-picture]").forEach((block) => {
      block.hidden = shown !== "" && block.dataset.picture !== shown;
      const pair = block.querySelector(".pair, .over"), figures = [...pair.querySelectorAll("figure")];
      pair.className = over ? "over" : "pair";
      figures.forEach((figure, i) => {
        const last = i === figures.length - 1;
        figure.hidden = over && i > 0 && !last;  // of several runs the first and the last
        figure.style.opacity = over && last ? String(pick("see-through").value / 100) : "";
      });
    });
  }
  all("[data-show], [data-show-run]").forEach((box) => box.addEventListener("change", bars));
  pick("only-sure").addEventListener("change", () => all("#all tbody tr").forEach((row) => {
    row.hidden = pick("only-sure").checked && !row.classList.contains("sure");
  }));
  if (pick("picture")) ["picture", "lay-over", "see-through"].forEach((id) => pick(id).addEventListener("input", pictures));
})();
