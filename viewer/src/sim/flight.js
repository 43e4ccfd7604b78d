/**
 * One control step of both drones: `sim/flight.py` and what MJX does for two free rigid bodies.
 *
 * A drone is {position, quaternion, velocity, rate}: m and m/s in the world frame, rad/s in the
 * body's. Numbers are doubles here and float32 in Python; that is the whole difference.
 */
import {
  add,
  apply,
  bodyZ,
  clamp,
  cross,
  dot,
  length,
  rotate,
  rotateInverse,
  scale,
  subtract,
  times,
  transpose,
  turned,
} from "./vector.js";

/** `step(drones, actions) -> drones` of the game's `flight` (`report/play_data.py`). */
export function buildStep(flight) {
  const bodies = flight.bodies.map((body) => new Body(body, flight));
  return (drones, actions) =>
    drones.map((drone, role) => {
      const action = actions[role].map((part) => clamp(part, -1, 1));
      const thrust = (bodies[role].fullThrust * (action[0] + 1)) / 2;
      const moment = scale(flight.moment_scale, action.slice(1));
      let after = drone;
      for (let i = 0; i < flight.substeps; i += 1)
        after = bodies[role].substep(after, thrust, moment);
      return after;
    });
}

class Body {
  constructor({ mass, inertia, axes, full_thrust: fullThrust, drag }, flight) {
    const weight = [0, 0, -mass * flight.gravity];
    Object.assign(this, { mass, inertia, fullThrust, drag, flight, weight });
    const same = (vector) => vector;
    const back = axes && transpose(axes);
    this.inwards = axes ? (vector) => apply(back, vector) : same;
    this.outwards = axes ? (vector) => apply(axes, vector) : same;
  }

  /** One physics step of `timestep` s; semi-implicit Euler. */
  substep({ position, quaternion, velocity, rate }, thrust, moment) {
    const { timestep, max_body_rate: cap } = this.flight;
    const force = this.push(quaternion, velocity, scale(thrust, bodyZ(quaternion)));
    const acceleration = scale(1 / this.mass, add(force, this.weight));
    const velocityAfter = add(velocity, scale(timestep, acceleration));
    const spun = add(rate, this.outwards(this.spin(this.inwards(rate), this.inwards(moment))));
    const rateAfter = scale(Math.min(1, cap / Math.max(length(spun), 1e-6)), spun);
    return {
      position: add(position, scale(timestep, velocityAfter)),
      // MuJoCo turns the body before the cap is applied.
      quaternion: turned(quaternion, spun, timestep),
      velocity: velocityAfter,
      rate: rateAfter,
    };
  }

  /** What a step adds to the body rate, along the principal axes. */
  spin(rate, moment) {
    const { inertia, drag, flight } = this;
    const h = flight.timestep;
    let [torque, diagonal] = [moment, inertia];
    if (drag) {
      const { force, slope } = resist(drag.angular, rate);
      torque = add(torque, force);
      diagonal = add(diagonal, scale(h, slope));
    }
    const momentum = times(inertia, rate);
    const explicit = subtract(torque, cross(rate, momentum));
    if (!flight.implicit) return explicit.map((part, i) => (h * part) / inertia[i]);
    // J = I + h ([w]x I - [I w]x), by rows: see gyroscopic_correction in sim/flight.py
    const [spins, lags] = [skew(rate), skew(momentum)];
    const jacobian = spins.map((row, i) =>
      row.map((part, j) => h * (part * inertia[j] - lags[i][j]) + (i === j ? diagonal[i] : 0)),
    );
    return scale(h, solve(jacobian, explicit));
  }

  /** The force to apply, drag included; world frame. */
  push(quaternion, velocity, force) {
    if (!this.drag) return force;
    const { mass, weight, flight } = this;
    const into = (vector) => this.inwards(rotateInverse(quaternion, vector));
    const { force: drag, slope } = resist(this.drag.linear, into(subtract(velocity, flight.wind)));
    const all = add(into(add(force, weight)), drag);
    const less = slope.map((part) => (flight.timestep * part) / (mass + flight.timestep * part));
    return add(force, rotate(quaternion, this.outwards(subtract(drag, times(less, all)))));
  }
}

/** Drag at `velocity` along the principal axes, and its loss per unit of velocity. */
function resist({ viscous, quadratic }, velocity) {
  const of = (factor) =>
    viscous.map((part, i) => part + factor * quadratic[i] * Math.abs(velocity[i]));
  return { force: scale(-1, times(of(1), velocity)), slope: of(2) };
}

function skew([x, y, z]) {
  return [
    [0, -z, y],
    [z, 0, -x],
    [-y, x, 0],
  ];
}

/** Solve a 3 x 3 system by Cramer's rule. */
function solve(matrix, vector) {
  const [a, b, c] = transpose(matrix);
  const cofactors = [cross(b, c), cross(c, a), cross(a, b)];
  const determinant = dot(a, cofactors[0]);
  return cofactors.map((cofactor) => dot(vector, cofactor) / determinant);
}
