/** One fight as objects of the scene, put in place for any time. */
import { Color, Group, Vector3 } from "three";
import { ENLARGEMENT } from "./drone.js";
import { ATTACKER, DEFENDER, ROLES, distance } from "./flight.js";
import { Label } from "./label.js";
import { Plumb, Pulse, bubble, targetMark } from "./marks.js";
import { Trail } from "./trail.js";

const SIGHTS = 40; // points of a path that an overview must hold
const IDLE = 0.15; // share of full thrust at which rotors turn at least
const TURNS = [2, 9]; // rotations a second without and with full thrust, slow enough for the eye

export class Model {
  /** `hangars` by side; `size`: uniform, of the picture in pixels; `colour(name)`: the theme's. */
  constructor(flight, hangars, rules, size, colour) {
    this.flight = flight;
    this.group = new Group();
    const times = Array.from({ length: flight.frames }, (_, i) => flight.timeOf(i));
    this.drones = flight.drones.map((drone) => {
      const side = flight.sides[drone];
      const paint = new Color(colour(ROLES[side]));
      const trail = new Trail(flight.path(drone), times, paint, size);
      const parts = { drone, body: hangars[side].build(), trail, plumb: new Plumb(paint) };
      this.group.add(parts.body.group, ...trail.meshes, ...parts.plumb.meshes);
      if (side === DEFENDER) parts.guard = this.guard(colour, rules);
      if (flight.team) parts.label = this.label(flight.names[drone], colour(ROLES[side]));
      return { ...parts, turned: turnedRotors(flight, drone) };
    });
    this.group.add(targetMark(new Color(colour("target")), flight.target, rules.reach));
    this.pulses = flight.events.map((event) => new Pulse(event, new Color(colour(event.colour))));
    for (const pulse of this.pulses) this.group.add(...pulse.meshes);
  }

  /** The radius around a defender within which it intercepts. */
  guard(colour, rules) {
    const sphere = bubble(new Color(colour("defender")), rules.intercept, 0.05, 0.5);
    this.group.add(sphere);
    return sphere;
  }

  /** A team mate's name beside it. */
  label(name, colour) {
    const label = new Label(name, colour);
    this.group.add(label.sprite);
    return label;
  }

  /**
   * `time` may lie after the end: the drones then stay where they are, and events fade in `fade` s.
   * `far`: m from the camera to what it looks at.
   */
  show(time, { trueSize, pixelRatio, fade, far }) {
    const { flight } = this;
    const now = Math.min(time, flight.end);
    const scale = trueSize ? 1 : ENLARGEMENT;
    for (const { drone, body, trail, plumb, guard, label, turned } of this.drones) {
      const position = flight.position(drone, now);
      const down = flight.down(drone, now);
      const [index, share] = flight.at(now);
      const turn = turned[index] + share * ((turned[index + 1] ?? turned[index]) - turned[index]);
      body.place(position, flight.attitude(drone, now), scale, turn, !down);
      trail.show(now, pixelRatio);
      plumb.place(position, scale, far);
      if (guard) {
        guard.position.fromArray(position);
        guard.visible = !down;
      }
      label?.place(position, scale, far, down);
    }
    for (const pulse of this.pulses) pulse.show(time, fade);
  }

  dispose() {
    for (const { trail, label } of this.drones) {
      trail.dispose();
      label?.dispose();
    }
    this.group.traverse((part) => part.material?.dispose());
  }
}

/** The points that an overview of `flight` must show: its paths, their shadows, the target. */
export function sights(flight, rules) {
  const [x, y, z] = flight.target;
  const { reach } = rules;
  const points = [
    [x - reach, y, z],
    [x + reach, y, z],
    [x, y - reach, z],
    [x, y + reach, z],
    [x, y, 0],
  ];
  points.push([x, y, z + reach]);
  const most = 1.3 * rules.arena; // who flies far away must not make the others small
  for (const drone of flight.drones) {
    for (let part = 0; part <= SIGHTS; part += 1) {
      const place = flight.position(drone, (flight.end * part) / SIGHTS);
      const [px, py, pz] = place.map((value) => Math.min(Math.max(value, -most), most));
      points.push([px, py, pz], [px, py, 0]);
    }
  }
  return points.map((point) => new Vector3(...point));
}

/** Rad that the rotors have turned at each state, faster under more thrust. */
function turnedRotors(flight, drone) {
  const turned = new Float32Array(flight.frames);
  for (let index = 1; index < flight.frames; index += 1) {
    const before = flight.timeOf(index - 1);
    const thrust = Math.max(IDLE, (flight.action(drone, before)[0] + 1) / 2);
    const rate = TURNS[0] + (TURNS[1] - TURNS[0]) * Math.sqrt(thrust);
    const runs = flight.down(drone, before) ? 0 : 1;
    turned[index] = turned[index - 1] + runs * 2 * Math.PI * rate * flight.gap(index - 1);
  }
  return turned;
}

/** From the drone that is followed to what it is after: the nearest attacker that flies, or the target. */
export function aim(flight, drone, time) {
  if (flight.sides[drone] === ATTACKER) return flight.target;
  const from = flight.position(drone, time);
  const places = flight.flying(ATTACKER, time).map((other) => flight.position(other, time));
  return places.reduce((a, b) => (distance(b, from) < distance(a, from) ? b : a));
}
