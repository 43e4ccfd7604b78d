/** The entry of the built script: `dronecombatPlay(id, data)` fills the element of that id. */
import * as sim from "../sim/index.js";
import { Page } from "./page.js";

function dronecombatPlay(id, data) {
  const host = document.getElementById(id);
  const place = document.createElement("div");
  place.className = "dronecombat-play-page";
  host.replaceChildren(place);
  try {
    host.play = new Page(place, data);
  } catch (error) {
    const text = document.createElement("p");
    text.textContent = `The game does not start: ${error.message}`;
    host.replaceChildren(text);
    throw error;
  }
}

dronecombatPlay.sources = SOURCES; // their sha256
dronecombatPlay.sim = sim; // for whoever wants to fly without the page, such as the tests
globalThis.dronecombatPlay = dronecombatPlay;
