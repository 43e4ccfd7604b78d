/** From a wanted acceleration to the game's action: `combat/autopilot.py`. */
import { add, apply, clamp, cross, rotateInverse, scale, times, transpose } from "./vector.js";

const POLE = 0.4; // of the attitude, a control step
const FLOOR_BRAKING = 2.5; // m/s^2
const FLOOR_MARGIN = 0.25; // m
export const MIN_LIFT = 0.15; // of gravity
export const VELOCITY_GAIN = 5; // 1/s

/** What the controller knows of the drone of `role` and of the clock. */
export function airframe({ flight, rules }, role) {
  const { gravity, substeps } = flight;
  const { mass, inertia, axes, full_thrust: fullThrust } = flight.bodies[role];
  const step = flight.timestep * substeps;
  const gap = 1 - POLE;
  const back = axes && transpose(axes);
  return {
    gravity,
    maxForce: fullThrust / mass,
    momentum: (rate) =>
      axes ? apply(axes, times(inertia, apply(back, rate))) : times(inertia, rate),
    momentScale: Math.max(flight.moment_scale, 1e-9),
    attitudeGain: gap ** 2 / step ** 2,
    rateGain: (2 * gap - (gap ** 2 * (substeps + 1)) / (2 * substeps)) / step,
    spinGain: gap / step,
    floor: rules.crash_altitude + FLOOR_MARGIN,
  };
}

/** The action that turns the thrust to `force`: thrust over mass, m/s^2, world frame. */
export function steer(body, { quaternion, rate }, force) {
  const wanted = rotateInverse(quaternion, force);
  const level = [-wanted[1], wanted[0]]; // e_z x wanted
  const sine = Math.hypot(...level);
  const axis = sine > 1e-6 ? level.map((part) => part / sine) : [1, 0];
  const angle = Math.atan2(sine, wanted[2]);
  const acceleration = [
    body.attitudeGain * angle * axis[0] - body.rateGain * rate[0],
    body.attitudeGain * angle * axis[1] - body.rateGain * rate[1],
    -body.spinGain * rate[2],
  ];
  const moment = add(body.momentum(acceleration), cross(rate, body.momentum(rate)));
  const thrust = (2 * wanted[2]) / body.maxForce - 1;
  return [thrust, ...scale(1 / body.momentScale, moment)].map((part) => clamp(part, -1, 1));
}

/** Thrust over mass nearest to a wanted `acceleration`: altitude first, then the way. */
export function attainable(body, { position, velocity }, acceleration) {
  const safe = -Math.sqrt(2 * FLOOR_BRAKING * Math.max(position[2] - body.floor, 0));
  const vertical = Math.max(acceleration[2], 2 * VELOCITY_GAIN * (safe - velocity[2]));
  const lift = clamp(vertical + body.gravity, MIN_LIFT * body.gravity, body.maxForce);
  const room = Math.sqrt(body.maxForce ** 2 - lift ** 2);
  const [x, y] = acceleration;
  const share = Math.min(1, room / Math.max(Math.hypot(x, y), 1e-6));
  return [share * x, share * y, lift];
}

/** The action with which a drone comes nearest to a wanted acceleration. */
export function fly(body, drone, acceleration) {
  return steer(body, drone, attainable(body, drone, acceleration));
}
