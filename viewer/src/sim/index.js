/** The game without a picture: physics, rules, observation, policies and pilots. No dependency. */
export { airframe, fly } from "./autopilot.js";
export { Game } from "./fight.js";
export { ATTACKER, CAUSE, DEFENDER, detect, judge } from "./rules.js";
export { length } from "./vector.js";
