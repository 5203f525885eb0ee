"use strict";
// What every part of the page needs: nodes, requests, what is told.
export const pick = (id) => document.getElementById(id);
export const state = { scene: null, stored: { runs: [], sweeps: [], scenes: [], kinds: [] } };

export function make(tag, attributes = {}, ...inner) {
  const svg = ["svg", "g", "circle", "line", "path", "polygon", "text", "rect"].includes(tag);
  const node = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  Object.entries(attributes).forEach(([name, value]) => {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value === true ? "" : value);
  });
  node.append(...inner);
  return node;
}

export function tell(text) {
  pick("told").textContent = text || "";
  pick("told").hidden = !text;
}

// One request; a mistake is told in its own words and given back as null.
export async function ask(action, what = {}) {
  let answer;
  try {
    answer = await fetch(action, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(what) });
  } catch { return ended(); }
  if (!answer.ok) { tell(`${action}: the server failed (${answer.status}); what it says is where wakeflow open was started`); return null; }
  const found = await answer.json();
  if (found.refused) { tell(found.refused); return null; }
  return found;
}

export function ended() {
  tell("wakeflow open has ended. Nothing here is lost as long as this page is open; start it again to go on.");
  return null;
}

