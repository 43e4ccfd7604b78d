/** The clock of a page: plays, pauses, seeks and steps. It knows neither drones nor buttons. */

export const SPEEDS = [1 / 16, 1 / 8, 1 / 4, 1 / 2, 1, 2, 4];
const EPILOGUE = 0.2; // of the longest fight, after its end: its last event fades
const EPILOGUES = [0.2, 1]; // s, at least and at most
const AGREEABLE = 3; // s that a fight should last on the screen

export class Clock {
  /** `dt`: s, one step; `onChange` is called after every change of time, speed or state. */
  constructor(dt, onChange) {
    Object.assign(this, { dt, onChange, time: 0, end: 0, speed: 1, playing: false, repeat: false });
    this.before = null;
  }

  get duration() {
    return this.end + this.fade;
  }

  /** How long after an event its mark fades, s. */
  get fade() {
    const [low, high] = EPILOGUES;
    return Math.min(Math.max(EPILOGUE * this.end, low), high);
  }

  /** Take over another end; the fight's speed is halved until it lasts long enough to be seen. */
  setEnd(end, choosesSpeed = false) {
    this.end = end;
    if (choosesSpeed) {
      const fits = (speed) => speed <= 1 && end / speed >= AGREEABLE;
      this.speed = SPEEDS.filter(fits).pop() ?? 1 / 8;
    }
    this.seek(this.time);
  }

  /** To be called before every picture with the browser's time in ms. */
  tick(now) {
    const passed = this.before === null ? 0 : Math.min((now - this.before) / 1000, 0.25);
    this.before = this.playing ? now : null;
    if (!this.playing || passed === 0) return;
    const time = this.time + passed * this.speed;
    if (time < this.duration) {
      this.time = time;
    } else if (this.repeat) {
      this.time = 0;
    } else {
      this.time = this.duration;
      this.playing = false;
    }
    this.onChange();
  }

  play(on = !this.playing) {
    if (on && this.time >= this.duration - 1e-6) this.time = 0;
    this.playing = on;
    this.onChange();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.onChange();
  }

  /** Pause, and go on or back by whole steps. */
  step(count) {
    this.playing = false;
    this.seek((Math.round(this.time / this.dt) + count) * this.dt);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.onChange();
  }

  /** To the next faster or slower speed of `SPEEDS`. */
  changeSpeed(by) {
    const index = SPEEDS.indexOf(this.speed) + by;
    this.setSpeed(SPEEDS[Math.min(Math.max(index, 0), SPEEDS.length - 1)]);
  }
}
