/** The page on which a person flies: puts the parts together and says what keys and buttons do. */
import { length } from "../sim/index.js";
import { icon, seconds, write } from "../dom.js";
import { Theme } from "../theme.js";
import { LOST, NO_WEBGL, PAUSE_ICON, PLAY_ICON, ROLES, frame } from "./layout.js";
import { Scene } from "./scene.js";
import { SPEEDS, Session } from "./session.js";
import { Sticks } from "./sticks.js";
import { banner } from "./texts.js";
import { place } from "./marker.js";
import style from "./style.js";

export class Page {
  /** `host`: an empty element; `data`: of `watch/play.py`. */
  constructor(host, data) {
    this.host = host;
    this.data = data;
    this.scene = null;
    this.acts = this.actions();
    const bodies = data.game.flight.bodies;
    const thrust = bodies.map((body) => body.full_thrust);
    const weight = bodies.map((body) => body.mass * data.game.flight.gravity);
    Object.assign(this, frame(data, { thrust, weight }, this.acts));
    const shadow = host.attachShadow({ mode: "open" });
    const sheet = document.createElement("style");
    sheet.textContent = style;
    shadow.append(sheet, this.root);
    this.theme = new Theme(host, () => this.paint());
    this.pad = new Sticks(this.stage, this.acts, this.sticks);
    this.session = new Session(data, {
      wish: () => this.wish(),
      onStart: (state) => this.scene?.begin(state, this.session.person),
      onStep: (state) => this.stepped(state),
      onPhase: () => this.session && this.tell(),
    });
    this.startScene();
    this.offerSides();
    this.listen();
    this.tell();
    this.loop = this.loop.bind(this);
    requestAnimationFrame(this.loop);
  }

  actions() {
    return {
      go: () => this.scene && this.session.go(),
      restart: () => this.scene && this.session.restart(),
      pause: () => this.session.pause(),
      speed: (value) => this.tell((this.session.speed = value)),
      change: (by) => {
        const index = SPEEDS.indexOf(this.session.speed) + by;
        this.acts.speed(SPEEDS[Math.min(Math.max(index, 0), SPEEDS.length - 1)]);
      },
      choose: (person) => this.session.choose(person),
      fix: (on) => this.scene && this.tell((this.scene.chase.fixed = on)),
      toggleCamera: () => this.acts.fix(!this.scene?.chase.fixed),
      theme: () => this.theme.toggle(),
      help: () => (this.session.pause(), this.help.showModal()),
    };
  }

  startScene() {
    try {
      this.scene = new Scene(this.canvas, this.session.game, (name) => this.theme.colour(name));
    } catch (error) {
      console.info(`play: ${error.message}`);
      this.say(NO_WEBGL);
      this.root.classList.add("undrawn");
      return;
    }
    this.scene.begin(this.session.state, this.session.person);
    this.canvas.addEventListener("webglcontextlost", () => (this.acts.pause(), this.say(LOST)));
    this.canvas.addEventListener("webglcontextrestored", () => this.say(""));
    new ResizeObserver(() => this.scene.resize()).observe(this.canvas);
    this.scene.resize();
  }

  /** Only the sides that have an opponent can be flown. */
  offerSides() {
    const { opponents } = this.data;
    this.sides.box.hidden = opponents.some((opponent) => opponent === null);
  }

