/** Numbers of the enlarged fight: both drones, distances, what happened and who wins. */
import { DEFENDER, ROLES } from "./flight.js";
import { element, seconds, tool, write } from "./dom.js";
import { teamCard } from "./team-card.js";

const NO_NUMBER = "–";

const ICONS = {
  all: "M4 4h7v7H4zm9 0h7v7h-7zM4 13h7v7H4zm9 0h7v7h-7z",
  previous: "M15 5 8 12l7 7z",
  next: "M9 5l7 7-7 7z",
};

export class Readouts {
  /** `acts`: what its buttons do, see `page.js`. */
  constructor(flights, rules, acts) {
    Object.assign(this, { flights, rules, acts });
    this.place = element("span", { class: "place" });
    this.browse = element(
      "nav",
      { class: "browse", "aria-label": "Fights" },
      tool("All fights", ICONS.all, acts.all),
      tool("Previous fight", ICONS.previous, acts.previous),
      this.place,
      tool("Next fight", ICONS.next, acts.next),
    );
    this.browse.hidden = flights.length === 1;
    this.verdict = element("p", { class: "verdict", "aria-live": "polite" });
    const { team } = flights[0];
    this.cards = ROLES.map((role, side) =>
      team ? teamCard(flights[0], side, acts) : droneCard(role, side, rules),
    );
    this.between = pairs([
      ["Apart", "m"],
      ["Closing", "m/s"],
      ["To the target", "m"],
    ]);
    this.events = element("ol", { class: "events" });
    this.panel = element(
      "aside",
      { class: "readouts", "aria-label": "Read-outs" },
      element("div", { class: "top" }, this.browse, this.verdict),
      element("div", { class: "cards" }, ...this.cards.map(({ card }) => card)),
      element("dl", { class: "card between" }, ...this.between.rows),
      element(
        "section",
        { class: "card log", "aria-label": "Events" },
        element("h2", { text: "Events" }),
        this.events,
      ),
    );
  }

  /** Take over the fight of that index; null hides the panel. */
  open(index) {
    this.flight = index === null ? null : this.flights[index];
    this.panel.hidden = index === null;
    if (index === null) return;
    const { flight } = this;
    write(this.place, `${index + 1} of ${this.flights.length}`);
    this.cards.forEach(({ card, name }, side) => {
      card.hidden = !flight.mates(side).length;
      write(name, flight.pilots[side]);
      name.title = flight.pilots[side];
    });
    this.panel.classList.toggle("uneventful", flight.events.length === 1);
    this.events.replaceChildren(...flight.events.map((event) => this.eventRow(event)));
  }

  show(time) {
    const { flight } = this;
    if (flight === null) return;
    const now = Math.min(time, flight.end);
    const over = time >= flight.end - 1e-6;
    this.verdict.dataset.winner = over ? flight.result.winner : "";
    write(
      this.verdict,
      over ? flight.result.sentence : [flight.name, flight.note].filter(Boolean).join(", "),
    );
    this.cards.forEach(({ show }, side) => {
      if (flight.mates(side).length) show(flight, side, now);
    });
    const { values } = this.between;
    const both = flight.mates(DEFENDER).length > 0;
    write(values[0], both ? flight.apart(now).toFixed(2) : NO_NUMBER);
    write(values[1], both ? signed(closingSpeed(flight, now)) : NO_NUMBER);
    write(values[2], flight.toTarget(now).toFixed(2));
    [...this.events.children].forEach((row, index) => {
      row.classList.toggle("past", flight.events[index].time <= time + 1e-6);
    });
  }

  eventRow(event) {
    const seek = () => this.acts.seek(event.time);
    const label = element("span", { text: event.text, "data-colour": event.colour });
    const time = element("time", { text: seconds(event.time) });
    return element(
      "li",
      {},
      element("button", { type: "button", on: { click: seek } }, time, label),
    );
  }
}

export function droneCard(role, index, rules) {
  const name = element("span", { class: "pilot" });
  const title = role[0].toUpperCase() + role.slice(1);
  const { rows, values } = pairs([
    ["Speed", "m/s"],
    ["Height", "m"],
    ["Thrust", "N"],
  ]);
  const thrust = bar("thrust");
  thrust.mark.style.left = `${(100 * rules.weight[index]) / rules.thrust[index]}%`;
  thrust.mark.title = "thrust that carries its weight";
  const moments = ["Roll", "Pitch", "Yaw"].map((axis) => ({ axis, ...bar("moment") }));
  const sticks = element("div", { class: "moments" });
  sticks.append(
    ...moments.map(({ axis, box }) => element("div", {}, element("span", { text: axis }), box)),
  );
  const heading = element("h2", {}, element("span", { text: title }), name);
  const numbers = element("dl", {}, ...rows);
  const card = element("section", { class: `card drone ${role}`, "aria-label": title });
  card.append(heading, numbers, thrust.box, sticks);
  const show = (flight, drone, time) => {
    const action = flight.action(drone, time);
    const share = flight.down(drone, time) ? 0 : (action[0] + 1) / 2;
    write(values[0], flight.speed(drone, time).toFixed(1));
    write(values[1], flight.position(drone, time)[2].toFixed(2));
    write(values[2], (share * rules.thrust[drone]).toFixed(2));
    thrust.fill.style.width = `${100 * share}%`;
    moments.forEach(({ fill }, axis) => {
      const push = flight.down(drone, time) ? 0 : action[1 + axis];
      fill.style.left = `${50 + 50 * Math.min(push, 0)}%`;
      fill.style.width = `${50 * Math.abs(push)}%`;
    });
  };
  return { card, name, show };
}

/** Rows of a list of numbers: label, value and unit. */
export function pairs(labels) {
  const values = labels.map(() => element("span", { class: "number", text: NO_NUMBER }));
  const rows = labels.map(([label, unit], i) =>
    element(
      "div",
      {},
      element("dt", { text: label }),
      element("dd", {}, values[i], element("span", { class: "unit", text: unit })),
    ),
  );
  return { rows, values };
}

function bar(kind) {
  const fill = element("span", { class: "fill" });
  const mark = element("span", { class: "mark" });
  return {
    fill,
    mark,
    box: element("div", { class: `gauge ${kind}`, "aria-hidden": "true" }, fill, mark),
  };
}

/** How fast the distance between the two nearest drones shrinks, m/s. */
function closingSpeed(flight, time) {
  const pair = flight.nearest(time);
  const [a, b] = pair.map((drone) => flight.position(drone, time));
  const [u, v] = pair.map((drone) => flight.velocity(drone, time));
  const gap = Math.hypot(...a.map((x, i) => x - b[i])) || 1;
  return -a.reduce((sum, x, i) => sum + ((x - b[i]) / gap) * (u[i] - v[i]), 0);
}

export function signed(value) {
  return value.toFixed(1).replace("-", "\u2212");
}
