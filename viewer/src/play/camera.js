/** Where the person looks from: behind the own drone towards what it is after, or from a fixed place. */
import { PerspectiveCamera, Vector3 } from "three";

const FIELD = 55; // degrees, vertical
const CHASE = { back: 2.7, pitch: 0.34, ahead: 1.2, above: 0.4 }; // m, rad, m, m
const FIXED = { back: 11, pitch: 0.5 };
const NARROW = 1.15; // of width to height, under which the fixed camera goes back
const CALM = 4; // 1/s, how fast the view follows the bearing
const QUICKEST = 2.5; // rad/s
const TOO_NEAR = 0.8; // m over ground, within which a bearing says nothing

export class Chase {
  constructor() {
    this.camera = new PerspectiveCamera(FIELD, 1, 0.03, 200);
    this.camera.up.set(0, 0, 1);
    this.fixed = false;
    this.yaw = 0; // rad, the direction of "forward"
  }

  /** Take a start: look from the own drone at its aim; the fixed camera holds all of `places`. */
  begin(own, aim, places) {
    this.yaw = bearing(own, aim) ?? 0;
    this.fixedYaw = this.yaw;
    const mean = (axis) => places.reduce((sum, place) => sum + place[axis] / places.length, 0);
    this.middle = new Vector3(mean(0), mean(1), 1);
  }

  get forward() {
    return this.fixed ? this.fixedYaw : this.yaw;
  }

  /** Follow; `seconds`: since the last picture. */
  follow(own, aim, seconds) {
    const wanted = bearing(own, aim);
    if (wanted === null) return;
    const turn = Math.atan2(Math.sin(wanted - this.yaw), Math.cos(wanted - this.yaw));
    const most = QUICKEST * seconds;
    this.yaw += Math.min(Math.max(turn * (1 - Math.exp(-CALM * seconds)), -most), most);
  }

  place(own, aspect) {
    const { camera } = this;
    const pivot = this.fixed ? this.middle.clone() : new Vector3(...own);
    const { back, pitch } = this.fixed ? FIXED : CHASE;
    const far = this.fixed ? back * Math.max(1, NARROW / aspect) : back;
    const ahead = new Vector3(Math.cos(this.forward), Math.sin(this.forward), 0);
    if (!this.fixed) pivot.addScaledVector(ahead, CHASE.ahead);
    const behind = far * Math.cos(pitch) + (this.fixed ? 0 : CHASE.ahead);
    camera.position.copy(pivot).addScaledVector(ahead, -behind);
    camera.position.z = Math.max(pivot.z + far * Math.sin(pitch), 0.1);
    if (!this.fixed) pivot.z += CHASE.above;
    camera.aspect = aspect;
    camera.lookAt(pivot);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    return camera;
  }

  get distance() {
    return this.fixed ? FIXED.back : CHASE.back + CHASE.ahead;
  }
}

/** Direction over ground from one place to another, rad; null where they are above each other. */
function bearing(from, to) {
  const [x, y] = [to[0] - from[0], to[1] - from[1]];
  return Math.hypot(x, y) < TOO_NEAR ? null : Math.atan2(y, x);
}
