/** The scripted pilots: `combat/scripted.py`. Each wants an acceleration, m/s^2, world frame. */
import { MIN_LIFT, VELOCITY_GAIN, airframe, fly } from "./autopilot.js";
import { add, bodyZ, clamp, dot, length, scale, subtract, unit } from "./vector.js";

const WEAVE = { speed: 3, rate: 5, phase: 1000, end: 2.5 };
const DIVE = { height: 2.5, speed: 6, climb: 4, fall: 7, lead: 1.1, committed: 0.5 };
const GUARD = {
  distance: 2,
  gain: 3,
  braking: 12,
  hurry: 1.5,
  velocityGain: VELOCITY_GAIN,
  along: 0,
  look: 0,
};
const KEEPER = {
  distance: 0.39,
  gain: 1.9,
  braking: 11,
  hurry: 0.85,
  velocityGain: 9.3,
  along: 1.1,
  look: 0.016,
  push: 0.94,
};
const SOONEST = 0.05;
const NAVIGATION_CONSTANT = 3;

/** `act(drones, target, time) -> action` of the pilot `name` in the place of `role`. */
export function buildScripted(name, game, role) {
  const body = airframe(game, role);
  const guidance = GUIDANCE[name];
  return (drones, target, time) => {
    const now = { own: drones[role], other: drones[1 - role], target, time };
    return fly(body, drones[role], guidance(body, now));
  };
}

const GUIDANCE = {
  hover: (body, { own }) => scale(-VELOCITY_GAIN, own.velocity),
  hover_guard: (body, now) => stand(body, GUARD, now),
  goalkeeper: (body, now) => stand(body, KEEPER, now),
  pure_pursuit: (body, { own, other }) =>
    rush(body, own.velocity, subtract(other.position, own.position)),
  proportional_navigation: proportionalNavigation,
  dash: (body, { own, target }) => rush(body, own.velocity, subtract(target, own.position)),
  weave,
  high_dive: highDive,
};

function weave(body, { own, target, time }) {
  const way = subtract(target, own.position);
  const side = unit([-way[1], way[0], 0]);
  const near = clamp((length(way) - WEAVE.end) / WEAVE.end, 0, 1);
  const swing = near * WEAVE.speed * Math.cos(WEAVE.rate * time + WEAVE.phase * target[2]);
  return rush(body, subtract(own.velocity, scale(swing, side)), way);
}

function highDive(body, { own, target }) {
  const way = subtract(target, own.position);
  const overGround = [way[0], way[1], 0];
  const ahead = unit(overGround);
  const climb = own.velocity[2];
  const above = Math.max(-way[2], 0);
  const fall = (climb + Math.sqrt(climb ** 2 + 2 * DIVE.fall * above)) / DIVE.fall;
  const meeting = length(overGround) / Math.max(fall, 0.1);
  const inTime = meeting < dot(own.velocity, ahead);
  const diving = (inTime || climb < -DIVE.committed) && above > 0;
  const rise = clamp(2 * (DIVE.height + way[2]), 0, DIVE.climb);
  const speed = diving ? Math.min(DIVE.lead * meeting, DIVE.speed) : DIVE.speed;
  const wanted = subtract(add(scale(speed, ahead), [0, 0, rise]), own.velocity);
  const [x, y, z] = scale(VELOCITY_GAIN, wanted);
  return [x, y, diving ? -DIVE.fall : z];
}

/** Go to the post before the target, towards the attacker, and stay there. */
function stand(body, stance, { own, other, target }) {
  const ahead = add(other.position, scale(stance.look, other.velocity));
  const line = subtract(ahead, target);
  const before = Math.min(stance.distance, 0.5 * length(line));
  const post = add(target, scale(before, unit(line)));
  const way = subtract(post, own.position);
  const distance = length(way);
  const stopping = Math.min(stance.gain * distance, Math.sqrt(2 * stance.braking * distance));
  const incoming = subtract(post, ahead);
  const closing = Math.max(dot(other.velocity, unit(incoming)), 0);
  const left = length(incoming);
  const hurried = stance.push
    ? (stance.hurry * distance) / Math.max(timeToGo(left, closing, stance.push * body.maxForce), SOONEST)
    : (stance.hurry * distance * closing) / Math.max(left, 0.3);
  const to = scale(Math.max(stopping, hurried), unit(way));
  const around = subtract(other.velocity, scale(dot(other.velocity, unit(line)), unit(line)));
  const along = scale((stance.along * before) / Math.max(length(line), 0.3), around);
  return scale(stance.velocityGain, subtract(add(to, along), own.velocity));
}

function proportionalNavigation(body, { own, other }) {
  const sight = subtract(other.position, own.position);
  const along = unit(sight);
  const relative = subtract(other.velocity, own.velocity);
  const closing = -dot(relative, along);
  const time = timeToGo(length(sight), closing, body.maxForce);
  const up = bodyZ(other.quaternion);
  const lift = Math.min(body.gravity / Math.max(up[2], 1e-3), body.maxForce);
  const turning = subtract(scale(lift, up), [0, 0, body.gravity]);
  const across = (vector) => subtract(vector, scale(dot(vector, along), along));
  const miss = add(scale(1 / Math.max(time, 0.05), across(relative)), scale(0.5, across(turning)));
  return fullThrust(body, along, scale(NAVIGATION_CONSTANT, miss));
}

/** Seconds until `distance` m are flown, `closing` at m/s now and pushed by `push` m/s^2. */
function timeToGo(distance, closing, push) {
  return (Math.sqrt(closing ** 2 + 2 * push * distance) - closing) / push;
}

/** Full thrust along `way` while the velocity across it dies out. */
function rush(body, velocity, way) {
  const along = unit(way);
  const across = subtract(velocity, scale(dot(velocity, along), along));
  return fullThrust(body, along, scale(-VELOCITY_GAIN, across));
}

/** `across` + s `along` with the largest s that full thrust and the least lift allow. */
function fullThrust(body, along, across) {
  const held = add(across, [0, 0, body.gravity]);
  const projection = dot(held, along);
  const room = projection ** 2 - dot(held, held) + body.maxForce ** 2;
  const most = Math.sqrt(Math.max(room, 0)) - projection;
  const descent = Math.max(-along[2], 1e-3);
  const untilLeastLift = Math.max(held[2] - MIN_LIFT * body.gravity, 0) / descent;
  return add(across, scale(Math.min(most, untilLeastLift), along));
}
