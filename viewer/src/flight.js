/**
 * One fight as Python wrote it (`report/replay_data.py`), and where its drones are at any time.
 * Units: m, m/s, s; world frame with z up; quaternions wxyz, body to world. Nothing is drawn here.
 */

export const DEFENDER = 0;
export const ATTACKER = 1;
export const ROLES = ["defender", "attacker"]; // the sides; in a duel their drones, too
const DUEL = [DEFENDER, ATTACKER];

const COLUMNS = 14; // of a drone in a state: position 3, quaternion 4, velocity 3, action 4
const QUATERNION = 3;
const VELOCITY = 7;
const ACTION = 10;
const STEPS = 32767; // of an int16 on either side of 0

export class Flight {
  /** `raw`: one entry of "fights" in the page's data. */
  constructor(raw) {
    const { name, note, defender, attacker, target, dt, frames, result, events } = raw;
    Object.assign(this, { name, note, target, dt, frames, result, events });
    this.pilots = [defender, attacker];
    this.sides = raw.sides ?? DUEL; // of each drone; a duel's data do not say it
    this.names = raw.names ?? ROLES;
    this.team = this.sides.length > 2;
    this.drones = [...this.sides.keys()].filter((drone) => !raw.alone || this.sides[drone]);
    this.end = result.time;
    this.states = unpack(raw.states, raw.extent, raw.fastest);
  }

  /** Index of the state at or before `time`, and how far on to the next, in [0, 1). */
  at(time) {
    const last = this.frames - 1;
    if (last === 0 || time <= 0) return [0, 0];
    const index = Math.min(Math.floor(time / this.dt + 1e-6), last - 1);
    return [index, Math.min(1, Math.max(0, (time - this.timeOf(index)) / this.gap(index)))];
  }

  /** Time of a state; the last gap is shorter where states were thinned out. */
  timeOf(index) {
    return index === this.frames - 1 ? this.end : index * this.dt;
  }

  gap(index) {
    return Math.max(this.timeOf(index + 1) - this.timeOf(index), 1e-9);
  }

  /** Position at `time`, a cubic through the states and along their velocities. */
  position(drone, time) {
    const [index, share] = this.at(time);
    const from = this.offset(index, drone);
    const to = this.offset(Math.min(index + 1, this.frames - 1), drone);
    const gap = share > 0 ? this.gap(index) : 0;
    const back = 1 - share;
    return [0, 1, 2].map((axis) => {
      const [a, b] = [this.states[from + axis], this.states[to + axis]];
      const leave = gap * this.states[from + VELOCITY + axis];
      const arrive = gap * this.states[to + VELOCITY + axis];
      const bend = share * back * (back * (leave - (b - a)) - share * (arrive - (b - a)));
      return a + share * (b - a) + bend;
    });
  }

  /** Attitude at `time`, [x, y, z, w] as three.js wants it; along the shorter arc. */
  attitude(drone, time) {
    const [index, share] = this.at(time);
    const from = this.offset(index, drone) + QUATERNION;
    const to = this.offset(Math.min(index + 1, this.frames - 1), drone) + QUATERNION;
    const parts = [0, 1, 2, 3];
    const dot = parts.reduce((sum, i) => sum + this.states[from + i] * this.states[to + i], 0);
    const weight = dot < 0 ? -share : share;
    const mixed = parts.map(
      (i) => (1 - share) * this.states[from + i] + weight * this.states[to + i],
    );
    const norm = Math.hypot(...mixed) || 1;
    const [w, x, y, z] = mixed.map((part) => part / norm);
    return [x, y, z, w];
  }

  velocity(drone, time) {
    return this.mixed(drone, time, VELOCITY, 3);
  }

  /** The action in force at `time`, in [-1, 1]: thrust, three moments. It holds for a step. */
  action(drone, time) {
    const [index, share] = this.at(time);
    const from = this.offset(share === 1 ? index + 1 : index, drone) + ACTION;
    return this.states.subarray(from, from + 4);
  }

  speed(drone, time) {
    return Math.hypot(...this.velocity(drone, time));
  }

  /** The drones of a side that take part. */
  mates(side) {
    return this.drones.filter((drone) => this.sides[drone] === side);
  }

  /** Those of them that fly at `time`; all where none does. */
  flying(side, time) {
    const mates = this.mates(side);
    const up = mates.filter((drone) => !this.down(drone, time));
    return up.length ? up : mates;
  }

  /** The defender and the attacker that are nearest to each other, of those that fly. */
  nearest(time) {
    const pairs = this.flying(DEFENDER, time).flatMap((defender) =>
      this.flying(ATTACKER, time).map((attacker) => [defender, attacker]),
    );
    const apart = ([a, b]) => distance(this.position(a, time), this.position(b, time));
    return pairs.reduce((best, pair) => (apart(pair) < apart(best) ? pair : best));
  }

  /** Distance between those two. */
  apart(time) {
    const [defender, attacker] = this.nearest(time);
    return distance(this.position(defender, time), this.position(attacker, time));
  }

  /** Distance from the nearest attacker that flies to the target. */
  toTarget(time) {
    const away = (drone) => distance(this.position(drone, time), this.target);
    return Math.min(...this.flying(ATTACKER, time).map(away));
  }

  /** Whether the drone has crashed or was struck by `time`. */
  down(drone, time) {
    const fell = ({ kind, roles, time: when }) =>
      kind !== "end" && roles.includes(drone) && when <= time + 1e-6;
    return this.events.some(fell);
  }

  /** Positions of all states of a drone: [x, y, z, x, y, z, ...]. */
  path(drone) {
    const path = new Float32Array(3 * this.frames);
    for (let index = 0; index < this.frames; index += 1) {
      const from = this.offset(index, drone);
      path.set(this.states.subarray(from, from + 3), 3 * index);
    }
    return path;
  }

  mixed(drone, time, column, count) {
    const [index, share] = this.at(time);
    const from = this.offset(index, drone) + column;
    const to = this.offset(Math.min(index + 1, this.frames - 1), drone) + column;
    const mix = (_, i) => (1 - share) * this.states[from + i] + share * this.states[to + i];
    return Array.from({ length: count }, mix);
  }

  offset(index, drone) {
    return (this.sides.length * index + drone) * COLUMNS;
  }
}

export function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** Base64 of little-endian int16, [frames, drones, 14], to numbers with their units. */
function unpack(text, extent, fastest) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const scales = [extent, extent, extent, 1, 1, 1, 1, fastest, fastest, fastest, 1, 1, 1, 1];
  const number = (_, i) => (view.getInt16(2 * i, true) / STEPS) * scales[i % COLUMNS];
  return Float32Array.from({ length: bytes.length / 2 }, number);
}
