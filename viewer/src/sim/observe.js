/** What each drone sees, eq. 5, in two frames and with what guidance steers by: `combat/observe.py`. */
import {
  add,
  clamp,
  conjugate,
  cross,
  dot,
  length,
  multiply,
  rotate,
  rotateInverse,
  scale,
  subtract,
  unit,
} from "./vector.js";

const DOWN = [0, 0, -1];
const [NEAR, SLOW, AHEAD] = [0.5, 1.0, 1.0]; // m, m/s, s: of the observation engagement
// Of `ego`, the columns of the other's attitude, rate and gravity.
const TURNED = new Set([10, 11, 12, 13, 26, 27, 28, 32, 33, 34]);

/** The same 35 numbers for both drones. */
function world(drones, target) {
  const pose = drones.flatMap(({ position, quaternion }) => [...position, ...quaternion]);
  const twist = drones.flatMap(({ quaternion, velocity, rate }) => [
    ...rotateInverse(quaternion, velocity),
    ...rate,
  ]);
  const gravity = drones.flatMap(({ quaternion }) => rotateInverse(quaternion, DOWN));
  const row = [...pose, ...target, ...twist, ...gravity];
  return [row, row];
}

/** 35 numbers for each drone in its own frame, itself first. */
function ego(drones, target) {
  return drones.map((own, role) => {
    const other = drones[1 - role];
    const into = (vector) => rotateInverse(own.quaternion, vector);
    return [
      ...own.position,
      ...own.quaternion,
      ...into(subtract(other.position, own.position)),
      ...multiply(conjugate(own.quaternion), other.quaternion),
      ...into(subtract(target, own.position)),
      ...into(own.velocity),
      ...own.rate,
      ...into(other.velocity),
      ...into(rotate(other.quaternion, other.rate)),
      ...into(DOWN),
      ...rotateInverse(other.quaternion, DOWN),
    ];
  });
}

/** 60 numbers for each drone: `ego`, and `combat/engagement.py`. */
function engagement(drones, target) {
  return ego(drones, target).map((seen, role) => {
    const [own, other] = [drones[role], drones[1 - role]];
    const way = subtract(other.position, own.position);
    const velocity = subtract(other.velocity, own.velocity);
    return [
      ...seen,
      ...approach(own.quaternion, way, velocity),
      ...approach(own.quaternion, subtract(target, own.position), scale(-1, own.velocity)),
      length(subtract(target, other.position)),
    ];
  });
}

/** Range, closing speed, rate of the line of sight, time to the closest approach, the way then, direction. */
function approach(quaternion, way, velocity) {
  const into = (vector) => rotateInverse(quaternion, vector);
  const range = length(way);
  const closing = -dot(unit(way), velocity);
  const speed = Math.max(length(velocity), SLOW);
  const time = clamp((closing * range) / speed ** 2, 0, AHEAD);
  const turning = scale(1 / (range ** 2 + NEAR ** 2), cross(way, velocity));
  const miss = add(way, scale(time, velocity));
  return [range, closing, ...into(turning), time, ...into(miss), ...into(unit(way))];
}

/** 50 of the 60: without how the other is turned. */
function tracks(drones, target) {
  return engagement(drones, target).map((seen) => seen.filter((_, column) => !TURNED.has(column)));
}

export const OBSERVATIONS = { world, ego, engagement, tracks };
