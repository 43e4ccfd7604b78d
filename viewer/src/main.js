/**
 * The entry of the built script: `dronecombatReplay(id, data, options)` fills the element of that
 * id, `dronecombatPairs(id, data)` likewise with a tournament's pairs. A notebook may run the script
 * before the element is in its document: then it is waited for.
 */
import { Page } from "./page.js";
import { Pairs } from "./pairs.js";

const PATIENCE = 10_000; // ms

function dronecombatReplay(id, data, { embedded = false } = {}) {
  const began = performance.now();
  const attempt = () => {
    const host = document.getElementById(id);
    if (host) return start(host, (place) => new Page(place, data, embedded));
    if (performance.now() - began < PATIENCE) return requestAnimationFrame(attempt);
    console.error(`replay: no element ${id}`);
  };
  attempt();
}

dronecombatReplay.sources = SOURCES; // their sha256: a notebook runs the script once
globalThis.dronecombatReplay = dronecombatReplay;
globalThis.dronecombatPairs = (id, data) =>
  start(document.getElementById(id), (place) => new Pairs(place, data));

/** Put the replay in the place of the element's text, or tell there why not. */
function start(host, make) {
  const place = document.createElement("div");
  place.className = "dronecombat-replay-page";
  host.replaceChildren(place);
  try {
    host.replay = make(place);
  } catch (error) {
    const text = document.createElement("p");
    text.textContent = `The replay does not start: ${error.message}`;
    host.replaceChildren(text);
    throw error;
  }
}
