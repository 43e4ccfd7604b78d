/**
 * Trails: a path as a band of constant width on the screen. The whole path lies in the geometry,
 * with the time of each point; the shader shows what has been flown by `now`.
 */
import { BufferAttribute, BufferGeometry, Mesh, ShaderMaterial } from "three";

const VERTEX = `
attribute vec3 ahead;
attribute float side;
attribute float when;
uniform vec2 size;
uniform float width;
uniform float height;
uniform float flat_;
varying float vSide;
varying float vWhen;
vec3 ground(vec3 point) { return mix(point, vec3(point.xy, height), flat_); }
void main() {
  mat4 view = projectionMatrix * modelViewMatrix;
  vec4 here = view * vec4(ground(position), 1.0);
  vec4 next = view * vec4(ground(position + ahead), 1.0);
  vec2 along = (next.xy / next.w - here.xy / here.w) * size;
  along = length(along) > 1e-6 ? normalize(along) : vec2(1.0, 0.0);
  here.xy += side * width * vec2(-along.y, along.x) / size * here.w;
  vSide = side;
  vWhen = when;
  gl_Position = here;
}`;

const FRAGMENT = `
uniform vec3 colour;
uniform float now;
uniform float strength;
uniform float fade;
varying float vSide;
varying float vWhen;
void main() {
  if (vWhen > now) discard;
  float age = (now - vWhen) / fade;
  float alpha = strength * mix(1.0, 0.38, smoothstep(0.0, 1.0, age));
  alpha *= 1.0 - smoothstep(0.55, 1.0, abs(vSide));
  gl_FragColor = vec4(colour, alpha);
  #include <colorspace_fragment>
}`;

export const TRAIL_WIDTH = 3.2; // CSS pixels to either side, its soft edge among them

export class Trail {
  /** `path`: [x, y, z, ...] m; `times`: s of each point; `size`: uniform, the picture's in pixels. */
  constructor(path, times, colour, size) {
    this.geometry = band(path, times);
    const fade = Math.max(0.6 * times.at(-1), 0.1); // s in which a trail pales
    this.air = new Mesh(this.geometry, material(colour, size, fade, 0.95, 0));
    this.shadow = new Mesh(this.geometry, material(colour, size, fade, 0.3, 1));
    this.meshes = [this.shadow, this.air];
    for (const mesh of this.meshes) mesh.frustumCulled = false; // its band is wider than its points
    this.shadow.renderOrder = 1;
    this.air.renderOrder = 3;
  }

  /** Of a fight under way: nothing has been flown, all points are at the start. */
  begin(start) {
    const { position, ahead } = this.geometry.attributes;
    for (let i = 0; i < position.count; i += 1) position.setXYZ(i, ...start);
    ahead.array.fill(0);
    this.count = position.count / 2;
    this.grow(0);
  }

  /** Point `index` has been reached: the band goes there, and the last point looks along it. */
  extend(index, place) {
    if (index >= this.count) return;
    const { position, ahead } = this.geometry.attributes;
    const back = 2 * Math.max(index - 1, 0);
    const way = [0, 1, 2].map((axis) => place[axis] - position.array[3 * back + axis]);
    for (const corner of [2 * index, 2 * index + 1]) position.setXYZ(corner, ...place);
    for (const corner of [back, back + 1, 2 * index, 2 * index + 1]) ahead.setXYZ(corner, ...way);
    this.grow(index);
  }

  grow(points) {
    this.geometry.setDrawRange(0, 6 * points);
    for (const name of ["position", "ahead"]) this.geometry.attributes[name].needsUpdate = true;
  }

  show(time, pixelRatio) {
    for (const mesh of this.meshes) {
      mesh.material.uniforms.now.value = time;
      mesh.material.uniforms.width.value = TRAIL_WIDTH * pixelRatio;
    }
  }

  dispose() {
    this.geometry.dispose();
    for (const mesh of this.meshes) mesh.material.dispose();
  }
}

function material(colour, size, fade, strength, flat) {
  const uniforms = {
    size,
    colour: { value: colour },
    now: { value: 0 },
    width: { value: TRAIL_WIDTH },
    strength: { value: strength },
    fade: { value: fade },
    flat_: { value: flat },
    height: { value: 0.006 },
  };
  const options = { transparent: true, depthWrite: false, side: 2 };
  return new ShaderMaterial({
    uniforms,
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    ...options,
  });
}

/** Two corners for each point, one on either side. */
function band(path, times) {
  const count = times.length;
  const corners = { position: 3, ahead: 3, side: 1, when: 1 };
  const geometry = new BufferGeometry();
  const arrays = {};
  for (const [name, width] of Object.entries(corners)) {
    arrays[name] = new Float32Array(2 * count * width);
    geometry.setAttribute(name, new BufferAttribute(arrays[name], width));
  }
  for (let i = 0; i < count; i += 1) {
    const [from, to] = [Math.max(i - 1, 0), Math.min(i + 1, count - 1)];
    for (const [k, side] of [
      [2 * i, 1],
      [2 * i + 1, -1],
    ]) {
      for (let axis = 0; axis < 3; axis += 1) {
        arrays.position[3 * k + axis] = path[3 * i + axis];
        arrays.ahead[3 * k + axis] = path[3 * to + axis] - path[3 * from + axis];
      }
      arrays.side[k] = side;
      arrays.when[k] = times[i];
    }
  }
  const faces = [];
  for (let i = 0; i + 1 < count; i += 1) {
    const k = 2 * i;
    faces.push(k, k + 1, k + 2, k + 1, k + 3, k + 2);
  }
  return geometry.setIndex(faces);
}
