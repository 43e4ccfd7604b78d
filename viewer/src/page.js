/** One replay on a page: puts the parts together and says what buttons, keys and gestures do. */
import { Clock } from "./clock.js";
import { Controls } from "./controls.js";
import { Flight, ROLES } from "./flight.js";
import { Gestures } from "./gestures.js";
import { listen } from "./keyboard.js";
import { LOST, NO_WEBGL, frame, resultList } from "./layout.js";
import { Readouts } from "./readouts.js";
import { Stage } from "./stage.js";
import style from "./style.js";
import { Theme } from "./theme.js";
import { Tiles } from "./tiles.js";
import { Timeline } from "./timeline.js";
import { write } from "./dom.js";

const GONE = 3000; // ms after which a page that left its document gives its graphics back

export class Page {
  /** `host`: an empty element; `data`: of `report/replay_data.py`; `embedded`: in a notebook. */
  constructor(host, data, embedded) {
    this.host = host;
    this.embedded = embedded;
    this.dirty = true;
    this.focus = null;
    this.stage = null;
    this.flights = data.fights.map((raw) => new Flight(raw));
    const dt = Math.min(...this.flights.map((flight) => flight.dt));
    this.clock = new Clock(dt, () => this.touch());
    this.acts = this.actions();
    this.tiles = new Tiles(this.flights, (index) => this.open(index));
    this.readouts = new Readouts(this.flights, data.rules, this.acts);
    this.timeline = new Timeline(this.clock, data.rules, (time) => this.acts.seek(time));
    this.controls = new Controls(this.acts);
    const shadow = host.attachShadow({ mode: "open" });
    const sheet = document.createElement("style");
    sheet.textContent = style;
    const parts = { tiles: this.tiles.grid, readouts: this.readouts.panel };
    Object.assign(parts, { timeline: this.timeline.box, controls: this.controls.box });
    Object.assign(this, frame(data, parts, this.acts));
    this.root.classList.toggle("embedded", embedded);
    shadow.append(sheet, this.root);
    this.theme = new Theme(host, () => this.paint());
    this.startStage(data.rules);
    this.stopListening = listen(embedded ? this.root : document, this.acts);
    this.controls.offer(this.flights[0]);
    this.watchSize();
    this.open(this.flights.length === 1 ? 0 : null, true);
    if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.clock.play(true);
    this.loop = this.loop.bind(this);
    requestAnimationFrame(this.loop);
  }

  /** What buttons, keys and gestures do. */
  actions() {
    const { clock } = this;
    const browse = (by) => () => {
      const count = this.flights.length;
      this.open(this.focus === null ? (by > 0 ? 0 : count - 1) : (this.focus + by + count) % count);
    };
    return {
      play: () => clock.play(),
      start: () => clock.seek(0),
      end: () => clock.seek(clock.end),
      seek: (time) => (clock.play(false), clock.seek(time)),
      step: (count) => clock.step(count),
      back: () => clock.step(-1),
      on: () => clock.step(1),
      speed: (value) => clock.setSpeed(value),
      faster: () => clock.changeSpeed(1),
      slower: () => clock.changeSpeed(-1),
      repeat: (on) => this.touch((clock.repeat = on)),
      follow: (side) => this.follow(side === null ? null : this.nextOf(side)),
      followDrone: (drone) => this.follow(drone),
      trueSize: (on) => this.stage && this.touch((this.stage.trueSize = on)),
      toggleSize: () => this.acts.trueSize(!this.stage?.trueSize),
      toggleRepeat: () => this.acts.repeat(!clock.repeat),
      resetView: () => this.touch(this.stage?.rig.reset()),
      next: browse(1),
      previous: browse(-1),
      all: () => this.flights.length > 1 && this.open(null),
      theme: () => this.theme.toggle(),
      help: () => this.help.showModal(),
    };
  }

