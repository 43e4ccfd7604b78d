/** From what a person wants to the game's action, through the scripted pilots' controller. */
import { airframe, fly } from "../sim/index.js";

const FASTEST = 12; // m/s over ground, with the stick at its end
const CLIMB = 5; // m/s
const GAIN = 5; // 1/s, as the scripted pilots': hands off, the drone brakes and stays

export class HandPilot {
  constructor(game, role) {
    this.role = role;
    this.body = airframe(game, role);
  }

  /** `wish`: {x, y} world frame and {up}, each a share of the stick in [-1, 1]. */
  act({ drones }, { x, y, up }) {
    const drone = drones[this.role];
    const wanted = [FASTEST * x, FASTEST * y, CLIMB * up];
    const acceleration = wanted.map((speed, i) => GAIN * (speed - drone.velocity[i]));
    return fly(this.body, drone, acceleration);
  }
}
