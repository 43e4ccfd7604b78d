/** The grid of fights: over each picture a transparent tile with its name and its outcome. */
import { ATTACKER, DEFENDER } from "./flight.js";
import { element, icon, seconds, write } from "./dom.js";

const ENLARGE =
  "M4 4h7v2H7.4l4.3 4.3-1.4 1.4L6 7.4V11H4zm16 16h-7v-2h3.6l-4.3-4.3 1.4-1.4 4.3 4.3V13h2z";
const RATIO = 1.45; // width over height that a picture had best

export class Tiles {
  /** `onOpen(index)`: a fight is to be enlarged. */
  constructor(flights, onOpen) {
    this.flights = flights;
    this.grid = element("div", { class: "tiles", role: "group", "aria-label": "Fights" });
    this.tiles = flights.map((flight, index) => tile(flight, index, onOpen));
    this.grid.append(...this.tiles.map(({ box }) => box));
    this.focus = null;
  }

  /** Show one fight alone, or all of them (null). */
  open(focus) {
    this.focus = focus;
    this.grid.classList.toggle("alone", focus !== null);
    this.tiles.forEach(({ box, enlarge }, index) => {
      box.hidden = focus !== null && index !== focus;
      enlarge.hidden = focus !== null;
    });
    this.arrange();
  }

  /** Choose the columns in which the pictures become largest. */
  arrange() {
    const count = this.focus === null ? this.tiles.length : 1;
    const { clientWidth: width, clientHeight: height } = this.grid;
    if (!width || !height) return;
    const size = (columns) => {
      const rows = Math.ceil(count / columns);
      return Math.min(width / columns, (RATIO * height) / rows);
    };
    const columns = Array.from({ length: count }, (_, i) => i + 1);
    const best = columns.reduce((a, b) => (size(b) > size(a) * 1.001 ? b : a));
    const enough = width < 620 && count > 1 ? Math.min(best, 2) : best; // a phone scrolls instead
    this.grid.style.setProperty("--columns", enough);
    this.grid.style.setProperty("--rows", Math.ceil(count / enough));
  }

  /** The visible pictures' places in `canvas`, in CSS pixels. */
  views(canvas) {
    const frame = canvas.getBoundingClientRect();
    const places = this.tiles.map(({ box }, index) => {
      if (box.hidden) return null;
      const { left, top, width, height } = box.getBoundingClientRect();
      const outside = top > frame.bottom || top + height < frame.top || width < 2 || height < 2;
      return outside
        ? null
        : { index, left: left - frame.left, top: top - frame.top, width, height };
    });
    return places.filter(Boolean);
  }

  show(time) {
    this.tiles.forEach(({ box, chip, numbers }, index) => {
      if (box.hidden) return;
      const flight = this.flights[index];
      const { result } = flight;
      const over = time >= flight.end - 1e-6;
      box.dataset.winner = over ? result.winner : "";
      write(chip, over ? `${result.text}, ${seconds(flight.end)}` : "");
      chip.hidden = !over;
      numbers.hidden = over;
      if (!over) write(numbers, distances(flight, time));
    });
  }
}

function tile(flight, index, onOpen) {
  const chip = element("span", { class: "chip", hidden: true });
  const numbers = element("span", { class: "numbers" });
  const enlarge = element(
    "button",
    {
      type: "button",
      class: "plain enlarge",
      "aria-label": `Enlarge ${flight.name}`,
      title: "Enlarge",
      on: { click: (event) => (event.stopPropagation(), onOpen(index)) },
    },
    icon(ENLARGE),
  );
  const head = element("div", { class: "head" }, element("strong", { text: flight.name }));
  if (flight.note) head.append(element("span", { text: flight.note }));
  const box = element("div", { class: "tile", "data-index": index }, head, enlarge, chip, numbers);
  return { box, chip, numbers, enlarge };
}

function distances(flight, time) {
  const up = (side) => flight.mates(side).filter((drone) => !flight.down(drone, time)).length;
  const parts = flight.team ? [`${up(DEFENDER)} against ${up(ATTACKER)} fly`] : [];
  if (flight.mates(DEFENDER).length) parts.push(`${flight.apart(time).toFixed(2)} m apart`);
  return [...parts, `${flight.toTarget(time).toFixed(2)} m to the target`].join("  ·  ");
}
