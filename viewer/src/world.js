/** What all fights share: sky, floor and lights, in the colours of the theme. */
import {
  Color,
  DirectionalLight,
  HemisphereLight,
  Mesh,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
} from "three";

const SKY_VERTEX = `
varying vec3 vRay;
void main() {
  vec4 far = inverse(projectionMatrix * viewMatrix) * vec4(position.xy, 1.0, 1.0);
  vRay = far.xyz / far.w - cameraPosition;
  gl_Position = vec4(position.xy, 0.9999999, 1.0);
}`;

const SKY_FRAGMENT = `
uniform vec3 zenith;
uniform vec3 horizon;
varying vec3 vRay;
void main() {
  float height = normalize(vRay).z;
  gl_FragColor = vec4(mix(horizon, zenith, smoothstep(-0.02, 0.55, height)), 1.0);
  #include <colorspace_fragment>
}`;

const FLOOR_VERTEX = `
varying vec2 vPlace;
void main() {
  vPlace = position.xy;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

// Lines every metre that fade where they would flicker, and the border of the arena.
const FLOOR_FRAGMENT = `
uniform vec3 inside;
uniform vec3 outside;
uniform vec3 lines;
uniform vec3 border;
uniform float halfWidth;
varying vec2 vPlace;
float stroke(float from, float blur, float width) {
  return 1.0 - smoothstep(width - blur, width + blur, from);
}
void main() {
  vec2 blur = fwidth(vPlace);
  vec2 from = abs(fract(vPlace - 0.5) - 0.5);
  vec2 width = 0.006 + 0.5 * blur;
  vec2 grid = vec2(stroke(from.x, blur.x, width.x), stroke(from.y, blur.y, width.y));
  grid *= 1.0 - smoothstep(0.12, 0.45, blur);
  float far = max(abs(vPlace.x), abs(vPlace.y)) - halfWidth;
  float soft = max(blur.x, blur.y);
  vec3 colour = mix(inside, outside, smoothstep(-soft, soft, far));
  colour = mix(colour, lines, max(grid.x, grid.y) * (far > 0.0 ? 0.45 : 1.0));
  colour = mix(colour, border, stroke(abs(far), soft, 0.025 + 0.5 * soft));
  float fade = 1.0 - smoothstep(1.5 * halfWidth, 3.6 * halfWidth, length(vPlace));
  gl_FragColor = vec4(colour, fade);
  #include <colorspace_fragment>
}`;

export class World {
  /** `halfWidth`: m from the centre of the arena to its border. */
  constructor(halfWidth) {
    this.scene = new Scene();
    this.colours = {};
    this.sky = shaded(2, SKY_VERTEX, SKY_FRAGMENT, this.uniforms(["zenith", "horizon"]));
    this.sky.material.transparent = false; // drawn before all that is solid, not after it
    this.sky.material.depthTest = false;
    this.sky.renderOrder = -2;
    const floor = this.uniforms(["inside", "outside", "lines", "border"]);
    floor.halfWidth = { value: halfWidth };
    this.floor = shaded(8 * halfWidth, FLOOR_VERTEX, FLOOR_FRAGMENT, floor);
    this.floor.renderOrder = -1;
    this.light = new HemisphereLight("#ffffff", "#8793a3", 1.7);
    this.light.position.set(0, 0, 1);
    const sun = new DirectionalLight("#ffffff", 1.9);
    sun.position.set(3, -5, 9);
    this.scene.add(this.sky, this.floor, this.light, sun);
  }

  /** `colour(name)`: the theme's colour of that name, as CSS spells it. */
  paint(colour) {
    for (const [name, value] of Object.entries(this.colours)) value.set(colour(name));
  }

  uniforms(names) {
    const pairs = names.map((name) => [name, { value: (this.colours[name] = new Color()) }]);
    return Object.fromEntries(pairs);
  }

  dispose() {
    for (const mesh of [this.sky, this.floor]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
    }
  }
}

function shaded(size, vertexShader, fragmentShader, uniforms) {
  const options = { transparent: true, depthWrite: false };
  const material = new ShaderMaterial({ uniforms, vertexShader, fragmentShader, ...options });
  const mesh = new Mesh(new PlaneGeometry(size, size), material);
  mesh.frustumCulled = false;
  return mesh;
}
