/** The page's frame: header, picture with what is written over it, read-outs, bar, list of keys. */
import { element, tool } from "../dom.js";
import { ENLARGEMENT } from "../drone.js";
import { droneCard, pairs } from "../readouts.js";
import { SPEEDS } from "./session.js";

const ICONS = {
  theme: "M12 3a9 9 0 1 0 0 18V3zm0-2a11 11 0 1 1 0 22 11 11 0 0 1 0-22z",
  help:
    "M11 17h2v2h-2zm1-12a4 4 0 0 0-4 4h2a2 2 0 1 1 3.3 1.5C12 11.6 11 12.4 11 15h2" +
    "c0-1.8.8-2.2 2-3.2A4 4 0 0 0 12 5z",
  again: "M12 5V1L7 6l5 5V7a5 5 0 1 1-5 5H5a7 7 0 1 0 7-7z",
  play: "M8 5v14l11-7z",
  pause: "M7 5h4v14H7zm6 0h4v14h-4z",
};
export const PLAY_ICON = ICONS.play;
export const PAUSE_ICON = ICONS.pause;
export const ROLES = ["defender", "attacker"];
export const NO_WEBGL =
  "This browser gives no WebGL, so the fight cannot be drawn and flown here. Switch hardware " +
  "acceleration on, or open the page in another browser.";
export const LOST =
  "The browser has taken the graphics away from this page. Load it again to fly on.";
const KEYS = [
  ["W A S D, arrows", "fly forward, left, back, right, as you see it"],
  ["Space, Shift", "more thrust: climb; less: sink"],
  ["Hands off", "the drone brakes and stays where it is"],
  ["Mouse: drag, wheel", "fly like a stick; climb or sink (also: drag with the right button)"],
  ["Fingers", "left part: fly; right part: climb or sink"],
  ["Gamepad", "left stick: fly; right stick or triggers: climb or sink; A: start"],
  ["Enter", "start, pause, go on, again"],
  ["R", "again from the start"],
  ["Esc, P", "pause"],
  ["C", "camera behind the drone, or at a fixed place"],
  ["- +", "slower, faster: up to real time"],
  ["T, ?", "light or dark, this list"],
];
const FRACTIONS = { 0.125: "\u215b", 0.25: "\u00bc", 0.5: "\u00bd", 1: "1" };

export function frame(data, rules, acts) {
  const parts = { ...header(data, acts), ...picture(acts), ...panel(rules), ...bar(acts) };
  const help = helpDialog();
  const main = element("main", {}, parts.stage, parts.panel);
  const footer = element("footer", {}, parts.controls);
  const root = element("div", { class: "replay play focused" }, parts.head, main, footer, help);
  return { ...parts, help, root };
}

function header(data, acts) {
  const about = element("p", { class: "about" });
  const score = element("p", { class: "score", "aria-live": "polite" });
  const titles = element("div", { class: "titles" }, element("h1", { text: data.title }), about);
  const head = element(
    "header",
    {},
    titles,
    score,
    tool("Light or dark", ICONS.theme, acts.theme),
    tool("Keys", ICONS.help, acts.help),
  );
  return { head, title: titles.firstChild, about, score };
}

function picture(acts) {
  const canvas = element("canvas", { "aria-hidden": "true" });
  const marker = (kind) => {
    const arrow = element("i", { text: "\u25b2" });
    const label = element("span");
    return {
      box: element("div", { class: `marker ${kind}`, hidden: true }, arrow, label),
      arrow,
      label,
    };
  };
  const markers = { other: marker("other"), target: marker("target") };
  const stick = (kind) => {
    const knob = element("i");
    return { box: element("div", { class: `stick ${kind}`, hidden: true }, knob), knob };
  };
  const sticks = { move: stick("move"), climb: stick("climb") };
  const banner = {
    large: element("strong"),
    small: element("p"),
    button: element("button", { type: "button", class: "close", on: { click: acts.go } }),
  };
  banner.box = element(
    "div",
    { class: "banner", role: "status" },
    banner.large,
    banner.small,
    banner.button,
  );
  const message = element("p", { class: "message", role: "alert", hidden: true });
  const size = element("p", {
    class: "size",
    text: `drones drawn ${ENLARGEMENT} times their size`,
  });
  const over = [...Object.values(markers), ...Object.values(sticks)].map(({ box }) => box);
  const stage = element("div", { class: "stage pad" }, canvas, ...over, size, banner.box, message);
  return { canvas, markers, sticks, banner, message, stage };
}

function panel(rules) {
  const cards = ROLES.map((role, index) => droneCard(role, index, rules));
  const between = pairs([
    ["Apart", "m"],
    ["To the target", "m"],
    ["Time left", "s"],
  ]);
  const box = element(
    "aside",
    { class: "readouts", "aria-label": "Read-outs" },
    element("div", { class: "cards" }, ...cards.map(({ card }) => card)),
    element("dl", { class: "card between" }, ...between.rows),
  );
  return { panel: box, cards, between: between.values };
}

function bar(acts) {
  const main = tool("Start", ICONS.play, acts.go, "primary");
  const clock = element("output", { class: "clock", "aria-label": "Time of the fight" });
  const choice = (label, entries, act) => {
    const nodes = entries.map(([value, text]) => ({
      value,
      node: element("button", { type: "button", text, on: { click: () => act(value) } }),
    }));
    const attributes = { class: "segments", role: "group", "aria-label": label, title: label };
    return { nodes, box: element("div", attributes, ...nodes.map(({ node }) => node)) };
  };
  const names = SPEEDS.map((speed) => [speed, `${FRACTIONS[speed]}\u00d7`]);
  const speeds = choice("Speed: 1\u00d7 is real time", names, acts.speed);
  const sides = choice(
    "Your side",
    [
      [0, "Defend"],
      [1, "Attack"],
    ],
    acts.choose,
  );
  const cameras = choice(
    "Camera",
    [
      [false, "Chase"],
      [true, "Fixed"],
    ],
    acts.fix,
  );
  const again = tool("Again from the start", ICONS.again, acts.restart);
  const controls = element(
    "div",
    { class: "controls" },
    element("div", { class: "transport" }, main, again, clock),
    element("div", { class: "options" }, sides.box, cameras.box, speeds.box),
  );
  return { main, clock, speeds, sides, cameras, controls };
}

function helpDialog() {
  const rows = KEYS.map(([key, meaning]) =>
    element("tr", {}, element("th", { scope: "row", text: key }), element("td", { text: meaning })),
  );
  const close = element("button", { type: "button", class: "close", text: "Close" });
  const dialog = element(
    "dialog",
    { "aria-label": "Keys" },
    element("h2", { text: "How to fly" }),
    element("table", {}, element("tbody", {}, ...rows)),
    close,
  );
  close.addEventListener("click", () => dialog.close());
  return dialog;
}
