/** The read-outs of a team: one line for each of its drones, which a click follows. */
import { ROLES } from "./flight.js";
import { element, write } from "./dom.js";

const NO_NUMBER = "–";

/** `flight`: any fight of the page, since all have the same teams; `acts`: see `page.js`. */
export function teamCard(flight, side, acts) {
  const mates = flight.mates(side);
  const title = ROLES[side][0].toUpperCase() + ROLES[side].slice(1) + (mates.length > 1 ? "s" : "");
  const name = element("span", { class: "pilot" });
  const lines = mates.map((drone) => line(flight.names[drone], () => acts.followDrone(drone)));
  const heads = ["", "m/s", "m high"].map((text) => element("th", { scope: "col", text }));
  const table = element(
    "table",
    { class: "team" },
    element("thead", {}, element("tr", {}, ...heads)),
    element("tbody", {}, ...lines.map(({ row }) => row)),
  );
  const heading = element("h2", {}, element("span", { text: title }), name);
  const card = element("section", { class: `card drone ${ROLES[side]}`, "aria-label": title });
  card.append(heading, table);
  const show = (shown, _, time) => {
    mates.forEach((drone, index) => lines[index].show(shown, drone, time));
  };
  return { card, name, show };
}

function line(label, follow) {
  const cells = [0, 1].map(() => element("td", { class: "number", text: NO_NUMBER }));
  const text = label[0].toUpperCase() + label.slice(1);
  const attributes = { type: "button", title: `Fly behind ${label}`, on: { click: follow } };
  const head = element("th", { scope: "row" }, element("button", { ...attributes, text }));
  const row = element("tr", {}, head, ...cells);
  const show = (flight, drone, time) => {
    const down = flight.down(drone, time);
    row.classList.toggle("down", down);
    write(cells[0], down ? "down" : flight.speed(drone, time).toFixed(1));
    write(cells[1], flight.position(drone, time)[2].toFixed(2));
  };
  return { row, show };
}
