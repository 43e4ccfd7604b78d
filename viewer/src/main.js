/**
 * The entry of the built script: `dronecombatReplay(id, data, options)` fills the element of that
 * id. A notebook may run the script before the element is in its document: then it is waited for.
 */
import { Page } from "./page.js";

const PATIENCE = 10_000; // ms

function dronecombatReplay(id, data, { embedded = false } = {}) {
  const began = performance.now();
  const attempt = () => {
    const host = document.getElementById(id);
    if (host) return start(host, data, embedded);
    if (performance.now() - began < PATIENCE) return requestAnimationFrame(attempt);
    console.error(`replay: no element ${id}`);
  };
  attempt();
}

dronecombatReplay.sources = SOURCES; // their sha256: a notebook runs the script once
globalThis.dronecombatReplay = dronecombatReplay;

/** Put the replay in the place of the element's text, or tell there why not. */
function start(host, data, embedded) {
  const place = document.createElement("div");
  place.className = "dronecombat-replay-page";
  host.replaceChildren(place);
  try {
    host.replay = new Page(place, data, embedded);
  } catch (error) {
    const text = document.createElement("p");
    text.textContent = `The replay does not start: ${error.message}`;
    host.replaceChildren(text);
    throw error;
  }
}