  listen() {
    const table = {
      Enter: this.acts.go,
      KeyR: this.acts.restart,
      Escape: this.acts.pause,
      KeyP: () => (this.session.phase === "paused" ? this.acts.go() : this.acts.pause()),
      KeyC: this.acts.toggleCamera,
      KeyT: this.acts.theme,
    };
    const named = { "+": () => this.acts.change(1), "=": () => this.acts.change(1) };
    Object.assign(named, { "-": () => this.acts.change(-1), "?": this.acts.help });
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || this.help.open) return;
      const on = event.composedPath()[0];
      if (event.key === "Enter" && on instanceof Element && on.matches("button")) return;
      if (!this.pad.key(event, true)) {
        const act = table[event.code] ?? named[event.key];
        if (!act || event.repeat) return;
        act();
      }
      event.preventDefault(); // space presses no button here, arrows scroll nothing
    });
    document.addEventListener("keyup", (event) => {
      if (this.pad.key(event, false)) event.preventDefault();
    });
    this.root.addEventListener("click", (event) => {
      // a button that was clicked, not reached by keys, gives Enter back to the game
      if (event.detail > 0) this.host.shadowRoot.activeElement?.blur();
    });
    const leave = () => (this.pad.release(), this.acts.pause());
    window.addEventListener("blur", leave);
    document.addEventListener("visibilitychange", () => document.hidden && leave());
  }

  /** What the person wants, in the world: forward is where the camera looks. */
  wish() {
    const { right, forward, up } = this.pad.read();
    const yaw = this.scene?.chase.forward ?? 0;
    const [cos, sin] = [Math.cos(yaw), Math.sin(yaw)];
    return { x: forward * cos + right * sin, y: forward * sin - right * cos, up };
  }

  stepped(state) {
    if (!this.scene) return;
    this.scene.extend(state);
    const { before, time, end } = this.session;
    const now = performance.now() / 1000;
    const fell = state.out.map((down, role) => down && !before.out[role]);
    fell.forEach(
      (down, role) => down && this.scene.mark(state.drones[role].position, now, ROLES[role]),
    );
    if (!state.cause || fell.some(Boolean) || time === 0) return;
    const colour = end.winner === "nobody" ? "neutral" : end.winner;
    this.scene.mark(state.drones[1].position, now, colour);
  }

  paint() {
    this.scene?.paint();
  }

  say(text) {
    this.message.hidden = text === "";
    write(this.message, text);
  }

  /** Show what has changed with the phase, the side, the speed or the camera. */
  tell() {
    const { session } = this;
    const { phase, score, person } = session;
    const runs = phase === "flying" || phase === "counting";
    this.root.dataset.phase = phase;
    this.main.replaceChildren(icon(runs ? PAUSE_ICON : PLAY_ICON));
    const label = { ready: "Start", over: "Again", paused: "Go on" }[phase] ?? "Pause";
    this.main.setAttribute("aria-label", label);
    this.main.title = `${label} (Enter)`;
    const opponent = this.data.opponents[1 - person].label;
    write(this.title, `Fly against ${opponent}`);
    write(this.about, `You fly the ${ROLES[person]}; the ${ROLES[1 - person]} is ${opponent}`);
    const ties = score.tied ? `, ${score.tied} tied` : "";
    write(this.score, `You ${score.won} : ${score.lost}${ties}`);
    for (const { nodes, value } of [
      { nodes: this.speeds.nodes, value: session.speed },
      { nodes: this.sides.nodes, value: person },
      { nodes: this.cameras.nodes, value: this.scene?.chase.fixed ?? false },
    ])
      for (const each of nodes)
        each.node.setAttribute("aria-pressed", String(each.value === value));
    this.cards.forEach(({ name }, role) => {
      write(name, role === person ? "you" : opponent);
      name.title = name.textContent;
    });
    this.announce();
  }

  announce() {
    const { large, small, button, winner } = banner(this.session);
    this.banner.box.hidden = large === "" || !this.scene;
    this.banner.box.dataset.winner = winner;
    write(this.banner.large, large);
    write(this.banner.small, small);
    write(this.banner.button, button);
    this.banner.button.hidden = button === "";
  }

  loop(now) {
    requestAnimationFrame(this.loop);
    const passed = Math.max((now - (this.last ?? now)) / 1000, 0);
    this.last = now;
    if (document.hidden) return;
    const { session } = this;
    if (session.phase !== "flying") this.pad.read(); // a gamepad's start button
    session.pass(passed);
    if (session.phase === "counting") this.announce();
    this.show(Math.min(passed, 0.1));
  }

  show(passed) {
    const { session } = this;
    const { state, actions, phase } = session;
    const drones = [0, 1].map((role) => session.drone(role));
    this.readOut(drones);
    if (!this.scene) return;
    const runs = phase === "flying" || phase === "over";
    const thrusts = actions.map(([thrust], role) => (state.out[role] ? 0 : (thrust + 1) / 2));
    this.scene.draw({
      drones,
      out: state.out,
      thrusts: thrusts.map((share) => Math.max(share, 0.1)),
      time: session.time + 1e-6,
      seconds: phase === "paused" ? 0 : passed * (runs ? session.speed : 1),
      now: performance.now() / 1000,
    });
    const { camera } = this.scene.chase;
    const other = drones[1 - session.person].position;
    const own = drones[session.person].position;
    place(this.markers.other, camera, own, other, this.canvas, ROLES[1 - session.person]);
    place(this.markers.target, camera, own, state.target, this.canvas, "target");
  }

  readOut(drones) {
    const { session } = this;
    const { state, actions, game } = session;
    const flight = {
      action: (role) => actions[role],
      down: (role) => state.out[role],
      speed: (role) => length(state.drones[role].velocity),
      position: (role) => drones[role].position,
    };
    this.cards.forEach((card, role) => card.show(flight, role, session.time));
    const gap = (a, b) => length(a.map((x, i) => x - b[i])).toFixed(2);
    const [defender, attacker] = drones.map(({ position }) => position);
    write(this.between[0], gap(defender, attacker));
    write(this.between[1], gap(attacker, state.target));
    const all = game.rules.episode_steps * game.dt;
    write(this.between[2], (all - session.time).toFixed(1));
    write(this.clock, seconds(session.time));
  }
}
