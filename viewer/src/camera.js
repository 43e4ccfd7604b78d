/**
 * Where the camera stands: an overview of the whole fight, or behind a drone that it follows.
 * Both are turned, zoomed and moved by hand. All fights of a page share one view.
 */
import { PerspectiveCamera, Vector3 } from "three";
import { ENLARGEMENT } from "./drone.js";
import { aim } from "./model.js";

const FIELD = 38; // degrees, vertical
const MARGIN = 0.9; // of the picture that an overview may fill
const BORDER = 0.3; // m around what it shows
const CHASE = 0.62; // m behind a drone of true size
const CALM = 0.35; // s to either side, over which the direction of a chase is averaged
const PITCH = [-0.12, 1.5]; // rad: hardly below the floor, never over the top
const ZOOM = [0.12, 6];

const VIEWS = {
  overview: { yaw: -0.87, pitch: 0.46, zoom: 1 }, // the attacker flies from left to right
  follow: { yaw: Math.PI, pitch: 0.3, zoom: 1 }, // yaw: from the direction of flight
};

export class Rig {
  constructor() {
    this.camera = new PerspectiveCamera(FIELD, 1, 0.02, 200);
    this.camera.up.set(0, 0, 1);
    this.followed = null; // a drone, or null: the overview
    this.reset();
  }

  reset() {
    const fresh = ([name, view]) => [name, { ...view, pan: new Vector3() }];
    this.views = Object.fromEntries(Object.entries(VIEWS).map(fresh));
  }

  get view() {
    return this.views[this.followed === null ? "overview" : "follow"];
  }

  orbit(yaw, pitch) {
    this.view.yaw += yaw;
    this.view.pitch = clamp(this.view.pitch + pitch, PITCH);
  }

  zoom(factor) {
    this.view.zoom = clamp(this.view.zoom * factor, ZOOM);
  }

  /** Move the picture by shares of its height, to the right and up. */
  pan(right, up) {
    const { camera, distance } = this;
    const tall = 2 * distance * Math.tan((FIELD * Math.PI) / 360);
    const along = (column) => new Vector3().setFromMatrixColumn(camera.matrixWorld, column);
    this.view.pan.addScaledVector(along(0), -right * tall).addScaledVector(along(1), -up * tall);
  }

  /** Point the camera at `flight` at `time`; `points`: what an overview must show. */
  place(flight, time, points, aspect, trueSize) {
    const { view, camera } = this;
    const now = Math.min(time, flight.end);
    const drone = flight.drones.includes(this.followed) ? this.followed : flight.drones[0];
    const follows = this.followed !== null;
    const turn = follows ? view.yaw + heading(flight, drone, now) : view.yaw;
    const flatness = Math.cos(view.pitch);
    const back = new Vector3(
      Math.cos(turn) * flatness,
      Math.sin(turn) * flatness,
      Math.sin(view.pitch),
    );
    const pivot = new Vector3();
    if (follows) {
      pivot.fromArray(flight.position(drone, now));
      this.distance = CHASE * (trueSize ? 1 : ENLARGEMENT) * view.zoom;
    } else {
      const { pivot: middle, far } = fit(points, back, aspect);
      pivot.copy(middle);
      this.distance = view.zoom * far;
    }
    pivot.add(view.pan);
    camera.position.copy(pivot).addScaledVector(back, this.distance);
    camera.position.z = Math.max(camera.position.z, 0.05);
    camera.near = Math.max(0.01, this.distance / 200);
    camera.aspect = aspect;
    camera.lookAt(pivot);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    return camera;
  }
}

/**
 * The point to look at and how far back to stand, so that all `points` are just inside the picture.
 * For each pair of opposite edges: with r across, d towards the camera and t the tangent of half
 * the angle, r0 + t D >= r + t d and t D - r0 >= t d - r for all points; both are met with equality.
 */
function fit(points, back, aspect) {
  const right = new Vector3(0, 0, 1).cross(back).normalize();
  const up = back.clone().cross(right);
  const tall = MARGIN * Math.tan((FIELD * Math.PI) / 360);
  const axes = [
    [right, tall * aspect],
    [up, tall],
  ].map(([axis, tangent]) => {
    let [above, below] = [-Infinity, -Infinity];
    for (const point of points) {
      const [across, near] = [point.dot(axis), tangent * point.dot(back)];
      above = Math.max(above, across + near + BORDER);
      below = Math.max(below, near - across + BORDER);
    }
    return { axis, middle: (above - below) / 2, far: (above + below) / (2 * tangent) };
  });
  const far = Math.max(...axes.map((axis) => axis.far));
  const pivot = new Vector3();
  for (const { axis, middle } of axes) pivot.addScaledVector(axis, middle);
  const depth = points.reduce((sum, point) => sum + point.dot(back), 0) / points.length;
  return { pivot: pivot.addScaledVector(back, depth), far: far - depth };
}

/** Calm direction over ground, rad, from a drone to what it is after. */
function heading(flight, drone, time) {
  let [x, y] = [0, 0];
  for (let shift = -CALM; shift <= CALM + 1e-9; shift += CALM / 3) {
    const when = Math.min(Math.max(time + shift, 0), flight.end);
    const from = flight.position(drone, when);
    const to = aim(flight, drone, when);
    const length = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
    x += (to[0] - from[0]) / length;
    y += (to[1] - from[1]) / length;
  }
  return Math.atan2(y, x);
}

function clamp(value, [low, high]) {
  return Math.min(Math.max(value, low), high);
}