  startStage(rules) {
    try {
      const colour = (name) => this.theme.colour(name);
      this.stage = new Stage(this.canvas, this.flights, rules, colour);
    } catch (error) {
      console.info(`replay: ${error.message}`);
      this.say(NO_WEBGL);
      this.root.classList.add("undrawn");
      this.root
        .querySelector(".stage")
        .append(resultList(this.flights, (index) => this.open(index)));
      return;
    }
    this.canvas.addEventListener("webglcontextlost", () => this.say(LOST));
    this.canvas.addEventListener("webglcontextrestored", () => this.touch(this.say("")));
    const mayZoom = () => {
      const { scrollHeight, clientHeight } = this.tiles.grid;
      return this.embedded ? this.root.matches(":focus-within") : scrollHeight <= clientHeight + 1;
    };
    const moves = { onMove: () => this.touch(), onOpen: (index) => this.click(index), mayZoom };
    new Gestures(this.tiles.grid, this.stage.rig, moves);
  }

  /** Show one fight large, or all of them (null). */
  open(focus, first = false) {
    const changed = this.focus !== focus;
    this.focus = focus;
    const shown = focus === null ? this.flights : [this.flights[focus]];
    this.clock.setEnd(Math.max(...shown.map((flight) => flight.end)), first);
    this.tiles.open(focus);
    this.readouts.open(focus);
    this.timeline.open(shown);
    this.root.classList.toggle("focused", focus !== null);
    this.tally.hidden = focus !== null;
    if (changed && this.stage) this.stage.rig.reset();
    this.touch();
  }

  click(index) {
    if (this.focus === null) this.open(index);
    if (this.embedded) this.root.querySelector(".controls button").focus({ preventScroll: true });
  }

  /** Follow a drone, or see the whole fight (null). */
  follow(drone) {
    if (!this.stage || drone === undefined) return;
    this.stage.rig.followed = drone;
    this.touch();
  }

  /** The drone of a side to follow: the first that flies, or the one after that which is followed. */
  nextOf(side) {
    const flight = this.flights[this.focus ?? 0];
    const mates = flight.flying(side, Math.min(this.clock.time, flight.end));
    return mates.find((drone) => drone > (this.stage?.rig.followed ?? Infinity)) ?? mates[0];
  }

  paint() {
    this.stage?.paint((name) => this.theme.colour(name));
    this.touch();
  }

  say(text) {
    this.message.hidden = text === "";
    write(this.message, text);
  }

  /** Ask for a new picture. */
  touch() {
    this.dirty = true;
  }

  watchSize() {
    this.watcher = new ResizeObserver(() => {
      this.tiles.arrange();
      this.stage?.resize();
      this.touch();
    });
    for (const part of [this.canvas, this.tiles.grid]) this.watcher.observe(part);
    this.tiles.grid.addEventListener("scroll", () => this.touch());
    this.visible = true;
    this.sight = new IntersectionObserver((entries) => {
      this.visible = entries.at(-1).isIntersecting;
      this.touch();
    });
    this.sight.observe(this.host);
  }

  loop(now) {
    if (this.gone) return;
    if (this.host.isConnected) this.seen = now;
    else if (now - (this.seen ??= now) > GONE) return this.dispose();
    requestAnimationFrame(this.loop);
    this.clock.tick(now);
    if (!this.dirty || !this.visible) return;
    this.dirty = false;
    this.show();
  }

  show() {
    const { time } = this.clock;
    this.tiles.show(time);
    this.readouts.show(time);
    this.timeline.show();
    this.controls.show(this.clock, this.stage);
    write(this.tally, tally(this.flights, time));
    this.size.hidden = Boolean(this.stage?.trueSize);
    this.stage?.draw(this.tiles.views(this.canvas), this.clock);
  }

  /** Give everything back; a page that was taken out of its document does so by itself. */
  dispose() {
    if (this.gone) return;
    this.gone = true;
    this.stopListening();
    this.theme.dispose();
    this.watcher.disconnect();
    this.sight.disconnect();
    this.stage?.dispose();
  }
}

/** How the fights that are over have ended. */
function tally(flights, time) {
  const over = flights.filter(({ end }) => time >= end - 1e-6);
  const won = (winner) => over.filter(({ result }) => result.winner === winner).length;
  const many = (side) => (flights[0].mates(side).length > 1 ? "s" : "");
  const parts = ROLES.map((role, side) => `${role}${many(side)} ${won(role)}`);
  const rest = over.length - won("defender") - won("attacker");
  if (rest) parts.push(`nobody ${rest}`);
  return `Won: ${parts.join(", ")} (${over.length} of ${flights.length} over)`;
}
