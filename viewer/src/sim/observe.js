/** What each drone sees, eq. 5, in two frames: `combat/observe.py`. */
import { conjugate, multiply, rotate, rotateInverse, subtract } from "./vector.js";

const DOWN = [0, 0, -1];

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

export const OBSERVATIONS = { world, ego };
