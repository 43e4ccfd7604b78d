/** Vectors [x, y, z] and unit quaternions [w, x, y, z], body to world. Nothing here changes its arguments. */

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (factor, a) => [factor * a[0], factor * a[1], factor * a[2]];
export const times = (a, b) => [a[0] * b[0], a[1] * b[1], a[2] * b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const distance = (a, b) => length(subtract(a, b));
export const unit = (a) => scale(1 / Math.max(length(a), 1e-6), a);
export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

export function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

/** The product of a matrix, given by rows, and a vector. */
export const apply = (matrix, vector) => matrix.map((row) => dot(row, vector));

export const transpose = (matrix) => [0, 1, 2].map((i) => matrix.map((row) => row[i]));

/** The body's z axis in the world frame. */
export function bodyZ([w, x, y, z]) {
  return [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
}

/** Body frame to world frame. */
export function rotate([w, ...axis], vector) {
  const twice = scale(2, cross(axis, vector));
  return add(add(vector, scale(w, twice)), cross(axis, twice));
}

/** World frame to body frame. */
export const rotateInverse = (quaternion, vector) => rotate(conjugate(quaternion), vector);

export const conjugate = ([w, x, y, z]) => [w, -x, -y, -z];

/** Hamilton product: first `right`, then `left`. */
export function multiply([w1, ...v1], [w2, ...v2]) {
  return [w1 * w2 - dot(v1, v2), ...add(add(scale(w1, v2), scale(w2, v1)), cross(v1, v2))];
}

/** The attitude after `seconds` at `rate` rad/s in the body frame, as MuJoCo integrates it. */
export function turned(quaternion, rate, seconds) {
  const speed = length(rate);
  const half = (speed * seconds) / 2;
  const share = speed > 0 ? Math.sin(half) / speed : 0;
  const after = multiply(quaternion, [Math.cos(half), ...scale(share, rate)]);
  const norm = Math.hypot(...after);
  return after.map((part) => part / norm);
}
