/** Mouse and touch on the pictures: turn, zoom and move the view, enlarge a fight by a click. */

const TURN = 0.0075; // rad a pixel
const STILL = 6; // pixels that a click may wander

/** Moves `rig`, calls `onMove()` after that, and `onOpen(index)` for a click on a fight. */
export class Gestures {
  constructor(grid, rig, { onMove, onOpen, mayZoom }) {
    Object.assign(this, { grid, rig, onMove, onOpen, mayZoom });
    this.fingers = new Map();
    grid.addEventListener("pointerdown", (event) => this.down(event));
    grid.addEventListener("pointermove", (event) => this.move(event));
    for (const kind of ["pointerup", "pointercancel"]) {
      grid.addEventListener(kind, (event) => this.up(event));
    }
    grid.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    grid.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  down(event) {
    if (event.target.closest("button")) return;
    this.fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.fingers.size === 1) {
      const index = event.target.closest(".tile")?.dataset.index;
      this.click = {
        index,
        x: event.clientX,
        y: event.clientY,
        moves: event.button === 2 || event.shiftKey,
      };
    } else {
      this.click.index = undefined;
    }
  }

  move(event) {
    const finger = this.fingers.get(event.pointerId);
    if (!finger) return;
    const [dx, dy] = [event.clientX - finger.x, event.clientY - finger.y];
    const wandered = Math.hypot(event.clientX - this.click.x, event.clientY - this.click.y) > STILL;
    if (this.fingers.size === 1 && this.click.index !== undefined && !wandered) return;
    this.click.index = undefined;
    this.grid.setPointerCapture(event.pointerId);
    const before = this.pinch();
    Object.assign(finger, { x: event.clientX, y: event.clientY });
    if (this.fingers.size === 1) this.turn(dx, dy);
    else this.squeeze(before, this.pinch());
    this.onMove();
  }

  up(event) {
    if (!this.fingers.delete(event.pointerId) || event.type !== "pointerup") return;
    if (this.click.index !== undefined && event.button === 0) this.onOpen(Number(this.click.index));
  }

  turn(dx, dy) {
    const tall = this.grid.clientHeight || 1;
    if (this.click.moves) this.rig.pan(dx / tall, -dy / tall);
    else this.rig.orbit(-dx * TURN, dy * TURN);
  }

  squeeze(before, after) {
    const tall = this.grid.clientHeight || 1;
    this.rig.zoom(before.spread / after.spread);
    this.rig.pan((after.x - before.x) / tall, (before.y - after.y) / tall);
  }

  /** Middle and spread of the first two fingers. */
  pinch() {
    const [a, b = a] = [...this.fingers.values()];
    const spread = Math.max(Math.hypot(a.x - b.x, a.y - b.y), 1);
    return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, spread };
  }

  wheel(event) {
    if (!event.ctrlKey && !this.mayZoom()) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    this.rig.zoom(Math.exp(0.0016 * lines * event.deltaY));
    this.onMove();
  }
}
