/** Fights one after another: what phase a fight is in, its fixed steps, and the score. No picture. */
import { CAUSE, Game } from "../sim/index.js";
import { HandPilot } from "./hand.js";

export const SPEEDS = [1 / 8, 1 / 4, 1 / 2, 1]; // of real time, never faster
export const COUNT_FROM = 3;
const BEAT = 0.6; // s, of the count
const MOST_PASSED = 0.1; // s at once: a browser that stalls loses time, it catches up with nothing

export class Session {
  /** `wish()`: what the person wants, see `hand.js`; `onStep(state)`, `onPhase()`: see `page.js`. */
  constructor(data, { wish, onStart, onStep, onPhase }) {
    Object.assign(this, { opponents: data.opponents, wish, onStart, onStep, onPhase });
    this.game = new Game(data.game);
    this.ends = data.game.ends;
    this.speed = 1 / 2;
    this.choose(data.side);
  }

  /** Fly `person`'s side: 0 the defender, 1 the attacker. The score begins anew. */
  choose(person) {
    this.person = person;
    this.opponent = this.game.pilot(this.opponents[1 - person], 1 - person);
    this.hand = new HandPilot(this.game, person);
    this.score = { won: 0, lost: 0, tied: 0 };
    this.prepare();
  }

  /** A fresh start, at rest until `go`. */
  prepare() {
    this.state = this.before = this.game.spawn();
    this.actions = [0, 1].map(() => [-1, 0, 0, 0]);
    this.share = 0;
    this.onStart?.(this.state);
    this.enter("ready");
  }

  /** The one button: start, pause, go on, again. */
  go() {
    const { phase } = this;
    if (phase === "over") this.prepare();
    if (phase === "ready" || phase === "over") {
      this.counted = 0;
      this.enter("counting");
    } else if (phase === "paused") this.enter(this.interrupted);
    else this.pause();
  }

  restart() {
    this.prepare();
    this.go();
  }

  pause() {
    if (this.phase !== "flying" && this.phase !== "counting") return;
    this.interrupted = this.phase;
    this.enter("paused");
  }

  enter(phase) {
    this.phase = phase;
    this.onPhase?.();
  }

  /** What is left of the count: 3, 2, 1. */
  get count() {
    return COUNT_FROM - Math.floor(this.counted / BEAT);
  }

  get time() {
    return this.state.clock * this.game.dt;
  }

  /** Who won, for a fight that is over. */
  get end() {
    return this.ends[this.state.cause];
  }

  /** Go on by the time since the last picture, in s. */
  pass(seconds) {
    const passed = Math.min(seconds, MOST_PASSED);
    if (this.phase === "counting") {
      this.counted += passed;
      if (this.counted >= COUNT_FROM * BEAT) this.enter("flying");
      return;
    }
    if (this.phase !== "flying") return;
    this.share += (passed * this.speed) / this.game.dt;
    while (this.share >= 1 && this.phase === "flying") {
      this.share -= 1;
      this.step();
    }
    this.share = Math.min(this.share, 1);
  }

  /** One control step of both. */
  step() {
    const { state, person } = this;
    const action = this.hand.act(state, this.wish());
    const other = this.opponent(state).map((part) => Math.min(Math.max(part, -1), 1));
    this.actions = person === 0 ? [action, other] : [other, action];
    this.before = state;
    this.state = this.game.step(state, this.actions);
    this.onStep?.(this.state);
    if (this.state.cause !== CAUSE.NONE) this.finish();
  }

  finish() {
    const { winner } = this.end;
    const own = ["defender", "attacker"][this.person];
    this.score[winner === "nobody" ? "tied" : winner === own ? "won" : "lost"] += 1;
    this.before = this.state;
    this.enter("over");
  }

  /** The drone between its last two states, so that it moves evenly on every screen. */
  drone(role) {
    const [from, to] = [this.before.drones[role], this.state.drones[role]];
    const mix = (a, b, sign = 1) =>
      a.map((x, i) => (1 - this.share) * x + sign * this.share * b[i]);
    const same = from.quaternion.reduce((sum, x, i) => sum + x * to.quaternion[i], 0);
    const turned = mix(from.quaternion, to.quaternion, same < 0 ? -1 : 1);
    const norm = Math.hypot(...turned) || 1;
    return {
      position: mix(from.position, to.position),
      quaternion: turned.map((part) => part / norm),
      velocity: to.velocity,
    };
  }
}
