/** What a control step contains and what ends the fight: `combat/rules.py`. Plain numbers. */
import { add, clamp, dot, length, scale, subtract } from "./vector.js";

export const DEFENDER = 0;
export const ATTACKER = 1;

/** Numbers of `types.Cause`. */
export const CAUSE = {
  NONE: 0,
  INTERCEPT: 1,
  REACHED: 2,
  DEFENDER_CRASH: 3,
  ATTACKER_CRASH: 4,
  BOTH_CRASH: 5,
  TIMEOUT: 6,
  DIVERGED: 7,
  DEFENDER_INVALID: 8,
  ATTACKER_INVALID: 9,
  BOTH_INVALID: 10,
};

/** Smallest distance to the origin along the segment from `start` to `end`. */
export function closestApproach(start, end) {
  const delta = subtract(end, start);
  const along = clamp(-dot(start, delta) / Math.max(dot(delta, delta), 1e-12), 0, 1);
  return length(add(start, scale(along, delta)));
}

/** `before`, `after`: both positions at the step's ends; `out`: who was down before it. */
export function detect(rules, before, after, target, out, clock) {
  const from = rules.swept_events ? before : after;
  const between = (places) => subtract(places[DEFENDER], places[ATTACKER]);
  const toTarget = (places) => subtract(places[ATTACKER], target);
  const crashed = after.map(([, , height], role) => height < rules.crash_altitude && !out[role]);
  const gap = closestApproach(between(from), between(after));
  const miss = closestApproach(toTarget(from), toTarget(after));
  return {
    intercept: gap < rules.intercept_radius && !out.some(Boolean),
    reached: miss < rules.reach_radius && !out[ATTACKER],
    crashed,
    down: out.map((was, role) => was || crashed[role]),
    timeout: clock >= rules.episode_steps,
  };
}

/** The cause that ends the fight in this step; the first of simultaneous events counts. */
export function judge(rules, { intercept, reached, crashed, down, timeout }) {
  let [defender, attacker] = crashed;
  let both = defender && attacker;
  if (rules.crash_rule === "out") defender = false;
  if (rules.crash_rule === "grounded") {
    both = down.every(Boolean);
    defender = attacker = false;
  }
  if (intercept) return CAUSE.INTERCEPT;
  if (reached) return CAUSE.REACHED;
  if (both) return CAUSE.BOTH_CRASH;
  if (defender) return CAUSE.DEFENDER_CRASH;
  if (attacker) return CAUSE.ATTACKER_CRASH;
  return timeout ? CAUSE.TIMEOUT : CAUSE.NONE;
}

/** The cause by which sides whose action is not a number lose. */
export function forfeit([defender, attacker]) {
  if (defender) return attacker ? CAUSE.BOTH_INVALID : CAUSE.DEFENDER_INVALID;
  return attacker ? CAUSE.ATTACKER_INVALID : CAUSE.NONE;
}
