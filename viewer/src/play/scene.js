/** The running fight as a picture: drones, trails, target and radii, in one WebGL context. */
import { Color, Group, Vector2, WebGLRenderer } from "three";
import { ENLARGEMENT, Hangar } from "../drone.js";
import { Plumb, Pulse, bubble, targetMark } from "../marks.js";
import { Trail } from "../trail.js";
import { World } from "../world.js";
import { Chase } from "./camera.js";

const MOST_PIXELS = 2; // of the screen for one CSS pixel
const MOST_POINTS = 3000; // of a trail
const TURNS = 9; // rotations a second under full thrust, slow enough for the eye
const FADE = 0.9; // s, of the mark of an event
const ROLES = ["defender", "attacker"];

export class Scene {
  /** Throws where the browser gives no WebGL. `colour(name)`: the theme's colour of that name. */
  constructor(canvas, game, colour) {
    const context = canvas.getContext("webgl2", { antialias: true, alpha: false, stencil: false });
    if (context === null) throw new Error("no WebGL");
    this.renderer = new WebGLRenderer({ canvas, context });
    Object.assign(this, { canvas, rules: game.rules, dt: game.dt, colour });
    this.chase = new Chase();
    this.size = { value: new Vector2(1, 1) };
    this.world = new World(game.start.half_width);
    this.hangars = ROLES.map((role) => new Hangar(colour(role)));
    this.turned = [0, 0];
    this.group = new Group();
    this.world.scene.add(this.group);
    this.paint();
  }

  paint() {
    this.world.paint(this.colour);
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, MOST_PIXELS));
    this.renderer.setSize(Math.max(clientWidth, 1), Math.max(clientHeight, 1), false);
  }

  /** A new fight: everything in its place for `state`; `person`: the own role. */
  begin({ drones, target }, person) {
    this.clear();
    const { rules } = this;
    const paint = ROLES.map((role) => new Color(this.colour(role)));
    const points = Math.min(rules.episode_steps + 1, MOST_POINTS);
    const times = Array.from({ length: points }, (_, i) => i * this.dt);
    this.parts = drones.map(({ position }, role) => {
      const trail = new Trail(new Float32Array(3 * points), times, paint[role], this.size);
      trail.begin(position);
      return { trail, body: this.hangars[role].build(), plumb: new Plumb(paint[role]) };
    });
    for (const { trail, body, plumb } of this.parts)
      this.group.add(body.group, ...trail.meshes, ...plumb.meshes);
    this.guard = bubble(paint[0], rules.intercept_radius, 0.05, 0.5);
    this.group.add(
      this.guard,
      targetMark(new Color(this.colour("target")), target, rules.reach_radius),
    );
    const places = [...drones.map(({ position }) => position), target];
    this.target = target;
    this.person = person;
    this.chase.begin(drones[person].position, this.aim(drones), places);
  }

  /** What the person's drone is after: the attacker, or the target. */
  aim(drones) {
    return this.person === 0 ? drones[1].position : this.target;
  }

  /** A step has been flown. */
  extend({ clock, drones }) {
    this.parts.forEach(({ trail }, role) => trail.extend(clock, drones[role].position));
  }

  /** An event at a place of the fight, at `time` s. */
  mark(place, time, colour) {
    const pulse = new Pulse({ place, time }, new Color(this.colour(colour)));
    this.pulses.push(pulse);
    this.group.add(...pulse.meshes);
  }

  /** `drones`: as they are drawn now; `seconds`: since the last picture; `now`: s, of the pulses. */
  draw({ drones, out, thrusts, time, seconds, now }) {
    const { clientWidth, clientHeight } = this.canvas;
    const ratio = this.renderer.getPixelRatio();
    this.size.value.set(clientWidth * ratio, clientHeight * ratio);
    const own = drones[this.person].position;
    this.chase.follow(own, this.aim(drones), seconds);
    const camera = this.chase.place(own, clientWidth / Math.max(clientHeight, 1));
    drones.forEach(({ position, quaternion: [w, x, y, z] }, role) => {
      const { body, trail, plumb } = this.parts[role];
      if (!out[role]) this.turned[role] += 2 * Math.PI * TURNS * Math.sqrt(thrusts[role]) * seconds;
      body.place(position, [x, y, z, w], ENLARGEMENT, this.turned[role], !out[role]);
      trail.show(time, ratio);
      plumb.place(position, ENLARGEMENT, this.chase.distance);
    });
    this.guard.position.fromArray(drones[0].position);
    this.guard.visible = !out[0];
    for (const pulse of this.pulses) pulse.show(now, FADE);
    this.renderer.render(this.world.scene, camera);
  }

  clear() {
    for (const { trail } of this.parts ?? []) trail.dispose();
    this.group.traverse((part) => {
      const shared = this.hangars.some((hangar) => Object.values(hangar).includes(part.material));
      if (!shared) part.material?.dispose();
    });
    this.group.clear();
    this.pulses = [];
  }
}
