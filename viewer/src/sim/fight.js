/** One fight from start to end: `combat/env.py` without rewards. Who flies is the caller's. */
import { OBSERVATIONS } from "./observe.js";
import { buildPolicy } from "./policy.js";
import { buildScripted } from "./pilots.js";
import { buildStep } from "./flight.js";
import { CAUSE, detect, forfeit, judge } from "./rules.js";

const MAX_COORDINATE = 1e4; // a state beyond it has diverged
const PARTS = ["position", "quaternion", "velocity", "rate"];
const REST = [0, 0, 0];

/** `game`: of `report/play_data.py`. */
export class Game {
  constructor(game) {
    Object.assign(this, game);
    this.fly = buildStep(game.flight);
    this.dt = game.flight.timestep * game.flight.substeps;
  }

  /** A fight about to start; `random`: random numbers in [0, 1). */
  spawn(random = Math.random) {
    const { places, uniform, half_width: half, low, high, spread } = this.start;
    const [defender, attacker, target] = places.map((place, i) => {
      const [x, y] = place.map((middle) => {
        const offset = 2 * random() - 1;
        return uniform ? half * offset : middle + spread[i] * offset;
      });
      return [x, y, low + random() * (high - low)];
    });
    const still = (position) => ({
      position,
      quaternion: [1, 0, 0, 0],
      velocity: REST,
      rate: REST,
    });
    return {
      drones: [still(defender), still(attacker)],
      target,
      clock: 0,
      out: [false, false],
      cause: CAUSE.NONE,
    };
  }

  observe({ drones, target }, layout = this.observation) {
    return OBSERVATIONS[layout](drones, target);
  }

  /** One control step with both `actions`; the state after it. A fight that has ended stays. */
  step(state, actions) {
    if (state.cause !== CAUSE.NONE) return state;
    const { drones: before, target, out } = state;
    const invalid = actions.map((action, role) => !action.every(Number.isFinite) && !out[role]);
    const finite = actions.map((action) =>
      action.map((part) => (Number.isFinite(part) ? part : 0)),
    );
    const flown = this.fly(before, finite);
    const sane = flown.every(isSane);
    const drones = before.map((drone, role) => (sane && !out[role] ? flown[role] : atRest(drone)));
    const clock = state.clock + 1;
    const positions = [before, drones].map((both) => both.map(({ position }) => position));
    const events = detect(this.rules, ...positions, target, out, clock);
    let cause = invalid.some(Boolean) ? forfeit(invalid) : judge(this.rules, events);
    if (!sane) cause = CAUSE.DIVERGED;
    const down = sane ? events.down : out;
    const after = drones.map((drone, role) => (down[role] ? atRest(drone) : drone));
    return { drones: after, target, clock, out: down, cause };
  }

  /** `act(state) -> action` of a policy or a scripted pilot of the page's data. */
  pilot(raw, role) {
    if (raw.scripted) {
      const act = buildScripted(raw.scripted, this, role);
      return ({ drones, target, clock }) => act(drones, target, clock * this.dt);
    }
    const policy = buildPolicy(raw);
    return (state) => policy(this.observe(state, raw.observation)[role]);
  }
}

function isSane(drone) {
  return PARTS.every((part) => drone[part].every((value) => Math.abs(value) < MAX_COORDINATE));
}

const atRest = (drone) => ({ ...drone, velocity: REST, rate: REST });
