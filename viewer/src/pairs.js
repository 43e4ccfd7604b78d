/**
 * A tournament's win-rate maps on a page: whoever clicks a cell sees a fight of that pair.
 *
 * `dronecombatPairs(id, data)` fills the element of that id; `data`: of `report/pairs_page.py`. The
 * address names the cell, #MAP-ROW-COLUMN, so that a report can link to it.
 */
import { element, write } from "./dom.js";
import { Page } from "./page.js";
import { colourOf } from "./palette.js";
import { Theme } from "./theme.js";
import frame from "./style-frame.css";
import pairs from "./style-pairs.css";
import theme from "./style-theme.css";

const ARROWS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1] };

export class Pairs {
  /** `host`: an empty element. */
  constructor(host, data) {
    this.data = data;
    this.page = null;
    this.chosen = null;
    this.host = host;
    const known = data.maps.flatMap((map) => map.rates.flat()).filter((rate) => rate !== null);
    this.limits = [Math.min(...known), Math.max(...known)];
    this.said = element("p", { class: "said", role: "status" });
    this.place = element("div", { class: "fight" });
    this.maps = data.maps.map((map, index) => this.map(map, index));
    const titles = element(
      "div",
      { class: "titles" },
      element("h1", { text: data.title }),
      element("p", { class: "about", text: data.about }),
    );
    const maps = element("div", { class: "maps" }, ...this.maps.map(({ box }) => box));
    const root = element("div", { class: "pairs" }, titles, maps, this.said, this.place);
    const sheet = document.createElement("style");
    sheet.textContent = [theme, frame, pairs].join("\n");
    host.attachShadow({ mode: "open" }).append(sheet, root);
    this.theme = new Theme(host, () => {});
    window.addEventListener("hashchange", () => this.follow());
    this.follow();
  }

  /** One method's map: defenders upwards, attackers to the right, as in the report. */
  map(map, index) {
    const cells = map.rates.map((rates, row) =>
      rates.map((rate, column) => this.cell(map, [index, row, column], rate)),
    );
    const rows = cells.map((row) => element("div", { role: "row", class: "row" }, ...row)).reverse();
    const label = `Win rates of ${map.name}: defenders upwards, attackers to the right`;
    const grid = element("div", { class: "grid", role: "grid", "aria-label": label }, ...rows);
    grid.style.setProperty("--columns", map.columns.length);
    grid.addEventListener("keydown", (event) => this.walk(event));
    const ends = (labels) => `${labels[0]} … ${labels.at(-1)}`;
    const axes = `Attackers to the right: ${ends(map.columns)}. Defenders upwards: ${ends(map.rows)}.`;
    const heading = element("h2", { text: map.name });
    const box = element("section", {}, heading, grid, element("p", { class: "axes", text: axes }));
    return { box, cells };
  }

  cell(map, place, rate) {
    const [, row, column] = place;
    const there = map.fights[row][column] !== null;
    const share = rate === null ? "not played" : `wins ${rate.toFixed(2)}`;
    const title = `${map.rows[row]} defends against ${map.columns[column]}: ${share}`;
    const attributes = { type: "button", role: "gridcell", title, "aria-label": title, tabindex: -1 };
    const button = element("button", { ...attributes, disabled: !there });
    if (rate !== null) button.style.background = colourOf(rate, this.limits);
    button.dataset.place = place.join("-");
    button.addEventListener("click", () => (location.hash = button.dataset.place));
    return button;
  }

  /** Arrow keys go from cell to cell. */
  walk(event) {
    const by = ARROWS[event.key];
    const from = event.target.dataset?.place?.split("-").map(Number);
    if (!by || !from) return;
    event.preventDefault();
    this.maps[from[0]].cells[from[1] + by[0]]?.[from[2] + by[1]]?.focus();
  }

  /** Show the fight that the address names; the first of all where it names none. */
  follow() {
    const named = location.hash.slice(1).split("-").map(Number);
    const [map, row, column] = this.fightAt(named) === null ? this.first() : named;
    const data = this.data.maps[map];
    const fight = this.data.fights[this.fightAt([map, row, column])];
    this.mark(this.maps[map].cells[row][column]);
    this.page?.dispose();
    const host = element("div");
    this.place.replaceChildren(host);
    const title = `${data.rows[row]} defends against ${data.columns[column]}`;
    const replay = { title, about: data.about, rules: this.data.rules, fights: [fight] };
    this.page = new Page(host, replay, true);
    const rate = data.rates[row][column];
    const wins = rate === null ? "" : `; this defender wins ${rate.toFixed(2)} of the fights`;
    write(this.said, `${data.name}: ${title}${wins}. ${fight.result.sentence}.`);
  }

  /** The number of the fight of a cell, null where there is none. */
  fightAt([map, row, column]) {
    return this.data.maps[map]?.fights[row]?.[column] ?? null;
  }

  /** The final policies of the first map, or the cell nearest to the end that has a fight. */
  first() {
    for (const [map, { fights }] of this.data.maps.entries())
      for (let row = fights.length - 1; row >= 0; row--)
        for (let column = fights[row].length - 1; column >= 0; column--)
          if (fights[row][column] !== null) return [map, row, column];
    throw new Error("no fight was recorded");
  }

  mark(cell) {
    this.chosen?.removeAttribute("aria-selected");
    this.chosen?.setAttribute("tabindex", "-1");
    cell.setAttribute("aria-selected", "true");
    cell.setAttribute("tabindex", "0");
    this.chosen = cell;
  }
}
