/** The bar of buttons: play and step, the camera, speed and size. */
import { SPEEDS } from "./clock.js";
import { ATTACKER, DEFENDER } from "./flight.js";
import { element, icon, seconds, tool, write } from "./dom.js";

const ICONS = {
  play: "M8 5v14l11-7z",
  pause: "M7 5h4v14H7zm6 0h4v14h-4z",
  start: "M6 5h2v14H6zm12 0v14L9 12z",
  back: "M15 6v12l-8-6zM17 6h2v12h-2z",
  on: "M9 6v12l8-6zM5 6h2v12H5z",
  repeat: "M7 7h10v3l4-4-4-4v3H5v6h2zm10 10H7v-3l-4 4 4 4v-3h12v-6h-2z",
};
const CAMERAS = [
  [null, "Overview"],
  [DEFENDER, "Defender"],
  [ATTACKER, "Attacker"],
];
const FRACTIONS = { 0.0625: "1/16", 0.125: "1/8", 0.25: "\u00bc", 0.5: "\u00bd" };

export class Controls {
  /** `acts`: what the buttons do, see `page.js`. */
  constructor(acts) {
    this.playing = null;
    this.playButton = tool("Play", ICONS.play, acts.play, "primary");
    this.time = element("output", { class: "clock", "aria-label": "Time of the fight" });
    this.speed = element("select", { "aria-label": "Speed", title: "Speed: 1\u00d7 is real time" });
    this.speed.append(
      ...SPEEDS.map((value) => element("option", { value, text: speedName(value) })),
    );
    this.speed.addEventListener("change", () => acts.speed(Number(this.speed.value)));
    this.cameras = CAMERAS.map(([side, label]) => ({
      side,
      label,
      node: cameraButton(side, label, acts),
    }));
    this.trueSize = checkbox("True size", acts.trueSize);
    this.repeat = tool("Repeat", ICONS.repeat, acts.toggleRepeat, "repeat");
    const camera = element("div", { class: "segments", role: "group", "aria-label": "Camera" });
    camera.append(...this.cameras.map(({ node }) => node));
    this.box = element(
      "div",
      { class: "controls" },
      element(
        "div",
        { class: "transport" },
        tool("To the start", ICONS.start, acts.start, "start"),
        tool("A step back", ICONS.back, acts.back),
        this.playButton,
        tool("A step on", ICONS.on, acts.on),
        this.time,
        this.repeat,
        this.speed,
      ),
      element("div", { class: "options" }, camera, this.trueSize.label),
    );
  }

  /** A side that no fight shows cannot be followed; of a team one drone after the other is. */
  offer(flight) {
    this.flight = flight;
    for (const { side, label, node } of this.cameras) {
      if (side === null) continue;
      const mates = flight.mates(side);
      node.hidden = !mates.length;
      if (mates.length > 1) node.title = `Fly behind the next ${label.toLowerCase()}`;
    }
  }

  show(clock, stage) {
    if (this.playing !== clock.playing) {
      this.playing = clock.playing;
      const label = clock.playing ? "Pause" : "Play";
      this.playButton.replaceChildren(icon(ICONS[label.toLowerCase()]));
      this.playButton.setAttribute("aria-label", label);
      this.playButton.title = `${label} (space)`;
    }
    write(this.time, `${Math.min(clock.time, clock.end).toFixed(2)} / ${seconds(clock.end)}`);
    this.speed.value = clock.speed;
    this.repeat.setAttribute("aria-pressed", String(clock.repeat));
    if (stage === null) return;
    this.trueSize.box.checked = stage.trueSize;
    const { followed } = stage.rig;
    for (const { side, label, node } of this.cameras) {
      const pressed = followed === null ? side === null : side === this.flight.sides[followed];
      node.setAttribute("aria-pressed", String(pressed));
      const name = pressed && side !== null ? this.flight.names[followed] : label;
      write(node, name[0].toUpperCase() + name.slice(1));
    }
  }
}

function cameraButton(side, label, acts) {
  const node = element("button", {
    type: "button",
    text: label,
    on: { click: () => acts.follow(side) },
  });
  node.title = side === null ? "See the whole fight" : `Fly behind the ${label.toLowerCase()}`;
  return node;
}

function checkbox(text, act) {
  const box = element("input", { type: "checkbox" });
  box.addEventListener("change", () => act(box.checked));
  return { box, label: element("label", { class: "check" }, box, element("span", { text })) };
}

function speedName(value) {
  return `${FRACTIONS[value] ?? value}\u00d7`;
}
