/** What the person does with keys, gamepad, mouse and fingers: {right, forward, up} in [-1, 1]. */

const KEYS = {
  KeyW: ["forward", 1],
  ArrowUp: ["forward", 1],
  KeyS: ["forward", -1],
  ArrowDown: ["forward", -1],
  KeyD: ["right", 1],
  ArrowRight: ["right", 1],
  KeyA: ["right", -1],
  ArrowLeft: ["right", -1],
  Space: ["up", 1],
  ShiftLeft: ["up", -1],
  ShiftRight: ["up", -1],
};
const REACH = 70; // pixels from the middle of a stick to its end
const DEAD = 0.14; // of a gamepad's stick, around its middle
const NOTCH = 250; // ms that a notch of the wheel climbs
const START = [0, 9]; // buttons of a gamepad: A, start
const TRIGGERS = [6, 7];

export class Sticks {
  /** `pad`: the element that is dragged on; `acts`: {go} of a gamepad's button; `drawn`: stick nodes. */
  constructor(pad, acts, drawn) {
    Object.assign(this, { pad, acts, drawn });
    this.held = new Set();
    this.fingers = new Map(); // pointer: {stick, x, y, dx, dy}
    this.wheel = { up: 0, until: 0 };
    this.pressed = false;
    pad.addEventListener("pointerdown", (event) => this.down(event));
    pad.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"])
      pad.addEventListener(kind, (event) => this.up(event));
    pad.addEventListener("contextmenu", (event) => event.preventDefault());
    pad.addEventListener("wheel", (event) => this.turn(event), { passive: false });
  }

  /** Take a key; true if it is one of flying. */
  key(event, isDown) {
    if (!KEYS[event.code]) return false;
    if (isDown) this.held.add(event.code);
    else this.held.delete(event.code);
    return true;
  }

  release() {
    this.held.clear();
    this.fingers.clear();
    this.draw();
  }

  read() {
    const wish = { right: 0, forward: 0, up: 0 };
    for (const code of this.held) wish[KEYS[code][0]] += KEYS[code][1];
    for (const { stick, dx, dy } of this.fingers.values()) {
      if (stick === "move") {
        wish.right += dx / REACH;
        wish.forward -= dy / REACH;
      } else wish.up -= dy / REACH;
    }
    if (performance.now() < this.wheel.until) wish.up += this.wheel.up;
    this.readGamepads(wish);
    const over = Math.max(1, Math.hypot(wish.right, wish.forward));
    const up = Math.min(Math.max(wish.up, -1), 1);
    return { right: wish.right / over, forward: wish.forward / over, up };
  }

  readGamepads(wish) {
    let pressed = false;
    for (const gamepad of navigator.getGamepads?.() ?? []) {
      if (!gamepad?.connected) continue;
      const axis = (i) => {
        const value = gamepad.axes[i] ?? 0;
        return Math.abs(value) < DEAD ? 0 : value;
      };
      const button = (i) => gamepad.buttons[i]?.value ?? 0;
      wish.right += axis(0);
      wish.forward -= axis(1);
      wish.up += button(TRIGGERS[1]) - button(TRIGGERS[0]) - axis(3);
      pressed ||= START.some((i) => gamepad.buttons[i]?.pressed);
    }
    if (pressed && !this.pressed) this.acts.go();
    this.pressed = pressed;
  }

  down(event) {
    if (event.target.closest("button")) return;
    event.preventDefault();
    const frame = this.pad.getBoundingClientRect();
    const right = event.clientX > frame.left + 0.6 * frame.width;
    const climbs = event.pointerType === "touch" ? right : event.button === 2;
    const taken = [...this.fingers.values()].map(({ stick }) => stick);
    const stick = climbs ? "climb" : "move";
    if (taken.includes(stick)) return;
    this.pad.setPointerCapture(event.pointerId);
    const place = { x: event.clientX - frame.left, y: event.clientY - frame.top };
    this.fingers.set(event.pointerId, { stick, ...place, dx: 0, dy: 0 });
    this.draw();
  }

  move(event) {
    const finger = this.fingers.get(event.pointerId);
    if (!finger) return;
    const frame = this.pad.getBoundingClientRect();
    const [dx, dy] = [event.clientX - frame.left - finger.x, event.clientY - frame.top - finger.y];
    const share = Math.min(1, REACH / Math.max(Math.hypot(dx, dy), 1));
    Object.assign(finger, { dx: share * dx, dy: share * dy });
    this.draw();
  }

  up(event) {
    if (this.fingers.delete(event.pointerId)) this.draw();
  }

  turn(event) {
    if (event.ctrlKey) return; // the browser's own zoom
    event.preventDefault();
    this.wheel = { up: -Math.sign(event.deltaY), until: performance.now() + NOTCH };
  }

  /** Show the sticks under mouse and fingers. */
  draw() {
    const shown = Object.fromEntries([...this.fingers.values()].map((f) => [f.stick, f]));
    for (const [stick, { box, knob }] of Object.entries(this.drawn)) {
      const finger = shown[stick];
      box.hidden = !finger;
      if (!finger) continue;
      box.style.left = `${finger.x}px`;
      box.style.top = `${finger.y}px`;
      const dx = stick === "climb" ? 0 : finger.dx;
      knob.style.translate = `calc(-50% + ${dx}px) calc(-50% + ${finger.dy}px)`;
    }
  }
}
